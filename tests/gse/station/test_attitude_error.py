"""Measured against true attitude: the same everywhere on the sky."""

import math

import numpy as np
import pytest

from gse.attitude import Attitude
from gse.station.attitude_error import attitude_error


@pytest.mark.parametrize(("ra", "de"), [(0.0, 0.0), (359.99999, 45.0), (123.0, 89.9999), (10.0, -90.0), (200.0, 90.0)])
def test_an_error_is_the_same_everywhere_on_the_sky_also_at_the_poles_and_across_zero(ra, de):
    true = Attitude.from_angles(ra, de, 77.0)
    small = np.radians(np.array([30.0, -20.0, 400.0]) / 3600)
    x, y, z = small
    turn = np.array([[1, -z, y], [z, 1, -x], [-y, x, 1]])
    turn, _ = np.linalg.qr(turn.T)
    turn = turn.T * np.sign(np.diag(turn))[:, None]
    error = attitude_error(Attitude(turn @ true.icrs_to_sensor, np.zeros((3, 3))), true)
    assert math.hypot(error.d_ra_cosde_arcsec, error.d_de_arcsec) == pytest.approx(math.hypot(30, 20), rel=1e-3)
    assert math.hypot(error.cross_x_arcsec, error.cross_y_arcsec) == pytest.approx(math.hypot(30, 20), rel=1e-3)
    assert error.d_roll_arcsec == pytest.approx(400, rel=1e-3)


def test_signs_are_east_north_and_roll_as_defined():
    true = Attitude.from_angles(100.0, -6.5, 20.0)
    error = attitude_error(Attitude.from_angles(100.0 + 10 / 3600, -6.5 + 5 / 3600, 20.0 + 50 / 3600), true)
    assert error.d_ra_cosde_arcsec == pytest.approx(10 * math.cos(math.radians(6.5)), abs=1e-3)
    assert error.d_de_arcsec == pytest.approx(5, abs=1e-3)
    assert error.d_roll_arcsec == pytest.approx(50 - 10 * math.sin(math.radians(-6.5)), abs=0.01)


def test_an_answer_on_the_other_side_of_the_sky_is_180_degrees_off():
    error = attitude_error(Attitude.from_angles(190.0, -30.0, 0.0), Attitude.from_angles(10.0, 30.0, 0.0))
    assert math.hypot(error.d_ra_cosde_arcsec, error.d_de_arcsec) == pytest.approx(180 * 3600)
