"""Directions spread evenly over the sky, [N] eqs 10-16."""

import numpy as np
from numpy.typing import NDArray


def spiral_directions(count: int) -> NDArray[np.float64]:
    """The ``count`` unit vectors (N, 3) of the spherical spiral.

    k runs from 1 to n; the paper prints 0 to n - 1, where eq 10 gives z above 1 for k = 0.
    """
    k = np.arange(1, count + 1)
    z = 1 - (2 * k - 1) / count
    phi = np.arccos(z)
    theta = np.sqrt(count * np.pi) * phi
    return np.column_stack([np.sin(phi) * np.cos(theta), np.sin(phi) * np.sin(theta), z])
