"""Likelihood of models that compete for the errors of a session: angles over time and residuals over the field.

A model is a sum of columns; each predicts the mean of the three error angles, their cosine ordinates and the parameters
of the field. Noise of the angles has, on each axis, the spectrum of white noise with or without a part of exponential
correlation, of any strength and time, integrated over its scale and weighted by its likelihood under the model: a slow
cause is believed only where slow noise does not explain it as well. The mean is then a Student t with the spectrum at
zero, and what single stars keep (gse.values.star_influence) added; the field is one with the stars' own scatter.
Columns are fitted by expectation maximisation over the spectra. A model's score is twice its logarithm of likelihood
less PENALTY for each column and the logarithm of the number of places that were searched (as in the Bayesian
information criterion of Schwarz 1978 for 150 values: with the frame rate the penalty would grow, and with it what is
missed).
"""

import functools
import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gse.values.matrices import inv, log_det, lstsq, pinv, product, solve, weighted_sums

PENALTY = 5.0
_TIMES = np.geomspace(0.3, 600.0, 16)
"""Lengths of the session in correlation times."""
_STRENGTHS = np.array([0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 3e3, 1e4, 1e5, 1e6])
_WHITE_PRIOR = 0.5
_ROUNDS = 12
_SETTLED = 1e-3
_RIDGE = 1e-12
_TINY = 1e-300


@dataclass(frozen=True, slots=True, eq=False)
class Observed:
    """What models compete for, the angles in coordinates in which their noise is independent and alike.

    ``frames`` is their number, ``mean`` (3,) with the covariance ``lasting`` (3, 3) of what stars keep, ``cosines``
    (K, 3); ``normal`` (F, F) and ``right`` (F,) are normal equations of the field, with ``freedom`` (0: no field).
    """

    frames: int
    mean: NDArray[np.float64]
    lasting: NDArray[np.float64]
    cosines: NDArray[np.float64]
    normal: NDArray[np.float64]
    right: NDArray[np.float64]
    freedom: float


@dataclass(frozen=True, slots=True, eq=False)
class Predictions:
    """Predictions of P columns: ``mean`` (3, P), ``cosines`` (K, 3, P), ``field`` (F, P), each per unit."""

    mean: NDArray[np.float64]
    cosines: NDArray[np.float64]
    field: NDArray[np.float64]

    def __add__(self, other: Self) -> "Predictions":
        """Both side by side."""
        pairs = ((getattr(self, name), getattr(other, name)) for name in ("mean", "cosines", "field"))
        return Predictions(*(np.concatenate(pair, axis=-1) for pair in pairs))

    @property
    def count(self) -> int:
        """P."""
        return int(self.mean.shape[-1])


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """Coefficients (P,) with their covariance (P, P), and twice the logarithm of the likelihood."""

    coefficients: NDArray[np.float64]
    covariance: NDArray[np.float64]
    twice_log_likelihood: float
    precision: NDArray[np.float64]


def fitted(observed: Observed, columns: Predictions) -> Fitted:
    """Fit columns to what was observed, from slow and from white noise on: there may be a maximum on either side."""
    slow = _unexplained(observed)
    if not columns.count:
        return Fitted(np.zeros(0), np.zeros((0, 0)), slow.log, slow.precision)
    white = replace(slow, precision=white_precision(observed.cosines))
    coefficients, state = max(
        (_climbed(observed, columns, start) for start in (slow, white)), key=lambda end: end[1].log
    )
    normal, _ = _equations(observed, columns, state)
    scale = np.sqrt(np.maximum(np.diag(normal), _TINY))
    covariance = pinv(normal / scale[:, None] / scale, rcond=1e-10) / scale[:, None] / scale
    return Fitted(coefficients, covariance, state.log, state.precision)


def by_its_noise(without: NDArray[np.float64], left: NDArray[np.float64]) -> float:
    """Twice the log likelihood that is gained ``without`` a cause (K, 3) by the noise that is ``left`` (K, 3) with it.

    The prior is spread over all shapes of slow noise, and the right one pays for that. Slow noise that is left with the
    cause is in the session anyway: without the cause its shape is believed as much. White noise gains nothing.
    """
    _, _, _, _, prior = _shapes(len(left))
    with_cause = prior[:, None] + _of_shapes(left)[0]
    believed = np.maximum(prior[:, None], with_cause - _log_sum(with_cause))
    likelihood = _of_shapes(without)[0]
    return 2 * float((_log_sum(believed + likelihood) - _log_sum(prior[:, None] + likelihood)).sum())


