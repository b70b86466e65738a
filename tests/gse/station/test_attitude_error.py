"""Measured against true attitude: the same everywhere on the sky."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gse.attitude import Attitude
from gse.station.attitude_error import attitude_error, attitude_errors


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


def test_many_errors_at_once_are_those_one_by_one_also_at_the_pole_and_without_an_error():
    true = Rotation.random(40, rng=np.random.default_rng(4)).as_matrix()
    true[0], true[1] = np.eye(3), np.diag([1.0, -1.0, -1.0])  # the boresight is at a pole
    turn = Rotation.from_rotvec(np.random.default_rng(5).normal(0, 0.01, (40, 3)))
    measured = turn.as_matrix() @ true
    measured[2] = true[2]
    expected = [dataclasses.astuple(attitude_error(*(Attitude(one, np.zeros((3, 3))) for one in pair)))
                for pair in zip(measured, true, strict=True)]  # fmt: skip
    assert attitude_errors(measured, true) == pytest.approx(np.array(expected), abs=1e-6)
