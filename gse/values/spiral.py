"""Directions spread evenly over the sky, [N] eqs 10-16."""

import numpy as np
from numpy.typing import NDArray


def spiral_directions(count: int, of: range | None = None) -> NDArray[np.float64]:
    """The ``count`` unit vectors (N, 3) of the spherical spiral, or those ``of`` them, counted from 0.

    k runs from 1 to n; the paper prints 0 to n - 1, where eq 10 gives z above 1 for k = 0.
    """
    k = 1 + np.arange(count) if of is None else 1 + np.array(of, dtype=np.int64)
    z = 1 - (2 * k - 1) / count
    phi = np.arccos(z)
    theta = np.sqrt(count * np.pi) * phi
    return np.column_stack([np.sin(phi) * np.cos(theta), np.sin(phi) * np.sin(theta), z])
