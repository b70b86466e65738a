"""The frames that one figure or share needs until it is decided.

A PASS asks that a figure and its uncertainty keep the limit (gse.statistics.decision), so that a session must be long
enough for what the sensor is expected to do. Errors are simulated as a bias with noise of exponential correlation and
judged by the functions of the verdict; beyond MAX_SIMULATED independent values the uncertainty goes as one over the
root of the length. The generator starts from a constant: the same question has the same answer.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrik, betaincinv, ndtr, ndtri

from gse.statistics.decision import (
    COVERAGE_FACTOR,
    PROBABILITY,
    Row,
    further_share,
    lengths_to_pass,
)
from gse.statistics.sampling import MIN_FRAMES, error_bounds
from gse.values.matrices import straight_line

SESSIONS, SETTLING_SESSIONS = 120, 400
"""To search for the length, and for each of those about it: of 120 sessions nine in ten are known to 2.7 % only."""
MAX_SIMULATED = 400

NEVER = math.inf
"""Minutes, or lengths of a session, after which a row is decided that no length of session decides."""

_SEED = 1
_FIRST_N_EFF = 60.0
_LEAST_N_EFF = 10.0
_PER_INDEPENDENT = 60.0
"""Simulated frames in the time of one independent value: more change nothing; eight make a plan a quarter too short."""
_MAX_STEPS = 10
_CLOSE = 0.08
_MOST_STRETCH = 2.0
"""Largest stretch in one step; the rare session with very wide bounds does not become longer by scaling."""
_LAST_STRETCH = 1e6
_ABOUT = np.array([0.85, 1.0, 1.2])
_HALVINGS = 40
_MAX_FRAMES = 1_000_000
_RISK = 0.05


@dataclass(frozen=True, slots=True)
class Expected:
    """What a sensor is expected to do on one axis: bias, standard deviation, integrated autocorrelation time.

    ``tau_s`` is that of AxisStatistics: zero for white noise, twice the time constant of an exponential correlation.
    """

    bias_arcsec: float
    noise_arcsec: float
    tau_s: float
    frames_per_s: float

    @property
    def frames_per_value(self) -> float:
        """Frames that one independent value takes."""
        return max(self.tau_s * self.frames_per_s, 1.0)


def accuracy_frames(expected: Expected, limit_arcsec: float, *, truth_arcsec: float) -> int | None:
    """Frames after which mean and 95th percentile of the absolute error pass with PROBABILITY; None: never.

    ``truth_arcsec`` is the standard uncertainty of truth.
    """
    if max(_true_statistics(expected)) + COVERAGE_FACTOR * truth_arcsec >= limit_arcsec:
        return None
    n_eff = _settled(_independent_values(expected, limit_arcsec, truth_arcsec), expected, limit_arcsec, truth_arcsec)
    return max(math.ceil(n_eff * expected.frames_per_value), MIN_FRAMES)


def _settled(n_eff: float, expected: Expected, limit_arcsec: float, truth_arcsec: float) -> float:
    """The length found, or a longer one after which PROBABILITY of more sessions pass, by a line through their shares.

    With few independent values some sessions have very wide bounds, and the share grows slowly with the length.
    """
    if n_eff > MAX_SIMULATED:
        return n_eff
    lengths, shares = n_eff * _ABOUT, []
    for length in lengths.tolist():
        made = _simulate(expected, length, SETTLING_SESSIONS)
        shares.append(float(_passes(made.values, made.guards, limit_arcsec, truth_arcsec).mean()))
    least = 0.5 / SETTLING_SESSIONS
    slope, at = straight_line(np.log(lengths), ndtri(np.clip(shares, least, 1 - least)))
    asked = math.exp((float(ndtri(PROBABILITY)) - at) / slope) if slope > 0 else n_eff
    return min(max(asked, n_eff), float(lengths[-1]))


def _independent_values(expected: Expected, limit_arcsec: float, truth_arcsec: float) -> float:
    """Independent values that a session needs: between the longest failing length and the shortest passing one."""
    failing, passing, n_eff = _LEAST_N_EFF / _MOST_STRETCH, math.inf, _FIRST_N_EFF
    for _ in range(_MAX_STEPS):
        most = _MOST_STRETCH if n_eff < MAX_SIMULATED else _LAST_STRETCH
        needed = n_eff * _stretch(_simulate(expected, n_eff), expected, limit_arcsec, truth_arcsec, most=most)
        failing, passing = (n_eff, passing) if needed > n_eff else (failing, n_eff)
        beyond = max(needed, n_eff) <= _LEAST_N_EFF or needed > n_eff >= MAX_SIMULATED
        if beyond or abs(math.log(needed / n_eff)) < _CLOSE:
            return needed
        if math.log(passing / failing) < _CLOSE:
            break
        inside = failing < needed < passing
        n_eff = float(np.clip(needed if inside else math.sqrt(failing * passing), _LEAST_N_EFF, MAX_SIMULATED))
    return passing


def availability_frames(expected: float, limit: float, *, frames_per_value: float = 1.0) -> int | None:
    """Frames after which the lower bound (one-sided 95 %, Clopper & Pearson) of the availability keeps its limit.

    With PROBABILITY, for an expected availability of independent frames, or of runs of ``frames_per_value``; None where
    the limit is not below what is expected.
    """
    numbers = np.unique(np.geomspace(1, _MAX_FRAMES, 4000).astype(np.int64))
    passing = np.flatnonzero([_availability_passes(int(number), expected, limit) for number in numbers])
    return math.ceil(numbers[passing[0]] * frames_per_value) if len(passing) else None


def false_answer_frames(limit: float) -> int:
    """Frames without one false answer after which their share is below a limit with 95 %."""
    return math.ceil(math.log(_RISK) / math.log1p(-limit))


def simulated_errors(expected: Expected, n: int, sessions: int, generator: np.random.Generator) -> NDArray[np.float64]:
    """Errors (sessions, n) of what is expected: an autoregressive process of first order about the bias."""
    noise = generator.standard_normal((n, sessions))
    kept = (expected.frames_per_value - 1) / (expected.frames_per_value + 1)
    new = math.sqrt(1 - kept**2)
    for frame in range(1, n):
        noise[frame] = kept * noise[frame - 1] + new * noise[frame]
    return np.ascontiguousarray(expected.bias_arcsec + expected.noise_arcsec * noise.T)


@dataclass(frozen=True, slots=True)
class _Simulated:
    """Of each session (S, 2): mean and 95th percentile of the absolute errors, and the distances to their bounds."""

    values: NDArray[np.float64]
    guards: NDArray[np.float64]


def _simulate(expected: Expected, n_eff: float, sessions: int = SESSIONS) -> _Simulated:
    noise = expected.noise_arcsec or 1.0
    coarse = min(expected.frames_per_value, _PER_INDEPENDENT)
    unit = _simulate_unit(expected.bias_arcsec / noise, expected.noise_arcsec > 0, coarse, n_eff, sessions)
    return _Simulated(noise * unit.values, noise * unit.guards)


@functools.lru_cache(maxsize=64)
def _simulate_unit(bias: float, noisy: bool, frames_per_value: float, n_eff: float, count: int) -> _Simulated:
    """With noise of 1: axes that differ in scale only share their sessions."""
    expected = Expected(bias, float(noisy), frames_per_value, 1.0)
    n = max(round(n_eff * frames_per_value), MIN_FRAMES)
    sessions = simulated_errors(expected, n, count, np.random.default_rng(_SEED + count - SESSIONS))
    values, guards = [], []
    for errors in sessions:
        bounds, absolute = error_bounds(errors), np.abs(errors)
        both = float(absolute.mean()), float(np.percentile(absolute, 95))
        values.append(both)
        guards.append((bounds.mean_abs.upper - both[0], bounds.p95_abs.upper - both[1]))
    return _Simulated(np.array(values), np.array(guards))


def _stretch(simulated: _Simulated, expected: Expected, limit: float, truth: float, *, most: float) -> float:
    """By how much longer or shorter sessions must be for PROBABILITY, by the root of their length."""
    true = np.array(_true_statistics(expected))
    low, high = most**-0.5, most**0.5
    for _ in range(_HALVINGS):
        scale = math.sqrt(low * high)
        values = true + scale * (simulated.values - true)
        passing = float(_passes(values, scale * simulated.guards, limit, truth).mean())
        low, high = (scale, high) if passing >= PROBABILITY else (low, scale)
    return float(low**-2)


def _passes(values: NDArray[np.float64], guards: NDArray[np.float64], limit: float, truth: float) -> NDArray[np.bool_]:
    """Which sessions (S,) keep the limit with both figures (S, 2)."""
    return np.asarray((values + np.hypot(guards, COVERAGE_FACTOR * truth) <= limit).all(axis=1))


def _true_statistics(expected: Expected) -> tuple[float, float]:
    """Mean and 95th percentile of the absolute value of a normal quantity."""
    bias, noise = abs(expected.bias_arcsec), expected.noise_arcsec
    if noise == 0:
        return bias, bias
    mean = noise * math.sqrt(2 / math.pi) * math.exp(-((bias / noise) ** 2) / 2)
    mean += bias * math.erf(bias / noise / math.sqrt(2))
    low, high = bias, bias + 2 * noise
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        within = float(ndtr((middle - bias) / noise) - ndtr((-middle - bias) / noise))
        low, high = (middle, high) if within < 1 - _RISK else (low, middle)
    return mean, high


def _availability_passes(n: int, expected: float, limit: float) -> bool:
    """Whether PROBABILITY of the sessions of n frames have enough answers."""
    missing = math.ceil(bdtrik(PROBABILITY, n, 1 - expected)) if expected < 1 else 0
    return bool(betaincinv(n - missing, missing + 1, _RISK) >= limit)  # NaN where all are missing


def figure_times(row: Row) -> float:
    """Further lengths of the session after which a figure is decided."""
    return further_share(row.limit - row.value, _sampling(row), row.truth_uncertainty, row.n_eff)


def figure_length(row: Row) -> float:
    """The length of another session like the one of a row, in that, after which its figure passes."""
    return lengths_to_pass(row.limit - row.value, _sampling(row), row.truth_uncertainty, row.n_eff)


def _sampling(row: Row) -> float:
    if math.isnan(row.uncertainty) or math.isinf(row.truth_uncertainty):
        return row.uncertainty
    return math.sqrt(max(row.uncertainty**2 - (COVERAGE_FACTOR * row.truth_uncertainty) ** 2, 0.0))
