"""What star places leave open: numbers by hand, blends against the integral over all faint companions."""

import math

import pytest
from scipy.integrate import quad
from skies.known_nights import session

from gse.statistics.star_terms import FieldOfStars, own_stars, star_terms
from gse.values.constants import ARCSEC_RAD
from gse.values.instant import from_text

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


# By hand


def test_a_field_that_is_not_described_is_that_of_the_reference_sensor():
    field = FieldOfStars()
    assert (field.stars, field.width_rad, field.pixel_arcsec) == (10.0, math.radians(14.0), 49.0)
    assert (field.catalog_stars, field.rest_epoch_jyear, field.at_rest) == (4200, 2016.0, 1.0)


def of_session(matched=(0, 12, 8, 30), **facts):
    made = session(4)
    made.frames.columns["matched"] = matched
    made.catalog = facts
    return FieldOfStars.from_session(made)


@pytest.mark.parametrize(
    ("matched", "facts", "expected"),
    [
        ((0, 12, 8, 30), {"stars": 5000, "at_rest": 1000, "rest_epoch_jyear": 1991.25}, (12, 5000, 1991.25, 0.2)),
        ((0, 1, 0, 0), {"stars": 5000, "at_rest": 0, "epoch_jyear": 2000}, (1, 5000, 2000.0, 0.0)),
        ((0, 0, 0, 0), {"rest_epoch_jyear": 2010, "epoch_jyear": 2016.0}, (10, 4200, 2010.0, 1.0)),
        ((9, 9, 9, 9), {"stars": 0, "at_rest": 0}, (9, 4200, 2016.0, 1.0)),
        ((9, 9, 9, 9), {"stars": 1, "at_rest": 1}, (9, 1, 2016.0, 1.0)),
        ((9, 9, 9, 9), {"stars": "many", "at_rest": 4, "epoch_jyear": "new"}, (9, 4200, 2016.0, 1.0)),
        ((9, 9, 9, 9), {"stars": 8, "at_rest": "few"}, (9, 8, 2016.0, 1.0)),
    ],
)
def test_the_field_of_a_session_has_its_stars_and_its_catalogue_and_else_what_is_usual(matched, facts, expected):
    field = of_session(matched, **facts)
    assert (field.stars, field.catalog_stars, field.rest_epoch_jyear, field.at_rest) == expected
    assert field.pixel_arcsec == pytest.approx(49.465, abs=0.001)
    assert field.width_rad == pytest.approx(2 * math.atan(512 / 4169.905), rel=0.01)  # a square detector


@pytest.mark.parametrize(
    ("at_rest", "squared"), [(1.0, 0.12**2), (0.25, 0.25 * 0.12**2 + 0.75 * 0.0035**2), (0.0, 0.0035**2)]
)
@pytest.mark.parametrize("epoch_jyear", [2016.0, 2036.0])
def test_stars_at_rest_and_others_add_up_by_their_shares_before_and_after_the_epoch(at_rest, squared, epoch_jyear):
    field = FieldOfStars(rest_epoch_jyear=epoch_jyear, at_rest=at_rest)
    found = terms(field)["proper motion"]
    assert found.standard == pytest.approx(10 * math.sqrt(squared), rel=1e-3)
    assert found.corrected is (at_rest < 1)
    assert found.explanation == f"{100 * at_rest:.0f} % of the catalogue's stars stand where they stood 10 years ago"


@pytest.mark.parametrize("name", ["proper motion", "parallax", "blends"])
def test_the_error_of_a_star_is_that_of_a_fix_over_the_root_of_their_number_and_its_roll_by_the_width(name):
    """Stars all over a square field have a moment of a sixth of its width squared about its middle."""
    found = terms()[name]
    assert (found.ra_arcsec, found.de_arcsec) == pytest.approx((found.standard / 4, found.standard / 4))
    assert found.roll_arcsec == pytest.approx(found.standard / 4 * math.sqrt(6) / math.radians(14.0))
    assert found.unit == "arcsec per star"
    assert found.corrected is False
    assert found.evidence.startswith("B: ")


def test_companions_are_looked_for_within_three_pixels():
    assert "companions within 3 px" in terms()["blends"].evidence
    wide = FieldOfStars(stars=16.0, width_rad=math.radians(14.0), pixel_arcsec=100.0, catalog_stars=4 * 4200)
    assert terms(wide)["blends"].standard == pytest.approx(2**2 * 2 * terms()["blends"].standard)


def test_the_own_choice_of_stars_is_a_term_of_the_sensor_alone():
    found = own_stars(0.5, math.radians(14.0))
    assert (found.name, found.unit, found.corrected, found.common) == ("own choice of stars", "arcsec", True, True)
    assert (found.standard, found.ra_arcsec, found.de_arcsec) == (0.5, 0.5, 0.5)
    assert found.roll_arcsec == pytest.approx(0.5 * math.sqrt(6) / math.radians(14.0))
