"""A sensor's own answers to the panoramas of a night by astropy: which offsets are its own, which are its stars'."""

from dataclasses import replace

import numpy as np
import pytest
from skies import known_nights
from skies.own_answers import by_stars, with_answers, without_error
from skies.wrong_night import Plan, World, session, station_text

from gse.config.station import parse_station
from gse.diagnosis.sensor_findings import by_each_idea, sensor_findings
from gse.station.own_answers import SensorAnswers, sensor_answers
from gse.station.setup import set_up
from gse.values.constants import EARTH_RATE_ARCSEC_PER_S
from gse.values.instant import from_text
from gse.values.mount import InertialDirection, Mount
from gse.values.site import Site

SITE = Site(latitude_deg=48.2, longitude_deg=11.6, height_m=500.0, pressure_hpa=955.0, temperature_c=8.0)
ARCTIC = Site(latitude_deg=71.3, longitude_deg=-179.4, height_m=10.0, pressure_hpa=1012.0, temperature_c=-20.0)
WORLD = World(SITE, azimuth_deg=130.0, altitude_deg=75.0, roll_deg=30.0, whole_pixels=False, noise_px=0.1)
PLAN = Plan("2026-03-20T21:30:00Z", 40.0, 5.0, seed=6)


@pytest.fixture(scope="module")
def night():
    return session(WORLD, WORLD, PLAN)


def catalog_of(world, plan):
    text = station_text(world)
    return set_up(parse_station(text), text, utc_ns=from_text(plan.start)).identifier.catalog


@pytest.fixture(scope="module")
def catalog():
    return catalog_of(WORLD, PLAN)


def said(made):
    return list(sensor_findings(made, sensor_answers(made), None))


@pytest.mark.parametrize("delay", [0, 1])
def test_a_delay_of_one_exposure_at_five_a_second_is_named_with_what_looks_the_same(night, catalog, delay):
    found = said(with_answers(night, *by_stars(night, catalog, delay=delay)))
    assert [finding.cause for finding in found] == ["sensor delay"] * delay
    for finding in found:
        assert "as those of 0.2" in finding.size or "as those of 0.1" in finding.size
        turned = f"a body frame that is turned about the pole by {-0.2 * EARTH_RATE_ARCSEC_PER_S:+.1f}"
        assert any(text.startswith(turned[:-2]) for text in finding.equals)
        assert "mounted at another roll" in finding.next_step


def test_a_sensor_that_takes_other_stars_may_lie_as_far_off(night, catalog):
    """Ten of twenty-two: they lie elsewhere in the air."""
    assert said(with_answers(night, *by_stars(night, catalog, most=10))) == []


@pytest.mark.parametrize(("stars", "is_said"), [(10, False), (19, True)])
def test_a_sensor_that_takes_far_fewer_stars_chooses_them_otherwise(night, catalog, stars, is_said):
    """Of 22: by the air between ten of them as few arcsec may be told as by that between others."""
    angles, counts = by_stars(night, catalog)
    shifted = angles + np.array([0.0, 5.4 / 3600, 0.0])
    assert bool(said(with_answers(night, shifted, 0 * counts + stars))) == is_said


def test_a_sensor_that_does_not_say_how_many_stars_it_took_may_have_taken_others(night, catalog):
    angles, counts = by_stars(night, catalog, delay=1)
    assert said(with_answers(night, angles, 0 * counts)) == []


@pytest.mark.parametrize("idea", ["its stars", "its field", "its boresight"])
def test_the_mean_of_its_stars_or_of_its_field_or_the_boresight_is_as_good_an_answer(idea):
    """At 35 deg air parts the stars of a field so that these lie some arcsec apart."""
    world = replace(WORLD, site=ARCTIC, azimuth_deg=210.02, altitude_deg=35.0, roll_deg=144.72)
    plan = replace(PLAN, start="2026-01-18T12:40:00Z")
    low = session(world, world, plan)
    angles, counts = by_stars(low, catalog_of(world, plan))
    if idea != "its stars":
        angles = without_error(low, whole_field=idea == "its field")
    assert said(with_answers(low, angles, counts)) == []


