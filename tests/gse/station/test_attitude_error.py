"""Measured against true attitude: the same everywhere on the sky."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gse.station.results import attitude_error, attitude_errors
from gse.values.attitude import Attitude


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


# Against a calculation of its own: the sphere by vectors, the roll by scipy's quaternion


def by_vectors(measured, true):
    """The five errors, in arcsec: the arc from the true boresight, split along east, north, columns and rows."""
    boresight, seen = true[2], measured[2]
    east = np.cross([0.0, 0.0, 1.0], boresight)
    east /= np.linalg.norm(east)
    north = np.cross(boresight, east)
    arc = math.atan2(np.linalg.norm(np.cross(boresight, seen)), boresight @ seen)
    towards = seen - (seen @ boresight) * boresight
    towards /= np.linalg.norm(towards)
    _, _, z, w = Rotation.from_matrix(measured @ true.T).as_quat()
    roll = math.remainder(2 * math.atan2(z, w), math.tau)
    parts = [towards @ east, towards @ north, None, towards @ true[0], towards @ true[1]]
    return [math.degrees(roll if part is None else arc * part) * 3600 for part in parts]


@pytest.mark.parametrize("size_rad", [1e-6, 1e-3, 0.2, 1.5])
def test_errors_are_those_of_vectors_and_quaternions(size_rad):
    true = Rotation.random(20, rng=np.random.default_rng(8)).as_matrix()
    measured = Rotation.from_rotvec(np.random.default_rng(9).normal(0, size_rad, (20, 3))).as_matrix() @ true
    expected = [by_vectors(*pair) for pair in zip(measured, true, strict=True)]
    assert attitude_errors(measured, true) == pytest.approx(np.array(expected), rel=1e-9, abs=1e-6)


@pytest.mark.parametrize(
    ("pole", "towards_deg", "east", "north"),
    [
        (1.0, 0.0, 0.0, -10.0),  # at the north pole the meridian RA = 0 leads south
        (1.0, 90.0, 10.0, 0.0),
        (1.0, 180.0, 0.0, 10.0),
        (-1.0, 0.0, 0.0, 10.0),
        (-1.0, 90.0, 10.0, 0.0),
        (-1.0, 270.0, -10.0, 0.0),
    ],
)
def test_at_a_pole_itself_east_and_north_are_those_of_the_meridian_ra_zero(pole, towards_deg, east, north):
    true = np.diag([1.0, pole, pole])
    towards = math.radians(towards_deg)
    off = np.array([math.cos(towards), math.sin(towards), 0.0]) * math.radians(10 / 3600)
    turn = Rotation.from_rotvec(np.cross(true[2], off)).as_matrix()
    error = attitude_errors((true @ turn.T)[None], true[None])[0]
    assert error[:3] == pytest.approx([east, north, 0.0], abs=1e-5)
    assert error[3:] == pytest.approx(true[:2] @ off * 206_264.806247, abs=1e-5)


def test_where_there_is_no_error_each_part_is_nothing_and_a_turn_about_the_boresight_is_all_roll():
    true = Rotation.random(5, rng=np.random.default_rng(3)).as_matrix()
    assert attitude_errors(true, true) == pytest.approx(np.zeros((5, 5)), abs=1e-9)
    exact = np.eye(3)[None]
    assert attitude_errors(exact, exact).tolist() == [[0.0] * 5]
    turned = Rotation.from_rotvec([0.0, 0.0, math.radians(30)]).as_matrix()
    assert abs(attitude_errors(turned[None] @ exact, exact)[0]).tolist() == pytest.approx([0, 0, 108_000, 0, 0])
