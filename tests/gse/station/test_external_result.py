"""What an external identifier gave as a result of the station: status, roll, residuals, by hand."""

import math
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from skies.made_frames import FIELD_14_DEG

from gse.attitude import Attitude
from gse.catalog import load_catalog
from gse.external.answers import ExternalAnswer, Failure, FailureKind
from gse.external.identifier import ExternalIdentifier, Given
from gse.identifier import Identification
from gse.instant import from_text
from gse.mount import Mount
from gse.panorama import Panorama, Panoramas
from gse.site import Site
from gse.station.attitude_error import attitude_errors
from gse.station.external_result import (
    geometric_of,
    has_roll,
    identification_of,
    matches_of,
    status_of,
    with_roll,
)
from gse.station.frame_processor import FrameProcessor
from gse.station.non_stellar import NonStellarObjects
from gse.station.results import Status
from gse.truth import EarthOrientation, SiderealTruth

ARCSEC = math.pi / 648_000
ATTITUDE = Attitude.from_angles(120.0, 35.0, 50.0)
UTC_NS = from_text("2026-03-20T18:30:00Z")
SITE = Site(latitude_deg=48.0, longitude_deg=11.0, height_m=300.0)


@pytest.fixture(scope="module")
def catalog():
    return load_catalog(stars=4000)


def found_of(catalog):
    """Five stars near the boresight, and where they are seen."""
    stars = np.argsort(-(catalog.icrs @ ATTITUDE.boresight_icrs))[:5]
    return Identification(np.arange(5), stars, math.nan), catalog.icrs[stars] @ ATTITUDE.icrs_to_sensor.T


def test_residuals_are_measured_less_catalogue_places_in_arcsec(catalog):
    found, seen = found_of(catalog)
    off = np.array([[10.0, -20.0], [0.0, 0.0], [3.0, 4.0], [-60.0, 1.0], [0.5, 0.0]])
    seen[:, :2] += off * ARCSEC
    matches = matches_of(found, catalog, ATTITUDE, seen, None, UTC_NS)
    assert matches.residuals_arcsec == pytest.approx(off, abs=1e-6)
    assert matches.stars.tolist() == found.stars.tolist()
    assert matches.name_of(int(found.stars[0])) == catalog.name(int(found.stars[0]))


def test_an_answer_that_names_no_star_has_no_residuals(catalog):
    none = Identification(np.arange(0), np.arange(0), math.nan)
    assert len(matches_of(none, catalog, ATTITUDE, np.zeros((0, 3)), None, UTC_NS)) == 0


def test_residuals_under_a_truth_are_free_of_aberration_and_air(catalog):
    truth = SiderealTruth(SITE, EarthOrientation.from_disk(UTC_NS))
    true = truth.attitude_true(UTC_NS, Mount(altitude_deg=40.0))
    stars = np.argsort(-(catalog.icrs @ true.boresight_icrs))[:5]
    apparent = truth.apparent(catalog.icrs[stars], UTC_NS) @ true.icrs_to_sensor.T
    seen = truth.refraction.added(apparent, true.icrs_to_sensor @ truth.icrs_to_horizon(UTC_NS)[2])
    found = Identification(np.arange(5), stars, math.nan)
    assert np.abs(matches_of(found, catalog, true, seen, truth, UTC_NS).residuals_arcsec).max() < 0.05
    assert np.abs(matches_of(found, catalog, true, seen, None, UTC_NS).residuals_arcsec).max() > 20
    raw = Attitude.from_angles(true.ra_deg, true.de_deg, true.roll_deg)
    moved = geometric_of(raw, seen, truth, UTC_NS)
    assert np.degrees(np.arccos(moved.boresight_icrs @ raw.boresight_icrs)) * 3600 > 20  # by air and aberration


@pytest.mark.parametrize("objects", [0, 1])
def test_where_fewer_than_two_objects_are_given_a_cross_stands_for_a_whole_field(objects):
    """At 40 deg of altitude, where air lifts the boresight by an arcminute, and the lower edge by more."""
    truth = SiderealTruth(SITE, EarthOrientation.from_disk(UTC_NS))
    raw = truth.attitude_true(UTC_NS, Mount(altitude_deg=40.0))
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-0.06, 0.06, 9), np.linspace(-0.06, 0.06, 9)))
    field = np.column_stack([x, y, np.ones(81)])
    field /= np.linalg.norm(field, axis=1)[:, None]
    whole = geometric_of(raw, field, truth, UTC_NS).icrs_to_sensor[None]
    found = geometric_of(raw, field[:objects], truth, UTC_NS).icrs_to_sensor[None]
    assert np.abs(attitude_errors(found, whole)).max() < 0.1
    assert np.hypot(*attitude_errors(raw.icrs_to_sensor[None], whole)[0, 3:]) > 40


