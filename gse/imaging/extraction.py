"""Extraction: a detector image becomes a panorama (LAPAN paper, section 2).

``extract`` is the paper's: the brightest pixel of each row, neighbours of the same star made one, the 30 highest index
values. ``extract_sub_pixel`` is that of a better sensor, by Source Extractor (Bertin & Arnouts 1996; Barbary 2016, the
package sep): objects over a background that varies, blends parted, brightest by their light, at their windowed centres.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gse.errors import UsageError
from gse.values.panorama import MAX_OBJECTS

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


def without_hot_pixels(image: NDArray[Any], hot_xy_px: Sequence[tuple[int, int]]) -> NDArray[Any]:
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


# Centres of light.

_MESHES = 32
_SMALLEST_MESH_PX, _LARGEST_MESH_PX = 32, 64
"""Meshes of the background, a 32nd of the picture's width: a steep glow wants small ones. An object that is larger than
two is taken for background."""
_BACKGROUNDS = 2
"""The second takes what the first left of a slope, which is no noise either."""
_SIGMAS = 4.0
_QUIETEST_STEPS = 0.3
"""Noise of a picture whose neighbouring pixels are mostly equal: rounding to whole steps, 1 / sqrt(12), remains."""
_FEWEST_PIXELS = 4
_MOST_RUNS = 40_000
"""Stretches of bright pixels in the rows of a picture, some 10,000 stars: those that are looked at in a second."""
_RAISED = 4.0
_SHARP_PERCENTILE = 25
"""Of the objects, in width: that many at least are stars. What glow and cloud leave is wider."""
_WIDEST = 3.0
"""An object's light counts as that of a star of at most three times its height: a glow is wide and flat."""
_PIXELS_AT_ONCE = 1_000_000
"""Pixels of unfinished objects that sep keeps; its own limit of 300,000 is too small for a large picture."""
_STAR_RADIUS_PX = 5.0
_RADIUS_TO_SIGMA = 2 / 2.3548
"""Half of the light of a Gaussian lies within 1.18 sigma; Source Extractor takes this factor."""
_NARROWEST_PX = 1.0
"""A narrower window sees so few pixels that the centre leans towards the middle of one."""
_FARTHEST_PX = 2.0
"""How far a windowed centre may be from the centre of the object's pixels; farther is a neighbour's."""


def extract_sub_pixel(image: NDArray[Any], *, step: float = 1.0, index_max: int = 4096) -> Objects:
    """The objects of an image (rows, columns) at the centres of their light.

    An object is at least four pixels of the smoothed image, two of them of the image itself, that stand 4 sigma over
    the local background. ``step`` is the smallest difference of two values of the image. The index value is the
    object's light as the height of a star of the usual width over the background, ``index_max`` at most; objects beyond
    that follow each other by one.
    """
    sep = _source_extractor()
    light = np.array(image, dtype=np.float32, order="C")
    mesh_px = min(max(light.shape[1] // _MESHES, _SMALLEST_MESH_PX), _LARGEST_MESH_PX)
    for _ in range(_BACKGROUNDS):
        sep.Background(light, bw=mesh_px, bh=mesh_px).subfrom(light)
    noise = sep.Background(light, bw=mesh_px, bh=mesh_px).globalrms
    found = _found(sep, light, _SIGMAS * max(noise, _QUIETEST_STEPS * step))
    # A hot pixel spreads over nine by the smoothing alone.
    found = found[(found["tnpix"] >= 2) & (found["flux"] > 0)]
    if not len(found):
        return np.empty((0, 2)), np.empty(0)
    height = found["flux"] / np.percentile(found["flux"] / found["peak"], _SHARP_PERCENTILE)
    height = np.minimum(height, _WIDEST * found["peak"])
    brightest = np.lexsort((-found["flux"], -height))[:MAX_OBJECTS]
    # Above the scale the order remains: a panorama of nothing but saturated stars has a brightest one.
    index = np.clip(np.rint(height[brightest]), 1, index_max - np.arange(len(brightest))).astype(np.float64)
    return _centres(sep, light, found[brightest]), index


def _source_extractor() -> Any:
    """The package sep: only pictures need it, and not every Python has it."""
    try:
        import sep
    except ImportError as error:
        raise UsageError(
            "centres of light need the package sep, which is not installed: `pip install sep` "
            "(it has wheels for Python 3.11 to 3.13), or extract without --sub-pixel"
        ) from error
    return sep


def _found(sep: Any, light: NDArray[np.float32], threshold: float) -> NDArray[Any]:
    """The objects above a threshold, which is raised until they are not too many to look at: the brightest remain."""
    sep.set_extract_pixstack(_PIXELS_AT_ONCE)
    brightest = float(light.max())
    while True:
        bright = light > threshold
        if np.count_nonzero(bright[:, 1:] & ~bright[:, :-1]) <= _MOST_RUNS:
            try:
                return np.asarray(sep.extract(light, threshold, minarea=_FEWEST_PIXELS))
            except Exception:  # sep has no narrower one: an object of too many parts, or too large
                if threshold > brightest:
                    raise
        threshold *= _RAISED


def _centres(sep: Any, light: NDArray[np.float32], found: NDArray[Any]) -> NDArray[np.float64]:
    """Windowed centres (N, 2) as x, y: the weights are as wide as the stars of the picture, or as a wider object."""
    x, y = found["x"], found["y"]
    usual, _ = sep.flux_radius(light, x, y, np.full(len(found), _STAR_RADIUS_PX), 0.5, subpix=5)
    own, _ = sep.flux_radius(light, x, y, 6 * found["a"], 0.5, normflux=found["flux"], subpix=5)
    radius = np.fmax(np.nanmedian(usual), own)
    sigma = np.fmax(_RADIUS_TO_SIGMA * radius, _NARROWEST_PX)
    window_x, window_y, _ = sep.winpos(light, x, y, sigma)
    near = np.hypot(window_x - x, window_y - y) <= _FARTHEST_PX
    centres = np.column_stack([np.where(near, window_x, x), np.where(near, window_y, y)])
    rows, columns = light.shape
    return np.asarray(np.clip(centres, -0.5, (columns - 0.5, rows - 0.5)), dtype=np.float64)
