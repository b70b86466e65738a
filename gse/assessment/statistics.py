"""Figures of a session: what an assessor asks of accuracy, identification, time and clock.

Accuracy is taken over the frames that were identified, not called false, and not left out by name; false answers are
counted, not averaged in.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv

from gse.assessment.axis_statistics import AxisStatistics, axis_statistics
from gse.assessment.clock_health import ClockHealth, clock_health
from gse.assessment.onboard_equivalence import OnboardEquivalence, equivalence
from gse.assessment.percentiles import Percentiles, percentiles
from gse.constants import EARTH_RATE_ARCSEC_PER_S
from gse.station.exclusions import Exclusion, excluded
from gse.station.frame_table import ANSWER_CHECKS, STATUSES
from gse.station.results import AnswerCheck, Status
from gse.station.session_data import SessionData

AXES = ("d_ra_cosde", "d_de", "d_roll", "cross_x", "cross_y")
OUTLIER_ARCSEC = 1800.0
"""An answer this far from the median of all is false, whatever the judge has seen: half a degree."""

_MAX_DE_FOR_RA_DEG = 89.9
_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class Proportion:
    """A share with its 95 % Clopper-Pearson bounds (two-sided); NaN of nothing."""

    count: int
    of: int
    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class EarthRate:
    """Rate of the boresight about the pole as measured, against that of the Earth, in arcsec/s.

    Measured as the Earth's rate plus the robust drift of dRA* / cos DE, with the half-width of its 95 % interval.
    """

    measured_arcsec_per_s: float
    error_arcsec_per_s: float
    expected_arcsec_per_s: float


@dataclass(frozen=True, slots=True)
class Statistics:
    """All figures of a session.

    ``frames_expected`` are those received and those that the sequence numbers miss. ``available`` is identified and
    not false, of the expected; ``false_answers`` is of the frames that were answered, with a one-sided 95 % upper
    bound. ``outage_s`` is the longest time between answers. ``equivalence`` is None where the sensor sent no answers of
    its own.
    """

    frames: int
    duration_s: float
    frames_expected: int
    statuses: dict[str, int]
    judged: dict[str, int]
    available: Proportion
    false_answers: Proportion
    false_upper_95: float
    axes: dict[str, AxisStatistics]
    mean_abs_d_ra_deg: float
    mean_abs_d_de_deg: float
    earth_rate: EarthRate
    identification_ms: Percentiles
    arrival_ms: Percentiles
    acquisition_s: float
    outage_s: float
    clock: ClockHealth
    equivalence: OnboardEquivalence | None
    excluded: tuple[tuple[Exclusion, int], ...]


def statistics(session: SessionData) -> Statistics:
    """The figures of a night, without what its events and its operator leave out.

    Columns are taken one at a time: the rows of eight hours at 10 Hz are 40 MB, and a selection of them is a copy.
    """
    frames = session.frames.columns
    named = session.exclusions()
    kept = ~excluded(frames["utc_ns"], named)
    status, judged = frames["status"][kept], frames["judge"][kept]
    answered = status == STATUSES.index(Status.IDENTIFIED)
    false = answered & _false(judged, frames["cross_x_arcsec"][kept], frames["cross_y_arcsec"][kept])
    used = np.flatnonzero(kept)[answered & ~false & np.isfinite(frames["d_de_arcsec"][kept])]
    used = used[np.argsort(frames["utc_ns"][used], kind="stable")]  # a step of the clock may turn the order
    used_ns = frames["utc_ns"][used]
    axes = {axis: axis_statistics(used_ns, frames[f"{axis}_arcsec"][used]) for axis in AXES}
    de_true_deg = frames["de_true_deg"][used]
    expected = len(status) + session.link.frames_lost
    n_answered, n_false = int(answered.sum()), int(false.sum())
    return Statistics(
        frames=len(frames),
        duration_s=float(np.ptp(frames["utc_ns"])) / 1e9 if len(frames) else 0.0,
        frames_expected=expected,
        statuses={name.value: int((status == place).sum()) for place, name in enumerate(STATUSES)},
        judged={name.value: int((judged == place).sum()) for place, name in enumerate(ANSWER_CHECKS)},
        available=proportion(n_answered - n_false, expected),
        false_answers=proportion(n_false, n_answered),
        false_upper_95=_upper(n_false, n_answered, 0.95) if n_answered else _NAN,
        axes=axes,
        mean_abs_d_ra_deg=_mean_abs_d_ra_deg(frames["d_ra_cosde_arcsec"][used], de_true_deg),
        mean_abs_d_de_deg=axes["d_de"].mean_abs_arcsec / 3600,
        earth_rate=_earth_rate(de_true_deg, axes["d_ra_cosde"]),
        identification_ms=percentiles(frames["elapsed_us"] / 1e3),
        arrival_ms=percentiles((frames["host_utc_ns"] - frames["utc_ns"])[frames["host_utc_ns"] > 0] / 1e6),
        acquisition_s=_acquisition_s(frames["utc_ns"][kept], answered & ~false),
        outage_s=_outage_s(frames["utc_ns"][kept], answered & ~false),
        clock=clock_health(session.clock, session.events, frames, stated_error_s=session.clock_error_s),
        equivalence=equivalence(frames, np.flatnonzero(kept), [answer for _, answer in session.sensor_attitudes]),
        excluded=tuple((item, int(excluded(frames["utc_ns"], (item,)).sum())) for item in named),
    )


def false_answers(frames: NDArray[np.void]) -> NDArray[np.bool_]:
    """Which frames (M,) were answered falsely: the judge says so, or all other answers are far away."""
    answered = frames["status"] == STATUSES.index(Status.IDENTIFIED)
    return np.asarray(answered & _false(frames["judge"], frames["cross_x_arcsec"], frames["cross_y_arcsec"]))


def _false(
    judged: NDArray[np.uint8], cross_x_arcsec: NDArray[np.float64], cross_y_arcsec: NDArray[np.float64]
) -> NDArray[np.bool_]:
    return np.asarray(
        (judged == ANSWER_CHECKS.index(AnswerCheck.FALSE)) | _outlier(cross_x_arcsec, cross_y_arcsec), dtype=bool
    )


def proportion(count: int, of: int) -> Proportion:
    """A share with exact (Clopper-Pearson) bounds."""
    if of == 0:
        return Proportion(0, 0, _NAN, _NAN, _NAN)
    low = float(betaincinv(count, of - count + 1, 0.025)) if count else 0.0
    return Proportion(count, of, count / of, low, _upper(count, of, 0.975))


def _upper(count: int, of: int, confidence: float) -> float:
    """The one-sided upper bound of a share, by Clopper & Pearson."""
    return float(betaincinv(count + 1, of - count, confidence)) if count < of else 1.0


def _outlier(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Answers far from the median of all: a wrong mount moves all answers alike, a false answer only itself."""
    known = np.isfinite(x)
    if not known.any():
        return np.zeros(len(x), dtype=bool)
    distance = np.hypot(x - np.median(x[known]), y - np.median(y[known]))
    return np.asarray(distance > OUTLIER_ARCSEC, dtype=bool)  # NaN is not


