"""Fewer points that look the same: plots of a long session must stay small."""

import numpy as np
from numpy.typing import NDArray

BINS = 1200
"""About one bin for each half point of the printed width."""


def extremes(values: NDArray[np.float64], bins: int = BINS) -> NDArray[np.int64]:
    """Rows to draw of values (N,): of each bin its lowest and highest, first and last; NaN keeps its gap.

    All rows where there are not more than four for each bin.
    """
    n = len(values)
    if n <= 4 * bins:
        return np.arange(n)
    edges = np.linspace(0, n, bins + 1).astype(np.int64)
    kept = [edges[:-1], edges[1:] - 1]
    kept += [_places(values, edges, extreme) for extreme in (np.fmin, np.fmax)]
    return np.unique(np.concatenate(kept))


def _places(values: NDArray[np.float64], edges: NDArray[np.int64], extreme: np.ufunc) -> NDArray[np.int64]:
    """The first row of each bin that holds its extreme value; none of a bin of NaN alone."""
    best = np.repeat(extreme.reduceat(values, edges[:-1]), np.diff(edges))
    rows = np.flatnonzero(values == best)
    bin_of_row = np.searchsorted(edges, rows, side="right") - 1
    _, first = np.unique(bin_of_row, return_index=True)
    places: NDArray[np.int64] = rows[first]
    return places


def sample(count: int, wanted: int) -> NDArray[np.int64]:
    """Row numbers of at most ``wanted`` of ``count`` rows, evenly spaced."""
    if count <= wanted:
        return np.arange(count)
    return np.linspace(0, count - 1, wanted).astype(np.int64)
