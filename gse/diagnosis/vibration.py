"""Vibration: a boresight that scatters from frame to frame by more than its stars explain.

A mount that shakes moves all stars of a frame alike: the attitudes scatter, the residuals within a frame do not. What
the residuals make of the boresight is its noise equivalent angle as predicted; both are taken without what lasts longer
than 20 s.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gse.diagnosis.error_series import ErrorSeries
from gse.diagnosis.field_patterns import FieldOfErrors
from gse.finding import Finding
from gse.matrices import lstsq, product
from gse.star_influence import boresight_shifts
from gse.station.session_data import SessionData
from gse.statistics.low_field import air_in_field

_CAUSE = "vibration"
LEAST_RATIO = 4.0
"""Of the variances, so that the scatter is twice what stars explain: seeing makes a part of it too."""
_LEAST_SIGMAS = 5.0
_BLOCK_S, _MIN_BLOCKS = 20.0, 8
_FRAMES_OF_BLOCK = 12
_LAGS = 20
_LINE_SHARE = 0.3
_LINE_OVER_MEDIAN = 20.0
_UNEVEN = 0.2


@dataclass(frozen=True, slots=True)
class Vibration:
    """Root mean square in arcsec along columns and rows together, beyond the predicted one; a frequency, or NaN."""

    excess_arcsec: float
    predicted_arcsec: float
    frequency_hz: float
    frame_hz: float


def without_waves(series: ErrorSeries, periods_s: Sequence[float]) -> ErrorSeries:
    """The errors without the sinusoids that were found."""
    phases = [2 * math.pi / period_s * series.time_s for period_s in periods_s]
    waves = [wave(phase) for phase in phases for wave in (np.sin, np.cos)]
    if not waves:
        return series
    design = np.column_stack([np.ones(len(series.time_s)), *waves])
    fit = lstsq(design, series.errors_arcsec)
    return replace(series, errors_arcsec=series.errors_arcsec - product(design[:, 1:], fit[1:]))


def vibration(series: ErrorSeries, field: FieldOfErrors) -> Vibration | None:
    """None where the scatter is what the stars explain, and where most frames are of one instant with another."""
    frame_s = float(np.median(np.diff(series.time_s)))
    if frame_s <= 0:
        return None
    longest_s = min(_BLOCK_S, series.duration_s / _MIN_BLOCKS)
    blocks = np.floor(series.time_s / max(longest_s, _FRAMES_OF_BLOCK * frame_s, 1e-9)).astype(np.int64)
    if len(np.unique(blocks)) < _MIN_BLOCKS // 2:
        return None
    quick = _without_means(series.errors_arcsec[:, :2], blocks)
    predicted = _predicted(field, series.rows, blocks)
    ratio = np.array([_usual_variance(axis, blocks) for axis in quick.T]) / predicted
    sigma = np.sqrt(2 / np.array([_independent(axis) for axis in quick.T]))
    if not ((ratio > LEAST_RATIO) & (ratio - 1 > _LEAST_SIGMAS * sigma)).any():
        return None
    axis = int(((ratio - 1) * predicted).argmax())
    excess = float(np.maximum((ratio - 1) * predicted, 0).sum())
    line_hz = _line_hz(series.time_s, quick[:, axis], frame_s, excess)
    return Vibration(math.sqrt(excess), math.sqrt(float(predicted.sum())), line_hz, 1 / frame_s)


def _usual_variance(quick: NDArray[np.float64], blocks: NDArray[np.int64]) -> float:
    """The median over blocks, so that a slip inside one of them counts for nothing."""
    _, place, count = np.unique(blocks, return_inverse=True, return_counts=True)
    squares = np.bincount(place, weights=quick**2) / count
    full = count >= min(_FRAMES_OF_BLOCK / 2, int(np.median(count)))
    freedom = max(float(np.median(count[full])) - 1, 1.0)
    return float(np.median(squares[full])) / (1 - 2 / (9 * freedom)) ** 3  # Wilson & Hilferty's median of chi squared


def _without_means(values: NDArray[np.float64], blocks: NDArray[np.int64]) -> NDArray[np.float64]:
    """Values (M, P) about the means of their blocks, scaled up by what these took."""
    _, place, count = np.unique(blocks, return_inverse=True, return_counts=True)
    means = np.column_stack([np.bincount(place, weights=part) for part in values.T]) / count[:, None]
    kept = 1 - 1 / np.maximum(count, 2)
    return np.asarray((values - means[place]) / np.sqrt(kept)[place, None])


def _predicted(field: FieldOfErrors, rows: NDArray[np.int64], block_of_row: NDArray[np.int64]) -> NDArray[np.float64]:
    """Variances (2,) along columns and rows of one frame's boresight, by the residuals of its stars."""
    stars = field.stars
    block_of_frame = np.full(max(int(rows.max()), int(stars.frames.max())) + 1, -1)
    block_of_frame[rows] = block_of_row
    blocks = block_of_frame[stars.frames]
    cells = stars.stars * (int(blocks.max()) + 2) + blocks
    quick = _without_means(stars.errors, cells)
    variance = float((quick**2).mean())
    turns = np.einsum("nij,nkj->ik", stars.operators, stars.operators) / len(np.unique(stars.frames))
    to_shifts = boresight_shifts(np.eye(3)).T
    return np.asarray(np.diag(product(to_shifts, turns, to_shifts.T))[:2] * variance)


def _independent(values: NDArray[np.float64]) -> float:
    """How many values tell the variance as well as these: by the squares of the first autocorrelations."""
    total = float(product(values, values)) or math.inf  # an axis without any error
    lags = range(1, min(_LAGS, len(values) // 4))
    return len(values) / (1 + 2 * sum((float(product(values[lag:], values[:-lag])) / total) ** 2 for lag in lags))


def _line_hz(time_s: NDArray[np.float64], values: NDArray[np.float64], frame_s: float, excess: float) -> float:
    """The frequency that has a good share of the excess; NaN where frames are irregular or there is none."""
    steps = np.diff(time_s)
    if (np.abs(steps - frame_s) > _UNEVEN * frame_s).mean() > _UNEVEN / 10:
        return math.nan
    power = np.abs(np.fft.rfft(values)) ** 2 * 2 / len(values) ** 2
    power[0] = 0.0
    peak = int(power.argmax())
    line = float(power[max(peak - 1, 0) : peak + 2].sum())
    if line < _LINE_SHARE * excess / 2 or power[peak] < _LINE_OVER_MEDIAN * np.median(power[1:]):
        return math.nan
    return peak / (len(values) * frame_s)


def without_shaking(found: tuple[Finding, ...], session: SessionData) -> tuple[Finding, ...]:
    """Findings without a vibration where air parts the stars.

    An identifier then names those whose errors make up for the air, so that they scatter by less than all do.
    """
    if any(finding.cause == _CAUSE for finding in found) and air_in_field(session):
        return tuple(finding for finding in found if finding.cause != _CAUSE)
    return found
