"""Statistics of one error axis over time: bias, drift, low-frequency error, noise equivalent angle."""

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gse.statistics.sampling import (
    MIN_FRAMES,
    MIN_N_EFF,
    NO_BOUNDS,
    Bounds,
    ErrorBounds,
    error_bounds,
    mean_bounds,
    root_mean_square_bounds,
    slope_bounds,
)
from gse.statistics.slopes import theil_sen

WINDOW_S = 20.0
"""The running mean over this time is called low-frequency; what is left over is noise. In 20 s a star crosses a few
pixels, so that the error of single pixels still counts as noise."""

MIN_S = 10.0
"""Shorter sessions get no bounds: a star takes three seconds over a pixel, and an error that lasts minutes looks like
none."""
_MAX_BLOCKS = 200
"""Medians (less than twice as many) that the robust slope is taken over: it compares each with each."""
_S_PER_H = 3600.0
_ROWS_AT_ONCE = 1 << 14
"""Each array of a day at 10 Hz has 7 MB."""
_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class AxisStatistics:
    """One axis of the attitude error, in arcsec; NaN where there are too few frames for a figure.

    ``bias`` is the mean, ``bias_error`` the half-width of its 95 % interval. ``std`` is about the mean, ``rms`` about
    zero. ``drift`` is the Theil-Sen slope. ``low_frequency`` is the standard deviation of the running mean over 20 s
    once bias, drift, and the noise that such a mean leaves are taken away (0 where no more than noise is found),
    ``nea`` the noise equivalent angle: the standard deviation of what the running mean leaves, and ``nea_successive``
    the standard deviation of successive differences / sqrt(2). ``p95_abs``, ``p99_abs``, ``max_abs`` are of the
    absolute values.

    ``*_low`` and ``*_high``, like the bounds in ``*_bounds``, hold the true value with 95 %, correlation of the
    frames taken into account; they are NaN below 30 frames and where every value is the same, those of bias, mean
    and percentile also in a session shorter than ten seconds. ``n_eff`` is the number of independent
    frames that the session is worth, ``tau_s`` its integrated autocorrelation time: the time of one of them.
    ``too_short`` says why bounds are missing, or tell little; it is empty where they are sound.
    """

    n: int
    n_eff: float
    tau_s: float
    too_short: str
    bias_arcsec: float
    bias_error_arcsec: float
    bias_bounds_arcsec: Bounds
    std_arcsec: float
    std_bounds_arcsec: Bounds
    three_sigma_arcsec: float
    rms_arcsec: float
    mean_abs_arcsec: float
    mean_abs_bounds_arcsec: Bounds
    p95_abs_arcsec: float
    p95_abs_bounds_arcsec: Bounds
    p99_abs_arcsec: float
    max_abs_arcsec: float
    drift_arcsec_per_h: float
    drift_low_arcsec_per_h: float
    drift_high_arcsec_per_h: float
    low_frequency_arcsec: float
    low_frequency_low_arcsec: float
    low_frequency_high_arcsec: float
    nea_arcsec: float
    nea_low_arcsec: float
    nea_high_arcsec: float
    nea_successive_arcsec: float


def axis_statistics(utc_ns: NDArray[np.int64], error_arcsec: NDArray[np.float64]) -> AxisStatistics:
    """The statistics of errors (M,) at instants (M,) in order, all finite; ValueError where they are not in order."""
    n = len(error_arcsec)
    if n == 0:
        return _nothing()
    if (np.diff(utc_ns) < 0).any():
        raise ValueError("the instants of the errors are not in order; sort them first")
    time_s = (utc_ns - utc_ns[0]) / 1e9
    absolute = np.abs(error_arcsec)
    p95, p99 = (float(value) for value in np.percentile(absolute, [95, 99]))
    std = float(error_arcsec.std(ddof=1)) if n > 1 else _NAN
    bounds = error_bounds(error_arcsec, time_s) if time_s[-1] >= MIN_S else ErrorBounds()
    slope, slopes = drift(time_s, error_arcsec)
    smooth, count = _running_mean(time_s, error_arcsec)
    noise = _noise(error_arcsec - smooth, count)
    slow = _low_frequency(time_s, smooth, count, slope=slope, noise=noise)
    return AxisStatistics(
        n=n,
        n_eff=bounds.n_eff,
        tau_s=bounds.tau_frames * _frame_s(time_s),
        too_short=_too_short(n, float(time_s[-1]), bounds.n_eff),
        bias_arcsec=float(error_arcsec.mean()),
        bias_error_arcsec=(bounds.bias.high - bounds.bias.low) / 2,
        bias_bounds_arcsec=bounds.bias,
        std_arcsec=std,
        std_bounds_arcsec=root_mean_square_bounds(error_arcsec - error_arcsec.mean()),
        three_sigma_arcsec=3 * std,
        rms_arcsec=float(np.sqrt((error_arcsec**2).mean())),
        mean_abs_arcsec=float(absolute.mean()),
        mean_abs_bounds_arcsec=bounds.mean_abs,
        p95_abs_arcsec=p95,
        p95_abs_bounds_arcsec=bounds.p95_abs,
        p99_abs_arcsec=p99,
        max_abs_arcsec=float(absolute.max()),
        drift_arcsec_per_h=slope,
        drift_low_arcsec_per_h=slopes.low,
        drift_high_arcsec_per_h=slopes.high,
        low_frequency_arcsec=slow.value,
        low_frequency_low_arcsec=slow.low,
        low_frequency_high_arcsec=slow.high,
        nea_arcsec=noise.value,
        nea_low_arcsec=noise.low,
        nea_high_arcsec=noise.high,
        nea_successive_arcsec=_successive(time_s, error_arcsec),
    )


