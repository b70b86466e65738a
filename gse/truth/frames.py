"""Reference frames: those in which sensors state RA and DE, and the horizon frame of the mount."""

import functools
import math

import erfa
import numpy as np
from numpy.typing import NDArray

from gse.values.attitude_convention import ReferenceFrame
from gse.values.instant import NS_PER_S, to_julian_date
from gse.values.matrices import product
from gse.values.mount import Mount

# The mount: a direction in the horizon frame (x east, y north, z up) as a rotation, and back.

_STAND = np.eye(3)
_STAND.flags.writeable = False


@functools.lru_cache(maxsize=16)
def horizon_to_sensor(mount: Mount) -> NDArray[np.float64]:
    """The rotation (3, 3) from the horizon frame to the sensor frame; its rows are the sensor's axes.

    Image up is the direction of the zenith turned by the roll counter-clockwise as seen in the sky, that is towards
    smaller azimuth. Needed with every frame: the array is kept, and read-only. Before a star simulator the sensor's
    frame is the only one, see InertialTruth.
    """
    if mount.inertial is not None:
        return _STAND
    azimuth, altitude, roll = np.radians([mount.azimuth_deg, mount.altitude_deg, mount.roll_deg])
    sin_a, cos_a, sin_h, cos_h = math.sin(azimuth), math.cos(azimuth), math.sin(altitude), math.cos(altitude)
    boresight = np.array([cos_h * sin_a, cos_h * cos_a, sin_h])
    zenithwards = np.array([-sin_h * sin_a, -sin_h * cos_a, cos_h])
    left = np.array([-cos_a, sin_a, 0.0])
    up = math.cos(roll) * zenithwards + math.sin(roll) * left
    rotation = np.array([np.cross(-up, boresight), -up, boresight])
    rotation.flags.writeable = False
    return rotation


def horizon_axes(longitude: float, latitude: float) -> NDArray[np.float64]:
    """East, north and up at a place by its angles in radians: rows (3, 3) in Earth-fixed axes."""
    sin_l, cos_l, sin_b, cos_b = math.sin(longitude), math.cos(longitude), math.sin(latitude), math.cos(latitude)
    east, north = [-sin_l, cos_l, 0.0], [-sin_b * cos_l, -sin_b * sin_l, cos_b]
    return np.array([east, north, [cos_b * cos_l, cos_b * sin_l, sin_b]])


def mount_of(rotation: NDArray[np.float64]) -> Mount:
    """The angles of a rotation (3, 3) from the horizon frame to the sensor frame.

    Within 0.01 arcsec of the zenith or nadir azimuth is only known together with roll, and is called 0.
    """
    east, north, up = (float(value) for value in rotation[2])
    level = math.hypot(east, north)
    azimuth = math.atan2(east, north) if level > 5e-8 else 0.0
    zenithwards = np.array([-up * math.sin(azimuth), -up * math.cos(azimuth), level])
    left = np.array([-math.cos(azimuth), math.sin(azimuth), 0.0])
    image_up = -rotation[1]
    roll = math.atan2(float(product(image_up, left)), float(product(image_up, zenithwards)))
    return Mount(
        azimuth_deg=math.degrees(azimuth) % 360.0,
        altitude_deg=math.degrees(math.atan2(up, level)),
        roll_deg=math.degrees(roll) % 360.0,
    )


_CELL_NS = 300 * NS_PER_S
"""Precession and nutation move by 0.0005 arcsec in this time."""
_CELLS_KEPT = 1024
"""Cells of three days; a live session asks for the same one with each answer, and making it takes 0.1 ms."""

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
