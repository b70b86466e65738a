"""Two nights side by side: figures, their differences, and which differences are a regression."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from gse.assessment.autocorrelation import mean_error
from gse.assessment.axis_statistics import AxisStatistics, quick_errors
from gse.assessment.counted_frames import false_answers
from gse.assessment.field_content import FieldContent, field_content
from gse.assessment.metrics import Metric, metrics
from gse.assessment.sampling import MIN_FRAMES
from gse.assessment.statistics import Statistics, statistics
from gse.instant import NS_PER_S
from gse.station.frame_table import STATUSES
from gse.station.results import Status
from gse.station.session_data import SessionData

PAIRED_SHARE = 0.9
"""Two nights are of the same panoramas when this share of the shorter one's are in both."""
SAME_WITHIN_NS = NS_PER_S
"""The UTC of a panorama differs by less between replays; a sensor that restarts repeats numbers and time tags."""

_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class Row:
    """One figure of both nights.

    ``alike`` is the second night's figure as it would be over the fields of the first; ``difference`` is that less the
    first. ``sigmas`` says how significant the difference is, positive where the second night is worse (NaN: not known);
    ``worse`` is a regression: significant, and larger than ``allowed``. A figure without ``gate`` is only shown.
    """

    name: str
    unit: str
    first: float
    second: float
    alike: float
    difference: float
    sigmas: float
    allowed: float
    worse: bool = False
    gate: bool = True


@dataclass(frozen=True, slots=True)
class SessionComparison:
    """All rows; ``paired`` where both nights are of the same panoramas, which makes small differences significant.

    ``metrics`` are the metrics of ECSS-E-ST-60-20C that both nights have, none of them judged.
    """

    rows: tuple[Row, ...]
    paired: bool
    metrics: tuple[Row, ...]

    @property
    def regressions(self) -> tuple[Row, ...]:
        """The rows in which the second night is worse."""
        return tuple(row for row in self.rows if row.worse)


def session_comparison(
    first: SessionData,
    second: SessionData,
    *,
    sigmas: float = 3.0,
    allowed_share: float = 0.01,
    bias_is_regression: bool = False,
) -> SessionComparison:
    """Compare two nights.

    The second is worse in a figure where the difference is beyond ``sigmas`` and larger than ``allowed_share`` of the
    first station's limit for it. With ``bias_is_regression`` a bias that changed either way is one.
    """
    limits = first.station.limits
    figures = statistics(first), statistics(second)
    columns = first.frames.columns, second.frames.columns
    pairs = _pairs(*columns)
    fields = field_content(first), field_content(second)
    rows = []
    for axis, label, limit in (
        ("d_ra_cosde", "dRA*", limits.d_ra_cosde_arcsec),
        ("d_de", "dDE", limits.d_de_arcsec),
    ):
        allowed = allowed_share * limit
        one, two = (_Axis.of(*of_one, axis) for of_one in zip(figures, columns, fields, strict=True))
        # The same panoramas have the same fields: fewer stars identified in them is a loss of the second.
        growth = 1.0 if pairs is not None else one.field.geometry / two.field.geometry
        growth = growth if math.isfinite(growth) else 1.0
        change = _paired_change(axis, columns, pairs)
        rows.append(_mean_abs(f"mean |{label}|", one, two, growth, change, allowed))
        rows.append(_noise(f"NEA {label}", one, two, growth, allowed))
        rows.append(_bias(f"bias {label}", one, two, allowed, gate=bias_is_regression))
    rows.append(_availability(figures, columns, pairs, allowed_share))
    rows.append(_false(figures, columns, pairs))
    if pairs is None:
        rows.append(_time(figures))
    shown = tuple(_metric_rows(*figures, independent=pairs is None))
    return SessionComparison(tuple(_judged(row, sigmas) for row in rows), pairs is not None, shown)


_AXIS_NAMES = {"cross_x": ", x", "cross_y": ", y", "d_roll": ", roll", None: ""}


def _metric_rows(first: Statistics, second: Statistics, *, independent: bool) -> Iterator[Row]:
    """Metrics of both; sigmas where both have an interval, and are of different panoramas."""
    others = {(metric.subject, metric.name, metric.axis): metric for metric in metrics(second)}
    for one in metrics(first):
        two = others.get((one.subject, one.name, one.axis))
        if two is None or math.isnan(one.value) or math.isnan(two.value):
            continue
        difference = two.value - one.value
        error = math.hypot(_standard(one), _standard(two)) if independent else _NAN
        name = f"{one.subject} {one.name}{_AXIS_NAMES[one.axis]}"
        sigmas = _sigmas(difference, error)
        yield Row(name, one.unit, one.value, two.value, two.value, difference, sigmas, math.inf, gate=False)


