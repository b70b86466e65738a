"""Extraction: a detector image becomes a panorama (LAPAN paper, section 2).

``extract`` is the paper's: the brightest pixel of each row, neighbours of the same star made one, the 30 highest index
values. ``extract_sub_pixel`` is that of a better sensor: objects 5 sigma above their local background, at the centre
of their light.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gse.imaging.blobs import background_of, find_blobs
from gse.panorama import MAX_OBJECTS

FOOTPRINT_PX = 4
"""Rows on each side of a star's brightest that its light reaches."""

SAME_COLUMN_PX = 2
"""By how many columns the brightest pixels of one star differ from row to row."""

Objects = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Pixels (N, 2) as x, y and index values (N,), brightest first."""


def extract(image: NDArray[np.uint16], *, least_index: int = 1) -> Objects:
    """The objects of an image (rows, columns) by the LAPAN paper, section 2, down to ``least_index``.

    Of a star's kept pixels the brightest counts, of equals the middle one. The paper leaves open how neighbours are
    recognised, and which pixel of a saturated star counts.
    """
    column = image.argmax(axis=1)
    index = image[np.arange(len(image)), column].astype(np.int64)
    free = index >= least_index
    kept: list[int] = []
    for row in np.argsort(-index, kind="stable"):
        if len(kept) == MAX_OBJECTS:
            break
        if free[row]:
            star = _rows_of_star(column, index, int(row))
            equals = star[index[star] == index[row]]
            kept.append(int(equals[len(equals) // 2]))
            free[star] = False
    rows = np.array(kept, dtype=np.int64)
    return np.column_stack([column[rows], rows]).astype(np.float64), index[rows].astype(np.float64)


def extract_sub_pixel(image: NDArray[np.uint16], *, sigmas: float = 5.0) -> Objects:
    """The objects of an image (rows, columns) at the centres of their light; the index value is the brightest pixel's.

    An object is a blob of at least two pixels, each ``sigmas`` above the local background.
    """
    background, noise = background_of(image)
    blobs = find_blobs(image, background, sigmas * noise)
    blobs = blobs[np.lexsort((-blobs[:, 3], -blobs[:, 2]))][:MAX_OBJECTS]
    return np.ascontiguousarray(blobs[:, :2]), blobs[:, 2].copy()


def without_hot_pixels(image: NDArray[np.uint16], hot_xy_px: Sequence[tuple[int, int]]) -> NDArray[np.uint16]:
    """The image with each hot pixel (x, y) replaced by the median of its neighbours that are none themselves."""
    repaired = image.copy()
    rows, columns = image.shape
    hot = np.zeros(image.shape, dtype=np.bool_)
    inside = [(x, y) for x, y in hot_xy_px if 0 <= x < columns and 0 <= y < rows]
    for x, y in inside:
        hot[y, x] = True
    for x, y in inside:
        around = np.s_[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]
        neighbours = image[around][~hot[around]]
        repaired[y, x] = np.median(neighbours) if len(neighbours) else 0
    return repaired


def _rows_of_star(column: NDArray[np.intp], index: NDArray[np.int64], row: int) -> NDArray[np.int64]:
    """The rows whose kept pixel belongs to the star that is brightest in ``row``, in ascending order.

    All pixels of its column within the footprint, even if a brighter star took a row between; further out as long as
    they follow row by row without getting brighter, as a saturated star's do.
    """
    first, last = max(row - FOOTPRINT_PX, 0), min(row + FOOTPRINT_PX, len(column) - 1)
    near = first + np.flatnonzero(np.abs(column[first : last + 1] - column[row]) <= SAME_COLUMN_PX)
    above = _followed(column, index, int(near[0]), -1)
    below = _followed(column, index, int(near[-1]), +1)
    return np.concatenate([np.arange(above, near[0]), near, np.arange(near[-1] + 1, below + 1)])


def _followed(column: NDArray[np.intp], index: NDArray[np.int64], row: int, step: int) -> int:
    """The last row that belongs to a star when one goes on from ``row``."""
    while (
        0 <= row + step < len(column)
        and abs(column[row + step] - column[row]) <= SAME_COLUMN_PX
        and index[row + step] <= index[row]
    ):
        row += step
    return row
