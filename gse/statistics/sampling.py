"""Sampling bounds of the statistics of a series of errors.

Mean and 95th percentile of absolute errors are the ones seen. How far the true ones may lie from them is that of a
model of the errors with a slow part (gse.statistics.error_model), taken as normal, with the error of the shape of what
is seen beside it: for the percentile that of the share of values beyond it (Woodruff 1952, JASA 47, 635, on the
logarithm of the share); where less than three independent values lie beyond, by an exponential tail, which errs to the
safe side for tails up to exponential.

``upper`` and ``lower`` are for the decision. What changes more slowly than the session shows is bounded there by what
the session saw of it: correlation times end at the length of the session, and no bound lies further out than twice the
spread of the errors. ``low`` and ``high`` are the 95 % interval of the true figure, of correlation times up to twenty
sessions: where the session has few independent values, it is much wider than U.

Other means are bounded by the error of a mean of correlated values, standard deviations on the scale of their
logarithm, where their distribution is symmetric.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrik, ndtr

from gse.statistics.error_model import SESSION, ErrorModel, MixedStudent, error_model
from gse.values.matrices import product

# Percentiles of something measured once per frame.

_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class Percentiles:
    """Percentiles of ``n`` values; NaN where there is none."""

    n: int
    p50: float
    p95: float
    p99: float
    max: float


def percentiles(values: NDArray[np.float64]) -> Percentiles:
    """Percentiles of the finite values."""
    finite = values[np.isfinite(values)]
    if len(finite) == 0:
        return Percentiles(0, _NAN, _NAN, _NAN, _NAN)
    p50, p95, p99 = (float(value) for value in np.percentile(finite, [50, 95, 99]))
    return Percentiles(len(finite), p50, p95, p99, float(finite.max()))


MIN_FRAMES = 30
"""Fewer frames get no bounds."""
MIN_N_EFF = 10.0
"""Below this effective number a session is called too short to tell."""

TWO_SIDED = 0.975
ONE_SIDED = 0.95
_Z = 1.959964
_Z_ONE = 1.644854
_TAIL_SHARE = 0.05
_SHAPE_OF_MEAN, _SHAPE_OF_P95 = 0.25, 0.8
"""Of the error of a figure's values, what mean and scatter do not take up: 0.21 and 0.65 of normal ones."""
_LEVEL, _LESS, _WELL_BIASED, _FEW_VALUES = 0.96, 0.22, 1.2, 7.0
_LOWER = 0.04
_MOST_SPREADS = 2.0
"""Largest U, in the spread of the errors seen (99 %): once for these, once for what changes more slowly."""
_STRETCHES, _RANGE, _BENT = 8, 2.85, 1.3
"""Parts of a series whose means show a bend; the range of so many normal values in their standard deviation; and the
slope that one cycle may have, in its range about that slope."""
_TAIL_FROM = 0.8
_TAIL_EVENTS = 3.0
_MAX_LOG = 50.0


@dataclass(frozen=True, slots=True)
class Bounds:
    """Bounds of a figure, in its unit; all NaN where none can be given.

    ``low`` and ``high`` hold the true value between them with 95 %; ``lower`` and ``upper`` are one-sided, for the
    decision: a true value at a limit is below ``lower``, or above ``upper``, in 5 % of the sessions.
    """

    low: float = _NAN
    high: float = _NAN
    lower: float = _NAN
    upper: float = _NAN


NO_BOUNDS = Bounds()


@dataclass(frozen=True, slots=True)
class ErrorBounds:
    """What a series of errors leaves open; NaN where it cannot be known.

    ``n_eff`` is the number of independent values whose mean would be as uncertain, at most the number of values;
    ``tau_frames`` the integrated autocorrelation time from minus to plus infinity (twice the time constant of an
    exponential correlation): the frames that one independent value takes. ``mean_abs`` and ``p95_abs`` are of the
    absolute values.
    """

    n_eff: float = _NAN
    tau_frames: float = _NAN
    bias: Bounds = NO_BOUNDS
    mean_abs: Bounds = NO_BOUNDS
    p95_abs: Bounds = NO_BOUNDS