def _standard(metric: Metric) -> float:
    return (metric.high - metric.low) / 2 / 1.96


_Pairs = tuple[NDArray[np.int64], NDArray[np.int64]]
_Columns = tuple[NDArray[np.void], NDArray[np.void]]
_Figures = tuple[Statistics, Statistics]


class _Axis(NamedTuple):
    """One axis of one night: its figures, what its stars make of them, and standard errors by the order of its frames.

    ``noise_time_share`` is that of the noise equivalent angle, as a share of it.
    """

    figures: AxisStatistics
    field: FieldContent
    time_error_arcsec: float
    time_error_abs_arcsec: float
    noise_time_share: float

    @classmethod
    def of(cls, figures: Statistics, frames: NDArray[np.void], fields: dict[str, FieldContent], axis: str) -> "_Axis":
        good = _good(frames)
        errors = frames[f"{axis}_arcsec"][good]
        square = quick_errors(frames["utc_ns"][good], errors) ** 2
        noise_share = _error_of_mean(square) / 2 / max(float(square.mean()), 1e-300) if len(square) else _NAN
        by_time = _error_of_mean(errors), _error_of_mean(np.abs(errors)), noise_share
        return cls(figures.onboard.axes[axis], fields.get(axis, _NO_FIELD), *by_time)

    @property
    def bias_error_arcsec(self) -> float:
        """Standard error of the bias: what frames show, and what stars keep."""
        return math.hypot(self.time_error_arcsec, self.field.bias_error_arcsec)

    @property
    def noise_error_arcsec(self) -> float:
        """Standard error of the noise equivalent angle: what frames show, or stars that differ."""
        return max(self.noise_time_share, self.field.noise_error_share) * self.figures.nea_arcsec

    @property
    def mean_abs_error_arcsec(self) -> float:
        """Standard error of the mean absolute error: what frames show, or by bias and spread as of normal errors."""
        share = self.figures.bias_arcsec / max(self.figures.std_arcsec, 1e-9)
        by_bias = math.erf(share / math.sqrt(2)) * self.bias_error_arcsec
        spread_error = self.field.spread_error_share * self.figures.std_arcsec
        by_stars = math.hypot(by_bias, math.sqrt(2 / math.pi) * math.exp(-(share**2) / 2) * spread_error)
        return max(by_stars, self.time_error_abs_arcsec)


_NO_FIELD = FieldContent(_NAN, 0.0, 0.0, 0.0)


def _judged(row: Row, sigmas: float) -> Row:
    if row.name.startswith("bias"):
        worse = abs(row.sigmas) > sigmas and abs(row.difference) > row.allowed
    else:
        loss = -row.difference if row.name == "availability" else row.difference
        worse = row.sigmas > sigmas and loss > row.allowed
    return replace(row, worse=row.gate and worse)


def _pairs(first: NDArray[np.void], second: NDArray[np.void]) -> _Pairs | None:
    """Rows of the panoramas that are in both nights, or None where these are few."""
    common, one, two = np.intersect1d(first["time_us"], second["time_us"], return_indices=True)
    same = first["frame_no"][one] == second["frame_no"][two]
    same &= np.abs(first["utc_ns"][one] - second["utc_ns"][two]) < SAME_WITHIN_NS
    if len(common) == 0 or same.sum() < PAIRED_SHARE * min(len(first), len(second)):
        return None
    return one[same], two[same]


def _good(frames: NDArray[np.void]) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(frames["d_de_arcsec"]) & ~false_answers(frames), dtype=bool)


class _Change(NamedTuple):
    """Mean change of the absolute error of the panoramas that are in both nights, and its standard error."""

    mean: float
    error: float


def _paired_change(axis: str, columns: _Columns, pairs: _Pairs | None) -> _Change | None:
    """None of different panoramas, or where none of them was answered well in both nights."""
    if pairs is None:
        return None
    errors = [np.abs(frames[f"{axis}_arcsec"]) for frames in columns]
    both = _good(columns[0])[pairs[0]] & _good(columns[1])[pairs[1]]
    change = (errors[1][pairs[1]] - errors[0][pairs[0]])[both]
    return _Change(float(change.mean()), _error_of_mean(change)) if len(change) else None


def _mean_abs(name: str, one: _Axis, two: _Axis, growth: float, change: "_Change | None", allowed: float) -> Row:
    """Mean absolute error; that of the second over the fields of the first by a normal distribution of its errors."""
    a, b = one.figures.mean_abs_arcsec, two.figures.mean_abs_arcsec
    if change is not None:
        return Row(name, "arcsec", a, b, a + change.mean, change.mean, _sigmas(change.mean, change.error), allowed)
    bias, spread = two.figures.bias_arcsec, two.figures.std_arcsec
    alike = b if growth == 1 else b + _folded_mean(bias, spread * growth) - _folded_mean(bias, spread)
    scale = growth if math.isfinite(growth) else 1.0
    error = math.hypot(one.mean_abs_error_arcsec, scale * two.mean_abs_error_arcsec)
    return Row(name, "arcsec", a, b, alike, alike - a, _sigmas(alike - a, error), allowed)


