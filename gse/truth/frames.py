"""Reference frames in which sensors state RA and DE: rotations from ICRS axes."""

import erfa
import numpy as np
from numpy.typing import NDArray

from gse.attitude_convention import ReferenceFrame
from gse.instant import NS_PER_S, to_julian_date

_CELL_NS = 300 * NS_PER_S
"""Precession and nutation move by 0.0005 arcsec in this time."""

_J2000_TT = 2_451_545.0, 0.0


def icrs_to_frame(frame: ReferenceFrame, utc_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Rotations (M, 3, 3) from ICRS axes to those of a frame at instants (M,).

    J2000 differs from ICRS by the frame bias (0.02 arcsec). UTC is taken for TT: in that minute nothing moves.
    """
    if frame == "ICRS":
        return np.broadcast_to(np.eye(3), (len(utc_ns), 3, 3))
    if frame == "J2000":
        return np.broadcast_to(erfa.ufunc.bp06(*_J2000_TT)[0], (len(utc_ns), 3, 3))
    cells, place = np.unique(utc_ns // _CELL_NS, return_inverse=True)
    of_cells = [erfa.ufunc.pnm06a(*to_julian_date(cell * _CELL_NS + _CELL_NS // 2)) for cell in cells.tolist()]
    return np.asarray(of_cells, dtype=np.float64).reshape(-1, 3, 3)[place]
