"""The reference identifier's check of an answer, and the status that an answer gets."""

import threading
import time
from dataclasses import astuple, replace
from typing import ClassVar

import numpy as np
import pytest
from skies.known_nights import START_NS, TRUTH
from skies.made_frames import FIELD_14_DEG
from skies.one_by_one import attitudes_of, others_of

from gse.catalog import load_catalog
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.external.answers import ExternalAnswer
from gse.external.identifier import ExternalIdentifier, Given
from gse.identifier import Answers, Identification, ObjectColumns, Reason, Unidentified
from gse.identifier.robust import RobustIdentifier
from gse.station.columns import ANSWER_CHECKS
from gse.station.frame_processor import FrameProcessor, Identified
from gse.station.non_stellar import NonStellarObjects
from gse.station.results import AnswerCheck, Matches, Starlight, Status, attitude_error
from gse.truth import EarthOrientation, SiderealTruth
from gse.values.attitude import Attitude, paper_mean
from gse.values.limits import Limits
from gse.values.mount import InertialDirection, Mount
from gse.values.panorama import Panorama, Panoramas

BORESIGHT = Attitude.from_angles(83.0, 0.0, 20.0)
ACROSS = np.cross(BORESIGHT.boresight_icrs, [0.0, 0.0, 1.0])
SITE = parse_station(BUILT_IN_TEXT).site
NO_MATCH = Unidentified(Reason.NO_MATCH, "made on purpose")


class Turned:
    """An identifier whose boresight is wrong by an angle: its catalogue is turned by that."""

    name = "turned"

    def __init__(self, reference, by_deg):
        by = np.radians(by_deg)
        x, y, z = ACROSS
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        turn = np.eye(3) + np.sin(by) * cross + (1 - np.cos(by)) * cross @ cross
        self.identify_many = reference.identify_many
        self.catalog = replace(reference.catalog, icrs=reference.catalog.icrs @ turn.T)


class Silent:
    """An identifier that always gives the same answer, or none."""

    name = "silent"

    def __init__(self, catalog, answer=NO_MATCH):
        self.catalog, self.answer = catalog, answer

    def identify_many(self, objects):
        return Answers.from_answers([self.answer] * len(objects))


class KeptWaiting(Silent):
    """An identifier that is kept from the processor for a while, as by another program of a busy host."""

    def identify_many(self, objects):
        threading.Event().wait(0.3)
        return super().identify_many(objects)


@pytest.fixture(scope="module")
def reference():
    return RobustIdentifier(FIELD_14_DEG, load_catalog(stars=20_000))


@pytest.fixture(scope="module")
def panorama(reference):
    xy_px = FIELD_14_DEG.pixels(reference.catalog.icrs @ BORESIGHT.icrs_to_sensor.T)
    xy_px = xy_px[FIELD_14_DEG.contains(xy_px)][:25]
    return Panorama(1_774_000_000_000_000_000, xy_px, np.linspace(4000.0, 200.0, 25), 1)


def processor(identifier, reference):
    hot = NonStellarObjects(FIELD_14_DEG, SITE, [])
    return FrameProcessor(FIELD_14_DEG, 4096, identifier, reference, hot, None, None)


def result(identifier, reference, panorama):
    made = processor(identifier, reference)
    panoramas = Panoramas.from_panoramas([panorama])
    identified = made.identify(panoramas)
    return made.conclude(panoramas, identified, identified.elapsed_us)[0]


@pytest.mark.parametrize(
    ("by_deg", "check"),
    [
        (0.0, AnswerCheck.CORRECT),
        (0.049, AnswerCheck.CORRECT),
        (0.051, AnswerCheck.FALSE),
        (1.0, AnswerCheck.FALSE),
        (-4.0, AnswerCheck.FALSE),
        (90.0, AnswerCheck.FALSE),
        (180.0, AnswerCheck.FALSE),
    ],
)
def test_an_answer_is_false_where_its_boresight_is_a_twentieth_of_a_degree_off(reference, panorama, by_deg, check):
    found = result(Turned(reference, by_deg), reference, panorama)
    assert found.status is Status.IDENTIFIED
    assert found.answer_check is check


