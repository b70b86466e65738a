"""Hot pixels: objects that stay where they are while the sky moves over the detector."""

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

MIN_SHARE = 0.3
"""A hot pixel is among the brightest 30 in at least this share of the panoramas."""

MIN_PANORAMAS = 20
MIN_MOTION_PX = 8.0
"""By how much the stars must have moved before an object that stands still is called a hot pixel."""


def hot_pixels(
    panoramas_px: Sequence[NDArray[np.float64]], named: Sequence[NDArray[np.int64]], moved_px: float
) -> tuple[tuple[int, int], ...]:
    """Pixels (x, y), sorted, where an object stands in many panoramas and mostly is not a star.

    ``panoramas_px`` holds the objects (N, 2) of each panorama, ``named`` the rows that are stars, and ``moved_px`` is
    how far a star moved from the first to the last. Empty for a sky that stood still and for few panoramas.
    """
    if len(panoramas_px) < MIN_PANORAMAS or moved_px < MIN_MOTION_PX:
        return ()
    seen: Counter[tuple[int, int]] = Counter()
    starlike: Counter[tuple[int, int]] = Counter()
    for xy_px, stars in zip(panoramas_px, named, strict=True):
        pixels = [(int(x), int(y)) for x, y in np.rint(xy_px).tolist()]
        seen.update(set(pixels))
        starlike.update({pixels[row] for row in stars.tolist()})
    enough = MIN_SHARE * len(panoramas_px)
    return tuple(sorted(pixel for pixel, count in seen.items() if count >= enough and starlike[pixel] < count / 2))
