"""Spatial errors and temporal noise of single stars, and what they make of the boresight.

ECSS-E-ST-60-20C Rev.2: the FOV spatial error is slow over the field of view, the pixel spatial error is periodic in the
place on the pixel, temporal noise is what is left. A least-squares fit of a polynomial of the field and of harmonics of
the pixel phase to each star's residuals tells them apart, each axis for itself. The rms of a fitted part is freed of
the noise of its coefficients, whose covariance is clustered by star: all errors of one star are taken as dependent.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.values.matrices import pinv, product
from gse.values.star_influence import attitude_operators, boresight_shifts

DEGREE = 3
"""Degree of the polynomial over the field; focal length, distortion and tilt of the detector have degree 3 or less."""
HARMONICS = 2
MIN_STARS = 20
"""Fewer stars do not tell ten coefficients of the field from their own errors."""


@dataclass(frozen=True, slots=True)
class ErrorPart:
    """The rms of one part of a star's error along one axis, with its 95 % interval (0 as ``low`` where nothing is
    shown), and the rms that it makes of the boresight along that axis; arcsec."""

    rms_arcsec: float
    low_arcsec: float
    high_arcsec: float
    boresight_arcsec: float


@dataclass(frozen=True, slots=True)
class SpatialErrors:
    """One axis: ECSS FOV spatial error, pixel spatial error, temporal noise; of ``stars`` stars and ``n`` residuals."""

    fov: ErrorPart
    pixel: ErrorPart
    temporal: ErrorPart
    stars: int
    n: int


def spatial_errors(
    matches: NDArray[np.void], directions_sensor: NDArray[np.float64], size_px: tuple[int, int]
) -> tuple[SpatialErrors, SpatialErrors] | None:
    """Along columns and rows, from matches (N,) of dtype MATCH and their directions (N, 3); None of too few stars.

    ``size_px`` is the detector's (columns, rows).
    """
    _, star = np.unique(matches["star"], return_inverse=True)
    if len(matches) == 0 or int(star.max()) + 1 < MIN_STARS:
        return None
    operators = attitude_operators(directions_sensor, matches["frame"])
    field, pixel = _field_basis(matches, size_px), _pixel_basis(matches)
    x, y = (_axis(np.hstack([field, pixel]), field.shape[1], matches, star, operators, axis) for axis in ("x", "y"))
    return x, y


def _axis(
    basis: NDArray[np.float64],
    of_field: int,
    matches: NDArray[np.void],
    star: NDArray[np.int64],
    operators: NDArray[np.float64],
    axis: str,
) -> SpatialErrors:
    values = matches[f"residual_{axis}_arcsec"].astype(np.float64)
    inverse = pinv(product(basis.T, basis))
    fit = product(inverse, product(basis.T, values))
    left = values - product(basis, fit)
    scores = np.stack([np.bincount(star, weights=part * left) for part in basis.T], axis=1)
    stars = len(scores)
    few = stars / (stars - basis.shape[1])
    covariance = product(few * inverse, product(scores.T, scores), inverse)
    column = 0 if axis == "x" else 1
    shifts = boresight_shifts(operators[:, :, column])[:, column]
    fov, pixel = (
        _part(basis[:, part], fit[part], covariance[part, part], shifts, matches["frame"])
        for part in (slice(0, of_field), slice(of_field, None))
    )
    return SpatialErrors(fov, pixel, _noise(left, star, shifts, matches["frame"]), stars, len(values))


def _part(
    basis: NDArray[np.float64],
    fit: NDArray[np.float64],
    covariance: NDArray[np.float64],
    shifts: NDArray[np.float64],
    frames: NDArray[np.int64],
) -> ErrorPart:
    """Mean square of a fitted part less what noise alone puts there, with the variance of a quadratic form."""
    gram = product(basis.T, basis) / len(basis)
    noise = float(np.trace(product(gram, covariance)))
    square = float(product(fit, gram, fit)) - noise
    spread = product(gram, covariance)
    variance = 2 * float(np.trace(product(spread, spread))) + 4 * max(
        float(product(fit, gram, covariance, gram, fit)), 0.0
    )
    half = 1.96 * math.sqrt(variance)
    rms = math.sqrt(max(square, 0.0))
    made = _per_frame(product(basis, fit) * shifts, frames)
    by_noise = _per_frame_noise(basis, covariance, shifts, frames)
    boresight = math.sqrt(max(float((made**2).mean()) - by_noise, 0.0))
    return ErrorPart(rms, math.sqrt(max(square - half, 0.0)), math.sqrt(max(square + half, 0.0)), boresight)


def _noise(
    left: NDArray[np.float64], star: NDArray[np.int64], shifts: NDArray[np.float64], frames: NDArray[np.int64]
) -> ErrorPart:
    """What is left: its mean square clustered by star; the fit of three angles to a frame took its share of it."""
    count = np.bincount(star)
    per_frame = len(left) / len(np.unique(frames))
    scale = 1 / max(1 - 1.5 / per_frame, 0.25)
    square = float((left**2).mean()) * scale
    differences = np.bincount(star, weights=left**2) * scale - square * count
    half = 1.96 * math.sqrt(float((differences**2).sum())) / len(left)
    boresight = math.sqrt(float((shifts**2).sum()) / len(np.unique(frames)) * float((left**2).mean()))
    return ErrorPart(math.sqrt(square), math.sqrt(max(square - half, 0.0)), math.sqrt(square + half), boresight)


def _per_frame(values: NDArray[np.float64], frames: NDArray[np.int64]) -> NDArray[np.float64]:
    _, place = np.unique(frames, return_inverse=True)
    return np.asarray(np.bincount(place, weights=values), dtype=np.float64)


def _per_frame_noise(
    basis: NDArray[np.float64],
    covariance: NDArray[np.float64],
    shifts: NDArray[np.float64],
    frames: NDArray[np.int64],
) -> float:
    """Mean square over frames of what the noise of the coefficients makes of the boresight."""
    made = np.column_stack([_per_frame(part * shifts, frames) for part in basis.T])
    return float(np.einsum("ni,ij,nj->", made, covariance, made)) / len(made)


def _field_basis(matches: NDArray[np.void], size_px: tuple[int, int]) -> NDArray[np.float64]:
    """Products (N, 9) of powers of the place, from -1 to 1 over the detector, about their means."""
    columns, rows = size_px
    x, y = 2 * matches["x_px"].astype(np.float64) / columns - 1, 2 * matches["y_px"].astype(np.float64) / rows - 1
    powers = [(i, j) for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i) if i + j > 0]
    basis = np.column_stack([x**i * y**j for i, j in powers])
    return np.asarray(basis - basis.mean(axis=0), dtype=np.float64)


def _pixel_basis(matches: NDArray[np.void]) -> NDArray[np.float64]:
    """Harmonics (N, 8) of the phase along columns and rows."""
    phases = [2 * math.pi * matches[name].astype(np.float64) for name in ("x_px", "y_px")]
    waves = [wave(order * phase) for phase in phases for order in range(1, HARMONICS + 1) for wave in (np.sin, np.cos)]
    return np.asarray(np.column_stack(waves), dtype=np.float64)