def error_bounds(errors: NDArray[np.float64], time_s: NDArray[np.float64] | None = None) -> ErrorBounds:
    """The bounds of errors (M,) in their order, at instants (M,), by default evenly spaced."""
    if not _tells(errors):
        return ErrorBounds()
    model = error_model(errors, time_s)
    n_eff = float(min(errors.var() / model.mean_error(SESSION).standard ** 2, len(errors)))
    bias = _symmetric(float(errors.mean()), _half_widths(model.mean_error()))
    absolute = np.abs(errors)
    if not _tells(absolute):
        return ErrorBounds(n_eff, len(errors) / n_eff, bias)
    return ErrorBounds(n_eff, len(errors) / n_eff, bias, *_of_absolute(errors, absolute, model, n_eff))


def _of_absolute(
    errors: NDArray[np.float64], absolute: NDArray[np.float64], model: ErrorModel, n_eff: float
) -> tuple[Bounds, Bounds]:
    """Bounds of mean and 95th percentile of the absolute errors, as normal errors leave them open about what is seen.

    What is seen is not normal, and a percentile is worth less than mean and scatter are: the error of its shape.
    """
    mean, std = float(errors.mean()), float(errors.std())
    ascending = np.sort(absolute)
    seen = np.array([float(absolute.mean()), float(_quantile(ascending, 0.95))])
    plain = _folded(np.array([mean]), np.array([std]))
    points = (_folded(*model.points(longest)) - plain for longest in (SESSION, math.inf))
    decisive, all_of_them = (np.sort(figures, axis=1) for figures in points)
    number = model.shape_number
    most = _MOST_SPREADS * float(_quantile(np.sort(np.abs(errors - mean)), 0.99))
    level = _level(abs(mean) / std, n_eff)

    def end(of: NDArray[np.float64], share: float, quantile: float) -> NDArray[np.float64]:
        """How far either figure may lie from what is seen; below it where the share is."""
        sign = math.copysign(1.0, share - 0.5)
        about = 0.0 if share > 0.5 else np.maximum(np.median(of, axis=1), 0.0)
        distance = np.maximum(sign * (_quantile(of, share) - about), 0.0)
        return sign * np.hypot(distance, _shape_error(absolute, ascending, number, sign * quantile))

    low, high = seen + end(all_of_them, 1 - TWO_SIDED, _Z), seen + end(all_of_them, TWO_SIDED, _Z)
    lower = seen + np.maximum(end(decisive, _LOWER, _Z_ONE), -most)
    upper = seen + np.minimum(end(decisive, level, _Z_ONE), most)
    ends = np.maximum(np.column_stack([np.minimum(low, lower), np.maximum(high, upper), lower, upper]), 0.0)
    return Bounds(*ends[0].tolist()), Bounds(*ends[1].tolist())


