"""Reference frames in which sensors state RA and DE: rotations from ICRS axes."""

import functools

import erfa
import numpy as np
from numpy.typing import NDArray

from gse.attitude_convention import ReferenceFrame
from gse.instant import NS_PER_S, to_julian_date

_CELL_NS = 300 * NS_PER_S
"""Precession and nutation move by 0.0005 arcsec in this time."""
_CELLS_KEPT = 1024
"""Of three days: a live session asks for the same one with each answer, and it takes 0.1 ms."""

_J2000_TT = 2_451_545.0, 0.0
_J2000_TO_B1950 = np.array(
    [
        [0.9999256794956877, 0.0111814832391717, 0.0048590037723143],
        [-0.0111814832204662, 0.9999374848933135, -0.0000271702937440],
        [-0.0048590038153592, -0.0000271625947142, 0.9999881946023742],
    ]
)
"""Murray 1989, A&A 218, 325, for 1950.0; the axes of FK4 turn against it by 0.001 arcsec a year."""


def icrs_to_frame(frame: ReferenceFrame, utc_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Rotations (M, 3, 3) from ICRS axes to those of a frame at instants (M,).

    J2000 differs from ICRS by the frame bias (0.02 arcsec), which B1950 leaves out. UTC is taken for TT: in that minute
    nothing moves.
    """
    if frame == "ICRS":
        return np.broadcast_to(np.eye(3), (len(utc_ns), 3, 3))
    if frame == "B1950":
        return np.broadcast_to(_J2000_TO_B1950, (len(utc_ns), 3, 3))
    if frame == "J2000":
        return np.broadcast_to(erfa.ufunc.bp06(*_J2000_TT)[0], (len(utc_ns), 3, 3))
    cells, place = np.unique(utc_ns // _CELL_NS, return_inverse=True)
    of_cells = [_icrs_to_date(cell) for cell in cells.tolist()]
    return np.asarray(of_cells, dtype=np.float64).reshape(-1, 3, 3)[place]


@functools.lru_cache(_CELLS_KEPT)
def _icrs_to_date(cell: int) -> NDArray[np.float64]:
    rotation: NDArray[np.float64] = erfa.ufunc.pnm06a(*to_julian_date(cell * _CELL_NS + _CELL_NS // 2))
    return rotation
