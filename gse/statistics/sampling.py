"""Sampling bounds of the statistics of a series of errors.

Each bound takes the correlation of the series into account (gse.statistics.autocorrelation). Means of absolute values
and standard deviations are bounded on the scale of their logarithm, where their distribution is symmetric. The 95th
percentile is bounded by the percentiles at the shares that the share of values above it may truly have (Woodruff 1952,
JASA 47, 635, on the logarithm of the share); where less than three independent values lie beyond, by an exponential
tail, which errs to the safe side for tails up to exponential. The share is never taken as better known than the mean
absolute value: the few values of a tail tell little of their correlation.

A slow error shows in a session as a bias, and a session shorter than it lasts shows little of its scatter. Absolute
values hide both, so that their bounds are at least as wide as with the bias at either of its own bounds, and upwards
with the variance of the mean beside the scatter.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.statistics.autocorrelation import MixedStudent, mean_error, weighted_sum_error
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
_TAIL_FROM = 0.8
_TAIL_EVENTS = 3.0
_MAX_LOG = 50.0


@dataclass(frozen=True, slots=True)
class Bounds:
    """Bounds of a figure, in its unit; all NaN where none can be given.

    ``low`` and ``high`` hold the true value between them with 95 %; ``lower`` and ``upper`` are one-sided: the true
    value is above ``lower`` with 95 %, and below ``upper`` with 95 %.
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


def error_bounds(errors: NDArray[np.float64]) -> ErrorBounds:
    """The bounds of errors (M,) in their order."""
    absolute = np.abs(errors)
    if not _tells(errors):
        return ErrorBounds()
    error_of_bias = mean_error(errors)
    n_eff = float(min(errors.var() / error_of_bias.standard**2, len(errors)))
    of_bias = _half_widths(error_of_bias)
    bias = _symmetric(float(errors.mean()), of_bias)
    if not _tells(absolute):
        return ErrorBounds(n_eff, len(errors) / n_eff, bias)
    of_mean = _half_widths(mean_error(absolute))
    mean_abs = _of_logarithm(float(absolute.mean()), of_mean, 1.0)
    p95_abs = _percentile_95(absolute, of_mean)
    two, one = (_shifted(errors, *each) for each in zip(of_bias, (_Z, _Z_ONE), strict=True))
    return ErrorBounds(
        n_eff,
        len(errors) / n_eff,
        bias,
        _widened(mean_abs, two[0], one[0]),
        _widened(_above(p95_abs, mean_abs), two[1], one[1]),
    )


def mean_bounds(values: NDArray[np.float64]) -> Bounds:
    """Of the mean of values (M,) in their order."""
    return _symmetric(float(values.mean()), _half_widths(mean_error(values))) if _tells(values) else NO_BOUNDS


def root_mean_square_bounds(values: NDArray[np.float64]) -> Bounds:
    """Of the root of the mean square of values (M,) in their order."""
    squares = values**2
    if not _tells(squares):
        return NO_BOUNDS
    mean = float(squares.mean())
    bounds = _of_logarithm(mean, _half_widths(mean_error(squares)), 0.5)
    root = 1 / math.sqrt(mean)
    return Bounds(*(root * value for value in (bounds.low, bounds.high, bounds.lower, bounds.upper)))


def slope_bounds(slope: float, at: NDArray[np.float64], values: NDArray[np.float64]) -> Bounds:
    """Of the slope of values (M,) over places (M,) in their order, whose estimate is given."""
    if not _tells(values) or at[-1] <= at[0]:
        return NO_BOUNDS
    from_middle = at - at.mean()
    weights = from_middle / product(from_middle, from_middle)
    residuals = values - values.mean() - product(weights, values) * from_middle
    if not _tells(residuals):
        return NO_BOUNDS
    return _symmetric(slope, _half_widths(weighted_sum_error(weights, residuals)))


def effective_number(happened: NDArray[np.bool_]) -> float:
    """Of the share of frames (M,) in their order in which something happened, for exact bounds of the share.

    The number of independent frames whose share would have the same interval, so that what is not known of the
    correlation counts too (Korn & Graubard 1998, Survey Methodology 24, 193). The number of frames where it happened in
    all or in none: such a series tells nothing of its correlation.
    """
    n, share = len(happened), float(happened.mean()) if len(happened) else _NAN
    if n < MIN_FRAMES or share in (0.0, 1.0):
        return float(n)
    half_width = mean_error(happened.astype(np.float64)).half_width(TWO_SIDED)
    return min(share * (1 - share) * (_Z / half_width) ** 2, float(n))


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


def _percentile_95(absolute: NDArray[np.float64], of_mean: tuple[float, float]) -> Bounds:
    ascending = np.sort(absolute)
    beyond = (absolute >= _at_share(ascending, _TAIL_SHARE)).astype(np.float64)
    if not _tells(beyond):
        return NO_BOUNDS
    share = float(beyond.mean())
    scatter = math.sqrt(share * (1 - share)) / float(absolute.std())
    of_share = _half_widths(mean_error(beyond))
    two, one = (max(own, scatter * other) / share for own, other in zip(of_share, of_mean, strict=True))
    n_eff = (1 - share) / share * (_Z / two) ** 2
    low, lower = (_at_share(ascending, _TAIL_SHARE * _exp(log)) for log in (two, one))
    high, upper = (_beyond(ascending, log, n_eff) for log in (two, one))
    return Bounds(low, high, lower, upper)


def _shifted(errors: NDArray[np.float64], half_width: float, quantile: float) -> NDArray[np.float64]:
    """Mean and 95th percentile (rows) of the absolute values with the bias at either end of its interval: least, most.

    The most has the variance of the mean beside the scatter that the session shows.
    """
    mean = float(errors.mean())
    scatter = math.hypot(1.0, half_width / quantile / float(errors.std()))
    towards = np.abs(errors - min(max(mean, -half_width), half_width))
    away = np.abs(scatter * (errors - mean) + mean + math.copysign(half_width, mean))
    return np.array([[float(one.mean()), percentile_95(one)] for one in (towards, away)]).T


def percentile_95(values: NDArray[np.float64]) -> float:
    """As numpy's, which spends ten times as long on its options."""
    place = 0.95 * (len(values) - 1)
    left = int(place)
    below, above = np.partition(values, (left, left + 1))[left : left + 2]
    return float(below + (place - left) * (above - below))


def _widened(bounds: Bounds, two: NDArray[np.float64], one: NDArray[np.float64]) -> Bounds:
    low, high = min(bounds.low, float(two[0])), max(bounds.high, float(two[1]))
    return Bounds(low, high, min(bounds.lower, float(one[0])), max(bounds.upper, float(one[1])))


def _above(bounds: Bounds, least: Bounds) -> Bounds:
    """Bounds of what is at least as great as something else: a percentile of few values is bounded by 0 alone."""
    return Bounds(max(bounds.low, least.low), bounds.high, max(bounds.lower, least.lower), bounds.upper)


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
