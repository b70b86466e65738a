"""What stars with lasting errors do to the attitude as they come into the field and leave it.

A double star, a bad place in the catalogue or a star in the blur of the lens keeps its error; the day it leaves the
field the boresight steps. Each star's error is the mean of its residuals and of what the fits of its frames took of it,
as far as it is more than chance: the means of all stars together tell how great lasting errors are, and each mean is
made smaller by its own part of chance (James & Stein 1961). Whole means would hand the noise of one star on to the next
as stars come and go, which looks like a drift.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gse.camera import Camera
from gse.diagnosis.error_series import ErrorSeries
from gse.instant import NS_PER_S
from gse.star_influence import FrameFits, StarCells, boresight_shifts
from gse.station.frame_table import thinned, xy_px_of
from gse.truth import time_blocks

_MOST_ROWS = 40_000
_ROUNDS = 5
"""Each takes what the one before left of a star among the others of its frames, a twentieth or less."""


def sampled_matches(matches: NDArray[np.void], series: ErrorSeries) -> NDArray[np.void]:
    """Those that answers name in the frames of a series, of every second, third, ... frame where they are many."""
    return thinned(matches.compress(matches["named"] & np.isin(matches["frame"], series.rows)), _MOST_ROWS)


def without_star_changes(
    series: ErrorSeries, matches: NDArray[np.void], residuals_arcsec: NDArray[np.float64], camera: Camera
) -> ErrorSeries:
    """The errors without what a change of the stars makes of their lasting errors; their mean stays.

    ``residuals_arcsec`` (N, 2) are those of matches (rows of MATCH), of some frames at least.
    """
    xy_px = xy_px_of(matches)
    directions = camera.directions(xy_px)
    fits = FrameFits.of(directions, matches["frame"])
    at_s = np.interp(matches["frame"], series.rows, series.time_s)
    cells = _Cells.of(matches["star"], time_blocks(np.asarray(at_s * NS_PER_S, dtype=np.int64)))
    turns = np.zeros((len(fits.numbers), 3))
    for _ in range(_ROUNDS):
        turns = fits.turns(cells.lasting(residuals_arcsec + np.cross(turns[fits.place], directions)[:, :2]))
    shifts = boresight_shifts(turns)
    made = np.column_stack([np.interp(series.rows, fits.numbers, shift) for shift in shifts.T])
    return replace(series, errors_arcsec=series.errors_arcsec - (made - made.mean(axis=0)))


@dataclass(frozen=True, slots=True, eq=False)
class _Cells:
    """Cells of one star in one stretch of time: ``cell`` (N,) of each sighting, ``star`` (C,) of each cell."""

    cell: NDArray[np.int64]
    star: NDArray[np.int64]

    @classmethod
    def of(cls, stars: NDArray[np.integer], blocks: NDArray[np.int64]) -> "_Cells":
        cells = StarCells.of(stars, blocks)
        return cls(cells.of_row, np.unique(cells.star, return_inverse=True)[1])

    def lasting(self, errors: NDArray[np.float64]) -> NDArray[np.float64]:
        """What each sighting (N, 2) has of the lasting error of its star, by errors (N, 2); zero where none shows it.

        The variance of a cell's mean is what the cells of one star scatter by, that of lasting errors what the means of
        stars scatter by beyond it.
        """
        means, cells = _means(errors, self.cell), np.bincount(self.star)
        stars = _means(means, self.star)
        freedom = len(self.star) - len(cells)
        if not freedom:
            return np.zeros_like(errors)
        chance = float(((means - stars[self.star]) ** 2).sum()) / (2 * freedom)
        lasting = max(float((cells[:, None] * stars**2).sum()) / 2 - len(cells) * chance, 0.0) / len(self.star)
        sure = lasting / np.maximum(lasting + chance / cells, 1e-300)
        return np.asarray((sure[:, None] * stars)[self.star[self.cell]])


def _means(values: NDArray[np.float64], group: NDArray[np.int64]) -> NDArray[np.float64]:
    """Of values (N, 2) over each group (N,)."""
    return np.column_stack([np.bincount(group, weights=part) for part in values.T]) / np.bincount(group)[:, None]