def test_what_is_false_is_as_the_limits_say(reference, panorama):
    made = replace(processor(Turned(reference, 0.05), reference), false_arcsec=200.0)
    panoramas = Panoramas.from_panoramas([panorama])
    assert ANSWER_CHECKS[made.identify(panoramas).answer_check[0]] is AnswerCheck.CORRECT
    closer = replace(made, false_arcsec=150.0)
    assert ANSWER_CHECKS[closer.identify(panoramas).answer_check[0]] is AnswerCheck.FALSE


def test_the_boresight_of_the_reference_identifier_is_kept_whatever_the_answer(reference, panorama):
    for identifier in (Turned(reference, 1.0), Silent(reference.catalog)):
        row = result(identifier, reference, panorama).row
        assert row["ra_reference_deg"] == pytest.approx(BORESIGHT.ra_deg, abs=1e-4)
        assert row["de_reference_deg"] == pytest.approx(BORESIGHT.de_deg, abs=1e-4)
    assert np.isnan(result(reference, None, panorama).row["ra_reference_deg"]).all()


@pytest.mark.parametrize(("others", "check"), [(12, AnswerCheck.CORRECT), (13, AnswerCheck.FALSE)])
def test_an_answer_of_which_more_than_half_of_the_stars_are_others_is_false_wherever_it_looks(
    reference, panorama, others, check
):
    """Of 25 stars; each other one is the next one's."""
    panoramas = Panoramas.from_panoramas([panorama])
    objects = ObjectColumns.from_panoramas([(FIELD_14_DEG.directions(panorama.xy_px), panorama.brightness)])
    true = reference.identify_many(objects)[0]
    stars = true.stars.copy()
    stars[:others] = np.roll(stars[:others], 1)
    source = Source(reference.catalog, stars, true.objects)
    made = processor(ExternalIdentifier(reference.catalog, source), reference)
    found = made.identify(panoramas)
    assert ANSWER_CHECKS[found.answer_check[0]] is check
    assert ANSWER_CHECKS[made._checks_under_air(panoramas, found)[0]] is check


@pytest.mark.parametrize(
    ("altitude_deg", "by_deg", "check"),
    [
        (12.0, 0.07, AnswerCheck.CORRECT),
        (12.0, 0.49, AnswerCheck.FALSE),
        (12.0, 1.0, AnswerCheck.FALSE),
        (60.0, 0.07, AnswerCheck.FALSE),
    ],
)
def test_air_parts_the_boresights_of_other_stars_in_a_low_field(reference, panorama, altitude_deg, by_deg, check):
    table = EarthOrientation.from_disk(panorama.utc_ns)
    truths = [SiderealTruth(replace(SITE, longitude_deg=float(east)), table) for east in range(-180, 180, 2)]
    heights = [(truth.icrs_to_horizon(panorama.utc_ns) @ BORESIGHT.boresight_icrs)[2] for truth in truths]
    low = truths[int(np.abs(np.degrees(np.arcsin(heights)) - altitude_deg).argmin())]
    made, panoramas = (
        replace(processor(Turned(reference, by_deg), reference), truth=low),
        Panoramas.from_panoramas([panorama]),
    )
    identified = made.identify(panoramas)
    assert made.conclude(panoramas, identified, identified.elapsed_us)[0].answer_check is check


def test_the_time_that_a_busy_host_takes_away_is_not_that_of_the_identifier(reference, panorama):
    assert 0 <= result(KeptWaiting(reference.catalog), reference, panorama).elapsed_us < 150_000


def test_no_answer_is_absent_where_the_reference_identifier_has_one(reference, panorama):
    assert result(Silent(reference.catalog), reference, panorama).answer_check is AnswerCheck.ABSENT


@pytest.mark.parametrize("wrong_deg", [0.0, 10.0])
def test_nothing_is_said_of_an_answer_where_the_reference_identifier_has_none(reference, panorama, wrong_deg):
    answers = Turned(reference, wrong_deg)
    assert result(answers, None, panorama).answer_check is AnswerCheck.UNKNOWN
    assert result(answers, Silent(reference.catalog), panorama).answer_check is AnswerCheck.UNKNOWN


