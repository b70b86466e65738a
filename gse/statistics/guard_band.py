"""Guarded acceptance: a limit is kept where the figure and its uncertainty keep it (JCGM 106, 8.3.2)."""

import math

import numpy as np
from scipy.special import stdtrit

COVERAGE_FACTOR = 1.645
"""Of a one-sided 95 % bound of a normal quantity."""

_ONE_SIDED = 0.95
_LENGTHS = 500
"""Lengths that are tried for a decision; each is a few per cent longer than the one before."""
_ROUNDING = 1e-9


def guard(sampling: float, truth_standard: float) -> float:
    """The one-sided 95 % uncertainty of a figure, from what sampling leaves open and the standard uncertainty of truth.

    ``sampling`` is the distance between the figure and its one-sided 95 % bound. Both are independent: the squares add
    (JCGM 100, 5.1.2), each at 95 %. NaN or infinite where ``sampling`` is.
    """
    return math.hypot(sampling, COVERAGE_FACTOR * truth_standard)


def further_share(distance: float, sampling: float, truth_standard: float, n_eff: float = math.inf) -> float:
    """How much longer a session must be for a decision, as a share of its length; infinite where truth prevents it.

    ``distance`` lies between figure and limit, ``sampling`` between figure and one-sided 95 % bound: it falls with the
    square root of the length, and as Student's t does with the independent values, of which the session has ``n_eff``:
    one that has few does not know its own scatter. 0 where the figure is decided; NaN where ``sampling`` is.
    """
    room2 = distance**2 - (COVERAGE_FACTOR * truth_standard) ** 2
    if not room2 > 0:
        return math.inf
    most = sampling**2 / room2
    if most <= 1:
        return 0.0
    if not math.isfinite(most) or not math.isfinite(n_eff):
        return most - 1
    values = max(n_eff, 1.0)
    times = np.geomspace(1.0, most, _LENGTHS)
    left = most / times * (stdtrit(values * times, _ONE_SIDED) / stdtrit(values, _ONE_SIDED)) ** 2
    return float(times[np.argmax(left <= 1 + _ROUNDING)]) - 1


def keeps(value: float, upper: float, limit: float, truth_standard: float = 0.0) -> bool:
    """Whether a figure with this one-sided 95 % upper bound is within a limit beyond doubt; False for NaN."""
    return value + guard(upper - value, truth_standard) <= limit


def exceeds(value: float, lower: float, limit: float, truth_standard: float = 0.0) -> bool:
    """Whether a figure with this one-sided 95 % lower bound is beyond a limit beyond doubt; False for NaN."""
    return value - guard(value - lower, truth_standard) > limit