@pytest.mark.parametrize(
    ("ra_arcsec", "de_arcsec", "may_be_late"), [(0.0, 4.0, False), (3.0, 1.2, True), (3.0, 2.0, False)]
)
def test_a_bias_of_its_own_is_one_that_a_turned_body_frame_has(night, catalog, ra_arcsec, de_arcsec, may_be_late):
    """And one that a delay has, where as much in DE as there is other stars make: 1.3 arcsec here."""
    angles, counts = by_stars(night, catalog)
    shift = np.array([ra_arcsec / np.cos(np.radians(37.7)), de_arcsec, 0.0]) / 3600
    (finding,) = said(with_answers(night, angles + shift, counts))
    assert finding.cause == "sensor bias"
    assert finding.equals[0] == "a body frame that is turned by as much"
    assert [text for text in finding.equals if "answers of 0.25 s after" in text] == list(finding.equals[1:])
    assert len(finding.equals) == 1 + may_be_late


# By hand


def known(**changes):
    """Sixty answers here without an error, and those of a sensor that are 3 arcsec east and 4 south of them."""
    made = known_nights.session(60, noise=0.0)
    made.station = made.station.model_copy(update=changes)
    frames = made.frames.columns
    own = {name: np.full(60, np.nan) for name in SensorAnswers.__slots__}
    for name, off in (("d_ra_cosde_arcsec", 3.0), ("d_de_arcsec", -4.0)):
        own[name] = frames[name] + off
    return made, SensorAnswers(**own)


def test_at_the_zenith_field_and_boresight_are_one_and_answers_by_stars_lack_aberration():
    """The Earth's way shifts stars by 20.5 arcsec at most, and by as much in all these frames."""
    rows, (by_its_stars, by_field, by_boresight) = by_each_idea(*known(), np.arange(5, 60, 6))
    assert rows.tolist() == list(range(5, 60, 6))
    assert by_field == pytest.approx(np.tile([3.0, -4.0], (10, 1)), abs=1e-3)
    assert by_boresight == pytest.approx(by_field, abs=0.05)
    shift = by_its_stars - by_field
    assert 18 < np.hypot(*shift[0]) < 20.9
    assert shift == pytest.approx(np.tile(shift[0], (10, 1)), abs=0.05)


def test_by_the_field_an_answer_is_compared_with_the_one_here_whatever_that_is_off_by():
    made, own = known()
    frames = made.frames.columns
    frames["d_ra_cosde_arcsec"], frames["d_de_arcsec"] = 500.0, -700.0
    own.d_ra_cosde_arcsec[:], own.d_de_arcsec[:] = 503.0, -704.0
    _, (_, by_field, _) = by_each_idea(made, own, np.arange(60))
    assert by_field == pytest.approx(np.tile([3.0, -4.0], (60, 1)))


@pytest.mark.parametrize(("count", "taken"), [(1, 1), (16_384, 16_384), (16_385, 8_193), (32_769, 10_923)])
def test_of_many_rows_every_second_or_third_is_taken(count, taken):
    rows = np.arange(count) % 60
    found, ideas = by_each_idea(*known(), rows)
    assert found.tolist() == rows[:: -(-count // 16_384)].tolist()
    assert [len(one) for one in (found, *ideas)] == [taken] * 4


def test_without_a_truth_and_before_a_star_simulator_there_is_no_idea():
    made, own = known()
    made.earth_orientation = None
    assert by_each_idea(made, own, np.arange(60)) is None
    shown = Mount(inertial=InertialDirection(ra_deg=83.0, de_deg=-2.0))
    assert by_each_idea(*known(mount=shown), np.arange(60)) is None
