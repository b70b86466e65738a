"""The mount: a direction in the horizon frame (x east, y north, z up) as a rotation, and back."""

import functools
import math

import numpy as np
from numpy.typing import NDArray

from gse.matrices import product
from gse.mount import Mount

_STAND = np.eye(3)
_STAND.flags.writeable = False


@functools.lru_cache(maxsize=16)
def horizon_to_sensor(mount: Mount) -> NDArray[np.float64]:
    """The rotation (3, 3) from the horizon frame to the sensor frame; its rows are the sensor's axes.

    Image up is the direction of the zenith turned by the roll counter-clockwise as seen in the sky, that is towards
    smaller azimuth. Needed with every frame: the array is kept, and read-only. Before a star simulator the sensor's
    frame is the only one, see gse.truth.inertial.
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
