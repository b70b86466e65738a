"""The uncertainty of a mean of correlated values.

The variance of the mean of a stationary series is its spectrum at frequency zero divided by the number of values. It
is estimated from the lowest ORDINATES of the series' cosine transform, which are independent and nearly normal, each
with the spectrum at its own low frequency as variance (Müller & Watson 2008, Econometrica 76, 979). The spectrum
between them and zero is not known: a plain average of the ordinates (Lazarus, Lewis, Stock & Watson 2018, JBES 36,
541) takes it to be flat and gives intervals too narrow wherever the correlation time is more than a hundredth of the
session. Here the spectrum is white noise alone, or with a part of exponential correlation (as in Müller 2014, JBES
32, 311), of any strength and of any correlation time between twenty times and a three-hundredth of the session, or
with a sinusoid of random phase that has at least one cycle in the session, or with one change: a step, a ramp, a bend,
half a wave. The mean of a session with one change tells the mean of others as badly as one value would; without these
shapes a step in the middle or a ramp look like one whole wave, whose mean is known. Each shape, with its scale
integrated out, predicts the mean as a Student t; weighted by its likelihood and a fixed prior they give a mixture of
t distributions, whose quantiles are the bounds. A session of few correlation times thereby gets wide bounds instead
of narrow ones, and nothing is drawn at random. Refusing bounds below an effective number of one, or of ten, was tried
and rejected: the short sessions that look independent by chance are the ones left over, and of their bounds only half
held the true value; of all sessions' bounds 93 % and more do. Priors were chosen by measured coverage:
benchmarks/sampling.py.

Frames count by their order: a gap is closed, irregular steps are taken as equal.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from gse.process.jit import compiled, compiled_part
from gse.values.matrices import product

# A mixture of Student t distributions about zero: the error of an estimate whose scale is known by its likelihood.

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


ORDINATES = 32
"""More would separate short correlation times from white noise, but would ask more of the shape."""

_BLOCKS = 1024
"""Sums that the cosines are taken over; at the highest ordinate this changes an amplitude by 4e-4."""
_TIMES = np.geomspace(0.05, 300.0, 20)
"""Lengths of the session in exponential correlation times."""
_STRENGTHS = np.array([0.3, 1.0, 3.0, 10.0, 100.0, 1e6])
"""Spectrum of the correlated part at zero, in that of the white part."""
_CYCLES = np.arange(1.0, 12.1, 0.2)
"""Cycles of a sinusoid in the session; fewer are taken for slow noise, more lie beyond most of the ordinates."""
_PEAKS = np.array([3.0, 30.0, 300.0, 3000.0, 30_000.0])
"""Greatest ordinate of the sinusoid, in the spectrum of the white part. It is 1800 for an hour at 1 Hz with half of the
mean square in a sinusoid; a list that ends too early makes a strong sinusoid small."""
_STEPS = np.arange(0.1, 0.51, 0.1)
"""Places of a step in the session; from the end it has the same spectrum."""
_FLOOR = 1e-2
"""Least spectrum, in that of white noise of the same variance: a pattern that cancels to nothing in some of the sums
(a frame in fifty is lost, exactly) shows no contrast between these sums and the others."""
_NEGLIGIBLE = 1e-9
"""Shapes of less weight, in that of the likeliest, are left out."""
_WHITE_PRIOR = 0.5
_PRIOR_POWER = -0.5
"""The prior of a shape with exponential correlation goes as its time in _TIMES to this power."""
_SINUSOID_PRIOR = 0.1
_CHANGE_PRIOR = 0.05
_PHASES = 2000


@dataclass(frozen=True, slots=True)
class _Shapes:
    """Spectra (G, ORDINATES + 1) at the places 0, 1, ... of the cosines, and the logarithm of the prior (G,).

    The last of them are sinusoids of _CYCLES, each with _PEAKS, of which ``power`` (the mean square, times M) is given;
    before them are those with one change.
    """

    spectra: NDArray[np.float64]
    log_prior: NDArray[np.float64]
    power: NDArray[np.float64]


def mean_error(values: NDArray[np.float64]) -> MixedStudent:
    """The error of the mean of values (M,), not all the same, M > 8, in their order."""
    amplitudes = cosines(values - values.mean())
    squares = amplitudes**2 + _FLOOR * values.var()
    shapes = _shapes()
    weights, scales = _posterior(squares, 1)
    return _mixed(weights, scales * np.sqrt(shapes.spectra[:, 0] / len(values)), len(amplitudes))


def weighted_sum_error(weights: NDArray[np.float64], residuals: NDArray[np.float64]) -> MixedStudent:
    """The error of the sum of weights (M,) times values whose residuals (M,) from a straight line are given.

    For a slope: its weights are nearly the first cosine, which the line has taken out of the residuals, so that the
    ordinates from the second on tell the spectrum.
    """
    amplitudes, factors = cosines(residuals)[1:], cosines(weights)
    squares = amplitudes**2 + _FLOOR * residuals.var()
    shapes = _shapes()
    last = len(factors)
    spectra = shapes.spectra[:, 1 : last + 1]
    variance = product(spectra, factors**2) + spectra[:, -1] * max(
        float(product(weights, weights) - product(factors, factors)), 0.0
    )
    sinusoids = len(shapes.power)  # whose cosines are not independent
    variance[-sinusoids:] = product(weights, weights) + shapes.power / len(weights) * _response(weights)
    posterior, scales = _posterior(squares, 2)
    return _mixed(posterior, scales * np.sqrt(variance), len(amplitudes))


def _response(weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean square, over all phases, of the weighted sum of each sinusoid of mean square 1."""
    return np.repeat(np.abs(product(_waves(len(weights)), weights)) ** 2, len(_PEAKS))