def _folded_mean(bias: float, spread: float) -> float:
    """Mean absolute value of a normal distribution."""
    share = bias / max(spread, 1e-9)
    return spread * math.sqrt(2 / math.pi) * math.exp(-(share**2) / 2) + bias * math.erf(share / math.sqrt(2))


def _error_of_mean(values: NDArray[np.float64]) -> float:
    """Standard error of the mean of values (M,) in their order; of few, or of equal ones, as of independent values."""
    if len(values) < 2:
        return _NAN
    if len(values) < MIN_FRAMES or float(np.ptp(values)) == 0:
        return float(values.std(ddof=1) / math.sqrt(len(values)))
    return mean_error(values).standard


def _sigmas(difference: float, sigma: float) -> float:
    if sigma > 0:
        return difference / sigma
    return 0.0 if difference == 0 else math.copysign(math.inf, difference) if sigma == 0 else _NAN


def _noise(name: str, one: _Axis, two: _Axis, growth: float, allowed: float) -> Row:
    a, b = one.figures.nea_arcsec, two.figures.nea_arcsec
    error = math.hypot(one.noise_error_arcsec, growth * two.noise_error_arcsec)
    difference = growth * b - a
    return Row(name, "arcsec", a, b, growth * b, difference, _sigmas(difference, error), allowed)


def _bias(name: str, one: _Axis, two: _Axis, allowed: float, *, gate: bool) -> Row:
    """It may go either way; mean |error| has a large one."""
    a, b = one.figures.bias_arcsec, two.figures.bias_arcsec
    error = math.hypot(one.bias_error_arcsec, two.bias_error_arcsec)
    return Row(name, "arcsec", a, b, b, b - a, _sigmas(b - a, error), allowed, gate=gate)


def _availability(figures: _Figures, columns: _Columns, pairs: _Pairs | None, allowed: float) -> Row:
    a, b = (session.onboard.available for session in figures)
    missed = [~_answered_well(frames) for frames in columns]
    sigmas = _more_often(missed, pairs, (a.of - a.count, a.of), (b.of - b.count, b.of))
    return Row("availability", "", a.value, b.value, b.value, b.value - a.value, sigmas, allowed)


def _false(figures: _Figures, columns: _Columns, pairs: _Pairs | None) -> Row:
    a, b = (session.onboard.false_answers for session in figures)
    false = [false_answers(frames) for frames in columns]
    sigmas = _more_often(false, pairs, (a.count, a.of), (b.count, b.of))
    return Row("false answers", "", a.count, b.count, b.count, b.count - a.count, sigmas, 0.0)


def _answered_well(frames: NDArray[np.void]) -> NDArray[np.bool_]:
    answered = frames["status"] == STATUSES.index(Status.IDENTIFIED)
    return np.asarray(answered & ~false_answers(frames), dtype=bool)


def _more_often(
    happened: list[NDArray[np.bool_]], pairs: _Pairs | None, first: tuple[int, int], second: tuple[int, int]
) -> float:
    """Whether something happens more often in the second night, in sigmas, negative for less often.

    McNemar's exact test where every frame has its pair, else Fisher's; 0 where neither direction is likelier.
    """
    if pairs is not None and len(pairs[0]) == len(happened[0]) == len(happened[1]):
        one, two = happened[0][pairs[0]], happened[1][pairs[1]]
        only_one, only_two = int((one & ~two).sum()), int((two & ~one).sum())
        if only_one + only_two == 0:
            return 0.0
        both = only_one + only_two
        p = [float(scipy.stats.binomtest(count, both, alternative="greater").pvalue) for count in (only_two, only_one)]
    elif min(first[1], second[1]) == 0:
        return _NAN
    else:
        table = np.array([[second[0], second[1] - second[0]], [first[0], first[1] - first[0]]])
        p = [float(scipy.stats.fisher_exact(rows, alternative="greater").pvalue) for rows in (table, table[::-1])]
    more, less = (float(scipy.stats.norm.isf(min(max(value, 1e-300), 0.5))) for value in p)
    return more if more >= less else -less


def _time(figures: _Figures) -> Row:
    """Shown, not gated: recorded times belong to a host. Panoramas that are in both nights have the same."""
    a, b = (session.onboard.time_ms.p99 for session in figures)
    return Row("identification time, 99 %", "ms", a, b, b, b - a, _NAN, math.inf, gate=False)
