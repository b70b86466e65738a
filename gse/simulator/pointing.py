"""Where a mount points: turns of the head, one after the other.

Written from the words of gse.config.Mount, not from gse.truth, so that the one can be tested by the other.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gse.mount import Mount


def horizon_to_sensor(mount: Mount) -> NDArray[np.float64]:
    """The matrix (3, 3) that takes horizon vectors (x east, y north, z up) to the sensor frame (right, down, out)."""
    # Look at the northern horizon, upright: right is east, down is below, out is north.
    upright_north = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    # Turn the head to the right by the azimuth, tilt it up, roll the image top to the left.
    to_the_right = Rotation.from_euler("z", mount.azimuth_deg, degrees=True).as_matrix()
    tilt_up = Rotation.from_euler("x", -mount.altitude_deg, degrees=True).as_matrix()
    roll_left = Rotation.from_euler("z", mount.roll_deg, degrees=True).as_matrix()
    rotation: NDArray[np.float64] = roll_left @ tilt_up @ upright_north @ to_the_right
    return rotation