@pytest.mark.parametrize(
    ("reason", "status"),
    [
        (Reason.TOO_FEW, Status.TOO_FEW),
        (Reason.NO_MATCH, Status.NO_MATCH),
        (Reason.MIRRORED, Status.NO_MATCH),
        (Reason.AMBIGUOUS, Status.AMBIGUOUS),
        (Reason.SENSOR_FAULT, Status.SENSOR_FAULT),
    ],
)
def test_each_reason_has_its_status(reference, panorama, reason, status):
    found = result(Silent(reference.catalog, Unidentified(reason, "why")), None, panorama)
    assert (found.status, found.detail) == (status, "why")


def test_an_index_value_at_its_maximum_and_a_flag_that_is_not_a_fault_spoil_nothing(reference, panorama):
    bright = replace(panorama, brightness=np.linspace(4096.0, 200.0, 25), flags=frozenset({"saturated"}))
    assert result(Turned(reference, 0.0), reference, bright).status is Status.IDENTIFIED


def test_positions_without_sense_spoil_their_own_panorama_alone(reference, panorama):
    """Farther away than a float can square."""
    insane = replace(panorama, xy_px=np.full((25, 2), 1e300), problems=("x is 1e300",))
    made = processor(Turned(reference, 0.0), reference)
    panoramas = Panoramas.from_panoramas([panorama, insane, panorama])
    identified = made.identify(panoramas)
    assert identified.sound.tolist() == [True, False, True]
    finite = np.isfinite(identified.directions_sensor).all(axis=1)
    assert finite.tolist() == [True] * 25 + [False] * 25 + [True] * 25
    results = made.conclude(panoramas, identified, identified.elapsed_us)
    assert [one.status for one in results] == [Status.IDENTIFIED, Status.SENSOR_FAULT, Status.IDENTIFIED]
    assert results.rows["stars_seen"].tolist() == [len(results[0].matches), 0, len(results[2].matches)]


# Times, faults and covariances, by hand


class Working(Silent):
    """An identifier that takes 20 ms of the processor's time."""

    def identify_many(self, objects):
        until_ns = time.thread_time_ns() + 20_000_000
        while time.thread_time_ns() < until_ns:
            pass
        return super().identify_many(objects)


@pytest.mark.parametrize(("sound", "faulty"), [(1, 0), (1, 1), (4, 1)])
def test_the_time_of_panoramas_that_came_together_is_their_mean(reference, panorama, sound, faulty):
    """Of those that the identifier was shown; to a tenth of a microsecond."""
    spoiled = replace(panorama, problems=("no time",))
    panoramas = Panoramas.from_panoramas([panorama] * sound + [spoiled] * faulty)
    elapsed_us = processor(Working(reference.catalog), None).identify(panoramas).elapsed_us
    assert np.isnan(elapsed_us[sound:]).all()
    assert len(set(elapsed_us[:sound].tolist())) == 1
    assert 20_000 / sound <= elapsed_us[0] < 1.9 * 20_000 / sound
    assert elapsed_us[0] == round(float(elapsed_us[0]), 1)


