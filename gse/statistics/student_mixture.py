"""A mixture of Student t distributions about zero: the error of an estimate whose scale is known by its likelihood."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from gse.matrices import product
from gse.process.jit import compiled, compiled_part

_MAX_STEPS = 100
_ACCURACY = 1e-6


@dataclass(frozen=True, slots=True)
class MixedStudent:
    """A symmetric error about zero: weights and scales (G,) of Student t distributions, freedom of 2 at least."""

    weights: NDArray[np.float64]
    scales: NDArray[np.float64]
    freedom: int

    def half_width(self, probability: float) -> float:
        """The error that is not exceeded, sign counted, with this probability above 0.5."""
        quantile = float(stdtrit(self.freedom, probability))
        least, start = float(self.scales.min()) * quantile, float(product(self.weights, self.scales)) * quantile
        return _quantile(self.weights, self.scales, self.freedom, probability, least, start)

    @property
    def standard(self) -> float:
        """The standard error without the uncertainty of it: the weighted median of the scales."""
        order = np.argsort(self.scales)
        share = np.cumsum(self.weights[order])
        return float(self.scales[order][np.searchsorted(share, 0.5)])


@compiled
def _quantile(
    weights: NDArray[np.float64],
    scales: NDArray[np.float64],
    freedom: int,
    probability: float,
    least: float,
    start: float,
) -> float:
    """By Newton's steps. Above zero the distribution is concave: they end below from above, and stay below."""
    error = start
    peak = math.exp(math.lgamma((freedom + 1) / 2) - math.lgamma(freedom / 2)) / math.sqrt(math.pi * freedom)
    for _ in range(_MAX_STEPS):
        cosines = 1 / np.sqrt(1 + (error / scales) ** 2 / freedom)
        inside = _half_inside(cosines, freedom)
        missing, density = probability - 0.5, 0.0
        for shape in range(len(scales)):
            missing -= weights[shape] * inside[shape]
            density += weights[shape] / scales[shape] * cosines[shape] ** (freedom + 1)
        step = missing / (peak * density)
        error = max(error + step, least)
        if abs(step) < _ACCURACY * error:
            break
    return error


@compiled_part
def _half_inside(cosines: NDArray[np.float64], freedom: int) -> NDArray[np.float64]:
    """P(0 < T < t) for cosine = 1 / sqrt(1 + t^2 / freedom): Abramowitz & Stegun, 26.7.3 (odd) and 26.7.4 (even).

    Term by term for all of them, which the processor does several at once.
    """
    sines = np.sqrt(1 - cosines**2)
    is_odd = freedom % 2
    squares = cosines**2
    terms = cosines.copy() if is_odd else np.ones(len(cosines))
    totals = np.zeros(len(cosines))
    for below in range(2 + is_odd, freedom + 1, 2):
        for shape in range(len(cosines)):
            totals[shape] += terms[shape]
            terms[shape] *= squares[shape] * (below - 1) / below
    return (np.arccos(cosines) + sines * totals) / math.pi if is_odd else sines * totals / 2
