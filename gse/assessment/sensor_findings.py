"""What is wrong with a sensor's own answers: a line for each of convention, zeros, standstill, delay, bias."""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from gse.assessment.convention_search import ConventionSearch
from gse.assessment.sensor_answers import SensorAnswers
from gse.assessment.sensor_convention import convention_finding, is_wrong
from gse.constants import ARCSEC_PER_RAD, EARTH_RATE_ARCSEC_PER_S
from gse.finding import Finding
from gse.station.attitude_table import ANGLES, QUATERNION
from gse.station.session_data import SessionData

_STANDSTILL_S = 2.0
_FEWEST_ALIKE = 5
"""So many answers in a row that are the same to the last digit, for so long: the sky has turned by 30 arcsec."""
_SIGMAS = 5.0
_PIXEL_SIGMAS = 4.0
"""Stars that stay on their rows keep the error of whole pixels there for the whole session."""
_BLOCKS = 20
_FEWEST = 40


def sensor_findings(
    session: SessionData, own: SensorAnswers | None, search: ConventionSearch | None
) -> tuple[Finding, ...]:
    """A finding for each thing that the sensor's own answers look like; ``own`` are those beside panoramas."""
    stated = session.station.sensor.attitude
    found = [*convention_finding(search, stated), *_zeros(session), *_standstill(session)]
    if own is not None and not is_wrong(search, stated):
        found += _offset(session, own)
    return tuple(found)


def _zeros(session: SessionData) -> Iterator[Finding]:
    answers = session.sensor_attitudes.columns
    zeros = answers["acquired"].copy()
    for name in _names(answers["ra_deg"])[:3]:
        zeros &= np.nan_to_num(answers[name]) == 0
    count = int(zeros.sum())
    if count:
        size = f"{count} of {len(answers)} say RA 0, DE 0 and roll 0, and are called good"
        yield Finding("sensor answers of zeros", size, next_step="look where its firmware answers without an attitude")


def _standstill(session: SessionData) -> Iterator[Finding]:
    """Answers that stay while the sky turns; a sensor that looks at a fixed star field has a mount that says so."""
    answers = session.sensor_attitudes.columns
    acquired = np.flatnonzero(answers["acquired"])
    if len(acquired) < _FEWEST_ALIKE or session.station.mount.inertial is not None:
        return
    changed = np.zeros(len(acquired) - 1, dtype=np.bool_)
    for name in _names(answers["ra_deg"][acquired]):  # a column at a time: the rows of 8 h at 10 Hz are 24 MB
        changed |= np.diff(np.nan_to_num(answers[name][acquired])) != 0
    changes = np.flatnonzero(changed) + 1
    first, last = np.append(0, changes), np.append(changes, len(acquired)) - 1
    time_us = answers["time_us"][acquired].astype(np.int64)
    seconds = (time_us[last] - time_us[first]) / 1e6
    long = (seconds >= _STANDSTILL_S) & (last - first + 1 >= _FEWEST_ALIKE)
    if long.any():
        count, most_s = int((last - first + 1)[long].sum()), float(seconds[long].max())
        yield Finding(
            "sensor answers stand still",
            f"{count} of {len(acquired)} repeat the one before to the last digit, for up to {most_s:.1f} s, while the "
            f"sky turned by {most_s * EARTH_RATE_ARCSEC_PER_S:.0f} arcsec",
            next_step="look whether its firmware still ran",
        )


def _names(ra_deg: NDArray[np.float64]) -> tuple[str, ...]:
    """The columns of the numbers that the sensor sends as the direction."""
    return ANGLES if np.isfinite(ra_deg).any() else QUATERNION


def _offset(session: SessionData, own: SensorAnswers) -> Iterator[Finding]:
    """How the sensor's answers lie off those that follow here from its own panoramas: both saw the same stars."""
    frames = session.frames.columns
    both = np.flatnonzero(np.isfinite(own.d_de_arcsec) & np.isfinite(frames["d_de_arcsec"]))
    if len(both) < _FEWEST:
        return
    ra, ra_error = _typical(frames, both, own.d_ra_cosde_arcsec[both] - frames["d_ra_cosde_arcsec"][both])
    de, de_error = _typical(frames, both, own.d_de_arcsec[both] - frames["d_de_arcsec"][both])
    pixels_arcsec = session.station.sensor.camera().pixel_rad * ARCSEC_PER_RAD / math.sqrt(12)
    of_fix = pixels_arcsec / math.sqrt(max(float(np.median(frames["matched"][both])), 1.0))
    if math.hypot(ra, de) <= max(_PIXEL_SIGMAS * of_fix, _SIGMAS * math.hypot(ra_error, de_error)):
        return
    where = f"{_angle(ra)} east and {_angle(de)} north of those that follow from its own panoramas"
    cos_de = math.cos(math.radians(float(np.nanmedian(frames["de_true_deg"][both]))))
    if abs(de) > max(_SIGMAS * de_error, 0.1 * abs(ra)) or cos_de < 0.05:
        yield Finding("sensor bias", f"its answers lie {where}", next_step="compare its camera model and catalogue")
        return
    late_s = -ra / (EARTH_RATE_ARCSEC_PER_S * cos_de)
    side = "before" if late_s > 0 else "after"
    yield Finding(
        "sensor delay",
        f"its answers lie {where}, as those of {abs(late_s):.2f} s {side} the exposure that they are marked with",
        equals=("a bias of its own in RA",),
        next_step="look which exposure its firmware names in ATTITUDE",
    )


def _typical(frames: NDArray[np.void], rows: NDArray[np.int64], values: NDArray[np.float64]) -> tuple[float, float]:
    """Median of values (K,), and its error, by medians of blocks of time."""
    order = np.argsort(frames["utc_ns"][rows], kind="stable")
    medians = np.array([np.median(values[block]) for block in np.array_split(order, _BLOCKS)])
    return float(np.median(medians)), float(medians.std(ddof=1)) / math.sqrt(_BLOCKS)


def _angle(arcsec: float) -> str:
    return f"{arcsec:+.1f} arcsec" if abs(arcsec) < 3600 else f"{arcsec / 3600:+.3f} deg"