def white_precision(cosines: NDArray[np.float64]) -> NDArray[np.float64]:
    """Inverse variances (K, 3) as if all noise were that of the upper half of the ordinates."""
    upper = cosines[len(cosines) // 2 :]
    return np.broadcast_to(1 / np.maximum((upper**2).mean(axis=0), 1e-12), cosines.shape)


def _climbed(observed: Observed, columns: Predictions, state: "_State") -> tuple[NDArray[np.float64], "_State"]:
    for _ in range(_ROUNDS):
        normal, right = _equations(observed, columns, state)
        scale = np.sqrt(np.maximum(np.diag(normal), _TINY))
        ridged = normal / scale[:, None] / scale + _RIDGE * np.eye(columns.count)
        coefficients = solve(ridged, right / scale) / scale
        before, state = state, _state(observed, columns, coefficients)
        if abs(state.log - before.log) < _SETTLED:
            break
    return coefficients, state


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    """Weights of the next least squares, and twice the log likelihood, under some coefficients."""

    precision: NDArray[np.float64]
    of_mean: NDArray[np.float64]
    of_field: float
    log: float


@functools.lru_cache(maxsize=2)
def _unexplained(observed: Observed) -> _State:
    """The state without any column, from which each fit begins."""
    none = Predictions(*(np.zeros((*of.shape, 0)) for of in (observed.mean, observed.cosines, observed.right)))
    return _state(observed, none, np.zeros(0))


def _state(observed: Observed, columns: Predictions, coefficients: NDArray[np.float64]) -> _State:
    precision, mean_variance, log = _spectra(observed.cosines - product(columns.cosines, coefficients), observed.frames)
    left = observed.mean - product(columns.mean, coefficients)
    covariance = np.diag(mean_variance) + observed.lasting
    freedom = len(observed.cosines)
    inverse = inv(covariance)
    square_of_mean = float(product(left, inverse, left))
    log += -log_det(covariance) - (freedom + 3) * math.log1p(square_of_mean / freedom)
    of_field = 0.0
    if observed.freedom:
        at = product(columns.field, coefficients)
        square = _field_square(observed, at)
        count = observed.freedom + len(observed.right)
        log -= count * math.log1p(square / observed.freedom)
        of_field = count / (observed.freedom + square)
    return _State(precision, inverse * ((freedom + 3) / (freedom + square_of_mean)), of_field, log)


def _field_square(observed: Observed, at: NDArray[np.float64]) -> float:
    """By how much the parameters of the field differ from what the residuals say, in their own scatter, squared."""
    scale, normal, best = _field_alone(observed)
    off = best - at * scale
    return max(float(product(off, normal, off)), 0.0)


@functools.lru_cache(maxsize=2)
def _field_alone(observed: Observed) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Scales (F,), the normal equations (F, F) in them, and what these say of the parameters (F,) without a model."""
    scale = np.sqrt(np.diag(observed.normal))
    normal = observed.normal / scale[:, None] / scale
    best = lstsq(normal, observed.right / scale, rcond=1e-9)
    return scale, normal, np.asarray(best, dtype=np.float64)


def forget_observed() -> None:
    """Drop the errors that were fitted last."""
    _unexplained.cache_clear()
    _field_alone.cache_clear()


def _equations(
    observed: Observed, columns: Predictions, state: _State
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    weighted = columns.cosines * state.precision[:, :, None]
    of_mean, of_field = product(columns.mean.T, state.of_mean), state.of_field * columns.field.T
    normal = np.einsum("kap,kaq->pq", weighted, columns.cosines) + product(of_mean, columns.mean)
    right = np.einsum("kap,ka->p", weighted, observed.cosines) + product(of_mean, observed.mean)
    if observed.freedom:
        normal += product(of_field, observed.normal, columns.field)
        right += product(of_field, observed.right)
    return normal, right


def _spectra(left: NDArray[np.float64], frames: int) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Expected inverse variances (K, 3) of the ordinates, variances (3,) of the mean, twice the log likelihood."""
    first, inverse, _, _, prior = _shapes(len(left))
    log_likelihood, sums = _of_shapes(left)
    log = _log_sum(prior[:, None] + log_likelihood)
    weight = np.exp(prior[:, None] + log_likelihood - log)
    precision = weighted_sums(inverse, weight * len(left) / sums)
    mean_variance = (weight * sums / len(left) * first).sum(axis=0) / frames
    return precision, mean_variance, 2 * float(log.sum())


def _of_shapes(left: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Log likelihood (G, 3) of ordinates (K, 3) under each shape, its scale left open, and the sums (G, 3) in it."""
    _, _, by_place, log_spectra, _ = _shapes(len(left))
    sums = weighted_sums(by_place, left**2 + 1e-9 * left.var(axis=0) + 1e-12)
    return -0.5 * log_spectra[:, None] - 0.5 * len(left) * np.log(sums), sums


def _log_sum(logs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Logarithms (3,) of the sums of what has the logarithms (G, 3)."""
    greatest = logs.max(axis=0)
    return np.asarray(greatest + np.log(np.exp(logs - greatest).sum(axis=0)))


@functools.lru_cache(maxsize=8)
def _shapes(ordinates: int) -> tuple[NDArray[np.float64], ...]:
    """Spectra at zero (G, 1), inverses of the others (G, K) and (K, G), sums (G,) of their logs, the log prior (G,)."""
    places = np.arange(ordinates + 1)
    correlated = [1 + much * exponential_spectrum(time, places) for time in _TIMES for much in _STRENGTHS]
    spectra = np.vstack([np.ones(ordinates + 1), np.array(correlated)])
    prior = np.full(len(spectra), (1 - _WHITE_PRIOR) / len(correlated))
    prior[0] = _WHITE_PRIOR
    inverse = 1 / spectra[:, 1:]
    by_place = np.ascontiguousarray(inverse.T)
    return spectra[:, :1], inverse, by_place, np.log(spectra[:, 1:]).sum(axis=1), np.log(prior)


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
