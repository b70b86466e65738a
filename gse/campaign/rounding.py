"""Pixel phase error of a sensor that sends whole pixels: what is left of its residuals without the rounding.

A star at the phase p (px, from -0.5 to 0.5) is put on the pixel round(p + e(p) + n), with the sensor's own error
e = a sin(2 pi p) + b cos(2 pi p) and noise n of s px. So the mean residual at a phase is the mean of that pixel less p:
a saw tooth that s smooths and e bends. Its first two harmonics and the mean square of the residuals give a, b and s.
The phases come from the attitude fitted to the other stars of the frame, whose error smooths the harmonics further.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import ndtr

SQUARES_UNCERTAINTY = 0.03
"""Of the mean square, standard and relative: the noise differs from star to star."""
_GRID = 128
_PHASES = (np.arange(_GRID) + 0.5) / _GRID - 0.5
_PIXELS = np.arange(-4, 5)
_WAVES = np.stack([wave(2 * math.pi * k * _PHASES) for k in (1, 2) for wave in (np.sin, np.cos)])
_LEAST_NOISE_PX = 0.02
_FITTED_ANGLES = 1.5
"""The three angles of a frame have the error of so many of its n stars' values along an axis, over n."""


@dataclass(frozen=True, slots=True)
class Harmonics:
    """Amplitudes of sin and cos of one, two ... periods on a pixel, px, with their covariance."""

    values: NDArray[np.float64]
    covariance: NDArray[np.float64]


def without_rounding(found: Harmonics, mean_square_px2: float, stars_per_frame: float) -> Harmonics:
    """The sensor's own first harmonic, from the first two of its residuals and their mean square."""
    weights = np.linalg.cholesky(np.linalg.inv(_regular(found.covariance))).T

    def misfit(wanted: NDArray[np.float64]) -> NDArray[np.float64]:
        harmonics, square = _expected(wanted, stars_per_frame)
        apart = weights @ (found.values - harmonics)
        return np.append(apart, (mean_square_px2 / square - 1) / SQUARES_UNCERTAINTY)

    start = [0.0, 0.0, math.sqrt(max(mean_square_px2 - 1 / 12, 2 * _LEAST_NOISE_PX**2))]
    best = least_squares(misfit, start, bounds=([-1, -1, _LEAST_NOISE_PX], [1, 1, 3]))
    jacobian = np.asarray(best.jac)
    covariance = np.linalg.pinv(jacobian.T @ jacobian)
    freedom = len(best.fun) - 3
    stretched = max(2 * best.cost / freedom, 1.0)  # a model that does not fit says less
    return Harmonics(best.x[:2], covariance[:2, :2] * stretched)


def _expected(wanted: NDArray[np.float64], stars_per_frame: float) -> tuple[NDArray[np.float64], float]:
    """First two harmonics of the mean residual, as observed, and the mean square of a residual, px."""
    sine, cosine, noise_px = wanted
    before = _PHASES + sine * _WAVES[0] + cosine * _WAVES[1]
    share = ndtr((_PIXELS[:, None] + 0.5 - before) / noise_px) - ndtr((_PIXELS[:, None] - 0.5 - before) / noise_px)
    mean = _PIXELS @ share - _PHASES
    square = float((((_PIXELS[:, None] - _PHASES) ** 2) * share).sum(axis=0).mean())
    attitude_px2 = _FITTED_ANGLES * square / stars_per_frame
    smoothing = np.exp(-2 * math.pi**2 * attitude_px2 * np.array([1, 1, 4, 4]))
    return 2 * (_WAVES @ mean) / _GRID * smoothing, square + attitude_px2


def _regular(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """With a ten-thousandth of a pixel in each, so that it can be inverted."""
    return np.asarray(covariance + 1e-8 * np.eye(len(covariance)))
