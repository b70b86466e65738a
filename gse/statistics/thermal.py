"""Thermo-elastic error: how the attitude error follows the sensor's temperature, in arcsec per kelvin.

ECSS-E-ST-60-20C Rev.2 counts it among the bias and low-frequency errors. A straight drift in time is fitted beside the
temperature, so that a mount that sinks is not taken for it; where the temperature itself only drifts, the two cannot be
told apart and the interval says so. The interval respects autocorrelation: block means, Student's t.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from gse.matrices import pinv, product

BLOCKS = 32
"""Means of so many equal parts of the session are fitted; their residuals' correlation widens the interval."""
MIN_FRAMES = 60
RESOLUTION_K = 0.1
"""A temperature that moved by less than five of these tells nothing."""
_STEPS = 5


@dataclass(frozen=True, slots=True)
class ThermalError:
    """Arcsec per kelvin of one axis with its 95 % interval, and the range of the temperature in K."""

    arcsec_per_k: float
    low_arcsec_per_k: float
    high_arcsec_per_k: float
    range_k: float


def thermal_error(
    utc_ns: NDArray[np.int64],
    error_arcsec: NDArray[np.float64],
    temperature_c: NDArray[np.floating],
    *,
    resolution_k: float = RESOLUTION_K,
) -> ThermalError | None:
    """Of errors (M,) at instants (M,) and temperatures (M,); None where the temperature did not move, or is unknown."""
    known = np.isfinite(temperature_c) & np.isfinite(error_arcsec)
    if known.sum() < MIN_FRAMES:
        return None
    parts = np.array_split(np.flatnonzero(known), min(BLOCKS, int(known.sum()) // 5))
    error = np.array([float(np.mean(error_arcsec[rows])) for rows in parts])
    temperature = np.array([float(np.mean(temperature_c[rows].astype(np.float64))) for rows in parts])
    time_s = np.array([float(np.mean((utc_ns[rows] - utc_ns[0]) / 1e9)) for rows in parts])
    if np.ptp(temperature) < _STEPS * resolution_k or np.ptp(time_s) == 0:
        return None
    time = (time_s - time_s.mean()) / np.ptp(time_s)
    design = np.column_stack([np.ones_like(time), time, temperature - temperature.mean()])
    inverse = pinv(product(design.T, design))
    fit = product(inverse, product(design.T, error))
    left = error - product(design, fit)
    widening = _widening(left)
    freedom = max(len(error) / widening - design.shape[1], 1.0)
    variance = float(product(left, left)) / (len(error) - design.shape[1]) * widening * float(inverse[2, 2])
    half = float(stdtrit(freedom, 0.975)) * math.sqrt(variance)
    slope = float(fit[2])
    return ThermalError(slope, slope - half, slope + half, float(np.ptp(temperature)))


def _widening(left: NDArray[np.float64]) -> float:
    """By how much correlation of first order makes the variance of a slow regressor's coefficient larger."""
    total = float(product(left, left))
    share = float(product(left[1:], left[:-1])) / total if total > 0 else 0.0
    # The residuals of a fit show less correlation than the errors have (Kendall 1954).
    share = min(max(share + (1 + 4 * share) / len(left), 0.0), 0.9)
    return (1 + share) / (1 - share)
