"""Measured against true attitude."""

import math

import numpy as np
from numpy.typing import NDArray

from gse.process.jit import compiled
from gse.station.results import AttitudeError
from gse.values.attitude import Attitude
from gse.values.constants import ARCSEC_PER_RAD


def attitude_error(measured: Attitude, true: Attitude) -> AttitudeError:
    """The error of a measured attitude against the true one.

    E = measured true^T; the directions are taken on the tangent plane of the true boresight with the angle itself as
    length (arcs from the true boresight), the roll is the part of E about the boresight: no angle is subtracted from
    another, so that neither the poles nor RA = 0 nor an error of many degrees is a special case. At a pole itself
    "east" is that of the meridian RA = 0.
    """
    (error,) = attitude_errors(measured.icrs_to_sensor[None], true.icrs_to_sensor[None])
    return AttitudeError(*error.tolist())


def attitude_errors(measured: NDArray[np.float64], true: NDArray[np.float64]) -> NDArray[np.float64]:
    """``attitude_error`` of measured rotations (K, 3, 3) against true ones: the fields of AttitudeError, (K, 5)."""
    errors_arcsec = np.empty((len(measured), 5))
    _put_errors(np.ascontiguousarray(measured), np.ascontiguousarray(true), errors_arcsec)
    return errors_arcsec


@compiled
def _put_errors(measured: NDArray[np.float64], true: NDArray[np.float64], errors_arcsec: NDArray[np.float64]) -> None:
    """Put the fields of AttitudeError (K, 5) for rotations (K, 3, 3) into ``errors_arcsec``."""
    for k in range(len(measured)):
        e = np.zeros((3, 3))
        for i in range(3):
            for j in range(3):
                for axis in range(3):
                    e[i, j] += measured[k, i, axis] * true[k, j, axis]
        x, y = e[2, 0], e[2, 1]  # the measured boresight, in the true frame
        across = math.hypot(x, y)
        arc = ARCSEC_PER_RAD * (math.atan2(across, e[2, 2]) / across if across else 1.0)
        bx, by, bz = true[k, 2, 0], true[k, 2, 1], true[k, 2, 2]
        level = math.hypot(bx, by)
        cos_ra, sin_ra = (bx / level, by / level) if level else (1.0, 0.0)
        off_x, off_y = x * true[k, 0, 0] + y * true[k, 1, 0], x * true[k, 0, 1] + y * true[k, 1, 1]
        off_z = x * true[k, 0, 2] + y * true[k, 1, 2]
        errors_arcsec[k, 0] = arc * (cos_ra * off_y - sin_ra * off_x)
        errors_arcsec[k, 1] = arc * (level * off_z - bz * (cos_ra * off_x + sin_ra * off_y))
        errors_arcsec[k, 2] = ARCSEC_PER_RAD * math.atan2(e[1, 0] - e[0, 1], e[0, 0] + e[1, 1])
        errors_arcsec[k, 3], errors_arcsec[k, 4] = arc * x, arc * y
