"""Diagnosis: what a session's errors look like, named: mount, clock, focal length, distortion, mirror.

A finding is a hint for the operator and decides nothing; the verdict goes by the limits alone.
"""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from gse.assessment.counted_frames import CountedFrames
from gse.assessment.gross_causes import RawAttitudes, gross_cause
from gse.assessment.statistics import Statistics
from gse.assessment.time_tags import time_tag_faults
from gse.camera import Camera
from gse.constants import ARCSEC_PER_RAD, EARTH_RATE_ARCSEC_PER_S
from gse.finding import Finding
from gse.station.event_kinds import StationKind
from gse.station.frame_table import ANSWER_CHECKS, STATUSES
from gse.station.results import AnswerCheck, Status
from gse.station.session_data import SessionData

_SIGMAS = 4.0
_BIAS_SHARE_OF_LIMIT = 1 / 6
_DRIFT_ARCSEC = 4.0
"""Over a session: whole pixels alone can make 3 arcsec of slope out of a few stars."""
_MIN_DRIFT_S = 600.0
"""In less time whole pixels alone make a slope: a star takes 3 s from one to the next."""
_SENSOR_DRIFT_PPM = 100.0
"""A crystal keeps within 50 ppm over its whole temperature range."""
_SCALE = 3e-4
"""0.03 % of the focal length puts stars at the edge of 14 deg by 8 arcsec."""
_DISTORTION_PX = 0.3
_MIN_MATCHES = 200
_MAX_MATCHES = 50_000
"""More of a night do not make it better: it is the number of stars that does."""
_CELLS = 32


def findings(session: SessionData, stats: Statistics) -> tuple[Finding, ...]:
    """The causes of what a session shows, a gross one alone: under it all others are guesses."""
    gross = gross_finding(session, stats.counted)
    lines = (
        *_events(session),
        *_nothing_identified(session),
        *(() if gross else _bias(session, stats)),
        *(() if gross else _drift(session, stats)),
        *(() if gross else _optics(session)),
        *_unlike(stats),
    )
    return (*((gross,) if gross else ()), *(Finding(*line.split(": ", 1)) for line in lines))


def gross_finding(session: SessionData, counted: CountedFrames) -> Finding | None:
    """The mistake of the set-up, against the stated angles of the mount, whether or not a fit replaced them."""
    mount, orientation = session.station.mount, session.earth_orientation
    frames = session.frames.columns
    checked_false = frames["answer_check"] == ANSWER_CHECKS.index(AnswerCheck.FALSE)
    rows = np.flatnonzero(counted.answered & ~checked_false & ~counted.excluded)
    if orientation is None or not mount.stated or not len(rows):
        return None
    raw = RawAttitudes.of(frames[rows], session.station.sensor.camera())
    return gross_cause(raw, session.station.site, mount, orientation)


def _events(session: SessionData) -> Iterator[str]:
    kinds = {event.kind: event for event in session.events}
    named = (
        (StationKind.CLOCK_STEP, "clock step"),
        (StationKind.MIRRORED, "mirrored image"),
        (StationKind.NO_STATION, "station file"),
        (StationKind.SEQUENCE_CHAOS, "sequence numbers"),
        (StationKind.FROZEN, "frozen sensor"),
    )
    for kind, words in named:
        if kind in kinds:
            yield f"{words}: {kinds[kind].text}"


def _nothing_identified(session: SessionData) -> Iterator[str]:
    status = session.frames.columns["status"]
    no_match = int((status == STATUSES.index(Status.NO_MATCH)).sum())
    if no_match and not (status == STATUSES.index(Status.IDENTIFIED)).any():
        yield (
            f"not one of {no_match} panoramas with enough objects was identified: a focal length that is wrong by more "
            "than 0.2 %, or a mirrored image, does that; gse calibrate finds either"
        )


def _bias(session: SessionData, stats: Statistics) -> Iterator[str]:
    """A steady error: of the mount, or of the clock where it is a turn about the pole."""
    ra, de, roll = (stats.onboard.axes[axis] for axis in ("d_ra_cosde", "d_de", "d_roll"))
    least = _BIAS_SHARE_OF_LIMIT * min(session.station.limits.d_ra_cosde_arcsec, session.station.limits.d_de_arcsec)
    size = math.hypot(ra.bias_arcsec, de.bias_arcsec)
    error = math.hypot(ra.bias_error_arcsec, de.bias_error_arcsec) / 2  # 95 % to 1 sigma
    if not size > max(least, _SIGMAS * error):
        return
    where = f"{_shift(ra.bias_arcsec)} east and {_shift(de.bias_arcsec)} north of where the mount should look"
    de_rad = math.radians(float(np.nanmedian(session.frames.columns["de_true_deg"])))
    about_pole = ra.bias_arcsec / math.cos(de_rad)  # keeps position angles, so that it turns the roll the other way
    no_turn = abs(de.bias_arcsec) > max(_SIGMAS * de.bias_error_arcsec, 0.1 * size)
    other_roll = abs(roll.bias_arcsec + about_pole * math.sin(de_rad)) > max(2 * roll.bias_error_arcsec, 0.2 * size)
    if no_turn or other_roll:
        yield f"mount: the boresight lies {where}; gse align fits the mount"
        return
    yield (
        f"clock offset or mount: the boresight lies {where}, as if the clock were "
        f"{abs(about_pole) / EARTH_RATE_ARCSEC_PER_S:.2f} s {'slow' if about_pole > 0 else 'fast'}; only a clock that "
        "is measured otherwise tells the two apart"
    )


