"""Refraction from the zenith to the horizon: there and back, and held where the formula ends."""

import math

import erfa
import numpy as np
import pytest

from gse.truth import Refraction
from gse.values.site import Site

ARCSEC = math.pi / 180 / 3600
ROOF = Site(latitude_deg=-6.53, longitude_deg=106.7, height_m=250, pressure_hpa=985, temperature_c=25)
AIR = Refraction.at(ROOF)
ZENITH = np.array([0.0, 0.0, 1.0])


def at_zenith_distance(degrees, azimuth_deg=30.0):
    z, azimuth = np.radians(degrees), np.radians(azimuth_deg)
    return np.array([[np.sin(z) * np.sin(azimuth), np.sin(z) * np.cos(azimuth), np.cos(z)]])


def lifted_rad(degrees):
    """How far an object seen at a zenith distance is lifted, from its direction without air."""
    (before,) = AIR.removed(at_zenith_distance(degrees), ZENITH)
    return math.atan2(math.hypot(before[0], before[1]), before[2]) - math.radians(degrees)


def test_the_constants_are_those_of_erfa_for_the_air_of_the_site():
    a, b = erfa.refco(985.0, 25.0, ROOF.relative_humidity, 0.6)
    assert (AIR.a_rad, AIR.b_rad) == (a, b)


@pytest.mark.parametrize("degrees", [0.001, 5, 30, 45, 60, 75, 85, 87])
def test_an_object_is_lifted_by_a_tan_z_and_b_tan_cubed_z(degrees):
    tangent = math.tan(math.radians(degrees))
    expected = AIR.a_rad * tangent + AIR.b_rad * tangent**3
    assert lifted_rad(degrees) == pytest.approx(expected, rel=1e-6, abs=1e-12)
    assert AIR.bend_rad(math.radians(degrees)) == pytest.approx(expected, rel=1e-9)


def test_at_the_zenith_nothing_is_lifted():
    assert np.abs(AIR.removed(ZENITH[None], ZENITH) - ZENITH).max() == 0.0


def test_towards_the_horizon_the_formula_is_held():
    """From tan z = 20, as far as the size goes; from 3 deg of altitude for directions, where cos z is 0.05."""
    at_20 = AIR.a_rad * 20 + AIR.b_rad * 20**3
    for degrees in (87.2, 89.9, 90.0, 100.0):
        assert AIR.bend_rad(math.radians(degrees)) == pytest.approx(at_20)
    per_sine = (AIR.a_rad + AIR.b_rad * (1 / 0.05**2 - 1)) / 0.05
    for degrees in (88.0, 90.0, 95.0):
        assert lifted_rad(degrees) == pytest.approx(per_sine * math.sin(math.radians(degrees)), rel=1e-6)


@pytest.mark.parametrize("degrees", [1, 20, 45, 70, 80])
def test_what_is_removed_can_be_added_again(degrees):
    seen = at_zenith_distance(degrees)
    back = AIR.added(AIR.removed(seen, ZENITH), ZENITH)
    assert np.abs(back - seen).max() < 1e-4 * ARCSEC


def test_a_sensor_that_is_turned_sees_the_same_lift():
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    seen = np.vstack([at_zenith_distance(z, 50.0 * z) for z in (10.0, 40.0, 70.0)])
    assert np.allclose(AIR.removed(seen @ turn.T, turn @ ZENITH), AIR.removed(seen, ZENITH) @ turn.T, atol=1e-14)
