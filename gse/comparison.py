"""Measured against true attitude."""

import math

import numpy as np

from gse.attitude import Attitude
from gse.results import Discrepancy

_ARCSEC_PER_RAD = math.degrees(1) * 3600


def compare(measured: Attitude, true: Attitude) -> Discrepancy:
    """How far the measured attitude lies from the true one.

    E = measured true^T; the directions are taken on the tangent plane of the true boresight with the angle itself as
    length (arcs from the true boresight), the roll is the part of E about the boresight: no angle is subtracted from
    another, so that neither the poles nor RA = 0 nor an error of many degrees is a special case. At a pole itself
    "east" is that of the meridian RA = 0.
    """
    error = measured.icrs_to_sensor @ true.icrs_to_sensor.T
    x, y, z = (float(value) for value in error[2])  # the measured boresight in the true sensor frame
    across = math.hypot(x, y)
    arc = math.atan2(across, z) / across if across else 1.0
    bx, by, bz = (float(value) for value in true.icrs_to_sensor[2])
    level = math.hypot(bx, by)
    cos_ra, sin_ra = (bx / level, by / level) if level else (1.0, 0.0)
    east = np.array([-sin_ra, cos_ra, 0.0])
    north = np.array([-bz * cos_ra, -bz * sin_ra, level])
    offset_icrs = x * true.icrs_to_sensor[0] + y * true.icrs_to_sensor[1]
    roll = math.atan2(error[1, 0] - error[0, 1], error[0, 0] + error[1, 1])
    return Discrepancy(
        float(offset_icrs @ east) * arc * _ARCSEC_PER_RAD,
        float(offset_icrs @ north) * arc * _ARCSEC_PER_RAD,
        roll * _ARCSEC_PER_RAD,
        x * arc * _ARCSEC_PER_RAD,
        y * arc * _ARCSEC_PER_RAD,
    )
