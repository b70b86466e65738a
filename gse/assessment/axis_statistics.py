"""Figures of one error axis over time: bias, drift, low-frequency error, noise equivalent angle."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv, stdtrit

from gse.assessment.theil_sen import theil_sen

WINDOW_S = 20.0
"""The running mean over this time is called low-frequency; what is left over is noise. In 20 s a star crosses a few
pixels, so that the error of single pixels still counts as noise."""

_MAX_BLOCKS = 500
"""Medians that the robust slope is taken over: it compares each with each."""
_S_PER_H = 3600.0
_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class AxisStatistics:
    """One axis of the attitude error, in arcsec; NaN where there are too few frames for a figure.

    ``bias`` is the mean, with the half-width of its 95 % confidence interval from the scatter of block means, since
    neighbouring frames are not independent. ``std`` is about the mean, ``rms`` about zero. ``drift`` is the Theil-Sen
    slope with its 95 % interval. ``low_frequency`` is the standard deviation of the running mean over 20 s once bias
    and drift are taken away, ``nea`` the noise equivalent angle: the standard deviation of what the running mean
    leaves, and ``nea_successive`` the standard deviation of successive differences / sqrt(2); ``nea_low`` and
    ``nea_high`` bound ``nea`` (95 %, chi-square). ``p95_abs``, ``p99_abs``, ``max_abs`` are of the absolute values.
    """

    n: int
    bias_arcsec: float
    bias_error_arcsec: float
    std_arcsec: float
    three_sigma_arcsec: float
    rms_arcsec: float
    mean_abs_arcsec: float
    p95_abs_arcsec: float
    p99_abs_arcsec: float
    max_abs_arcsec: float
    drift_arcsec_per_h: float
    drift_low_arcsec_per_h: float
    drift_high_arcsec_per_h: float
    low_frequency_arcsec: float
    nea_arcsec: float
    nea_low_arcsec: float
    nea_high_arcsec: float
    nea_successive_arcsec: float


def axis_statistics(utc_ns: NDArray[np.int64], error_arcsec: NDArray[np.float64]) -> AxisStatistics:
    """The figures of errors (M,) at instants (M,) in order, all finite."""
    n = len(error_arcsec)
    if n == 0:
        return AxisStatistics(0, *[_NAN] * 17)
    time_s = (utc_ns - utc_ns[0]) / 1e9
    std = float(error_arcsec.std(ddof=1)) if n > 1 else _NAN
    slope, low, high = _drift(time_s, error_arcsec)
    smooth, count = _running_mean(time_s, error_arcsec)
    nea, freedom = _noise(error_arcsec - smooth, count)
    nea_low, nea_high = _chi_square_bounds(nea, freedom)
    if np.isfinite(slope):
        smooth -= (slope / _S_PER_H) * time_s
    return AxisStatistics(
        n,
        float(error_arcsec.mean()),
        _bias_error(time_s, error_arcsec),
        std,
        3 * std,
        float(np.sqrt((error_arcsec**2).mean())),
        *_absolute(error_arcsec),
        slope,
        low,
        high,
        float(smooth.std()) if time_s[-1] > 2 * WINDOW_S else _NAN,
        nea,
        nea_low,
        nea_high,
        _successive(time_s, error_arcsec),
    )


def _absolute(error: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """Mean, 95 %, 99 % and greatest of the absolute values."""
    absolute = np.abs(error)
    p95, p99 = (float(value) for value in np.percentile(absolute, [95, 99]))
    return float(absolute.mean()), p95, p99, float(absolute.max())


def _running_mean(
    time_s: NDArray[np.float64], error: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Mean over WINDOW_S about each instant, and how many frames it holds."""
    first = np.searchsorted(time_s, time_s - WINDOW_S / 2, side="left")
    last = np.searchsorted(time_s, time_s + WINDOW_S / 2, side="right")
    centre = error.mean()  # sums of small numbers stay exact
    sums = np.zeros(len(error) + 1)
    np.cumsum(error - centre, out=sums[1:])
    count = last - first
    means = sums[last]
    means -= sums[first]
    means /= count
    means += centre
    return means, count


def _noise(residual: NDArray[np.float64], count: NDArray[np.int64]) -> tuple[float, float]:
    """Standard deviation of white noise that leaves such a residual, and its degrees of freedom."""
    left = count > 1
    freedom = float((1 - 1 / count[left]).sum())
    # A frame minus a mean that it is part of has the variance s^2 (1 - 1/m).
    return (float(np.sqrt((residual[left] ** 2).sum() / freedom)), freedom) if freedom else (_NAN, 0.0)


def _successive(time_s: NDArray[np.float64], error: NDArray[np.float64]) -> float:
    steps = np.diff(time_s)
    if len(steps) == 0:
        return _NAN
    differences = np.diff(error)[steps <= 1.5 * np.median(steps)]
    return float(np.sqrt((differences**2).mean() / 2))


def _blocks(time_s: NDArray[np.float64], parts: int) -> list[NDArray[np.int64]]:
    edges = np.linspace(0, time_s[-1], parts + 1)[1:-1]
    return [rows for rows in np.split(np.arange(len(time_s)), np.searchsorted(time_s, edges)) if len(rows)]


def block_means(time_s: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means over 20 s, which count as independent; the values themselves where there are fewer than 8 such."""
    blocks = _blocks(time_s, max(int(time_s[-1] / WINDOW_S), 1))
    return np.array([values[rows].mean() for rows in blocks]) if len(blocks) >= 8 else values


def _bias_error(time_s: NDArray[np.float64], error: NDArray[np.float64]) -> float:
    """Half-width of the 95 % interval of the mean."""
    means = block_means(time_s, error)
    if len(means) < 2:
        return _NAN
    return float(stdtrit(len(means) - 1, 0.975) * means.std(ddof=1) / np.sqrt(len(means)))


def _drift(time_s: NDArray[np.float64], error: NDArray[np.float64]) -> tuple[float, float, float]:
    if len(time_s) < 3 or time_s[-1] <= time_s[0]:
        return _NAN, _NAN, _NAN
    blocks = _blocks(time_s, min(_MAX_BLOCKS, len(time_s)))
    if len(blocks) < 3:
        return _NAN, _NAN, _NAN
    medians = np.array([np.median(error[rows]) for rows in blocks])
    hours = np.array([time_s[rows].mean() for rows in blocks]) / _S_PER_H
    fit = theil_sen(medians, hours)
    return fit.slope, fit.low, fit.high


def _chi_square_bounds(sigma: float, freedom: float) -> tuple[float, float]:
    if freedom < 1:
        return _NAN, _NAN
    low, high = (sigma * math.sqrt(freedom / (2 * float(gammaincinv(freedom / 2, q)))) for q in (0.975, 0.025))
    return low, high
