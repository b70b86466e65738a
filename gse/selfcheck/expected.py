"""What a known error must show as, by astropy's directions and plain least squares."""

import numpy as np
from numpy.typing import NDArray

from gse.constants import ARCSEC_PER_RAD
from gse.instant import NS_PER_S
from gse.selfcheck.astropy_sky import AstropySky, east_and_north
from gse.selfcheck.known_errors import KnownError
from gse.selfcheck.made_sensor import MadeSensor
from gse.selfcheck.made_session import begins_ns, stated_sensor, true_sensor

_STEP_RAD = 1e-6


def expected_arcsec(sky: AstropySky, error: KnownError) -> tuple[float, float, float]:
    """Mean dRA* (east), dDE (north) and roll (up from north through east): the true axes against the stated ones."""
    utc_ns = begins_ns()
    stated = np.broadcast_to(stated_sensor().axes, (len(utc_ns), 3, 3))
    true = np.array([true_sensor(error, instant).axes for instant in utc_ns.tolist()])
    boresight, up = sky.boresight_and_up(stated, utc_ns + round(error.clock_s * NS_PER_S))
    true_boresight, true_up = sky.boresight_and_up(true, utc_ns)
    east, north = east_and_north(boresight)
    left = np.cross(up, boresight)  # from north through east, where up is north
    moved = true_boresight - boresight
    errors = [(moved * east).sum(axis=1), (moved * north).sum(axis=1), (true_up * left).sum(axis=1)]
    d_ra_cosde, d_de, roll = (np.mean(errors, axis=1) * ARCSEC_PER_RAD).tolist()
    return d_ra_cosde, d_de, roll


def noise_arcsec(sensor: MadeSensor, fields: list[NDArray[np.float64]], noise_px: float) -> tuple[float, float]:
    """The boresight's scatter along columns and rows that position noise makes, over fields of directions (N, 3).

    By least squares on the pixels: the turns about the sensor's axes that explain the displacements best.
    """
    variances = []
    for directions in fields:
        still = sensor.pixels(directions)
        shifts = [sensor.turned(axis, _STEP_RAD).pixels(directions) - still for axis in sensor.axes]
        design = np.stack([shift.ravel() for shift in shifts], axis=1) / _STEP_RAD
        covariance = np.linalg.inv(design.T @ design) * noise_px**2
        # A turn about up moves the boresight along columns, one about right along rows.
        variances.append([covariance[1, 1], covariance[0, 0]])
    along_x, along_y = (np.sqrt(np.mean(variances, axis=0)) * ARCSEC_PER_RAD).tolist()
    return along_x, along_y