@pytest.mark.parametrize(
    ("change", "detail"),
    [
        ({"flags": frozenset({"memory fault"})}, "the sensor reports memory fault"),
        ({"flags": frozenset({"memory fault", "detector fault", "saturated"}), "problems": ("no time",)},
         "the sensor reports detector fault and memory fault"),
        ({"problems": ("no time", "no age")}, "the sensor sent an impossible value: no time"),
        ({"xy_px": np.zeros((31, 2)), "brightness": np.linspace(5000, 1, 31)},
         "31 objects came, at most 30 were expected"),
        ({"brightness": np.linspace(4097.0, 200.0, 25)}, "index value 4097 came, at most 4096 was expected"),
        ({"xy_px": np.zeros((30, 2)), "brightness": np.linspace(4097, 1, 30)},
         "index value 4097 came, at most 4096 was expected"),
        ({"xy_px": np.full((1, 2), 500.0), "brightness": np.array([4097.0])},
         "index value 4097 came, at most 4096 was expected"),
    ],
)  # fmt: skip
def test_a_fault_of_the_sensor_is_told_whole_and_stands_beside_its_panorama(reference, panorama, change, detail):
    """Between a panorama without objects and one with thirty."""
    full = replace(panorama, xy_px=np.full((30, 2), 500.0), brightness=np.linspace(4096.0, 1.0, 30))
    empty = replace(panorama, xy_px=np.zeros((0, 2)), brightness=np.zeros(0))
    panoramas = Panoramas.from_panoramas([empty, replace(panorama, **change), full, empty])
    made = processor(Silent(reference.catalog), None)
    identified = made.identify(panoramas)
    results = made.conclude(panoramas, identified, identified.elapsed_us)
    found = [(one.status, one.detail) for one in results]
    assert found == [
        (Status.NO_MATCH, NO_MATCH.detail),
        (Status.SENSOR_FAULT, detail),
        *[(Status.NO_MATCH, NO_MATCH.detail)] * 2,
    ]


def test_the_covariance_of_an_attitude_is_that_of_three_tenths_of_a_pixel(reference, panorama):
    """The inverse of the Fisher information of unit vectors with that noise across each of them."""
    found = result(Turned(reference, 0.0), reference, panorama)
    seen = FIELD_14_DEG.directions(panorama.xy_px[[match.object for match in found.matches]])
    information = sum(np.eye(3) - np.outer(one, one) for one in seen)
    expected = (0.3 * FIELD_14_DEG.pixel_rad) ** 2 * np.linalg.inv(information)
    assert found.attitude.covariance_rad2 == pytest.approx(expected, rel=1e-6)


def test_the_mean_of_the_lapan_paper_is_taken_for_each_panorama_with_an_answer(reference, panorama):
    """The second has none: the third must not take its place."""
    rng = np.random.default_rng(6)
    seen = [replace(panorama, xy_px=panorama.xy_px + rng.normal(0, 0.5, (25, 2))) for _ in range(3)]
    seen[1] = replace(seen[1], problems=("no time",))
    made = replace(processor(Turned(reference, 0.0), None), paper_mean=True)
    panoramas = Panoramas.from_panoramas(seen)
    wahba = processor(Turned(reference, 0.0), None).identify(panoramas)
    found = made.identify(panoramas)
    assert found.attitudes[1] is None
    for k in (0, 2):
        directions = FIELD_14_DEG.directions(seen[k].xy_px)[found.answers[k].objects]
        stars = reference.catalog.icrs[found.answers[k].stars]
        expected = paper_mean(wahba.attitudes[k], directions, stars).icrs_to_sensor
        assert found.attitudes[k].icrs_to_sensor == pytest.approx(expected, abs=1e-14)
        assert np.abs(expected - wahba.attitudes[k].icrs_to_sensor).max() > 1e-11


# What is compared with truth


class Watched:
    """Takes the place of the classifier of objects: it notes what it is given, and names nothing."""

    def name(self, panoramas, directions_sensor, answers, icrs_to_sensor, *, truth_known):
        self.rotations, self.truth_known = icrs_to_sensor, truth_known
        return others_of([[]] * len(panoramas))


MOUNT = Mount(azimuth_deg=10.0, altitude_deg=70.0, roll_deg=30.0)
INERTIAL = Mount(inertial=InertialDirection(ra_deg=83.0, de_deg=0.0, roll_deg=20.0))


def concluded(identifier, panoramas, **changes):
    watched = Watched()
    made = replace(processor(identifier, None), non_stellar=watched, **changes)
    many = Panoramas.from_panoramas(panoramas)
    identified = made.identify(many)
    return identified, made.conclude(many, identified, identified.elapsed_us), watched


