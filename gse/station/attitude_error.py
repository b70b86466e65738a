"""Measured against true attitude."""

import math

from gse.attitude import Attitude
from gse.constants import ARCSEC_PER_RAD
from gse.station.results import AttitudeError


def attitude_error(measured: Attitude, true: Attitude) -> AttitudeError:
    """The error of a measured attitude against the true one.

    E = measured true^T; the directions are taken on the tangent plane of the true boresight with the angle itself as
    length (arcs from the true boresight), the roll is the part of E about the boresight: no angle is subtracted from
    another, so that neither the poles nor RA = 0 nor an error of many degrees is a special case. At a pole itself
    "east" is that of the meridian RA = 0.
    """
    error = measured.icrs_to_sensor @ true.icrs_to_sensor.T
    (e00, e01, _), (e10, e11, _), (x, y, z) = error.tolist()  # last column: the measured boresight, in the true frame
    axis_x, axis_y, (bx, by, bz) = true.icrs_to_sensor.tolist()
    across = math.hypot(x, y)
    arc = math.atan2(across, z) / across if across else 1.0
    level = math.hypot(bx, by)
    cos_ra, sin_ra = (bx / level, by / level) if level else (1.0, 0.0)
    off_x, off_y, off_z = (x * along_x + y * along_y for along_x, along_y in zip(axis_x, axis_y, strict=True))
    east = cos_ra * off_y - sin_ra * off_x
    north = level * off_z - bz * (cos_ra * off_x + sin_ra * off_y)
    return AttitudeError(
        east * arc * ARCSEC_PER_RAD,
        north * arc * ARCSEC_PER_RAD,
        math.atan2(e10 - e01, e00 + e11) * ARCSEC_PER_RAD,
        x * arc * ARCSEC_PER_RAD,
        y * arc * ARCSEC_PER_RAD,
    )
