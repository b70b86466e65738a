"""The spectrum of an error axis; frames may be missing."""

import numpy as np
from numpy.typing import NDArray

_BINS = 150
_MAX_SLOTS = 1 << 22
"""Of a night with more of them (five days at 10 Hz) the first are drawn."""


def power_density(
    time_s: NDArray[np.float64], error_arcsec: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Frequencies in Hz and one-sided power spectral density in arcsec^2/Hz, averaged in logarithmic bins.

    The periodogram of the errors less their mean, with zeros where a frame is missing (Schuster's; a night misses few).
    White noise of standard deviation s at a rate r is flat at 2 s^2/r. Empty for fewer than 16 frames.
    """
    if len(time_s) < 16:
        return np.empty(0), np.empty(0)
    step_s = float(np.median(np.diff(time_s)))
    span_s = float(time_s[-1] - time_s[0])
    if step_s <= 0 or span_s <= 0:
        return np.empty(0), np.empty(0)
    errors, count = _on_slots(time_s, error_arcsec, step_s)
    length = _quick_length(len(errors))
    power = np.abs(np.fft.rfft(errors, length)) ** 2 / count
    frequency = np.fft.rfftfreq(length, step_s)
    return _averaged(frequency[1:].astype(np.float64), 2 * step_s * power[1:])


def _quick_length(length: int) -> int:
    """The next of at most 64 times a power of two: a length with a great prime takes six times the memory and time.

    The zeros that are added, a thirtieth at most, move the frequencies a little.
    """
    step = 1 << max(length.bit_length() - 6, 0)
    return -(-length // step) * step


def _on_slots(
    time_s: NDArray[np.float64], error_arcsec: NDArray[np.float64], step_s: float
) -> tuple[NDArray[np.float64], int]:
    """The errors less their mean, one for each step of time, and how many there are."""
    slot = np.rint((time_s - time_s[0]) / step_s).astype(np.int64)
    drawn = int(np.searchsorted(slot, _MAX_SLOTS))
    errors = np.bincount(slot[:drawn], error_arcsec[:drawn] - error_arcsec[:drawn].mean())
    return np.asarray(errors, dtype=np.float64), drawn


def _averaged(
    frequency: NDArray[np.float64], density: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    edges = np.geomspace(frequency[0], frequency[-1] * (1 + 1e-9), _BINS + 1)
    place = np.clip(np.searchsorted(edges, frequency, side="right") - 1, 0, _BINS - 1)
    count = np.bincount(place, minlength=_BINS)
    filled = count > 0
    centre = np.bincount(place, frequency, _BINS)[filled] / count[filled]
    return centre, np.bincount(place, density, _BINS)[filled] / count[filled]
