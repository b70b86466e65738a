"""The spectrum of an error axis, from frames that need not be evenly spaced."""

import numpy as np
from astropy.timeseries import LombScargle
from numpy.typing import NDArray

_BINS = 150
_MAX_FREQUENCIES = 200_000


def power_density(
    time_s: NDArray[np.float64], error_arcsec: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Frequencies in Hz and one-sided power spectral density in arcsec^2/Hz, averaged in logarithmic bins.

    By Lomb and Scargle (frames are missing here and there), of the errors less their mean. White noise of standard
    deviation s at a rate r is flat at 2 s^2/r. Empty for fewer than 16 frames.
    """
    if len(time_s) < 16:
        return np.empty(0), np.empty(0)
    step_s = float(np.median(np.diff(time_s)))
    span_s = float(time_s[-1] - time_s[0])
    if step_s <= 0 or span_s <= 0:
        return np.empty(0), np.empty(0)
    count = min(int(span_s / (2 * step_s)), _MAX_FREQUENCIES)
    frequency = np.linspace(1 / span_s, 1 / (2 * step_s), max(count, 8))
    scargle = LombScargle(time_s - time_s[0], error_arcsec - error_arcsec.mean(), normalization="psd", fit_mean=False)
    power = scargle.power(frequency, method="fast", assume_regular_frequency=True)
    return _averaged(frequency, 2 * step_s * np.maximum(power, 0))


def _averaged(
    frequency: NDArray[np.float64], density: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    edges = np.geomspace(frequency[0], frequency[-1] * (1 + 1e-9), _BINS + 1)
    place = np.clip(np.searchsorted(edges, frequency, side="right") - 1, 0, _BINS - 1)
    count = np.bincount(place, minlength=_BINS)
    filled = count > 0
    centre = np.bincount(place, frequency, _BINS)[filled] / count[filled]
    return centre, np.bincount(place, density, _BINS)[filled] / count[filled]
