"""Sampling bounds of the statistics of a series of errors.

Each bound takes the correlation of the series into account (gse.assessment.autocorrelation). Means of absolute values
and standard deviations are bounded on the scale of their logarithm, where their distribution is symmetric. The 95th
percentile is bounded by the percentiles at the shares that the share of values above it may truly have (Woodruff 1952,
JASA 47, 635, on the logarithm of the share); where less than three independent values lie beyond, by an exponential
tail, which errs to the safe side for tails up to exponential.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.assessment.autocorrelation import MixedStudent, mean_error, weighted_sum_error

MIN_FRAMES = 30
"""Fewer frames get no bounds."""
MIN_N_EFF = 10.0
"""Below this effective number a session is called too short to tell."""

TWO_SIDED = 0.975
ONE_SIDED = 0.95
_Z = 1.959964
_TAIL_SHARE = 0.05
_TAIL_FROM = 0.8
_TAIL_EVENTS = 3.0
_MAX_LOG = 50.0
_NAN = float("nan")


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
class Correlation:
    """How many independent values a series is worth.

    ``n_eff`` is the number of independent values whose mean would be as uncertain, at most the number of values;
    ``frames`` is the integrated autocorrelation time in frames, from minus to plus infinity (twice the time constant of
    an exponential correlation): the frames that one independent value takes. NaN where it cannot be known.
    """

    n_eff: float
    frames: float

    @property
    def too_short(self) -> bool:
        """Whether the session says too little for any answer."""
        return not self.n_eff >= MIN_N_EFF


def correlation(values: NDArray[np.float64]) -> Correlation:
    """Of values (M,) in their order."""
    if not _tells(values):
        return Correlation(_NAN, _NAN)
    n_eff = float(min(values.var() / mean_error(values).standard ** 2, len(values)))
    return Correlation(n_eff, len(values) / n_eff)


def mean_bounds(values: NDArray[np.float64]) -> Bounds:
    """Of the mean of values (M,) in their order."""
    return _symmetric(float(values.mean()), mean_error(values)) if _tells(values) else NO_BOUNDS


def positive_mean_bounds(values: NDArray[np.float64]) -> Bounds:
    """Of the mean of values (M,) in their order, none negative."""
    return _of_logarithm(float(values.mean()), mean_error(values), 1.0) if _tells(values) else NO_BOUNDS


def root_mean_square_bounds(values: NDArray[np.float64]) -> Bounds:
    """Of the root of the mean square of values (M,) in their order."""
    squares = values**2
    if not _tells(squares):
        return NO_BOUNDS
    error = mean_error(squares)
    mean = float(squares.mean())
    bounds = _of_logarithm(mean, error, 0.5)
    root = 1 / math.sqrt(mean)
    return Bounds(*(root * value for value in (bounds.low, bounds.high, bounds.lower, bounds.upper)))


def slope_bounds(slope: float, at: NDArray[np.float64], values: NDArray[np.float64]) -> Bounds:
    """Of the slope of values (M,) over places (M,) in their order, whose estimate is given."""
    if not _tells(values) or at[-1] <= at[0]:
        return NO_BOUNDS
    from_middle = at - at.mean()
    weights = from_middle / (from_middle @ from_middle)
    residuals = values - values.mean() - (weights @ values) * from_middle
    return _symmetric(slope, weighted_sum_error(weights, residuals)) if _tells(residuals) else NO_BOUNDS


def percentile_95_bounds(values: NDArray[np.float64], ascending: NDArray[np.float64]) -> Bounds:
    """Of the 95th percentile of values (M,) in their order, none negative, given also in ascending order."""
    percentile = _at_share(ascending, _TAIL_SHARE)
    beyond = (values >= percentile).astype(np.float64)
    if not _tells(beyond):
        return NO_BOUNDS
    error, share = mean_error(beyond), float(beyond.mean())
    two, one = (error.half_width(probability) / share for probability in (TWO_SIDED, ONE_SIDED))
    n_eff = (1 - share) / share * (_Z / two) ** 2
    below = [_at_share(ascending, _TAIL_SHARE * _exp(log)) for log in (two, one)]
    above = [_upper(ascending, percentile, log, n_eff) for log in (two, one)]
    return Bounds(below[0], above[0], below[1], above[1])


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
    """Whether there is anything to tell a scatter from: equal values are no evidence of a scatter of zero."""
    return len(values) >= MIN_FRAMES and float(np.ptp(values)) > 0


def _symmetric(value: float, error: MixedStudent) -> Bounds:
    two, one = error.half_width(TWO_SIDED), error.half_width(ONE_SIDED)
    return Bounds(value - two, value + two, value - one, value + one)


def _of_logarithm(mean: float, error: MixedStudent, power: float) -> Bounds:
    two, one = (power * error.half_width(probability) / mean for probability in (TWO_SIDED, ONE_SIDED))
    return Bounds(*(mean * _exp(log) for log in (-two, two, -one, one)))


def _upper(ascending: NDArray[np.float64], percentile: float, log: float, n_eff: float) -> float:
    share = _TAIL_SHARE * _exp(-log)
    inside = _at_share(ascending, share)
    if share * n_eff >= _TAIL_EVENTS:
        return inside
    start = int(_TAIL_FROM * len(ascending))
    excess = float((ascending[start:] - ascending[start]).mean())
    return max(inside, percentile + excess * log)


def _at_share(ascending: NDArray[np.float64], share: float) -> float:
    """The value that a share of all values exceeds, interpolated; 0 where all of them do."""
    if share >= 1:
        return 0.0
    place = (1 - share) * (len(ascending) - 1)
    left = min(int(place), len(ascending) - 2)
    return float(ascending[left] + (place - left) * (ascending[left + 1] - ascending[left]))


def _exp(log: float) -> float:
    return math.exp(max(min(log, _MAX_LOG), -_MAX_LOG))
