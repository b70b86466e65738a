"""What the errors of single stars do to a fit that many of their frames enter.

An attitude of Wahba is the least-squares fit of one small rotation to the errors of its stars: w = F^-1 sum(r_i x e_i)
with F = sum(1 - r_i r_i^T). The errors of one star in different frames depend on each other: the catalogue's error
stays, and the place on the pixels changes slowly where the sky moves along them. Their autocovariance is taken from the
residuals of all stars together: each star alone would tell it badly.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.values.matrices import cholesky, eigh, inv, product

_MIN_STARS = 3
"""Two stars' residuals tell nothing across the line between them."""
_FARTHEST_BLOCKS = 100_000
"""Stretches that are farther apart count as this far: no session is as long (three weeks of 20 s), but a host's clock
that begins in 1970 leaps by 56 years, and the autocovariance has a row for each distance."""
_UNKNOWNS_OF_A_FRAME = 1.5
"""Three angles, in units of the two equations that a star gives."""


@dataclass(frozen=True, slots=True, eq=False)
class StarCells:
    """The sightings of one star in one stretch of time are a cell: star and stretch of each (C,), by star, then time.

    ``of_row`` (N,) is the cell of each sighting.
    """

    star: NDArray[np.int64]
    block: NDArray[np.int64]
    of_row: NDArray[np.int64]

    @classmethod
    def from_stars(cls, stars: NDArray[np.integer], blocks: NDArray[np.int64]) -> "StarCells":
        """Of stars (N,) and stretches (N,), as one number each: pairs take ten times as long to sort."""
        first = int(blocks.min(initial=0))
        width = int(blocks.max(initial=0)) - first + 1
        cells, of_row = np.unique(stars.astype(np.int64) * width + (blocks - first), return_inverse=True)
        star, block = np.divmod(cells, width)
        return cls(star, block + first, of_row)

    def means(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Mean (C, 2) of values (N, 2) over each cell."""
        return np.asarray(_sums(values, self.of_row) / np.bincount(self.of_row)[:, None])


@dataclass(frozen=True, slots=True, eq=False)
class FrameFits:
    """The fits of frames ``numbers`` (L,) to their stars in ``directions_sensor`` (N, 3).

    ``place`` (N,) is the place of each star's frame among them. ``inverse`` (L, 3, 3) is F^-1, zero in frames with less
    than three stars.
    """

    numbers: NDArray[np.int64]
    place: NDArray[np.int64]
    directions_sensor: NDArray[np.float64]
    inverse: NDArray[np.float64]

    @classmethod
    def from_directions(cls, directions_sensor: NDArray[np.float64], frames: NDArray[np.int64]) -> "FrameFits":
        """Of stars whose frames (N,) these are."""
        numbers, place = np.unique(frames, return_inverse=True)
        few = np.bincount(place) < _MIN_STARS
        fisher = _fisher(directions_sensor, place, len(numbers))
        fisher[few] = np.eye(3)
        inverse = np.asarray(inv(fisher), dtype=np.float64)
        inverse[few] = 0.0
        return cls(numbers, place, directions_sensor, inverse)

    def operators(self) -> NDArray[np.float64]:
        """Matrices (N, 3, 2) that take a star's error (columns, rows) to the small rotation it makes of its frame.

        The rotation is of the measured attitude, in the sensor frame.
        """
        return np.asarray(
            product(self.inverse.take(self.place, axis=0), _turns(self.directions_sensor)), dtype=np.float64
        )

    def turns(self, errors: NDArray[np.float64]) -> NDArray[np.float64]:
        """The small rotations (L, 3, ...) of the frames that errors (N, 2, ...) of all stars make together."""
        x, y, z = self.directions_sensor.T
        sums = []
        for along, across in errors.reshape(len(errors), 2, -1).transpose(2, 1, 0):
            out = -(x * along + y * across) / z
            moments = y * out - z * across, z * along - x * out, x * across - y * along
            sums.append([np.bincount(self.place, weights=moment) for moment in moments])
        return np.asarray(product(self.inverse, np.array(sums).transpose(2, 1, 0)).reshape(-1, 3, *errors.shape[2:]))


def attitude_operators(directions_sensor: NDArray[np.float64], frames: NDArray[np.int64]) -> NDArray[np.float64]:
    """``FrameFits.operators`` (N, 3, 2) of stars in directions (N, 3), whose frames (N,) these are."""
    return FrameFits.from_directions(directions_sensor, frames).operators()


def unfitted(residuals: NDArray[np.float64], frames: NDArray[np.int64]) -> NDArray[np.float64]:
    """Residuals (N, 2) scaled up to the size of the errors of which the fit of each frame took a share."""
    _, place, count = np.unique(frames, return_inverse=True, return_counts=True)
    left = 1 - _UNKNOWNS_OF_A_FRAME / np.maximum(count, _MIN_STARS)
    return np.asarray(residuals / np.sqrt(left)[place, None], dtype=np.float64)


def taken_by_fit(
    operators: NDArray[np.float64], directions_sensor: NDArray[np.float64], frames: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Vectors v (N, 3) by which the fit of a frame changes what its residuals show of the errors of its stars.

    For a combination of the attitude whose operators (N, 2) are given, and white errors e of variance 1: the operator
    times the residual has the variance operator^2 - v.v, and with that of another star u of the frame the covariance
    -v.u. Zeros in frames with less than three stars.
    """
    _, place = np.unique(frames, return_inverse=True)
    count = np.bincount(place)
    fisher = _fisher(directions_sensor, place, len(count))
    fisher[count < _MIN_STARS] = np.eye(3)
    root = cholesky(inv(fisher))
    turned = np.einsum("nij,nj->ni", _turns(directions_sensor), operators)
    return np.asarray(np.einsum("nij,ni->nj", root.take(place, axis=0), turned), dtype=np.float64)


def boresight_shifts(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Small rotations (N, 3) of the attitude as shifts of the boresight along columns and rows, and as roll."""
    return np.column_stack([-rotations[:, 1], rotations[:, 0], rotations[:, 2]])


def star_covariance(
    operators: NDArray[np.float64],
    errors: NDArray[np.float64],
    stars: NDArray[np.int64],
    blocks: NDArray[np.int64],
    *,
    within_blocks: bool,
) -> NDArray[np.float64]:
    """Covariance (p, p) of the sum of ``operators`` (N, p, 2) times the errors of stars (N, 2).

    Errors of different stars are independent, those of one star have the autocovariance that all stars show over the
    difference of their ``blocks`` (N,). Without ``within_blocks`` the part that is left after means over blocks alone:
    what the scatter of blocks does not show.
    """
    cells = StarCells.from_stars(stars, _without_leaps(blocks))
    flat = operators.reshape(len(operators), -1)
    sums = _sums(flat, cells.of_row).reshape(-1, *operators.shape[1:])
    groups = np.split(np.arange(len(cells.star)), np.flatnonzero(np.diff(cells.star)) + 1)
    autocovariance = _autocovariance(cells.means(errors), cells.block, groups)
    within = np.einsum("nia,nja,a->ij", sums, sums, autocovariance[:, 0])
    autocovariance[:, 0] = 0.0
    between = np.zeros_like(within)
    for rows in groups:
        lags = np.abs(cells.block[rows][:, None] - cells.block[rows])
        for axis in (0, 1):
            between += product(sums[rows, :, axis].T, autocovariance[axis][lags], sums[rows, :, axis])
    return _not_negative(between, within) + (within if within_blocks else 0.0)


def _without_leaps(blocks: NDArray[np.int64]) -> NDArray[np.int64]:
    """Numbers (N,) of stretches, from 0 on, of which none follows the one before it by more than _FARTHEST_BLOCKS."""
    distinct, place = np.unique(blocks, return_inverse=True)
    steps = np.minimum(np.diff(distinct, prepend=distinct[:1]), _FARTHEST_BLOCKS)
    return np.asarray(np.cumsum(steps)[place], dtype=np.int64)


def _not_negative(matrix: NDArray[np.float64], unit: NDArray[np.float64]) -> NDArray[np.float64]:
    """A symmetric matrix (p, p) without its negative part, in coordinates in which ``unit`` is one."""
    values, vectors = eigh(unit)
    scale = np.sqrt(np.maximum(values, values[-1] * 1e-24 + 1e-300))
    into = vectors / scale
    values, turned = eigh(product(into.T, matrix, into))
    back = product(vectors * scale, turned)
    return np.asarray(product(back * np.maximum(values, 0), back.T), dtype=np.float64)


def _autocovariance(
    means: NDArray[np.float64], blocks: NDArray[np.int64], groups: list[NDArray[np.int64]]
) -> NDArray[np.float64]:
    """Mean product (2, lags) of two blocks' errors of one star, over their distance, for columns and rows."""
    longest = max(int(np.ptp(blocks[rows])) for rows in groups) + 1
    pairs, products = np.zeros(longest), np.zeros((2, longest))
    for rows in groups:
        lags = np.abs(blocks[rows][:, None] - blocks[rows]).ravel()
        pairs += np.bincount(lags, minlength=longest)
        for axis in (0, 1):
            outer = np.outer(means[rows, axis], means[rows, axis]).ravel()
            products[axis] += np.bincount(lags, weights=outer, minlength=longest)
    return products / np.maximum(pairs, 1)


def _turns(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """r x e as matrices (N, 3, 2) of e along columns and rows: an error has no part along the line of sight."""
    x, y, z = directions.T
    turns = np.empty((len(directions), 3, 2))
    turns[:, 0, 0], turns[:, 1, 0], turns[:, 2, 0] = y * (-x / z), z - x * (-x / z), -y
    turns[:, 0, 1], turns[:, 1, 1], turns[:, 2, 1] = y * (-y / z) - z, -x * (-y / z), x
    return turns


def _sums(values: NDArray[np.float64], place: NDArray[np.int64]) -> NDArray[np.float64]:
    """Sums (L, P) of values (N, P) over the rows of each place (N,)."""
    return np.column_stack([np.bincount(place, weights=part) for part in values.T])


def _fisher(directions: NDArray[np.float64], place: NDArray[np.int64], frames: int) -> NDArray[np.float64]:
    fisher = np.empty((frames, 3, 3))
    total = np.bincount(place, minlength=frames)
    for i in range(3):
        for j in range(i, 3):
            outer = np.bincount(place, weights=directions[:, i] * directions[:, j], minlength=frames)
            fisher[:, i, j] = fisher[:, j, i] = (total if i == j else 0) - outer
    return fisher
