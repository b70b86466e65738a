"""Turns of the horizon frame about the axes that a set-up can be wrong about."""

import math

import erfa
import numpy as np
from numpy.typing import NDArray

from gse.truth import horizon_to_sensor
from gse.values.matrices import length, product
from gse.values.mount import Mount
from gse.values.site import Site

VERTICAL = np.array([0.0, 0.0, 1.0])
EAST = np.array([1.0, 0.0, 0.0])
"""Unit vectors in the horizon frame, x east, y north, z up."""


def about(axis: NDArray[np.float64], turn: NDArray[np.float64]) -> tuple[float, float]:
    """The angle about an axis (3,) that is nearest to a rotation (3, 3), and the angle that is left; radians."""
    along = float(product(axis, turn, axis))
    angle = math.atan2(float(product(axis, _odd(turn))), float(np.trace(turn)) - along)
    return angle, size_rad(product(turn, erfa.rv2m(angle * axis)))


def size_rad(turn: NDArray[np.float64]) -> float:
    """The angle of a rotation (3, 3), 0 to pi."""
    return math.atan2(length(_odd(turn)), float(np.trace(turn)) - 1)


def _odd(turn: NDArray[np.float64]) -> NDArray[np.float64]:
    """Twice the sine of the angle of a rotation (3, 3), along its axis (3,)."""
    return np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])


def pole(site: Site) -> NDArray[np.float64]:
    """The northern celestial pole (3,) in the horizon frame; a fast clock turns the measured mount about it."""
    latitude = math.radians(site.latitude_deg)
    return np.array([0.0, math.cos(latitude), math.sin(latitude)])


def level_axis(mount: Mount) -> NDArray[np.float64]:
    """The axis (3,) in the horizon frame about which a mount is lowered."""
    azimuth = math.radians(mount.azimuth_deg)
    return np.array([math.cos(azimuth), -math.sin(azimuth), 0.0])


def all_turns(mount: Mount) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Axes (3,) that make any turn, at the zenith too: the measured boresight goes across, up, and rolls."""
    boresight, up = horizon_to_sensor(mount)[2], -level_axis(mount)
    return np.cross(boresight, up), up, np.asarray(boresight)
