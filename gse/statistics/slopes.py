"""Slopes that outliers do not move: of points over time, and of values within each star."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from gse.values.matrices import product

# The Theil-Sen slope: the median of the slopes between all pairs of points.

_TAIL = 0.025
"""Outside each end of the interval of 95 %."""


@dataclass(frozen=True, slots=True)
class Slope:
    """A slope with its 95 % interval."""

    slope: float
    low: float
    high: float


def theil_sen(values: NDArray[np.float64], at: NDArray[np.float64]) -> Slope:
    """The slope of values (N,) over places (N,), not all of them the same, with Sen's interval (1968, JASA 63, 1379).

    As scipy.stats.theilslopes, whose package takes 32 MB and half a second to import.
    """
    apart = at[:, None] - at
    later = apart > 0
    slopes = (values[:, None] - values)[later] / apart[later]
    n = len(values)
    variance = (_of_pairs(n) - _of_ties(at) - _of_ties(values)) / 18
    half_width = -float(ndtri(_TAIL)) * math.sqrt(max(variance, 0.0))
    high = min(round((len(slopes) + half_width) / 2), len(slopes) - 1)
    low = max(round((len(slopes) - half_width) / 2) - 1, 0)
    middle = len(slopes) // 2
    slopes.partition(sorted({low, (len(slopes) - 1) // 2, middle, high}))
    median = (slopes[(len(slopes) - 1) // 2] + slopes[middle]) / 2
    return Slope(float(median), float(slopes[low]), float(slopes[high]))


def _of_pairs(n: int) -> int:
    """The term of n values in the variance of Kendall's statistic, times 18."""
    return n * (n - 1) * (2 * n + 5)


def _of_ties(values: NDArray[np.float64]) -> int:
    """The terms of values that are there more than once."""
    _, counts = np.unique(values, return_counts=True)
    return sum(_of_pairs(int(count)) for count in counts)


def slope_within(
    at: NDArray[np.float64], values: NDArray[np.float64], stars: NDArray[np.integer], fewest: int
) -> tuple[float, float] | None:
    """The slope of values (N,) over ``at`` (N,) that stars share, and half its 95 % interval, clustered by star.

    ``stars`` (N,) are rows of the catalogue. None of less than ``fewest`` stars, and where each has one instant.
    """
    star = stars.astype(np.intp)
    count = np.bincount(star)
    seen = np.flatnonzero(count)
    if len(seen) < fewest:
        return None
    count = np.maximum(count, 1)
    about = at - (np.bincount(star, at) / count).take(star)
    left = values - (np.bincount(star, values) / count).take(star)
    squares = float(product(about, about))
    if squares == 0:
        return None
    slope = float(product(about, left)) / squares
    scores = np.bincount(star, about * (left - slope * about)).take(seen)
    return slope, float(stdtrit(len(seen) - 1, 0.975)) * math.sqrt(float(product(scores, scores))) / squares