@pytest.mark.parametrize(
    ("status", "detail", "expected"),
    [
        ("TOO_FEW", "", (Status.TOO_FEW, "TOO_FEW")),
        ("AMBIGUOUS", "two", (Status.AMBIGUOUS, "AMBIGUOUS: two")),
        ("SENSOR_FAULT", "", (Status.SENSOR_FAULT, "SENSOR_FAULT")),
        ("NO_MATCH", "", (Status.NO_MATCH, "NO_MATCH")),
        ("lost in space", "", (Status.NO_MATCH, "lost in space")),
        ("IDENTIFIER_FAULT", "", (Status.NO_MATCH, "IDENTIFIER_FAULT")),
    ],
)
def test_a_word_of_the_station_is_its_status_and_any_other_is_no_match(status, detail, expected):
    assert status_of(Given(SimpleNamespace(status=status, detail=detail))) == expected


def test_a_failure_is_a_fault_of_the_identifier():
    failed = Given(Failure(FailureKind.GIVEN_UP, "it failed too often"))
    assert status_of(failed) == (Status.IDENTIFIER_FAULT, f"{FailureKind.GIVEN_UP}: it failed too often")
    assert has_roll(failed)
    assert has_roll(None)


def test_a_boresight_keeps_its_place_with_another_roll():
    turned = with_roll(ATTITUDE, 10.0)
    assert (turned.ra_deg, turned.de_deg, turned.roll_deg) == pytest.approx((120.0, 35.0, 10.0))


class Source:
    """Answers made on purpose."""

    identity: ClassVar[dict[str, str]] = {"name": "made", "version": "1"}

    def __init__(self, *answers):
        self._answers = answers

    def answers(self, panoramas):
        return [Given(one, 42.0) for one in self._answers[: len(panoramas)]]


def external(attitude, *, has_roll):
    none = np.zeros(0, dtype=np.int64)
    return ExternalAnswer({}, attitude, has_roll, "IDENTIFIED", "", none, none, None)


def test_an_answer_without_a_roll_has_no_error_of_roll_and_one_with_a_roll_has(catalog):
    truth, mount = SiderealTruth(SITE, EarthOrientation.from_disk(UTC_NS)), Mount(altitude_deg=80.0)
    true = truth.attitude_true(UTC_NS, mount)
    off = Attitude.from_angles(true.ra_deg, true.de_deg + 0.01, true.roll_deg + 0.1)
    identifier = ExternalIdentifier(catalog, Source(external(off, has_roll=False), external(off, has_roll=True)))
    hot = NonStellarObjects(FIELD_14_DEG, SITE)
    processor = FrameProcessor(FIELD_14_DEG, 4096, identifier, None, hot, truth, mount)
    places = np.array([[100.0, 200.0], [300.0, 500.0], [800.0, 700.0]])
    panoramas = Panoramas.of([Panorama(UTC_NS, places, np.array([300.0, 200.0, 100.0]), number) for number in (1, 2)])
    identified = processor.identify(panoramas)
    without, with_one = processor.conclude(panoramas, identified, identified.elapsed_us)
    assert (without.has_roll, with_one.has_roll) == (False, True)
    assert math.isnan(without.attitude_error.d_roll_arcsec)
    assert with_one.attitude_error.d_roll_arcsec == pytest.approx(360.0, abs=30)
    for result in (without, with_one):
        assert result.attitude_error.d_de_arcsec == pytest.approx(36.0, abs=30)  # less air and aberration
        assert result.elapsed_us == 42.0


def test_the_stars_that_an_answer_names_are_those_that_the_catalogue_has_the_first_of_them_too(catalog):
    places = np.array([[100.0, 200.0], [300.0, 500.0], [800.0, 700.0]])
    panorama = Panorama(UTC_NS, places, np.array([300.0, 200.0, 100.0]), 1)
    ids = np.array([catalog.ids[7], -5, catalog.ids[0]])
    answer = ExternalAnswer({}, ATTITUDE, True, "IDENTIFIED", "", np.arange(3), ids, None)
    found, attitude = identification_of(Given(answer, 1.0), panorama, ExternalIdentifier(catalog, Source()))
    assert found.stars.tolist() == [7, 0]
    assert found.objects.tolist() == [0, 2]
    assert attitude is ATTITUDE