@functools.lru_cache(maxsize=4)
def _waves(n: int) -> NDArray[np.complex128]:
    """Of _CYCLES (rows) at n values."""
    return np.asarray(np.exp(2j * math.pi * _CYCLES[:, None] * (np.arange(n) + 0.5) / n))


def _mixed(weights: NDArray[np.float64], scales: NDArray[np.float64], freedom: int) -> MixedStudent:
    return MixedStudent(weights[weights > 0], scales[weights > 0], freedom)


def cosines(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The first ORDINATES (at most M / 2) amplitudes of the cosine transform of values (M,), the mean left out.

    White noise has its own variance in each.
    """
    edges, basis = _basis(len(values))
    return np.asarray(math.sqrt(2 / len(values)) * product(basis, np.add.reduceat(values, edges)))


@functools.lru_cache(maxsize=4)
def _basis(n: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """First rows (B,) of the blocks, and cosines (ORDINATES, B) at their middles."""
    edges = np.linspace(0, n, min(n, _BLOCKS) + 1).astype(np.int64)
    middle = (edges[:-1] + edges[1:]) / (2 * n)
    places = np.arange(1, min(ORDINATES, n // 2) + 1)
    return edges[:-1], np.cos(math.pi * places[:, None] * middle)


def _posterior(squares: NDArray[np.float64], first: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Weight and scale (standard deviation at spectrum 1) of each shape, the scale with Jeffreys' prior.

    From squared amplitudes (C,) at the places ``first``, ``first`` + 1, ... of the cosines.
    """
    inverse, log_factor = _likelihood(first, len(squares))
    sums = product(inverse, squares)
    log_weight = log_factor - 0.5 * len(squares) * np.log(sums)
    weights = np.exp(log_weight - log_weight.max())
    weights[weights < _NEGLIGIBLE] = 0.0
    return weights / weights.sum(), np.sqrt(sums / len(squares))


@functools.lru_cache(maxsize=16)
def _likelihood(first: int, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Inverse spectra (G, count) from the place ``first`` on, and what the likelihood (G,) owes to shape and prior."""
    shapes = _shapes()
    spectra = shapes.spectra[:, first : first + count]
    return 1 / spectra, shapes.log_prior - 0.5 * np.log(spectra).sum(axis=1)


@functools.cache
def _shapes() -> _Shapes:
    places = np.arange(ORDINATES + 1)
    correlated = np.array([exponential_spectrum(time, places) + 1 / much for time in _TIMES for much in _STRENGTHS])
    waves = _sinusoids(_CYCLES, places)
    power = (_PEAKS / waves[:, 1:].max(axis=1)[:, None]).ravel()
    sinusoids = 1 + power[:, None] * np.repeat(waves, len(_PEAKS), axis=0)
    changes = 1 + (_PEAKS[:, None, None] * _changes(places)).reshape(-1, len(places))
    prior = np.repeat(_TIMES**_PRIOR_POWER, len(_STRENGTHS))
    prior *= (1 - _WHITE_PRIOR - _SINUSOID_PRIOR - _CHANGE_PRIOR) / prior.sum()
    others = [
        np.full(len(part), share / len(part))
        for part, share in ((changes, _CHANGE_PRIOR), (sinusoids, _SINUSOID_PRIOR))
    ]
    return _Shapes(
        np.vstack([np.ones(ORDINATES + 1), correlated, changes, sinusoids]),
        np.log(np.concatenate([[_WHITE_PRIOR], prior, *others])),
        power,
    )


def _changes(places: NDArray[np.int64]) -> NDArray[np.float64]:
    """Squares of the cosines (the mean at place 0) of one change, the greatest 1: steps, ramp, bend, half a wave.

    The mean is uncertain by twice the scatter that the change makes: nothing tells what comes before and after.
    """
    k = places[1:].astype(np.float64)
    steps = [np.sin(math.pi * k * place) ** 2 / k**2 for place in _STEPS]
    squares = np.array([*steps, (k % 2) / k**4, 1 / k**4, (k == 1).astype(np.float64)])
    squares /= squares.max(axis=1)[:, None]
    return np.column_stack([4 * squares.sum(axis=1), squares])


def exponential_spectrum(time: float, places: NDArray[np.int64]) -> NDArray[np.float64]:
    """Variances of the cosines (the mean at place 0) of a series with correlation exp(-time s) over s from 0 to 1.

    In units of the spectrum at zero of a long series: the double integral of correlation and cosines in closed form.
    """
    frequency = math.pi * places
    poles = time**2 + frequency**2
    ends = 1 - (-1.0) ** places * math.exp(-time)
    variance = time**2 / poles - 2 * time**3 * ends / poles**2
    variance[0] = 1 - (1 - math.exp(-time)) / time
    return np.asarray(variance)


def _sinusoids(cycles: NDArray[np.float64], places: NDArray[np.int64]) -> NDArray[np.float64]:
    """Variances of the cosines (the mean at place 0) of sinusoids (rows), by the sum.

    Each has a random phase and the mean square 1 / M.
    """
    place = (np.arange(_PHASES) + 0.5) / _PHASES
    basis = np.cos(math.pi * places[:, None] * place)
    size = np.where(places == 0, 1.0, 2.0)
    waves = (np.exp(2j * math.pi * number * place) / _PHASES for number in cycles)
    return np.array([size * np.abs(product(basis, wave)) ** 2 for wave in waves])
