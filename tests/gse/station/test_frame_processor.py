"""The reference identifier's check of an answer, and the status that an answer gets."""

import threading
from dataclasses import replace

import numpy as np
import pytest
from skies.made_frames import FIELD_14_DEG

from gse.attitude import Attitude
from gse.catalog import load_catalog
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.identifier import Answers, Reason, Unidentified
from gse.identifier.robust import RobustIdentifier
from gse.panorama import Panorama, Panoramas
from gse.station.frame_processor import FrameProcessor
from gse.station.non_stellar import NonStellarObjects
from gse.station.results import AnswerCheck, Status
from gse.truth import EarthOrientation, SiderealTruth

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
        return Answers.of([self.answer] * len(objects))


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
    panoramas = Panoramas.of([panorama])
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
    made, panoramas = replace(processor(Turned(reference, by_deg), reference), truth=low), Panoramas.of([panorama])
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


@pytest.mark.parametrize(
    ("change", "detail"),
    [
        ({"flags": frozenset({"detector fault"})}, "the sensor reports detector fault"),
        ({"problems": ("no time",)}, "no time"),
        ({"xy_px": np.zeros((31, 2)), "brightness": np.linspace(31, 1, 31)}, "31 objects"),
        ({"brightness": np.linspace(4097.0, 200.0, 25)}, "4097"),
        ({"xy_px": np.full((1, 2), 500.0), "brightness": np.array([4097.0])}, "4097"),
    ],
)
def test_a_panorama_that_the_sensor_spoiled_is_a_sensor_fault(reference, panorama, change, detail):
    found = result(Turned(reference, 0.0), reference, replace(panorama, **change))
    assert found.status is Status.SENSOR_FAULT
    assert detail in found.detail


def test_an_index_value_at_its_maximum_and_a_flag_that_is_not_a_fault_spoil_nothing(reference, panorama):
    bright = replace(panorama, brightness=np.linspace(4096.0, 200.0, 25), flags=frozenset({"saturated"}))
    assert result(Turned(reference, 0.0), reference, bright).status is Status.IDENTIFIED


def test_positions_without_sense_spoil_their_own_panorama_alone(reference, panorama):
    """Farther away than a float can square."""
    insane = replace(panorama, xy_px=np.full((25, 2), 1e300), problems=("x is 1e300",))
    made = processor(Turned(reference, 0.0), reference)
    panoramas = Panoramas.of([panorama, insane, panorama])
    identified = made.identify(panoramas)
    assert identified.sound.tolist() == [True, False, True]
    finite = np.isfinite(identified.directions_sensor).all(axis=1)
    assert finite.tolist() == [True] * 25 + [False] * 25 + [True] * 25
    results = made.conclude(panoramas, identified, identified.elapsed_us)
    assert [one.status for one in results] == [Status.IDENTIFIED, Status.SENSOR_FAULT, Status.IDENTIFIED]
    assert results.rows()["stars_seen"].tolist() == [len(results[0].matches), 0, len(results[2].matches)]