@dataclass(frozen=True, slots=True)
class _Interval:
    value: float = _NAN
    low: float = _NAN
    high: float = _NAN


def _nothing() -> AxisStatistics:
    values: dict[str, Any] = {field.name: _NAN for field in fields(AxisStatistics)}
    values |= {name: NO_BOUNDS for name in values if "_bounds_" in name}
    return AxisStatistics(**values | {"n": 0, "too_short": _too_short(0, _NAN, _NAN)})


def _too_short(n: int, duration_s: float, n_eff: float) -> str:
    if n < MIN_FRAMES:
        return f"too few frames to tell ({n}, {MIN_FRAMES} are needed)"
    if duration_s < MIN_S:
        return f"too short to tell ({duration_s:.1f} s, {MIN_S:g} s are needed)"
    if math.isnan(n_eff):
        return "every value is the same: nothing tells its scatter"
    number = f"{n_eff:.2g}" if n_eff >= 1 else "below 1"
    return f"too short to tell (n_eff {number})" if n_eff < MIN_N_EFF else ""


def _frame_s(time_s: NDArray[np.float64]) -> float:
    return float(np.median(np.diff(time_s))) if len(time_s) > 1 else _NAN


def _running_mean(
    time_s: NDArray[np.float64], error: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Mean over WINDOW_S about each instant, and how many frames it holds."""
    centre = error.mean()  # sums of small numbers stay exact
    sums = np.zeros(len(error) + 1)
    np.cumsum(error - centre, out=sums[1:])
    means, count = np.empty(len(error)), np.empty(len(error), dtype=np.int32)
    for begin in range(0, len(error), _ROWS_AT_ONCE):
        rows = slice(begin, begin + _ROWS_AT_ONCE)
        first = np.searchsorted(time_s, time_s[rows] - WINDOW_S / 2, side="left")
        last = np.searchsorted(time_s, time_s[rows] + WINDOW_S / 2, side="right")
        count[rows] = last - first
        means[rows] = (sums[last] - sums[first]) / count[rows] + centre
    return means, count


def _noise(residual: NDArray[np.float64], count: NDArray[np.int32]) -> _Interval:
    """Standard deviation of white noise that leaves such a residual."""
    left = count > 1
    if not left.all():
        residual, count = residual[left], count[left]
    shares = 1 - 1 / count
    freedom = float(shares.sum())
    if not freedom:
        return _Interval()
    value = float(np.sqrt((residual**2).sum() / freedom))
    # A frame minus a mean that it is part of has the variance s^2 (1 - 1/m).
    shares = np.sqrt(shares, out=shares)
    bounds = root_mean_square_bounds(np.divide(residual, shares, out=shares))
    return _Interval(value, bounds.low, bounds.high)


def _low_frequency(
    time_s: NDArray[np.float64],
    smooth: NDArray[np.float64],
    count: NDArray[np.int32],
    *,
    slope: float,
    noise: _Interval,
) -> _Interval:
    """Standard deviation of the running mean beyond noise, which also moves the bias and drift taken out."""
    if time_s[-1] <= 2 * WINDOW_S or math.isnan(noise.value) or math.isnan(slope):
        return _Interval()
    left = smooth - smooth.mean() - slope / _S_PER_H * (time_s - time_s.mean())
    variances = left**2 - noise.value**2 * (1 / count - 2 / len(smooth))
    variance, bounds = float(variances.mean()), mean_bounds(variances)
    return _Interval(*(math.sqrt(max(value, 0.0)) for value in (variance, bounds.low, bounds.high)))


def _successive(time_s: NDArray[np.float64], error: NDArray[np.float64]) -> float:
    steps = np.diff(time_s)
    if len(steps) == 0:
        return _NAN
    differences = np.diff(error)[steps <= 1.5 * np.median(steps)]
    return float(np.sqrt((differences**2).mean() / 2))


def quick_errors(utc_ns: NDArray[np.int64], error: NDArray[np.float64]) -> NDArray[np.float64]:
    """What the running mean leaves of errors (M,) at instants (M,) in order: of it the noise equivalent angle is."""
    return error - _running_mean((utc_ns - utc_ns[:1]) / 1e9, error)[0] if len(error) else error


def drift(time_s: NDArray[np.float64], error: NDArray[np.float64]) -> tuple[float, Bounds]:
    """The slope of the medians of stretches of frames: robust against outliers, with the bounds of a linear fit."""
    if len(time_s) < 3 or time_s[-1] <= time_s[0]:
        return _NAN, NO_BOUNDS
    rows = max(len(error) // _MAX_BLOCKS, 1)
    kept = len(error) // rows * rows
    medians = np.median(error[:kept].reshape(-1, rows), axis=1)
    hours = time_s[:kept].reshape(-1, rows).mean(axis=1) / _S_PER_H
    if hours[-1] <= hours[0]:
        return _NAN, NO_BOUNDS
    slope = theil_sen(medians, hours).slope
    return slope, slope_bounds(slope, hours, medians)
