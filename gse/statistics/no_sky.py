"""Stretches in which there was no sky to see: cloud, cover, daylight.

A stretch counts as such only where the reference identifier finds no star either, for ten seconds or longer (or in all
of a shorter session), and where something else shows the reason: the Sun, empty panoramas, or stars that faded before
or after. A sensor that fails under a clear, dark sky is not excused. Empty panoramas have a cause of their own: a blind
sensor sends them too.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from gse.instant import NS_PER_S
from gse.site import Site
from gse.station.exclusions import Cause, Exclusion
from gse.station.frame_columns import Columns, InOrder
from gse.station.frame_table import ANSWER_CHECKS, STATUSES
from gse.station.results import AnswerCheck, Status
from gse.station.sky_condition import FEWEST_EXPECTED, FEWEST_OBJECTS, SUN_LIMIT_DEG
from gse.truth.solar_system import sun_altitude_deg

FADED_MAG = 1.0
"""Stars that are fainter by this much than in the clear part of the session are behind cloud."""

MIN_STRETCH_NS = 10 * NS_PER_S
_BRIDGED_NS, _BRIDGED_FRAMES = 3 * NS_PER_S, 1.5
"""Single answers through a gap in the cloud do not end a stretch, nor does the time between two frames."""

_BESIDE_NS = 60 * NS_PER_S
MISSING_SHARE = 0.5
"""Of the share of the expected stars that the clear part of the session shows: a cloud hides the others."""

_CLEAR_PERCENTILE = 90.0


def no_sky(frames: Columns, site: Site) -> tuple[Exclusion, ...]:
    """The stretches of frames (rows of FRAME, any order) without a sky; each with its reason in words."""
    if (np.diff(frames["utc_ns"]) < 0).any():  # a step of the clock
        frames = InOrder(frames, np.argsort(frames["utc_ns"], kind="stable"))
    return tuple(_explained(frames, site))


def _explained(frames: Columns, site: Site) -> Iterator[Exclusion]:
    utc_ns = frames["utc_ns"]
    for first, last in _blind_stretches(frames):
        found = _reason(frames, first, last, site)
        if found is not None:
            yield Exclusion(int(utc_ns[first]), int(utc_ns[last]) + 1, found[1], found[0])


def _blind_stretches(frames: Columns) -> Iterator[tuple[int, int]]:
    """First and last row of each long stretch without an answer of either identifier."""
    seen = (frames["status"] == STATUSES.index(Status.IDENTIFIED)) | (
        frames["answer_check"] != ANSWER_CHECKS.index(AnswerCheck.UNKNOWN)
    )
    blind = np.flatnonzero(~seen)
    utc_ns = frames["utc_ns"]
    step_ns = float(np.median(np.diff(utc_ns))) if len(utc_ns) > 1 else 0.0
    bridged_ns = max(_BRIDGED_NS, _BRIDGED_FRAMES * step_ns)
    for part in np.split(blind, np.flatnonzero(np.diff(utc_ns[blind]) > bridged_ns) + 1):
        if not len(part):
            continue
        long = utc_ns[part[-1]] - utc_ns[part[0]] + _exposure_ns(frames, part[-1]) >= MIN_STRETCH_NS
        if long or len(part) == len(frames):
            yield int(part[0]), int(part[-1])


def _reason(frames: Columns, first: int, last: int, site: Site) -> tuple[Cause, str] | None:
    """Why there was no sky from one row to another; None where no evidence shows it."""
    part, utc_ns = slice(first, last + 1), frames["utc_ns"]
    middle_ns = int(utc_ns[first + (last + 1 - first) // 2])
    duration_s = float(utc_ns[last] - utc_ns[first] + _exposure_ns(frames, last)) / NS_PER_S
    sun_deg = sun_altitude_deg(site, middle_ns)
    if sun_deg > SUN_LIMIT_DEG:
        side = "above" if sun_deg >= 0 else "below"
        return Cause.NO_SKY, f"Sun {abs(sun_deg):.0f} deg {side} the horizon: no dark sky for {duration_s:.0f} s"
    if (frames["status"][part] == STATUSES.index(Status.SENSOR_FAULT)).any():
        return None  # only daylight explains an overexposed detector
    faded_mag = _faded_mag(frames, first, last)
    if faded_mag >= FADED_MAG:
        return Cause.NO_SKY, f"stars {faded_mag:.1f} mag too faint: cloud for {duration_s:.0f} s"
    if _missing(frames, first, last):
        return Cause.NO_SKY, f"less than half of the stars just before or after: cloud for {duration_s:.0f} s"
    most = int(np.percentile(frames["objects"][part], _CLEAR_PERCENTILE))
    if most < FEWEST_OBJECTS:
        return Cause.NO_OBJECTS, _few_objects(most, duration_s, float(np.median(frames["stars_expected"][part])))
    return None


def _few_objects(most: int, duration_s: float, expected: float) -> str:
    """Too few objects for an answer, with what may be the reason."""
    objects = "no object at all" if most == 0 else f"at most {most} object{'' if most == 1 else 's'}"
    stars = f", {expected:.0f} star{' is' if expected == 1 else 's are'} expected" if expected >= 0 else ""
    reason = "lens cap, cover or overcast" if most == 0 else "cloud, a cover, or a sensor that sends too few objects"
    if 0 <= expected < FEWEST_OBJECTS:
        reason = "the field has too few stars to be identified"
    return f"{objects} for {duration_s:.0f} s{stars}: {reason}"


def _exposure_ns(frames: Columns, row: int) -> int:
    """A frame of 60 s shows the sky of a minute."""
    exposure_s = float(frames["exposure_s"][row])
    return round(exposure_s * NS_PER_S) if exposure_s > 0 else 0


def _beside(frames: Columns, first: int, last: int) -> NDArray[np.bool_]:
    """Which frames are in a stretch or near it."""
    utc_ns = frames["utc_ns"]
    return np.asarray((utc_ns >= utc_ns[first] - _BESIDE_NS) & (utc_ns <= utc_ns[last] + _BESIDE_NS))


def _faded_mag(frames: Columns, first: int, last: int) -> float:
    """How much fainter than in the clear the stars were just before or after a stretch; 0 where none were seen.

    Brightness is that of an exposure of 1 s, under a dark sky: the light of twilight is added to that of the stars.
    """
    exposure_s = frames["exposure_s"]
    zero_point = frames["zero_point_mag"] - 2.5 * np.log10(np.where(exposure_s > 0, exposure_s, 1.0))
    known = np.isfinite(zero_point) & ~(frames["sun_altitude_deg"] > SUN_LIMIT_DEG)
    beside = known & _beside(frames, first, last)
    if not beside.any():
        return 0.0
    clear = np.percentile(zero_point[known], _CLEAR_PERCENTILE)
    return float(clear - zero_point[beside].min())


def _missing(frames: Columns, first: int, last: int) -> bool:
    """Whether most of the stars were missing just before or after a stretch, with a dark sky and enough of them."""
    expected = frames["stars_expected"]
    known = (frames["stars_seen"] > 0) & (expected >= FEWEST_EXPECTED) & ~(frames["sun_altitude_deg"] > SUN_LIMIT_DEG)
    beside = known & _beside(frames, first, last)
    if not beside.any():
        return False
    share = frames["stars_seen"] / np.where(known, expected, np.nan)
    least = np.percentile(share[beside], 100 - _CLEAR_PERCENTILE)
    return bool(least < MISSING_SHARE * np.percentile(share[known], _CLEAR_PERCENTILE))