def _quantile(ascending: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """np.quantile of what ascends along the last axis, to the last digit; its checks take ten times as long as this."""
    place = share * (ascending.shape[-1] - 1)
    left = int(place)
    low, high = ascending[..., left], ascending[..., min(left + 1, ascending.shape[-1] - 1)]
    part = place - left
    return np.asarray(low + (high - low) * part if part < 0.5 else high - (high - low) * (1 - part))


def _level(bias: float, n_eff: float) -> float:
    """The share of the points below U, for a bias in standard deviations.

    Not 0.95: that a bias of either sign makes an absolute value greater is in the points of a bias that is hardly
    known, which lie above the true figure more often than below. Found by simulation, so that a sensor at its limit
    passes as seldom as the decision states (benchmarks/sampling.py).
    """
    unknown = max(1 - bias / _WELL_BIASED, 0.0) * min(_FEW_VALUES / n_eff, 1.0)
    return _LEVEL - _LESS * unknown


def _shape_error(
    absolute: NDArray[np.float64], ascending: NDArray[np.float64], number: float, quantile: float
) -> NDArray[np.float64]:
    """Of mean and 95th percentile, on the side of the sign of ``quantile``, of so many independent values.

    That of the percentile by the percentile of the share of values beyond it (Woodruff 1952), on its logarithm.
    """
    log = quantile * math.sqrt((1 - _TAIL_SHARE) / _TAIL_SHARE / number)
    percentile_at = _beyond(ascending, log, number) if log > 0 else _at_share(ascending, _TAIL_SHARE * _exp(-log))
    of_mean = float(absolute.std()) * abs(quantile) / math.sqrt(number)
    return np.array([_SHAPE_OF_MEAN * of_mean, _SHAPE_OF_P95 * (percentile_at - _at_share(ascending, _TAIL_SHARE))])


def _folded(means: NDArray[np.float64], stds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean and 95th percentile (rows) of the absolute value of normal quantities (P,)."""
    biases = np.abs(means) / stds
    mean = math.sqrt(2 / math.pi) * np.exp(-(biases**2) / 2) + biases * (2 * ndtr(biases) - 1)
    at, values = _folded_percentiles()
    return np.array([stds * mean, stds * np.where(biases < at[-1], np.interp(biases, at, values), biases + _Z_ONE)])


@functools.cache
def _folded_percentiles() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The 95th percentile of the absolute value of a normal quantity of scatter 1, for biases."""
    biases = np.arange(0.0, 4.0, 0.01)
    low, high = biases + _Z_ONE, biases + _Z
    for _ in range(40):
        middle = (low + high) / 2
        is_inside = ndtr(middle - biases) - ndtr(-middle - biases) < 1 - _TAIL_SHARE
        low, high = np.where(is_inside, middle, low), np.where(is_inside, high, middle)
    return biases, low


def mean_bounds(values: NDArray[np.float64]) -> Bounds:
    """Of the mean of values (M,) in their order."""
    return (
        _symmetric(float(values.mean()), _half_widths(error_model(values).mean_error()))
        if _tells(values)
        else NO_BOUNDS
    )


def root_mean_square_bounds(values: NDArray[np.float64]) -> Bounds:
    """Of the root of the mean square of values (M,) in their order."""
    squares = values**2
    if not _tells(squares):
        return NO_BOUNDS
    mean = float(squares.mean())
    bounds = _of_logarithm(mean, _half_widths(error_model(squares).mean_error()), 0.5)
    root = 1 / math.sqrt(mean)
    return Bounds(*(root * value for value in (bounds.low, bounds.high, bounds.lower, bounds.upper)))


def slope_bounds(slope: float, at: NDArray[np.float64], values: NDArray[np.float64]) -> Bounds:
    """Of the slope of values (M,) over places (M,) in their order, whose estimate is given."""
    if not _tells(values) or at[-1] <= at[0]:
        return NO_BOUNDS
    from_middle = at - at.mean()
    residuals = values - values.mean() - product(from_middle, values) / product(from_middle, from_middle) * from_middle
    if not _tells(residuals):
        return NO_BOUNDS
    bent = _bent(residuals) / float(at[-1] - at[0])
    two, one = _half_widths(error_model(values, at).slope_error())
    return _symmetric(slope, (math.hypot(two, bent), math.hypot(one, bent)))


def _bent(residuals: NDArray[np.float64]) -> float:
    """How far values depart from a line beyond their noise, end to end: a swing of one cycle looks like a slope."""
    noise = float(np.diff(residuals).var()) / 2
    means = np.array([float(part.mean()) for part in np.array_split(residuals, _STRETCHES)])
    return _BENT * math.sqrt(max(float(np.ptp(means)) ** 2 - _RANGE**2 * noise * _STRETCHES / len(residuals), 0.0))


def effective_number(happened: NDArray[np.bool_]) -> float:
    """Of the share of frames (M,) in their order in which something happened, for exact bounds of the share.

    The number of independent frames whose share would have the same interval, so that what is not known of the
    correlation counts too (Korn & Graubard 1998, Survey Methodology 24, 193). The number of frames where it happened in
    all or in none: such a series tells nothing of its correlation.
    """
    n, share = len(happened), float(happened.mean()) if len(happened) else _NAN
    if n < MIN_FRAMES or share in (0.0, 1.0):
        return float(n)
    half_width = error_model(happened.astype(np.float64)).mean_error().half_width(TWO_SIDED)
    return min(share * (1 - share) * (_Z / half_width) ** 2, float(n))


def quantile_bounds(values: NDArray[np.float64], share: float) -> tuple[float, Bounds, float]:
    """The value that a share of all values (M,) in their order keeps, its bounds, and the effective number behind them.

    By order statistics, whatever the distribution (David & Nagaraja 2003, section 7.1), of as many independent values
    as the share beyond is worth. A bound for which there are too few is NaN: the upper one of 99.7 % needs 998.
    """
    if not _tells(values):
        return (float(np.quantile(values, share)) if len(values) else _NAN), NO_BOUNDS, _NAN
    ascending = np.sort(values)
    value = _at_share(ascending, 1 - share)
    number = effective_number(values > value)

    def at(probability: float) -> float:
        rank = 1 + float(bdtrik(probability, number, share))
        return _at_share(ascending, 1 - rank / (number + 1)) if 1 <= rank <= number else _NAN

    return value, Bounds(at(1 - TWO_SIDED), at(TWO_SIDED), at(1 - ONE_SIDED), at(ONE_SIDED)), number


def _tells(values: NDArray[np.float64]) -> bool:
    """Whether there is anything to tell a scatter from: equal values are not evidence of a scatter of zero."""
    return len(values) >= MIN_FRAMES and float(np.ptp(values)) > 0


def _half_widths(error: MixedStudent) -> tuple[float, float]:
    """Of the two-sided and of the one-sided interval."""
    return error.half_width(TWO_SIDED), error.half_width(ONE_SIDED)


def _symmetric(value: float, half_widths: tuple[float, float]) -> Bounds:
    two, one = half_widths
    return Bounds(value - two, value + two, value - one, value + one)


def _of_logarithm(mean: float, half_widths: tuple[float, float], power: float) -> Bounds:
    two, one = (power * half_width / mean for half_width in half_widths)
    return Bounds(mean * _exp(-two), mean * _growth(two), mean * _exp(-one), mean * _growth(one))


def _growth(log: float) -> float:
    """The exponential, beyond 1 its tangent: what is less certain than by its own size has no such skew."""
    return math.exp(log) if log < 1 else math.e * log


def _beyond(ascending: NDArray[np.float64], log: float, n_eff: float) -> float:
    """The value that exp(-log) of the share beyond the 95th percentile exceeds."""
    share = _TAIL_SHARE * _exp(-log)
    inside = _at_share(ascending, share)
    if share * n_eff >= _TAIL_EVENTS:
        return inside
    start = int(_TAIL_FROM * len(ascending))
    excess = float((ascending[start:] - ascending[start]).mean())
    return max(inside, _at_share(ascending, _TAIL_SHARE) + excess * log)


def _at_share(ascending: NDArray[np.float64], share: float) -> float:
    """The value that a share of all further values exceeds, interpolated; 0 where all of them do."""
    if share >= 1:
        return 0.0
    place = min(max((1 - share) * (len(ascending) + 1) - 1, 0.0), len(ascending) - 1.0)
    left = min(int(place), len(ascending) - 2)
    return float(ascending[left] + (place - left) * (ascending[left + 1] - ascending[left]))


def _exp(log: float) -> float:
    return math.exp(max(min(log, _MAX_LOG), -_MAX_LOG))
