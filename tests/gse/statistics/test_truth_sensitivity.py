"""What changed inputs make of the truth, against rates and angles that are known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from skies.known_nights import START_NS, TABLE

from gse.statistics.budget_terms import ChangedTruth, absolute, scaled, together
from gse.truth import SiderealTruth
from gse.values.constants import EARTH_RATE_ARCSEC_PER_S
from gse.values.mount import Mount
from gse.values.site import Site

LEANING = Mount(azimuth_deg=40.0, altitude_deg=45.0, roll_deg=10.0)
SITE = Site(latitude_deg=48.0, longitude_deg=11.0, height_m=500.0, pressure_hpa=955.0, temperature_c=10.0)
AT = ChangedTruth(SITE, LEANING, TABLE, START_NS)


def across(vector):
    return math.hypot(*vector[:2])


def test_a_mount_that_is_turned_moves_the_error_the_other_way_by_the_same_angle():
    higher = AT.changed(mount=Mount(azimuth_deg=40.0, altitude_deg=45.0 + 10 / 3600, roll_deg=10.0))
    assert across(higher) == pytest.approx(10.0, rel=1e-3)
    rolled = AT.changed(mount=Mount(azimuth_deg=40.0, altitude_deg=45.0, roll_deg=10.0 + 100 / 3600))
    assert across(rolled) == pytest.approx(0.0, abs=1e-3)
    assert abs(rolled[2]) == pytest.approx(100.0, rel=1e-3)


@pytest.mark.parametrize(
    ("azimuth_deg", "moved"), [(40.0, 0.0), (130.0, 20.0), (-50.0, 20.0), (85.0, 20 * math.sqrt(0.5))]
)
def test_a_tilt_about_a_level_direction_moves_what_is_beside_it(azimuth_deg, moved):
    """Of a boresight 45 deg high in azimuth 40 deg: about that azimuth it is lifted aside by its sine alone."""
    tilted = AT.tilted(azimuth_deg, 20.0)
    aside = 20 * math.sin(math.radians(45.0)) * abs(math.cos(math.radians(azimuth_deg - 40.0)))
    assert across(tilted) == pytest.approx(math.hypot(moved, aside), rel=1e-3)


def test_a_turn_in_the_sensor_frame_is_a_shift_and_a_roll():
    assert across(AT.turned(np.array([3.0, 4.0, 0.0]))) == pytest.approx(5.0, rel=1e-4)
    assert abs(AT.turned(np.array([0.0, 0.0, 50.0]))[2]) == pytest.approx(50.0, rel=1e-4)


def test_air_moves_what_is_measured_by_how_it_bends():
    thicker = AT.changed(site=Site(latitude_deg=48.0, longitude_deg=11.0, height_m=500.0, pressure_hpa=965.0,
                                   temperature_c=10.0))  # fmt: skip
    assert across(thicker) == pytest.approx(AT.refraction_arcsec * 10 / 955, rel=0.02)
    assert AT.refraction_arcsec == pytest.approx(58.3 * 955 / 1010 * 283 / 283, rel=0.03)  # at 45 deg and 10 degC


@pytest.mark.parametrize("pressure_hpa", [945.0, 965.0])
def test_air_that_bends_more_than_is_thought_leaves_what_a_mount_that_is_higher_than_stated_leaves(pressure_hpa):
    """Stars are lifted and the boresight is taken for too low, by as much as the air bends more."""
    other = replace(SITE, pressure_hpa=pressure_hpa)
    more_arcsec = AT.refraction_arcsec * (pressure_hpa / 955 - 1)  # in proportion to the pressure
    higher = AT.changed(mount=replace(LEANING, altitude_deg=45.0 + more_arcsec / 3600))
    assert AT.changed(site=other) == pytest.approx(higher, rel=5e-3, abs=1e-4)
    assert across(higher) > 0.5


@pytest.mark.parametrize("seconds", [0.01, 2.0])
def test_time_turns_the_sky_about_the_pole(seconds):
    ra, de, roll = AT.about_the_pole(seconds)
    assert (math.hypot(ra, roll), de) == (pytest.approx(EARTH_RATE_ARCSEC_PER_S * seconds), 0.0)
    assert ra == pytest.approx(EARTH_RATE_ARCSEC_PER_S * seconds * math.cos(AT.de_rad))
    later = SiderealTruth(SITE, TABLE).attitude_true(START_NS + round(seconds * 1e9), LEANING)
    now = SiderealTruth(SITE, TABLE).attitude_true(START_NS, LEANING)
    assert (later.ra_deg - now.ra_deg) * 3600 * math.cos(AT.de_rad) == pytest.approx(ra, rel=0.01)  # RA of date


@pytest.mark.parametrize(
    ("correction", "least", "most"),
    [
        ("nutation", 1.0, 20.0),
        ("UT1", 0.0, 10.0),
        ("polar motion", 0.0, 0.7),
        ("geodetic latitude", 100.0, 700.0),  # 11.5 arcmin at 45 deg of latitude
    ],
)
def test_what_the_frame_would_be_off_by_without_a_correction(correction, least, most):
    assert least < AT.without(correction) < most


def test_precession_turns_the_sky_about_the_pole_of_the_ecliptic_by_50_arcsec_a_year():
    boresight = SiderealTruth(SITE, TABLE).attitude_true(START_NS, LEANING).boresight_icrs
    pole_icrs = np.array([0.0, -math.sin(math.radians(23.44)), math.cos(math.radians(23.44))])
    across_arcsec = 50.3 * 26.2 * np.linalg.norm(np.cross(pole_icrs, boresight))
    assert AT.without("precession") == pytest.approx(across_arcsec, rel=0.02)


@pytest.mark.parametrize(
    ("correction", "least", "most"),
    [("annual aberration", 1.0, 20.6), ("diurnal aberration", 0.001, 0.33), ("light deflection", 1e-4, 0.1)],
)
def test_what_a_star_would_be_off_by_without_a_correction(correction, least, most):
    assert least < AT.star_without(correction) < most


def test_contributions_add_as_squares_and_scale_with_their_size():
    assert together([(3.0, 0.0, 1.0), (-4.0, 2.0, 0.0)]) == (5.0, 2.0, 1.0)
    assert absolute((-1.0, 2.0, -3.0)) == (1.0, 2.0, 3.0)
    asked = []

    def change(step):
        asked.append(step)
        return (-2 * step, step, 0.0)

    assert scaled(change, 100.0, 60.0) == (200.0, 100.0, 0.0)
    assert scaled(change, 10.0, 60.0) == (20.0, 10.0, 0.0)
    assert scaled(change, 0.0, 60.0) == (0.0, 0.0, 0.0)
    assert asked == [60.0, 10.0]
