"""Turns of the horizon frame about the axes that a set-up can be wrong about."""

import math
from collections.abc import Sequence

import erfa
import numpy as np
from numpy.typing import NDArray

from gse.truth import horizon_to_sensor, small_rotations
from gse.values.matrices import cholesky, inv, length, lstsq, product
from gse.values.mount import Mount
from gse.values.site import Site

VERTICAL = np.array([0.0, 0.0, 1.0])
EAST = np.array([1.0, 0.0, 0.0])
"""Unit vectors in the horizon frame, x east, y north, z up."""

_ROUNDS = 10
"""Steps, each of which leaves less than half of what was left; most need two."""


def about(axis: NDArray[np.float64], turn: NDArray[np.float64]) -> tuple[float, float]:
    """The angle about an axis (3,) that is nearest to a rotation (3, 3), and the angle that is left; radians."""
    along = float(product(axis, turn, axis))
    angle = math.atan2(float(product(axis, _odd(turn))), float(np.trace(turn)) - along)
    return angle, size_rad(product(turn, erfa.rv2m(angle * axis)))


def taken_out(
    turn: NDArray[np.float64], axes: Sequence[NDArray[np.float64]], covariance: NDArray[np.float64]
) -> tuple[list[float], float]:
    """The angles about axes (3,) that explain a rotation (3, 3) best, and chi-square of what they leave; radians.

    ``covariance`` (3, 3) is of its rotation vector, in the horizon frame. Turns of degrees about two axes do not
    commute: they are found by steps.
    """
    whiten = inv(cholesky(covariance))
    angles = np.zeros(len(axes))
    for _ in range(_ROUNDS if axes else 0):
        steps = lstsq(product(whiten, np.column_stack(axes)), product(whiten, _vector(turn)), rcond=1e-6)
        for axis, step in zip(axes, steps.tolist(), strict=True):
            turn = product(turn, erfa.rv2m(step * axis))
        angles += steps
    left = product(whiten, _vector(turn))
    return angles.tolist(), float(product(left, left))


def _vector(turn: NDArray[np.float64]) -> NDArray[np.float64]:
    """Its rotation vector (3,), positive as the angle of ``about`` is."""
    (vector,) = small_rotations(turn[None], np.eye(3))
    return np.asarray(vector)


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


def ahead(mount: Mount) -> NDArray[np.float64]:
    """The level axis (3,) in the horizon frame about which a mount leans to a side."""
    azimuth = math.radians(mount.azimuth_deg)
    return np.array([math.sin(azimuth), math.cos(azimuth), 0.0])


def all_turns(mount: Mount) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Axes (3,) that make any turn, at the zenith too: the measured boresight goes across, up, and rolls."""
    boresight, up = horizon_to_sensor(mount)[2], -level_axis(mount)
    return np.cross(boresight, up), up, np.asarray(boresight)