def _mean_abs_d_ra_deg(d_ra_cosde_arcsec: NDArray[np.float64], de_true_deg: NDArray[np.float64]) -> float:
    """Mean |dRA| (not times cos DE), as in table 4-1 of [S]; NaN too near the pole, where RA means nothing."""
    if len(de_true_deg) == 0 or np.abs(de_true_deg).max() > _MAX_DE_FOR_RA_DEG:
        return _NAN
    d_ra_arcsec = d_ra_cosde_arcsec / np.cos(np.radians(de_true_deg))
    return float(np.abs(d_ra_arcsec).mean()) / 3600


def _earth_rate(de_true_deg: NDArray[np.float64], d_ra_cosde: AxisStatistics) -> EarthRate:
    if len(de_true_deg) == 0 or abs(de_true_deg[0]) > _MAX_DE_FOR_RA_DEG:
        return EarthRate(_NAN, _NAN, EARTH_RATE_ARCSEC_PER_S)
    per_hour = math.cos(math.radians(float(np.mean(de_true_deg)))) * 3600
    half_width = (d_ra_cosde.drift_high_arcsec_per_h - d_ra_cosde.drift_low_arcsec_per_h) / 2
    measured = EARTH_RATE_ARCSEC_PER_S + d_ra_cosde.drift_arcsec_per_h / per_hour
    return EarthRate(measured, half_width / per_hour, EARTH_RATE_ARCSEC_PER_S)


def _acquisition_s(utc_ns: NDArray[np.int64], good: NDArray[np.bool_]) -> float:
    """From the first panorama to the first good answer."""
    return float(utc_ns[good][0] - utc_ns[0]) / 1e9 if good.any() else _NAN


def _outage_s(utc_ns: NDArray[np.int64], good: NDArray[np.bool_]) -> float:
    answers = utc_ns[good]
    return float(np.diff(answers).max()) / 1e9 if len(answers) > 1 else _NAN
