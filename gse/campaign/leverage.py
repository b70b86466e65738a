"""Leave-one-out residuals: each star's, as if it had no part in the fit of its frame's attitude.

A star pulls the attitude of its frame towards itself: its residual is smaller than its error, and its place on the
pixel, which the attitude tells, follows its own error. With H, the share of its error that the fit takes over, the
residual of the same star left out is (1 - H)^-1 times the one it has.
"""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gse.matrices import solve
from gse.star_influence import attitude_operators

_ROWS_AT_ONCE = 1 << 13
"""Matrices of all stars of a session take 60 MB."""
_MOST = 0.8
"""A star with more of its frame's fit than this tells nothing of itself."""


def left_out(
    residuals_arcsec: NDArray[np.float64], field_deg: NDArray[np.float64], frame: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Residuals (N, 2) of stars at field angles (N, 2) without their own share, and which of them tell anything.

    ``frame`` (N,) are in order.
    """
    first = np.flatnonzero(np.diff(frame, prepend=-1))  # frames stay whole
    cuts = first[np.unique(np.searchsorted(first, np.arange(0, len(frame), _ROWS_AT_ONCE)).clip(max=len(first) - 1))]
    parts = [
        _left_out(residuals_arcsec[part], field_deg[part], frame[part])
        for part in (slice(*ends) for ends in pairwise([*cuts.tolist(), len(frame)]))
    ]
    freed, useful = (np.concatenate(of_parts) for of_parts in zip(*parts, strict=True))
    return freed, useful


def _left_out(
    residuals_arcsec: NDArray[np.float64], field_deg: NDArray[np.float64], frame: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    tangent = np.tan(np.radians(field_deg))
    directions = np.column_stack([tangent, np.ones(len(tangent))])
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    operators = attitude_operators(directions, frame)
    x, y, z = (part[:, None] for part in directions.T)
    share = np.stack([operators[:, 1] * z - operators[:, 2] * y, operators[:, 2] * x - operators[:, 0] * z], axis=1)
    useful = (np.trace(share, axis1=1, axis2=2) / 2 < _MOST) & (np.abs(operators).max(axis=(1, 2)) > 0)
    share[~useful] = 0.0
    freed = solve(np.eye(2) - share, residuals_arcsec[:, :, None])[:, :, 0]
    return np.asarray(freed), np.asarray(useful)
