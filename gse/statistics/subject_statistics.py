"""Statistics of one subject on trial: its errors by axis, its answers, its times.

Accuracy is taken over the frames that were answered, not falsely, and that are not excluded
(gse.statistics.counted_frames). False answers are counted, not averaged in.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from gse.station.frame_columns import Columns
from gse.station.results import Subject
from gse.statistics.availability import Outages, available_share
from gse.statistics.axis_statistics import AxisStatistics, axis_statistics
from gse.statistics.counted_frames import CountedFrames
from gse.statistics.decision import Figure, Share, share_of
from gse.statistics.sampling import Percentiles, percentiles, quantile_bounds
from gse.values.axis import ALL_AXES, CROSS_X, CROSS_Y, D_DE, D_RA_COSDE, OF_SENSOR, Axis
from gse.values.constants import EARTH_RATE_ARCSEC_PER_S
from gse.values.instant import NS_PER_S
from gse.values.limits import Limits
from gse.values.matrices import pinv, product

# Time to first fix: from a cold start to the first good answer, as a list over the starts of a session.
#
# A start is the first panorama, or the first one after the sensor's frame numbers began anew: a reset, or power that
# came back. ECSS-E-ST-60-20C Rev.2 asks for the acquisition time as a distribution.


def first_fixes_s(
    utc_ns: NDArray[np.int64], frame_no: NDArray[np.uint32], good: NDArray[np.bool_]
) -> tuple[float, ...]:
    """Seconds from the first panorama (M,) of each start to its first good answer; NaN where none came.

    ``frame_no`` (M,) are the sensor's own numbers, ``good`` (M,) tells answers that are neither absent nor false.
    """
    if len(utc_ns) == 0:
        return ()
    numbers = frame_no.astype(np.int64)
    starts = np.flatnonzero(np.diff(numbers, prepend=numbers[0]) < 0)
    fixes = []
    for rows in np.split(np.arange(len(utc_ns)), starts):
        first = rows[good[rows]][:1]
        fixes.append(float(utc_ns[first[0]] - utc_ns[rows[0]]) / 1e9 if len(first) else float("nan"))
    return tuple(fixes)


# Thermo-elastic error: how the attitude error follows the sensor's temperature, in arcsec per kelvin.
#
# ECSS-E-ST-60-20C Rev.2 counts it among the bias and low-frequency errors. A straight drift in time is fitted beside
# the temperature, so that a mount that sinks is not taken for it; where the temperature itself only drifts, the two
# cannot be told apart and the interval says so. The interval respects autocorrelation: block means, Student's t.

BLOCKS = 32
"""Means of so many equal parts of the session are fitted; their residuals' correlation widens the interval."""
MIN_FRAMES = 60
RESOLUTION_K = 0.1
"""A temperature that moved by less than five of these tells nothing."""
_STEPS = 5


@dataclass(frozen=True, slots=True)
class ThermalError:
    """Arcsec per kelvin of one axis with its 95 % interval, and the range of the temperature in K."""

    arcsec_per_k: float
    low_arcsec_per_k: float
    high_arcsec_per_k: float
    range_k: float