@pytest.mark.parametrize(
    ("truth", "mount", "known"),
    [(None, None, False), (None, MOUNT, False), (TRUTH, None, True), (TRUTH, MOUNT, True), (TRUTH, INERTIAL, False)],
    ids=["nothing", "a mount", "a sky", "both", "a simulator of stars"],
)
def test_bodies_are_looked_for_where_the_true_sky_is_known_and_from_the_geometric_attitude(
    reference, panorama, truth, mount, known
):
    identified, results, watched = concluded(Turned(reference, 0.0), [panorama], truth=truth, mount=mount)
    assert watched.truth_known is known
    found = results[0]
    expected = identified.attitudes[0] if truth is None else found.attitude_geometric
    assert watched.rotations[0].tolist() == expected.icrs_to_sensor.tolist()
    assert (found.attitude_geometric is None) is (truth is None)
    assert (found.attitude_error is None) is (truth is None or mount is None)


def test_the_error_is_that_of_the_geometric_attitude_against_the_mount(reference, panorama):
    """A panorama without an answer stands before it, and has none."""
    spoiled = replace(panorama, problems=("no time",))
    _, results, _ = concluded(Turned(reference, 0.0), [spoiled, panorama], truth=TRUTH, mount=MOUNT)
    assert (results[0].attitude_error, results[0].attitude_true, results[0].attitude_geometric) == (None, None, None)
    found, true = results[1], TRUTH.attitude_true(panorama.utc_ns, MOUNT)
    assert found.attitude_true.icrs_to_sensor == pytest.approx(true.icrs_to_sensor, abs=1e-12)
    expected = attitude_error(found.attitude_geometric, true)
    assert astuple(found.attitude_error) == pytest.approx(astuple(expected), abs=1e-4)


def test_residuals_are_what_is_measured_less_what_is_expected_along_columns_and_rows(reference, panorama):
    """One of 25 stars is seen 0.4 px too far right and 0.3 px too far up: the fit follows by a part of it."""
    moved = panorama.xy_px.copy()
    moved[3] += 0.4, -0.3
    _, results, _ = concluded(Turned(reference, 0.0), [replace(panorama, xy_px=moved)])
    matches = {match.object: match for match in results[0].matches}
    pixel_arcsec = np.degrees(FIELD_14_DEG.pixel_rad) * 3600
    share = 1 - 1 / 25
    assert matches[3].residual_x_arcsec == pytest.approx(0.4 * pixel_arcsec * share, rel=0.2)
    assert matches[3].residual_y_arcsec == pytest.approx(-0.3 * pixel_arcsec * share, rel=0.2)
    assert results.residuals_arcsec.shape == (len(matches), 2)


class KnownAir:
    """A sky in which air lifts four objects apart by known angles, towards a zenith that stands on an axis."""

    def __init__(self, std_rad):
        self.std_rad = std_rad

    def icrs_to_horizon_at(self, utc_ns):
        assert utc_ns.tolist() == [2]
        return np.eye(3)[None]

    def unrefracted(self, stars, zenith_sensor):
        assert zenith_sensor.tolist() == [0.0, 0.0, 1.0]
        return stars - self.std_rad * np.outer([1.0, -1.0, 1.0, -1.0], [0.6, 0.8, 0.0])


FALSE_BEYOND_ARCSEC = Limits().false_beyond_arcsec


@pytest.mark.parametrize(
    ("separation_arcsec", "std_arcsec", "check"),
    [
        (FALSE_BEYOND_ARCSEC + 3 * 60.0 - 0.1, 60.0, AnswerCheck.CORRECT),
        (FALSE_BEYOND_ARCSEC + 3 * 60.0 + 0.1, 60.0, AnswerCheck.FALSE),
        (FALSE_BEYOND_ARCSEC, 0.0, AnswerCheck.FALSE),
        (FALSE_BEYOND_ARCSEC - 0.1, 0.0, AnswerCheck.CORRECT),
        (1799.9, 1000.0, AnswerCheck.CORRECT),
        (1800.0, 1000.0, AnswerCheck.FALSE),  # air does nothing of the kind
        (float("nan"), 1000.0, AnswerCheck.FALSE),
    ],
)
def test_a_false_answer_within_three_standard_deviations_of_the_lift_is_correct(
    reference, separation_arcsec, std_arcsec, check
):
    arcsec = np.pi / 648_000
    seen = [Panorama(utc_ns, np.full((count, 2), 500.0), np.ones(count)) for utc_ns, count in ((1, 2), (2, 4), (3, 0))]
    separation_rad = np.array([0.1, separation_arcsec, 0.1]) * [1.0, arcsec, 1.0]
    before = [AnswerCheck.FALSE, AnswerCheck.FALSE, AnswerCheck.ABSENT]
    identified = Identified(
        np.zeros((6, 3)),
        np.ones(3, dtype=np.bool_),
        Answers.from_answers([NO_MATCH] * 3),
        attitudes_of([Attitude(np.eye(3), np.eye(3))] * 3),
        np.array([ANSWER_CHECKS.index(one) for one in before], dtype=np.uint8),
        separation_rad,
        np.full((3, 3), np.nan),
        Starlight.none(3),
        np.zeros(3),
    )
    panoramas = Panoramas.from_panoramas(seen)
    for truth, expected in ((KnownAir(std_arcsec * arcsec), check), (None, AnswerCheck.FALSE)):
        made = replace(processor(Silent(reference.catalog), None), truth=truth, non_stellar=Watched())
        results = made.conclude(panoramas, identified, identified.elapsed_us)
        assert [one.answer_check for one in results] == [AnswerCheck.FALSE, expected, AnswerCheck.ABSENT]


