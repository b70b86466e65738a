"""Extraction: a detector image becomes a panorama (LAPAN paper, section 2).

``extract`` is the paper's: the brightest pixel of each row, neighbours of the same star made one, the 30 highest index
values. ``extract_sub_pixel`` is that of a better sensor: objects 5 sigma above their local background, at the centre
of their light.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gse.process.jit import compiled, compiled_part
from gse.values.panorama import MAX_OBJECTS

# Blobs of light in an image, and the background that they stand on.

_TILE_PX = 64
_SAMPLE_EVERY = 4
"""Every fourth pixel of a tile, in rows and columns, gives its median to a few per cent of the noise."""
_NOISE_ROWS = 16
"""Every 16th row holds enough pairs of neighbours."""
_MEDIAN_TO_SIGMA = 1.4826
_MOST_BLOBS = 4096
_LARGEST_BLOB_PX = 4096
"""A saturated Moon is larger; it is cut into several blobs, none of which is a star."""


def background_of(image: NDArray[np.uint16]) -> tuple[NDArray[np.float32], float]:
    """Medians of tiles of 64 px, (rows / 64, columns / 64) rounded up, and the noise about them (1 sigma)."""
    rows, columns = image.shape
    padded = np.pad(image, ((0, -rows % _TILE_PX), (0, -columns % _TILE_PX)), mode="reflect")
    tiled = padded.reshape(len(padded) // _TILE_PX, _TILE_PX, -1, _TILE_PX)
    samples = np.swapaxes(tiled[:, ::_SAMPLE_EVERY, :, ::_SAMPLE_EVERY], 1, 2)
    samples = samples.reshape(*samples.shape[:2], -1)
    middle = samples.shape[2] // 2
    medians = np.partition(samples, middle, axis=2)[:, :, middle].astype(np.float32)
    return medians, _noise_of(image)


def _noise_of(image: NDArray[np.uint16]) -> float:
    """1 sigma from the differences of neighbours: a slope of the background is not noise."""
    sampled = image[::_NOISE_ROWS].astype(np.int32)
    even = sampled.shape[1] // 2 * 2
    differences = np.abs(sampled[:, 1:even:2] - sampled[:, 0:even:2])
    percentiles = float(np.median(differences)) if differences.size else 0.0
    # Whole numbers: the spread of a quiet image can be 0.
    return max(_MEDIAN_TO_SIGMA * percentiles / math.sqrt(2), 0.5)


def find_blobs(image: NDArray[np.uint16], background: NDArray[np.float32], threshold: float) -> NDArray[np.float64]:
    """Blobs of two pixels and more that stand ``threshold`` over the background: rows of x, y, brightest pixel, light.

    x, y is the centre of light of the blob's pixels and of those around them. At most 4096 blobs are given, in the
    order of their first pixels.
    """
    blobs = np.empty((_MOST_BLOBS, 4))
    count = _find(image, background, threshold, blobs)
    return blobs[:count]


@compiled_part
def _level(background: NDArray[np.float32], y: float, x: float) -> float:
    """Background at a pixel: bilinear between the middles of tiles, continued to the edges."""
    v, h = (y + 0.5) / 64.0 - 0.5, (x + 0.5) / 64.0 - 0.5
    top = max(min(int(v), background.shape[0] - 2), 0)
    left = max(min(int(h), background.shape[1] - 2), 0)
    bottom, right = min(top + 1, background.shape[0] - 1), min(left + 1, background.shape[1] - 1)
    v, h = v - top, h - left
    above = background[top, left] * (1 - h) + background[top, right] * h
    below = background[bottom, left] * (1 - h) + background[bottom, right] * h
    return float(above * (1 - v) + below * v)


@compiled
def _find(
    image: NDArray[np.uint16], background: NDArray[np.float32], threshold: float, blobs: NDArray[np.float64]
) -> int:
    rows, columns = image.shape
    seen = np.zeros((rows, columns), dtype=np.uint8)
    pixels = np.empty((_LARGEST_BLOB_PX, 2), dtype=np.int32)
    count = 0
    for y in range(rows):
        for left in range(0, columns, 64):
            least = _least_in_tile(background, y // 64, left // 64) + threshold
            for x in range(left, min(left + 64, columns)):
                if image[y, x] <= least or seen[y, x] or image[y, x] - _level(background, y, x) <= threshold:
                    continue
                pixels[0, 0], pixels[0, 1] = y, x
                size = _fill(image, background, threshold, seen, pixels)
                if size >= 2 and count < len(blobs):
                    _measure(image, background, pixels[:size], seen, blobs[count])
                    count += 1
    return count


@compiled_part
def _least_in_tile(background: NDArray[np.float32], row: int, column: int) -> float:
    """The least background of a tile: it is bilinear in each quarter, so least at a corner or a middle."""
    least = np.inf
    for y in (0.0, 31.5, 63.0):
        for x in (0.0, 31.5, 63.0):
            least = min(least, _level(background, 64.0 * row + y, 64.0 * column + x))
    return least


@compiled_part
def _fill(
    image: NDArray[np.uint16],
    background: NDArray[np.float32],
    threshold: float,
    seen: NDArray[np.uint8],
    pixels: NDArray[np.int32],
) -> int:
    """Put the pixels (row, column) of the blob at ``pixels[0]`` after it; how many they are."""
    rows, columns = image.shape
    seen[pixels[0, 0], pixels[0, 1]] = 1
    size, done = 1, 0
    while done < size:
        row, column = pixels[done]
        done += 1
        for near_y in range(max(row - 1, 0), min(row + 2, rows)):
            for near_x in range(max(column - 1, 0), min(column + 2, columns)):
                if size == len(pixels) or seen[near_y, near_x]:
                    continue
                if image[near_y, near_x] - _level(background, near_y, near_x) > threshold:
                    seen[near_y, near_x] = 1
                    pixels[size, 0], pixels[size, 1] = near_y, near_x
                    size += 1
    return size


@compiled_part
def _measure(
    image: NDArray[np.uint16],
    background: NDArray[np.float32],
    pixels: NDArray[np.int32],
    seen: NDArray[np.uint8],
    blob: NDArray[np.float64],
) -> None:
    """Centre and light of a blob and its rim of one pixel; a pixel of the rim counts once (``seen`` 2 marks it)."""
    rows, columns = image.shape
    light = light_x = light_y = 0.0
    brightest = 0
    for pixel in range(len(pixels)):
        row, column = pixels[pixel]
        brightest = max(brightest, int(image[row, column]))
        for y in range(max(row - 1, 0), min(row + 2, rows)):
            for x in range(max(column - 1, 0), min(column + 2, columns)):
                is_own = y == row and x == column
                if not is_own and seen[y, x]:
                    continue
                if not is_own:
                    seen[y, x] = 2
                value = image[y, x] - _level(background, y, x)
                light += value
                light_x += value * x
                light_y += value * y
    # Pixels darker than the background around can pull the centre of a faint blob out of it.
    blob[0] = min(max(light_x / light, pixels[:, 1].min() - 0.5), pixels[:, 1].max() + 0.5)
    blob[1] = min(max(light_y / light, pixels[:, 0].min() - 0.5), pixels[:, 0].max() + 0.5)
    blob[2], blob[3] = brightest, light


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
