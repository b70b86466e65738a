"""Stars out of place: objects too far from where the camera of the station file has their stars."""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from gse.station.frame_columns import Columns
from gse.station.session_data import SessionData
from gse.station.sky_condition import FEWEST_UNMATCHED
from gse.statistics.counted_frames import CountedFrames
from gse.values.finding import Finding

_LOW_DEG = 10.0
"""At an altitude of 10 deg air lifts stars by 5 arcmin, at 30 deg by 1.7: a field holds both."""
_FEWEST_ANSWERED = 5
"""One picture may show the edge of a cloud, a bright Moon or a town."""
STARS_FALL_OUT = ("distortion", "focal length", "principal point", "pixel pitch")
"""Causes that may move stars by more than they are matched within; beside them all others are guesses then."""
FALLEN_OUT_SHARE = 0.3
"""Least share of the matched stars; satellites, noise or a few hot pixels make fewer."""


def stars_fall_out(frames: Columns, used: NDArray[np.bool_]) -> bool:
    """Whether many stars of the used frames (rows of FRAME) lie too far off to be matched.

    As these change, so do the errors.
    """
    unmatched, matched = (float(np.median(frames[name][used])) for name in ("false_objects", "matched"))
    return unmatched >= max(FEWEST_UNMATCHED, FALLEN_OUT_SHARE * matched)


def most_unmatched(session: SessionData, counted: CountedFrames) -> Iterator[Finding]:
    """What leaves too few good answers where most objects are none of the stars that ought to be there."""
    frames, known = session.frames.columns, counted.answered & ~counted.excluded
    if known.sum() < _FEWEST_ANSWERED or not stars_fall_out(frames, known):
        return
    good = (counted.answered & ~counted.false)[counted.expected].mean()
    if good >= session.station.limits.availability:
        return
    unmatched, matched, expected = (
        float(np.median(frames[name][known])) for name in ("false_objects", "matched", "stars_expected")
    )
    if unmatched > matched and expected >= matched + FEWEST_UNMATCHED:
        yield _out_of_place(
            session,
            f"{unmatched:.0f} objects as bright as stars of the catalogue are none of them, {matched:.0f} are, and "
            f"{expected:.0f} stars are expected",
        )


def _out_of_place(session: SessionData, seen: str) -> Finding:
    """Why stars do not lie where they are looked for: a field that reaches to the horizon, or another camera."""
    station, fitted = session.station, session.alignment
    mount = fitted.mount if fitted else station.mount
    lowest_deg = mount.altitude_deg - math.degrees(station.sensor.camera().diagonal_rad) / 2
    if mount.inertial is None and lowest_deg < _LOW_DEG:
        return Finding(
            "field near the horizon",
            f"{seen}: it reaches down to an altitude of {lowest_deg:.0f} deg, where air lifts stars by more than they "
            "are matched within",
            ("a camera that is not as stated",),
            "point the sensor higher, and repeat the session",
        )
    return Finding(
        "camera",
        f"{seen}: they do not lie where the camera of the station file has them",
        ("a distortion of the lens", "stars out of focus", "false objects of the sensor"),
        "fit the camera: gse calibrate SESSION --write FILE; look at the panoramas: gse view SESSION",
    )
