"""Where a mount points: turns of the head, one after the other.

Written from the words of gse.config.Mount, not from gse.truth, so that the one can be tested by the other.
"""

import math

import numpy as np
from numpy.typing import NDArray

from gse.constants import ARCSEC_RAD
from gse.matrices import product
from gse.mount import Mount
from gse.simulator.scenario import Motion


def horizon_to_sensor(mount: Mount) -> NDArray[np.float64]:
    """The matrix (3, 3) that takes horizon vectors (x east, y north, z up) to the sensor frame (right, down, out)."""
    # Look at the northern horizon, upright: right is east, down is below, out is north.
    upright_north = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    # Turn the head to the right by the azimuth, tilt it up, roll the image top to the left.
    to_the_right = _about(2, mount.azimuth_deg)
    tilt_up = _about(0, -mount.altitude_deg)
    roll_left = _about(2, mount.roll_deg)
    rotation: NDArray[np.float64] = product(roll_left, tilt_up, upright_north, to_the_right)
    return rotation


def _about(axis: int, angle_deg: float) -> NDArray[np.float64]:
    """The matrix (3, 3) that turns vectors about an axis, anticlockwise seen from its end."""
    one, other = (axis + 1) % 3, (axis + 2) % 3
    cosine, sine = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    matrix = np.eye(3)
    matrix[[one, other], [one, other]] = cosine
    matrix[one, other], matrix[other, one] = -sine, sine
    return matrix


def moved_by(motion: Motion, since_start_s: float) -> NDArray[np.float64]:
    """The matrix (3, 3) from the sensor frame of the mount at rest to that of the moved one."""
    moved = np.array(motion.drift_arcsec_per_h) * (since_start_s / 3600)
    for at_s, *arcsec in motion.slips:
        moved += np.array(arcsec) * (since_start_s >= at_s)
    slow = math.sin(2 * math.pi * since_start_s / motion.sinusoid_period_s)
    quick = math.sin(2 * math.pi * since_start_s * motion.vibration_hz)
    moved[:2] += slow * np.array(motion.sinusoid_arcsec) + quick * np.array(motion.vibration_arcsec)
    if not moved.any():
        return np.eye(3)
    from scipy.spatial.transform import Rotation  # a quarter of a second, which a mount at rest need not wait

    along_columns, along_rows, about = moved * ARCSEC_RAD
    # A boresight that goes to larger columns leaves the old one at smaller ones.
    rotation: NDArray[np.float64] = Rotation.from_rotvec([along_rows, -along_columns, about]).as_matrix()
    return rotation