def _shift(arcsec: float) -> str:
    return f"{arcsec:+.1f} arcsec" if abs(arcsec) < 3600 else f"{arcsec / 3600:+.3f} deg"


def _drift(session: SessionData, stats: Statistics) -> Iterator[str]:
    if stats.duration_s > _MIN_DRIFT_S:
        yield from _drift_of_boresight(stats)
    yield from time_tag_faults(session.frames.columns, session.events)
    ppm = stats.clock.sensor_drift_ppm
    if abs(ppm) > max(_SENSOR_DRIFT_PPM, 3 * stats.clock.sensor_drift_error_ppm):
        yield f"sensor clock drift: it runs {abs(ppm):.0f} ppm {'slow' if ppm > 0 else 'fast'} against the host's"


def _drift_of_boresight(stats: Statistics) -> Iterator[str]:
    ra, de = (stats.onboard.axes[axis] for axis in ("d_ra_cosde", "d_de"))
    moves = [
        abs(axis.drift_arcsec_per_h) * stats.duration_s / 3600 > _DRIFT_ARCSEC
        and axis.drift_low_arcsec_per_h * axis.drift_high_arcsec_per_h > 0
        for axis in (ra, de)
    ]
    rate = stats.onboard.earth_rate.measured_arcsec_per_s / EARTH_RATE_ARCSEC_PER_S - 1
    if moves[1]:
        yield f"the mount moves: dDE drifts by {de.drift_arcsec_per_h:+.1f} arcsec/h"
    elif moves[0] and math.isfinite(rate):
        yield (
            f"clock drift: dRA* drifts by {ra.drift_arcsec_per_h:+.1f} arcsec/h, as if the clock ran "
            f"{abs(rate) * 1e6:.0f} ppm {'slow' if rate > 0 else 'fast'}"
        )


def _unlike(stats: Statistics) -> Iterator[str]:
    own = stats.equivalence
    if own is None or own.same:
        return
    yield (
        f"the sensor's own answers are not the onboard-equivalent ones: of {own.answers}, {own.only_sensor} were "
        f"answered only by the sensor and {own.only_station} only here, the others lie up to "
        f"{own.separation_arcsec.max:.1f} arcsec apart"
    )


def _optics(session: SessionData) -> Iterator[str]:
    matches = session.frames.matches
    if len(matches) < _MIN_MATCHES:
        return
    matches = matches[:: max(len(matches) // _MAX_MATCHES, 1)]
    camera = session.station.sensor.camera()
    scale, scale_sigma = _radial(camera, matches, (1,))
    cubic, cubic_sigma = _radial(camera, matches, (1, 3))
    edge_px = abs(cubic) * camera.columns / 2
    if edge_px > _DISTORTION_PX and abs(cubic) > _SIGMAS * cubic_sigma:
        yield (
            f"distortion: stars at the edge lie {edge_px:.1f} px too far {'out' if cubic > 0 else 'in'} "
            "beyond what the focal length explains; gse calibrate fits it"
        )
        return
    if abs(scale) > max(_SCALE, _SIGMAS * scale_sigma):
        off = "short" if scale > 0 else "long"
        yield f"focal length: it is about {abs(scale):.2%} too {off}; gse calibrate fits it"


def _radial(camera: Camera, matches: NDArray[np.void], powers: tuple[int, ...]) -> tuple[float, float]:
    """Residuals along the radius by least squares on powers of it: the last coefficient, as a share of the half
    width at the edge, with its standard deviation.

    Errors in one of 32 x 32 cells of the detector are taken as dependent (the sandwich of Liang & Zeger 1986): one star
    crosses it, on the same side of its pixels.
    """
    offset_px = np.column_stack([matches["x_px"], matches["y_px"]]) - np.array(camera.principal_point_px)
    residual_px = np.column_stack([matches["residual_x_arcsec"], matches["residual_y_arcsec"]]).astype(np.float64) / (
        camera.pixel_rad * ARCSEC_PER_RAD
    )
    if camera.mirrored:
        residual_px[:, 0] = -residual_px[:, 0]
    length = np.hypot(residual_px[:, 0], residual_px[:, 1])
    good = length <= 5 * np.median(length)
    offset_px, residual_px = offset_px[good], residual_px[good]
    s = np.hypot(offset_px[:, 0], offset_px[:, 1]) / (camera.columns / 2)
    design = np.stack([offset_px * (s ** (power - 1))[:, None] for power in powers], axis=2)
    inverse = np.linalg.inv(np.einsum("nki,nkj->ij", design, design))
    fit = inverse @ np.einsum("nki,nk->i", design, residual_px)
    scores = np.einsum("nki,nk->ni", design, residual_px - design @ fit)
    cell = np.floor(np.column_stack([matches["x_px"], matches["y_px"]])[good] / (camera.columns / _CELLS)).astype(int)
    _, cluster = np.unique(cell[:, 0] * 10_000 + cell[:, 1], return_inverse=True)
    summed = np.stack([np.bincount(cluster, weights=score) for score in scores.T], axis=1)
    covariance = inverse @ (summed.T @ summed) @ inverse
    return float(fit[-1]), math.sqrt(float(covariance[-1, -1]))
