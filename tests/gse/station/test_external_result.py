"""What an external identifier gave as a result of the station: status, roll, residuals, by hand."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from skies.made_frames import FIELD_14_DEG
from skies.one_by_one import Light, lights_of

from gse.catalog import load_catalog
from gse.external.answers import ExternalAnswer, Failure, FailureKind
from gse.external.identifier import ExternalIdentifier, Given
from gse.identifier import Identification, Reason, Unidentified
from gse.station.columns import ANSWER_CHECKS
from gse.station.frame_processor import (
    FrameProcessor,
    Identified,
    external_answers_of,
    geometric_of,
    has_roll,
    identification_of,
    residuals_of,
    status_of,
    with_roll,
)
from gse.station.non_stellar import NonStellarObjects
from gse.station.results import AnswerCheck, Status, attitude_errors
from gse.truth import EarthOrientation, SiderealTruth
from gse.values.attitude import Attitude
from gse.values.instant import from_text
from gse.values.mount import Mount
from gse.values.panorama import Panorama, Panoramas
from gse.values.site import Site

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
    assert residuals_of(found, catalog, ATTITUDE, seen, None, UTC_NS) == pytest.approx(off, abs=1e-6)


def test_an_answer_that_names_no_star_has_no_residuals(catalog):
    none = Identification(np.arange(0), np.arange(0), math.nan)
    assert residuals_of(none, catalog, ATTITUDE, np.zeros((0, 3)), None, UTC_NS).shape == (0, 2)


def test_residuals_under_a_truth_are_free_of_aberration_and_air(catalog):
    truth = SiderealTruth(SITE, EarthOrientation.from_disk(UTC_NS))
    true = truth.attitude_true(UTC_NS, Mount(altitude_deg=40.0))
    stars = np.argsort(-(catalog.icrs @ true.boresight_icrs))[:5]
    apparent = truth.apparent(catalog.icrs[stars], UTC_NS) @ true.icrs_to_sensor.T
    seen = truth.refraction.added(apparent, true.icrs_to_sensor @ truth.icrs_to_horizon(UTC_NS)[2])
    found = Identification(np.arange(5), stars, math.nan)
    assert np.abs(residuals_of(found, catalog, true, seen, truth, UTC_NS)).max() < 0.05
    assert np.abs(residuals_of(found, catalog, true, seen, None, UTC_NS)).max() > 20
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
    panoramas = Panoramas.from_panoramas(
        [Panorama(UTC_NS, places, np.array([300.0, 200.0, 100.0]), number) for number in (1, 2)]
    )
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


# Answers and results by hand, without an identifier

PLACES = np.array([[100.0, 200.0], [300.0, 500.0], [800.0, 700.0]])


def made_panorama(number, objects=3):
    return Panorama(UTC_NS + number, PLACES[:objects], np.array([300.0, 200.0, 100.0])[:objects], number)


def no_answer(status="TOO_FEW", detail="two objects"):
    none = np.zeros(0, dtype=np.int64)
    return ExternalAnswer({}, None, False, status, detail, none, none, None)


def answer_of(catalog, rows, objects):
    return ExternalAnswer({}, ATTITUDE, True, "IDENTIFIED", "", np.array(objects), catalog.ids[np.array(rows)], None)


class Timed:
    """Answers made on purpose, each with its time; it notes the panoramas that it is asked for."""

    identity: ClassVar[dict[str, str]] = {"name": "made", "version": "1"}

    def __init__(self, *given):
        self._given, self.asked = list(given), []

    def answers(self, panoramas):
        self.asked += [panorama.frame_no for panorama in panoramas]
        return self._given


FAULT = Unidentified(Reason.SENSOR_FAULT, "the sensor reports detector fault")


def test_panoramas_without_a_fault_are_asked_for_and_what_is_given_for_each_has_its_place(catalog):
    crash = Failure(FailureKind.CRASH, "it ended")
    source = Timed(Given(answer_of(catalog, [3, 8], [0, 2]), 42.06), Given(no_answer(), None), Given(crash, 1000.04))
    panoramas = Panoramas.from_panoramas([made_panorama(number) for number in range(4)])
    identifier = ExternalIdentifier(catalog, source)
    answers, attitudes, elapsed_us, given = external_answers_of(identifier, panoramas, {1: FAULT})
    assert source.asked == [0, 2, 3]
    assert sorted(given) == [0, 2, 3]
    assert (answers[0].objects.tolist(), answers[0].stars.tolist()) == ([0, 2], [3, 8])
    assert math.isnan(answers[0].false_match_probability)
    assert answers[1] is FAULT
    assert answers[2] == Unidentified(Reason.NO_MATCH, "TOO_FEW: two objects")
    assert answers[3] == Unidentified(Reason.NO_MATCH, "CRASH: it ended")
    assert attitudes[0].icrs_to_sensor.tolist() == ATTITUDE.icrs_to_sensor.tolist()
    assert [attitudes[k] for k in (1, 2, 3)] == [None] * 3
    assert elapsed_us.tolist() == pytest.approx([42.1, math.nan, math.nan, 1000.0], nan_ok=True)


def identified_of(catalog, *given, panoramas=None):
    """What follows from three panoramas, of which the second is a fault of the sensor."""
    identifier = ExternalIdentifier(catalog, Timed(*given))
    panoramas = panoramas or Panoramas.from_panoramas([made_panorama(number) for number in range(3)])
    answers, attitudes, elapsed_us, by_panorama = external_answers_of(identifier, panoramas, {1: FAULT})
    light = lights_of([Light(k, 14.0 + k, 5.0, 100.0) for k in range(3)])
    checks = [ANSWER_CHECKS.index(one) for one in (AnswerCheck.FALSE, AnswerCheck.UNKNOWN, AnswerCheck.ABSENT)]
    identified = Identified(
        FIELD_14_DEG.directions(panoramas.xy_px),
        np.array([True, False, True]),
        answers,
        attitudes,
        np.array(checks, dtype=np.uint8),
        np.full(3, np.nan),
        np.full((3, 3), np.nan),
        light,
        elapsed_us,
        by_panorama,
    )
    return identifier, panoramas, identified


def results_of(identifier, panoramas, identified, elapsed_us, truth, mount):
    hot = NonStellarObjects(FIELD_14_DEG, SITE)
    processor = FrameProcessor(FIELD_14_DEG, 4096, identifier, None, hot, truth, mount)
    return processor.conclude(panoramas, identified, np.array(elapsed_us))


def test_results_of_an_answer_a_fault_and_no_answer_say_what_each_is(catalog):
    given = Given(answer_of(catalog, [3, 8], [0, 2]), 42.0), Given(no_answer(), 7.0)
    identifier, panoramas, identified = identified_of(catalog, *given)
    one, fault, none = results_of(identifier, panoramas, identified, [42.0, math.nan, 7.0], None, None)
    assert (one.status, one.detail, one.identifier) == (Status.IDENTIFIED, "", "external")
    assert (one.elapsed_us, one.answer_check, one.row["stars_seen"], one.has_roll) == (42.0, AnswerCheck.FALSE, 0, True)
    assert one.given is given[0]
    assert one.attitude.icrs_to_sensor.tolist() == ATTITUDE.icrs_to_sensor.tolist()
    assert (one.attitude_geometric, one.attitude_true, one.attitude_error) == (None, None, None)
    assert [(match.object, match.star) for match in one.matches] == [(0, catalog.name(3)), (2, catalog.name(8))]
    assert (fault.status, fault.detail) == (Status.SENSOR_FAULT, "the sensor reports detector fault")
    assert (fault.attitude, fault.elapsed_us, fault.given) == (None, None, None)
    assert (none.status, none.detail, none.elapsed_us) == (Status.TOO_FEW, "TOO_FEW: two objects", 7.0)
    assert (none.attitude, none.given) == (None, given[1])
    assert (none.answer_check, none.row["zero_point_mag"], none.has_roll) == (AnswerCheck.ABSENT, 16.0, True)
    assert [len(result.matches) for result in (fault, none)] == [0, 0]


def test_objects_of_a_result_are_those_of_its_own_panorama(catalog):
    """The residuals of the third panorama, whose objects stand elsewhere, by the geometry of a pinhole."""
    panoramas = Panoramas.from_panoramas([made_panorama(0, 2), made_panorama(1, 1), made_panorama(2)])
    stars = np.argsort(-(catalog.icrs @ ATTITUDE.boresight_icrs))[:2]
    given = Given(no_answer(), None), Given(answer_of(catalog, stars, [1, 2]), None)
    identifier, panoramas, identified = identified_of(catalog, *given, panoramas=panoramas)
    found = results_of(identifier, panoramas, identified, [math.nan] * 3, None, None)[2]
    assert found.elapsed_us is None
    offset = np.column_stack([PLACES[1:] - 511.5, np.full(2, FIELD_14_DEG.focal_length_px)])
    seen = offset / np.sqrt((offset**2).sum(axis=1))[:, None]
    expected = (seen - catalog.icrs[stars] @ ATTITUDE.icrs_to_sensor.T)[:, :2] / ARCSEC
    residuals = [(match.residual_x_arcsec, match.residual_y_arcsec) for match in found.matches]
    assert np.array(residuals) == pytest.approx(expected, abs=1e-6)


class StillSky:
    """A sky without aberration, whose air turns all that it shows by a milliradian; it notes what that is."""

    def __init__(self):
        self.shown = []

    def icrs_to_horizon(self, utc_ns):
        return np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])

    def attitude_true(self, utc_ns, mount):
        return Attitude.from_angles(0.0, 90.0, mount.roll_deg)

    def apparent(self, stars_icrs, utc_ns):
        return stars_icrs.copy()

    def unrefracted(self, directions_sensor, zenith_sensor):
        self.shown.append(directions_sensor.tolist())
        turn = Rotation.from_rotvec(-1e-3 * np.cross([0.0, 0.0, 1.0], zenith_sensor)).as_matrix()
        return directions_sensor @ turn.T


POLE = Attitude.from_angles(0.0, 90.0, 40.0)


def at_the_pole(*, has_roll, roll_deg=40.0, truth=None, mount=None):
    """The result of an answer that looks at the pole and names no star."""
    attitude = Attitude.from_angles(0.0, 90.0, roll_deg)
    catalog = load_catalog(stars=100)
    given = Given(external(attitude, has_roll=has_roll), 1.0), Given(no_answer(), None)
    identifier, panoramas, identified = identified_of(catalog, *given)
    return results_of(identifier, panoramas, identified, [1.0, math.nan, math.nan], truth, mount)[0]


def test_an_answer_is_compared_with_truth_where_there_are_a_sky_and_a_mount():
    sky, mount = StillSky(), Mount(roll_deg=40.0)
    for truth, of in ((None, None), (None, mount), (sky, None), (sky, mount)):
        found = at_the_pole(has_roll=True, truth=truth, mount=of)
        assert (found.attitude_geometric is None) is (truth is None)
        assert (found.attitude_true is None) is (truth is None or of is None)
        assert (found.attitude_error is None) is (truth is None or of is None)
    assert found.attitude_true.icrs_to_sensor == pytest.approx(POLE.icrs_to_sensor, abs=1e-15)
    apart = np.hypot(found.attitude_error.cross_x_arcsec, found.attitude_error.cross_y_arcsec)
    assert apart == pytest.approx(1e-3 / ARCSEC, rel=1e-6)


def test_a_roll_that_was_not_answered_is_that_of_the_truth_and_has_no_error():
    sky, mount = StillSky(), Mount(roll_deg=40.0)
    without = at_the_pole(has_roll=False, roll_deg=0.0, truth=sky, mount=mount)
    assert without.attitude.roll_deg == pytest.approx(40.0)
    assert math.isnan(without.attitude_error.d_roll_arcsec)
    assert math.isfinite(without.attitude_error.d_de_arcsec)
    assert at_the_pole(has_roll=False, roll_deg=0.0, truth=sky).attitude.roll_deg == pytest.approx(0.0)
    answered = at_the_pole(has_roll=True, roll_deg=41.0, truth=sky, mount=mount)
    assert answered.attitude.roll_deg == pytest.approx(41.0)
    assert answered.attitude_error.d_roll_arcsec == pytest.approx(3600.0, abs=1e-3)


@pytest.mark.parametrize(
    ("objects", "moved"), [([0, 2], [0, 2]), ([2, 0, 1], [2, 0, 1]), ([1], [0, 1, 2]), ([], [0, 1, 2])]
)
def test_air_is_taken_off_the_stars_of_an_answer_and_off_all_objects_where_it_names_fewer_than_two(
    catalog, objects, moved
):
    sky = StillSky()
    answer = ExternalAnswer({}, POLE, True, "IDENTIFIED", "", *[np.array(objects, dtype=np.int64)] * 2, None)
    answer = replace(answer, star_ids=catalog.ids[answer.objects])
    identifier, panoramas, identified = identified_of(catalog, Given(answer, 1.0), Given(no_answer(), None))
    results_of(identifier, panoramas, identified, [1.0, math.nan, math.nan], sky, None)
    assert sky.shown[0] == FIELD_14_DEG.directions(PLACES[moved]).tolist()


@pytest.mark.parametrize(("objects", "shown"), [(0, 4), (1, 4), (2, 2), (3, 3)])
def test_two_objects_are_enough_to_stand_for_themselves(objects, shown):
    sky = StillSky()
    geometric_of(POLE, FIELD_14_DEG.directions(PLACES[:objects]), sky, UTC_NS)
    assert len(sky.shown[0]) == shown


def test_the_cross_that_stands_for_objects_has_arms_of_three_degrees_about_the_boresight():
    sky = StillSky()
    geometric_of(POLE, np.zeros((0, 3)), sky, UTC_NS)
    cross = np.array(sky.shown[0])
    places = cross[:, :2] / cross[:, 2:]
    assert places == pytest.approx(np.array([[0.05, 0], [-0.05, 0], [0, 0.05], [0, -0.05]]), abs=1e-15)
    assert np.linalg.norm(cross, axis=1) == pytest.approx(np.ones(4), abs=1e-15)
