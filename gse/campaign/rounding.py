"""Pixel phase error of a sensor that sends whole pixels: what is left of its residuals without the rounding.

A star at the phase p (px, from -0.5 to 0.5) is put on the pixel round(p + e(p) + n), with the sensor's own error
e = a sin(2 pi p) + b cos(2 pi p) and noise n. So the mean residual at a phase is the mean of that pixel less p: a saw
tooth that the noise smooths and e bends. The noise follows, for a given e, from the mean square of the residuals; then
their first two harmonics give a and b. The phases come from the attitude fitted to the other stars of the frame, whose
error smooths the harmonics further.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import ndtr

from gse.matrices import cholesky, inv, pinv, product

SQUARES_UNCERTAINTY = 0.015
"""Of the mean square, standard and relative: outliers, and stars of different noise."""
_GRID = 64
_PHASES = (np.arange(_GRID) + 0.5) / _GRID - 0.5
_PIXELS = np.arange(-4, 5)[:, None]
_WAVES = np.stack([wave(2 * math.pi * k * _PHASES) for k in (1, 2) for wave in (np.sin, np.cos)])
_LEAST_NOISE_PX2 = 0.02**2
_FITTED_ANGLES = 1.5
"""The three angles of a frame have the error of so many of its n stars' values along an axis, over n."""
_TURNS = 4


@dataclass(frozen=True, slots=True)
class Harmonics:
    """Amplitudes of sin and cos of one, two ... periods on a pixel, px, with their covariance."""

    values: NDArray[np.float64]
    covariance: NDArray[np.float64]


def without_rounding(found: Harmonics, square_px2: float, stars_per_frame: float) -> Harmonics:
    """The sensor's own first harmonic, from the first two of its residuals and their mean square."""
    weights = cholesky(inv(found.covariance + 1e-8 * np.eye(len(found.covariance)))).T

    def misfit(wanted: NDArray[np.float64]) -> NDArray[np.float64]:
        expected = _expected(wanted[0], wanted[1], square_px2 * (1 + wanted[2]), stars_per_frame)
        return np.append(product(weights, found.values - expected), wanted[2] / SQUARES_UNCERTAINTY)

    best = least_squares(misfit, [0.0, 0.0, 0.0], bounds=([-0.5, -0.5, -0.2], [0.5, 0.5, 0.2]))
    jacobian = np.asarray(best.jac)
    covariance = pinv(product(jacobian.T, jacobian))
    stretched = max(2 * best.cost / (len(best.fun) - 3), 1.0)  # a model that does not fit says less
    return Harmonics(best.x[:2], covariance[:2, :2] * stretched)


def _expected(sine: float, cosine: float, square_px2: float, stars_per_frame: float) -> NDArray[np.float64]:
    """First two harmonics of the mean residual, as observed, px."""
    attitude_px2 = _FITTED_ANGLES * square_px2 / (stars_per_frame + _FITTED_ANGLES)
    before = _PHASES + sine * _WAVES[0] + cosine * _WAVES[1]
    smoothing = np.exp(-2 * math.pi**2 * attitude_px2 * np.array([1, 1, 4, 4]))
    return np.asarray(2 * product(_WAVES, _mean_residual(before, square_px2 - attitude_px2)) / _GRID * smoothing)


def _mean_residual(before: NDArray[np.float64], square_px2: float) -> NDArray[np.float64]:
    """Mean residual at each phase of stars whose residuals have this mean square."""
    noise_px2 = max(square_px2 - 1 / 12, _LEAST_NOISE_PX2)
    for _ in range(_TURNS):
        noise_px = math.sqrt(noise_px2)
        share = ndtr((_PIXELS + 0.5 - before) / noise_px) - ndtr((_PIXELS - 0.5 - before) / noise_px)
        square = float((((_PIXELS - _PHASES) ** 2) * share).sum(axis=0).mean())
        noise_px2 = max(noise_px2 + square_px2 - square, _LEAST_NOISE_PX2)
    return np.asarray((_PIXELS * share).sum(axis=0) - _PHASES)
