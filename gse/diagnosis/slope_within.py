"""The slope that the values of stars have within each star: new stars in the field change nothing."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from gse.matrices import product


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