class Few(Silent):
    """An identifier that names the first two objects of each panorama as stars 5 and 9, or nothing."""

    name = "few"


@pytest.mark.parametrize(
    ("answer", "with_reference", "stars"),
    [
        (Identification(np.array([0, 1]), np.array([5, 9]), 0.0), True, 2),
        (Identification(np.array([0, 1]), np.array([5, 9]), 0.0), False, 2),
        (NO_MATCH, True, 25),
        (NO_MATCH, False, 0),
    ],
)
def test_the_light_is_that_of_the_answer_or_of_the_reference_identifier_where_there_is_none(
    reference, panorama, answer, with_reference, stars
):
    made = processor(Few(reference.catalog, answer), reference if with_reference else None)
    light = made.identify(Panoramas.from_panoramas([panorama, panorama])).light
    assert light.stars.tolist() == [stars] * 2


def test_the_separation_is_between_the_boresights_and_none_where_one_of_them_is_missing(reference, panorama):
    spoiled = replace(panorama, problems=("no time",))
    panoramas = Panoramas.from_panoramas([spoiled, panorama])
    found = processor(Turned(reference, 0.5), reference).identify(panoramas)
    assert np.isnan(found.separation_rad[0])
    assert found.separation_rad[1] == pytest.approx(2 * np.sin(np.radians(0.25)), rel=1e-6)
    assert [ANSWER_CHECKS[one] for one in found.answer_check] == [AnswerCheck.UNKNOWN, AnswerCheck.FALSE]
    silent = processor(Silent(reference.catalog), reference).identify(panoramas)
    assert np.isnan(silent.separation_rad).all()
    assert [ANSWER_CHECKS[one] for one in silent.answer_check] == [AnswerCheck.UNKNOWN, AnswerCheck.ABSENT]


class LeftOut:
    """Takes the place of the search for stars that were left out, and notes what it is given."""

    def beside(self, objects, answers, frames):
        self.objects, self.answers, self.frames = objects, answers, frames
        return Matches.none(len(answers))


@pytest.mark.parametrize("truth", [None, TRUTH])
def test_stars_that_were_left_out_are_looked_for_in_the_frames_with_an_answer(reference, panorama, truth):
    left_out, spoiled = LeftOut(), replace(panorama, problems=("no time",))
    identified, results, _ = concluded(Turned(reference, 0.0), [spoiled, panorama], left_out=left_out, truth=truth)
    frames = left_out.frames
    assert frames.raw.tolist() == [identified.attitudes[1].icrs_to_sensor.tolist()]
    geometric = results[1].attitude_geometric if truth else identified.attitudes[1]
    assert frames.geometric.tolist() == [geometric.icrs_to_sensor.tolist()]
    assert (frames.truth, frames.utc_ns.tolist()) == (truth, [panorama.utc_ns])
    assert (frames.icrs_to_horizon is None) is (truth is None)
    assert left_out.objects.brightness.tolist() == 2 * panorama.brightness.tolist()


