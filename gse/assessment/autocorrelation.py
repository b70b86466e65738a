"""The uncertainty of a mean of correlated values.

The variance of the mean of a stationary series is its spectrum at frequency zero divided by the number of values. It
is estimated from the lowest ORDINATES of the series' cosine transform, which are independent and nearly normal, each
with the spectrum at its own low frequency as variance (Müller & Watson 2008, Econometrica 76, 979). The spectrum
between them and zero is not known: a plain average of the ordinates (Lazarus, Lewis, Stock & Watson 2018, JBES 36,
541) takes it to be flat and gives intervals too narrow wherever the correlation time is more than a hundredth of the
session. Here it is white noise or white noise with a part of exponential correlation, of any strength and of any
correlation time between a hundredth and fifty times the session (as in Müller 2014, JBES 32, 311). Each of these
shapes, with its scale integrated out, predicts the mean as a Student t; weighted by its likelihood and a fixed prior
they give a mixture of t distributions, whose quantiles are the bounds. A session of few correlation times thereby
gets wide bounds instead of narrow ones, and nothing is drawn at random. The prior was chosen by measured coverage:
benchmarks/sampling.py.

Frames count by their order: a gap is closed, irregular steps are taken as equal.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr

ORDINATES = 32
"""More would separate short correlation times from white noise, but would ask more of the shape."""

_BLOCKS = 1024
"""Sums that the cosines are taken over; at the highest ordinate this changes an amplitude by 4e-4."""
_TIMES = np.geomspace(0.05, 300.0, 20)
"""Lengths of the session in exponential correlation times."""
_STRENGTHS = np.array([0.3, 1.0, 3.0, 10.0, 100.0, 1e6])
"""Spectrum of the correlated part at zero, in that of the white part."""
_NEGLIGIBLE = 1e-9
"""Shapes of less weight, in that of the likeliest, are left out."""
_WHITE_PRIOR = 0.5
_PRIOR_POWER = -0.5
"""The prior of a shape with correlated part goes as its time in _TIMES to this power."""


@dataclass(frozen=True, slots=True)
class MixedStudent:
    """A symmetric error about zero: a mixture of Student t distributions, as weights and scales (G,)."""

    weights: NDArray[np.float64]
    scales: NDArray[np.float64]
    freedom: int

    def half_width(self, probability: float) -> float:
        """The error that is not exceeded, sign counted, with this probability above 0.5."""
        low, high = float(self.scales.min()) * 1e-3, float(self.scales.max()) * 1e3
        while high > low * (1 + 1e-7):
            middle = math.sqrt(low * high)
            below = float(self.weights @ stdtr(self.freedom, middle / self.scales))
            low, high = (middle, high) if below < probability else (low, middle)
        return high

    @property
    def standard(self) -> float:
        """The standard error without the uncertainty of it: the weighted median of the scales."""
        order = np.argsort(self.scales)
        share = np.cumsum(self.weights[order])
        return float(self.scales[order][min(int(np.searchsorted(share, 0.5)), len(order) - 1)])


@dataclass(frozen=True, slots=True)
class _Shapes:
    """Spectra (G, ORDINATES + 1) at the places 0, 1, ... of the cosines, and the logarithm of the prior (G,)."""

    spectra: NDArray[np.float64]
    log_prior: NDArray[np.float64]


def mean_error(values: NDArray[np.float64]) -> MixedStudent:
    """The error of the mean of values (M,), not all the same, M > 8, in their order."""
    amplitudes = cosines(values - values.mean())
    shapes = _shapes()
    places = slice(1, len(amplitudes) + 1)
    weights, scales = _posterior(amplitudes, shapes.spectra[:, places], shapes.log_prior)
    return _mixed(weights, scales * np.sqrt(shapes.spectra[:, 0] / len(values)), len(amplitudes))


def weighted_sum_error(weights: NDArray[np.float64], residuals: NDArray[np.float64]) -> MixedStudent:
    """The error of the sum of weights (M,) times values whose residuals (M,) from a straight line are given.

    For a slope: its weights are nearly the first cosine, which the line has taken out of the residuals, so that the
    ordinates from the second on tell the spectrum.
    """
    amplitudes, factors = cosines(residuals)[1:], cosines(weights)
    shapes = _shapes()
    last = len(factors)
    spectra = shapes.spectra[:, 1 : last + 1]
    variance = spectra @ factors**2 + spectra[:, -1] * max(float(weights @ weights - factors @ factors), 0.0)
    posterior, scales = _posterior(amplitudes, spectra[:, 1:], shapes.log_prior)
    return _mixed(posterior, scales * np.sqrt(variance), len(amplitudes))


def _mixed(weights: NDArray[np.float64], scales: NDArray[np.float64], freedom: int) -> MixedStudent:
    return MixedStudent(weights[weights > 0], scales[weights > 0], freedom)


def cosines(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The first ORDINATES (at most M / 2) amplitudes of the cosine transform of values (M,), the mean left out.

    White noise has its own variance in each.
    """
    n = len(values)
    blocks = min(n, _BLOCKS)
    edges = np.linspace(0, n, blocks + 1).astype(np.int64)
    sums = np.add.reduceat(values, edges[:-1])
    middle = (edges[:-1] + edges[1:]) / (2 * n)
    places = np.arange(1, min(ORDINATES, n // 2) + 1)
    return np.asarray(math.sqrt(2 / n) * (np.cos(math.pi * places[:, None] * middle) @ sums))


def _posterior(
    amplitudes: NDArray[np.float64], spectra: NDArray[np.float64], log_prior: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Weight and scale (standard deviation at spectrum 1) of each shape, the scale with Jeffreys' prior."""
    count = len(amplitudes)
    squares = (1 / spectra) @ amplitudes**2
    log_weight = log_prior - 0.5 * np.log(spectra).sum(axis=1) - 0.5 * count * np.log(squares)
    weights = np.exp(log_weight - log_weight.max())
    weights[weights < _NEGLIGIBLE] = 0.0
    return weights / weights.sum(), np.sqrt(squares / count)


@functools.cache
def _shapes() -> _Shapes:
    places = np.arange(ORDINATES + 1)
    correlated = [_exponential(time, places) for time in _TIMES]
    spectra = np.array([np.ones(ORDINATES + 1), *(part + 1 / much for part in correlated for much in _STRENGTHS)])
    prior = np.repeat(_TIMES**_PRIOR_POWER, len(_STRENGTHS))
    prior *= (1 - _WHITE_PRIOR) / prior.sum()
    return _Shapes(spectra, np.log(np.concatenate([[_WHITE_PRIOR], prior])))


def _exponential(time: float, places: NDArray[np.int64]) -> NDArray[np.float64]:
    """Variances of the cosines (the mean at place 0) of a series with correlation exp(-time s) over s from 0 to 1.

    In units of the spectrum at zero of a long series: the double integral of correlation and cosines in closed form.
    """
    frequency = math.pi * places
    poles = time**2 + frequency**2
    ends = 1 - (-1.0) ** places * math.exp(-time)
    variance = time**2 / poles - 2 * time**3 * ends / poles**2
    variance[0] = 1 - (1 - math.exp(-time)) / time
    return np.asarray(variance)