def thermal_error(
    utc_ns: NDArray[np.int64],
    error_arcsec: NDArray[np.float64],
    temperature_c: NDArray[np.floating],
    *,
    resolution_k: float = RESOLUTION_K,
) -> ThermalError | None:
    """Of errors (M,) at instants (M,) and temperatures (M,); None where the temperature did not move, or is unknown."""
    known = np.isfinite(temperature_c) & np.isfinite(error_arcsec)
    if known.sum() < MIN_FRAMES:
        return None
    parts = np.array_split(np.flatnonzero(known), min(BLOCKS, int(known.sum()) // 5))
    error = np.array([float(np.mean(error_arcsec[rows])) for rows in parts])
    temperature = np.array([float(np.mean(temperature_c[rows].astype(np.float64))) for rows in parts])
    time_s = np.array([float(np.mean((utc_ns[rows] - utc_ns[0]) / 1e9)) for rows in parts])
    if np.ptp(temperature) < _STEPS * resolution_k or np.ptp(time_s) == 0:
        return None
    time = (time_s - time_s.mean()) / np.ptp(time_s)
    design = np.column_stack([np.ones_like(time), time, temperature - temperature.mean()])
    inverse = pinv(product(design.T, design))
    fit = product(inverse, product(design.T, error))
    left = error - product(design, fit)
    widening = _widening(left)
    freedom = max(len(error) / widening - design.shape[1], 1.0)
    variance = float(product(left, left)) / (len(error) - design.shape[1]) * widening * float(inverse[2, 2])
    half = float(stdtrit(freedom, 0.975)) * math.sqrt(variance)
    slope = float(fit[2])
    return ThermalError(slope, slope - half, slope + half, float(np.ptp(temperature)))


def _widening(left: NDArray[np.float64]) -> float:
    """By how much correlation of first order makes the variance of a slow regressor's coefficient larger."""
    total = float(product(left, left))
    share = float(product(left[1:], left[:-1])) / total if total > 0 else 0.0
    # The residuals of a fit show less correlation than the errors have (Kendall 1954).
    share = min(max(share + (1 + 4 * share) / len(left), 0.0), 0.9)
    return (1 + share) / (1 - share)


_TURN_ARCSEC = 360 * 3600.0
_MAX_DE_FOR_RA_DEG = 89.9
_NAN = float("nan")
_ROWS_AT_ONCE = 1 << 14
"""Cells of more answers than these are large: those of a day at 10 Hz have 100 MB."""


@dataclass(frozen=True, slots=True)
class EarthRate:
    """Rate of the boresight about the pole as measured, against that of the Earth, in arcsec/s.

    Measured as the Earth's rate plus the robust drift of dRA* / cos DE, with the half-width of its 95 % interval.
    """

    measured_arcsec_per_s: float
    error_arcsec_per_s: float
    expected_arcsec_per_s: float


NO_EARTH_RATE = EarthRate(_NAN, _NAN, _NAN)
"""Before a star simulator, and in orbit."""


@dataclass(frozen=True, slots=True)
class SubjectStatistics:
    """All statistics of one subject's answers.

    ``available`` is answered and not false, of the expected frames; ``outages`` are the long ones of its absences.
    ``false_answers`` is of the judged answers, on as many ``star_fields`` of the sky. ``half_cone_95`` is the half-cone
    that holds 95 % of the boresights. ``time_ms`` is the identification time of this host for the onboard subject, and
    where ``time_is_stated`` the processing time that the sensor or an external identifier states by its own clock;
    ``slow`` the share of frames over the limit of time. ``outage_s`` is the longest time between good answers.
    ``arrival_ms`` is from mid-exposure to the arrival of its frame at the host: of the panorama for the onboard
    subject, of ATTITUDE for the sensor. ``thermal`` has an axis as key, None where the temperature tells nothing;
    ``first_fixes_s`` has an entry for each start of the sensor. ``at_confidence`` has an axis of the sensor as key: the
    absolute error that ``limits.confidence`` of the frames keep; it is empty without such a limit. ``output_rate_hz``
    is of the subject's frames, right or wrong, without the gaps between them.
    """

    subject: Subject
    available: Share
    outages: Outages
    false_answers: Share
    star_fields: int
    axes: dict[str, AxisStatistics]
    half_cone_95: AxisStatistics
    mean_abs_d_ra_deg: float
    mean_abs_d_de_deg: float
    earth_rate: EarthRate
    time_ms: Percentiles
    time_is_stated: bool
    slow: Share
    arrival_ms: Percentiles
    acquisition_s: float
    outage_s: float
    thermal: dict[str, ThermalError | None]
    first_fixes_s: tuple[float, ...]
    at_confidence: dict[str, Figure]
    output_rate_hz: float


@dataclass(frozen=True, slots=True, eq=False)
class SubjectAnswers:
    """One subject's answers as columns (M,) in the order of the frame table, whatever their source.

    ``counted`` says which of them count. ``time_is_stated`` as in SubjectStatistics.
    """

    columns: dict[str, NDArray[np.float64]]
    counted: CountedFrames
    time_ms: NDArray[np.float64]
    arrival_ms: NDArray[np.float64]
    time_is_stated: bool


def subject_statistics(
    subject: Subject,
    frames: Columns,
    answers: SubjectAnswers,
    limits: Limits,
    field_rad: float,
) -> SubjectStatistics:
    """Columns are taken one at a time: a selection of the rows of eight hours at 10 Hz is a copy of 40 MB."""
    counted = answers.counted
    used = np.flatnonzero(counted.used)
    used = used[np.argsort(frames["utc_ns"][used], kind="stable")]  # a step of the clock may turn the order
    used_ns = frames["utc_ns"][used]

    def errors(axis: Axis) -> NDArray[np.float64]:
        selected: NDArray[np.float64] = answers.columns[axis.column][used]
        return about_circular_mean(selected) if axis.wraps else selected

    axes = {axis.key: _axis(used_ns, errors(axis)) for axis in ALL_AXES}
    good = counted.answered & ~counted.false
    timed_frames = ~counted.excluded
    kept_ns = frames["utc_ns"][timed_frames]
    never_came = counted.never_came[counted.expected]
    available, outages = available_share(good[counted.expected], missing=never_came, unplaced=counted.unplaced)
    timed = answers.time_ms[np.isfinite(answers.time_ms)]
    return SubjectStatistics(
        subject=subject,
        available=available,
        outages=outages,
        false_answers=_share(counted.false[counted.judged]),
        star_fields=_star_fields(answers.columns["ra_deg"][used], answers.columns["de_deg"][used], field_rad),
        axes=axes,
        half_cone_95=axis_statistics(used_ns, np.hypot(errors(CROSS_X), errors(CROSS_Y))),
        mean_abs_d_ra_deg=_mean_abs_d_ra_deg(errors(D_RA_COSDE), _true_de_deg(frames, answers, used)),
        mean_abs_d_de_deg=axes[D_DE.key].mean_abs_arcsec / 3600,
        earth_rate=_earth_rate(_true_de_deg(frames, answers, used), axes[D_RA_COSDE.key]),
        time_ms=percentiles(timed),
        time_is_stated=answers.time_is_stated,
        slow=_share(timed > limits.identification_ms),
        arrival_ms=percentiles(answers.arrival_ms[np.isfinite(answers.arrival_ms)]),
        acquisition_s=_acquisition_s(kept_ns, good[timed_frames]),
        outage_s=_outage_s(kept_ns, good[timed_frames]),
        thermal=_thermal(used_ns, errors, frames["temperature_c"][used]),
        first_fixes_s=first_fixes_s(kept_ns, frames["frame_no"][timed_frames], good[timed_frames]),
        at_confidence=_at_confidence(errors, limits),
        output_rate_hz=_output_rate_hz(
            kept_ns[counted.answered[timed_frames]] if subject is Subject.SENSOR else kept_ns
        ),
    )


def _at_confidence(errors: Callable[[Axis], NDArray[np.float64]], limits: Limits) -> dict[str, Figure]:
    if {limits.x_arcsec, limits.y_arcsec, limits.about_arcsec} == {None}:
        return {}
    figures = {}
    for axis in OF_SENSOR:
        along = errors(axis)
        absolute = np.abs(along[np.isfinite(along)])
        value, bounds, number = quantile_bounds(absolute, limits.confidence)
        figures[axis.key] = Figure(value, bounds, number, len(absolute), _NAN)
    return figures


def _output_rate_hz(utc_ns: NDArray[np.int64]) -> float:
    """Of instants (M,); a step of one and a half is a frame that is missing, which counts for the availability."""
    steps = np.diff(np.sort(utc_ns))
    kept = steps[steps <= 1.5 * np.median(steps)] if len(steps) else steps
    return NS_PER_S / float(kept.mean()) if len(kept) and kept.mean() > 0 else _NAN


def _true_de_deg(frames: Columns, answers: SubjectAnswers, used: NDArray[np.int64]) -> NDArray[np.float64]:
    """True declination of the used frames (K,); that of the answer where only the sensor answered."""
    true_deg = frames["de_true_deg"][used]
    return np.where(np.isnan(true_deg), answers.columns["de_deg"][used], true_deg)


def _axis(used_ns: NDArray[np.int64], errors_arcsec: NDArray[np.float64]) -> AxisStatistics:
    """Of the frames that have the angle: an answer of RA and DE alone has no roll."""
    known = np.isfinite(errors_arcsec)
    return (
        axis_statistics(used_ns, errors_arcsec)
        if known.all()
        else axis_statistics(used_ns[known], errors_arcsec[known])
    )


def _thermal(
    used_ns: NDArray[np.int64], errors: Callable[[Axis], NDArray[np.float64]], temperature_c: NDArray[np.float32]
) -> dict[str, ThermalError | None]:
    return {axis.key: thermal_error(used_ns, errors(axis), temperature_c) for axis in OF_SENSOR}


def _share(happened: NDArray[np.bool_]) -> Share:
    return share_of(int(happened.sum()), len(happened))


def about_circular_mean(angles_arcsec: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same angles (M,), each within half a turn of their circular mean: +-180 deg do not average to nothing."""
    known = np.isfinite(angles_arcsec)
    if not known.all():
        angles_arcsec = angles_arcsec.copy()
        angles_arcsec[known] = about_circular_mean(angles_arcsec[known])
        return angles_arcsec
    if not len(angles_arcsec):
        return angles_arcsec
    phase = angles_arcsec * (2 * math.pi / _TURN_ARCSEC)
    mean = math.atan2(float(np.sin(phase).mean()), float(np.cos(phase).mean())) * _TURN_ARCSEC / (2 * math.pi)
    offset: NDArray[np.float64] = angles_arcsec - mean
    return mean + offset - _TURN_ARCSEC * np.round(offset / _TURN_ARCSEC)


def figure_of(axis: AxisStatistics, name: str, duration_s: float) -> Figure:
    """``mean_abs`` or ``p95_abs`` of an axis as a figure to decide on."""
    return Figure(
        getattr(axis, f"{name}_arcsec"), getattr(axis, f"{name}_bounds_arcsec"), axis.n_eff, axis.n, duration_s
    )


def _star_fields(ra_deg: NDArray[np.float64], de_deg: NDArray[np.float64], field_rad: float) -> int:
    """How many fields of stars the boresights were in, one next to the other: cells of half a field's width."""
    cells = np.empty(0, dtype=np.int64)
    most = math.ceil(1 / field_rad)
    place = (2 * most + 1) ** np.arange(3)  # one number for a cell: three take ten times as long to sort
    for first in range(0, len(ra_deg), _ROWS_AT_ONCE):
        rows = slice(first, first + _ROWS_AT_ONCE)
        ra, de = np.radians(ra_deg[rows]), np.radians(de_deg[rows])
        vectors = np.column_stack([np.cos(de) * np.cos(ra), np.cos(de) * np.sin(ra), np.sin(de)])
        cells = np.unique(np.concatenate([cells, product(np.floor(vectors / field_rad).astype(np.int64), place)]))
    return len(cells)


def _mean_abs_d_ra_deg(d_ra_cosde_arcsec: NDArray[np.float64], de_true_deg: NDArray[np.float64]) -> float:
    """Mean |dRA| (not times cos DE), as in table 4-1 of the LAPAN paper; NaN too near the pole."""
    if len(de_true_deg) == 0 or not np.abs(de_true_deg).max() <= _MAX_DE_FOR_RA_DEG:
        return _NAN
    d_ra_arcsec = d_ra_cosde_arcsec / np.cos(np.radians(de_true_deg))
    return float(np.abs(d_ra_arcsec).mean()) / 3600


def _earth_rate(de_true_deg: NDArray[np.float64], d_ra_cosde: AxisStatistics) -> EarthRate:
    if len(de_true_deg) == 0 or not abs(de_true_deg[0]) <= _MAX_DE_FOR_RA_DEG:
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