def test_nothing_is_looked_for_where_no_panorama_has_an_answer(reference, panorama):
    left_out = LeftOut()
    _, results, _ = concluded(Silent(reference.catalog), [panorama], left_out=left_out, truth=TRUTH, mount=MOUNT)
    assert not hasattr(left_out, "frames")
    assert (results[0].attitude, results[0].attitude_geometric, results[0].attitude_true) == (None, None, None)
    assert (len(results[0].matches), len(results.left_out.objects)) == (0, 0)


class InTurn(Silent):
    """An identifier that names two stars of the first panorama of each call, and nothing of the others."""

    def identify_many(self, objects):
        found = Identification(np.array([0, 1]), np.array([5, 9]), 0.0)
        return Answers.from_answers([found] + [NO_MATCH] * (len(objects) - 1))


def test_panoramas_without_an_answer_show_the_sky_of_the_reference_identifier_and_the_others_their_own(
    reference, panorama
):
    light = processor(InTurn(reference.catalog), reference).identify(Panoramas.from_panoramas([panorama] * 3)).light
    assert light.stars.tolist() == [2, 25, 25]
    light = processor(InTurn(reference.catalog), None).identify(Panoramas.from_panoramas([panorama] * 3)).light
    assert light.stars.tolist() == [2, 0, 0]


class Source:
    """A program that names stars of the first objects of each panorama, two where nothing else is said."""

    identity: ClassVar[dict[str, str]] = {"name": "made"}

    def __init__(self, catalog, stars=(5, 9), objects=(0, 1)):
        self._ids, self._objects = catalog.ids[list(stars)], np.array(objects)

    def answers(self, panoramas):
        answer = ExternalAnswer({}, BORESIGHT, True, "IDENTIFIED", "", self._objects, self._ids, None)
        return [Given(answer, 1.0) for _ in panoramas]


def test_the_sky_of_an_external_identifier_is_that_of_the_reference_identifier_where_this_has_an_answer(
    reference, panorama
):
    """It cannot know the second panorama, whose objects stand anywhere."""
    anywhere = replace(panorama, xy_px=np.random.default_rng(4).uniform(0, 1023, (25, 2)))
    external = ExternalIdentifier(reference.catalog, Source(reference.catalog))
    made, panoramas = processor(external, reference), Panoramas.from_panoramas([panorama, anywhere])
    identified = made.identify(panoramas)
    assert identified.light.stars.tolist() == [25, 2]
    results = made.conclude(panoramas, identified, identified.elapsed_us)
    assert [one.status for one in results] == [Status.IDENTIFIED] * 2
    assert results.rows["stars_seen"].tolist() == [25, 2]


def test_stars_as_a_mount_shows_them_through_air_have_no_error(reference):
    """At 40 deg of altitude, where air lifts them by 60 arcsec and aberration moves them by up to 20 arcsec."""
    utc_ns, mount = START_NS, Mount(azimuth_deg=200.0, altitude_deg=40.0, roll_deg=50.0)
    true = TRUTH.attitude_true(utc_ns, mount).icrs_to_sensor
    apparent = TRUTH.apparent(reference.catalog.icrs, utc_ns) @ true.T
    rows = np.flatnonzero((apparent[:, 2] > 0.9) & FIELD_14_DEG.contains(FIELD_14_DEG.pixels(apparent)))[:25]
    seen = TRUTH.refraction.added(apparent[rows], true @ TRUTH.icrs_to_horizon(utc_ns)[2])
    panorama = Panorama(utc_ns, FIELD_14_DEG.pixels(seen), np.linspace(4000.0, 200.0, 25), 1)
    identified, results, _ = concluded(Turned(reference, 0.0), [panorama], truth=TRUTH, mount=mount)
    assert len(results[0].matches) == 25
    assert np.abs(astuple(results[0].attitude_error)).max() < 0.05
    assert np.abs(results.residuals_arcsec).max() < 0.05
    raw = attitude_error(identified.attitudes[0], Attitude(true, np.zeros((3, 3))))
    assert np.hypot(raw.cross_x_arcsec, raw.cross_y_arcsec) > 40
