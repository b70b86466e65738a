"""Each star's share in the attitude error of its frame.

Wahba's attitude of a frame is the least-squares fit of one small rotation to the errors of its stars, so that the error
of the attitude is a sum over stars: w = F^-1 sum(r_i x e_i), with F = sum(1 - r_i r_i^T). What is known of the errors
e_i are the residuals, which are smaller, because the fit follows the errors: they are scaled up for that.
"""

import numpy as np
from numpy.typing import NDArray

_MIN_STARS = 3
"""Two stars' residuals tell nothing across the line between them."""


def star_influence(
    directions_sensor: NDArray[np.float64], residuals_arcsec: NDArray[np.float64], frames: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Small rotations (N, 3) of the measured attitude in the sensor frame, in arcsec, that single stars make.

    ``directions_sensor`` (N, 3), ``residuals_arcsec`` (N, 2) along columns and rows, measured minus expected, and
    ``frames`` (N,), the frame of each row. Rows of frames with less than three stars give zeros.
    """
    _, place = np.unique(frames, return_inverse=True)
    count = np.bincount(place)
    turns = np.cross(directions_sensor, _tangent(directions_sensor, residuals_arcsec))
    enough = count[place] >= _MIN_STARS
    fisher = _fisher(directions_sensor, place, len(count))
    fisher[count < _MIN_STARS] = np.eye(3)
    inverse = np.linalg.inv(fisher)
    # Two equations of each star, three unknowns of each frame: so much of the errors is left in the residuals.
    left = 1 - 1.5 / np.maximum(count, _MIN_STARS)
    influence = np.einsum("nij,nj->ni", inverse[place], turns) / left[place, None]
    return np.where(enough[:, None], influence, 0.0)


def boresight_influence(influence: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotations (N, 3) as shifts of the measured boresight along columns and rows, and as roll."""
    return np.column_stack([-influence[:, 1], influence[:, 0], influence[:, 2]])


def _tangent(directions: NDArray[np.float64], residuals_arcsec: NDArray[np.float64]) -> NDArray[np.float64]:
    """Errors (N, 3): along the line of sight a direction has none."""
    along = -(residuals_arcsec * directions[:, :2]).sum(axis=1) / directions[:, 2]
    return np.column_stack([residuals_arcsec, along])


def _fisher(directions: NDArray[np.float64], place: NDArray[np.int64], frames: int) -> NDArray[np.float64]:
    fisher = np.empty((frames, 3, 3))
    total = np.bincount(place, minlength=frames)
    for i in range(3):
        for j in range(i, 3):
            outer = np.bincount(place, weights=directions[:, i] * directions[:, j], minlength=frames)
            fisher[:, i, j] = fisher[:, j, i] = (total if i == j else 0) - outer
    return fisher


def persistent_covariance(
    influence: NDArray[np.float64], stars: NDArray[np.int64], blocks: NDArray[np.int64], frames: int
) -> NDArray[np.float64]:
    """Covariance (3, 3) that errors of single stars over more than one time block leave in the mean of ``frames``.

    The catalogue's error of a star stays, and its place on the pixels changes slowly where the sky moves along them:
    the scatter of the frames shows neither. It is the sum over stars of the products of different blocks' sums, in
    which noise within a block has no part (a covariance clustered by star, less one clustered by star and block).
    """
    cell, place = np.unique(np.column_stack([stars, blocks]), axis=0, return_inverse=True)
    sums = np.column_stack([np.bincount(place.ravel(), weights=part, minlength=len(cell)) for part in influence.T])
    _, star = np.unique(cell[:, 0], return_inverse=True)
    totals = np.column_stack([np.bincount(star, weights=part) for part in sums.T])
    values, vectors = np.linalg.eigh(totals.T @ totals - sums.T @ sums)
    persistent = (vectors * np.maximum(values, 0)) @ vectors.T / frames**2
    return np.asarray(persistent * few_clusters(totals), dtype=np.float64)


def few_clusters(scores: NDArray[np.float64]) -> float:
    """By how much a covariance (p, p) from sums (G, p) over independent clusters must be larger, because G is small.

    The variance of Student's t, nu / (nu - 2), with Satterthwaite's number of equal clusters less one for nu.
    """
    squares = scores**2 / np.maximum((scores**2).sum(axis=0), 1e-300)
    share = squares.mean(axis=1)
    freedom = share.sum() ** 2 / max(float((share**2).sum()), 1e-300) - 1
    return float(freedom / max(freedom - 2, 0.5)) if freedom > 0 else 1.0
