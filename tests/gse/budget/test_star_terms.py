"""What star places leave open: numbers by hand, blends against the integral over all faint companions."""

import math

import pytest
from scipy.integrate import quad

from gse.budget.star_terms import FieldOfStars, star_terms
from gse.constants import ARCSEC_RAD
from gse.instant import from_text

IN_2026_NS = from_text("2026-01-01T00:00:00Z")
FIELD = FieldOfStars(stars=16.0, width_rad=math.radians(14.0), pixel_arcsec=50.0, catalog_stars=4200, at_rest=1.0)


def terms(field=FIELD, duration_s=60.0):
    return {term.name: term for term in star_terms(field, IN_2026_NS, duration_s)}


def test_stars_at_rest_are_off_by_ten_years_of_proper_motion_over_the_root_of_their_number():
    found = terms()["proper motion"]
    assert found.standard == pytest.approx(10 * 0.12, rel=1e-3)
    assert (found.ra_arcsec, found.de_arcsec) == pytest.approx((1.2 / 4, 1.2 / 4), rel=1e-3)
    assert found.roll_arcsec == pytest.approx(1.2 / 4 / (math.radians(14.0) / math.sqrt(6)), rel=1e-3)


def test_stars_whose_motion_is_known_are_off_by_what_it_leaves():
    moving = FieldOfStars(rest_epoch_jyear=2016.0, at_rest=0.0)
    assert terms(moving)["proper motion"].standard == pytest.approx(10 * 0.0035, rel=1e-3)
    half = FieldOfStars(rest_epoch_jyear=2016.0, at_rest=0.5)
    assert terms(half)["proper motion"].standard == pytest.approx(10 * math.sqrt(0.5 * 0.12**2), rel=2e-3)


def test_parallaxes_are_17_milliarcseconds():
    assert terms()["parallax"].standard == 0.017


def test_blends_are_the_sum_over_all_companions_within_three_pixels():
    """Counts grow as 10^(0.45 m), a companion pulls by its share of the light; a star is 1 mag above the limit."""
    per_sr = 2 * 4200 / (4 * math.pi)
    radius = 3 * 50.0 * ARCSEC_RAD
    light2, _ = quad(lambda m: 0.45 * math.log(10) * 10 ** (0.45 * m) * 10 ** (-0.8 * (m + 1)), 0, 60)
    distance2, _ = quad(lambda d: 2 * math.pi * d * d**2 / 2, 0, radius)
    expected = math.sqrt(per_sr * light2 * distance2) / ARCSEC_RAD
    assert terms()["blends"].standard == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("hours", "is_common"), [(0.9, True), (1.0, False)])
def test_the_same_stars_err_alike_until_the_sky_has_crossed_the_field(hours, is_common):
    """14 deg at 15.04 deg an hour are 56 minutes."""
    assert {term.common for term in star_terms(FIELD, IN_2026_NS, hours * 3600)} == {is_common}
