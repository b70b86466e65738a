"""A subject as a comparison takes it: which of its answers are good, missed, false and slow, frame by frame."""

import copy
import math

import numpy as np
import pytest
from skies.known_nights import session
from skies.own_answers import with_answers, without_error

from gse.station.columns import ANSWER_CHECKS, STATUSES
from gse.station.own_answers import ERRORS
from gse.station.results import AnswerCheck, Status, Subject
from gse.verdict.compared_rows import ComparedSession


def rows(mask):
    return np.flatnonzero(mask).tolist()


@pytest.fixture(scope="module")
def frames_of_all_kinds():
    """Twelve frames: the second without an answer, the third false, the fourth without truth, two about the limit."""
    made = session(12, noise=1.0, step_s=1.0)
    frames = made.frames.columns
    frames["status"][1], frames["d_de_arcsec"][1] = STATUSES.index(Status.NO_MATCH), math.nan
    frames["answer_check"][2] = ANSWER_CHECKS.index(AnswerCheck.FALSE)
    frames["d_de_arcsec"][3] = math.nan
    frames["elapsed_us"][4:6] = 200_000.0, 200_001.0
    return made


def test_answers_of_the_table_are_good_missed_false_or_slow(frames_of_all_kinds):
    found = ComparedSession.from_session(frames_of_all_kinds)
    table, frames = found.table, frames_of_all_kinds.frames.columns
    assert rows(~table.good) == [1, 2, 3]
    assert rows(table.missed) == [1, 2]
    assert rows(table.false) == [2]
    assert rows(table.slow) == [5]
    assert table.utc_ns.tolist() == frames["utc_ns"].tolist()
    assert list(table.errors) == list(ERRORS)
    for name in ERRORS:
        assert np.array_equal(table.errors[name], frames[name], equal_nan=True)
    assert table.statistics is found.statistics.onboard
    assert found.sensor is None


@pytest.fixture(scope="module")
def answered():
    """Twenty answers of a sensor: the second not sent, the third 0.3 deg off, two about the limit of time."""
    made = session(20, noise=1.0, step_s=1.0)
    angles = without_error(made, whole_field=True)
    for name, values in zip(("ra_deg", "de_deg", "roll_deg"), angles.T, strict=True):
        made.frames.columns[name] = values
    angles[2, 1] += 0.3
    angles[1] = math.nan
    found = with_answers(made, angles, np.full(20, 9))
    found.sensor_attitudes.columns["latency_ms"][3:5] = 200.0, 200.5
    return found


def test_a_sensors_own_answers_are_good_missed_false_or_slow(answered):
    found = ComparedSession.from_session(answered)
    assert rows(~found.sensor.good) == [1, 2]
    assert rows(found.sensor.missed) == [1, 2]
    assert rows(found.sensor.false) == [2]
    assert rows(found.sensor.slow) == [5]  # the fifth answer is to the sixth panorama
    assert found.sensor.errors["d_de_arcsec"][2] == pytest.approx(1080.0, abs=1.0)
    assert found.sensor.statistics is found.statistics.subjects[Subject.SENSOR]
    assert np.array_equal(found.sensor.utc_ns, answered.frames.columns["utc_ns"])
    assert not rows(~found.table.good)


def test_answers_in_another_convention_are_neither_good_nor_false(answered):
    hours = copy.deepcopy(answered)
    hours.sensor_attitudes.columns["ra_deg"] /= 15
    hours.sensor_attitudes.columns["de_deg"][1] -= 0.3  # one wrong answer of nineteen is more than nearly all
    found = ComparedSession.from_session(hours).sensor
    assert rows(found.good) == rows(found.false) == []
    assert rows(found.missed) == [1]


@pytest.mark.parametrize(
    ("column", "change"), [("latency_ms", 1.0), ("de_deg", 1 / 3600), ("ra_deg", 0.01), ("roll_deg", 0.1)]
)
def test_a_sensor_said_the_same_where_each_answer_its_time_and_its_errors_are(answered, column, change):
    other = copy.deepcopy(answered)
    other.sensor_attitudes.columns[column][7] += change  # the answer to the ninth panorama
    one, two = ComparedSession.from_session(answered), ComparedSession.from_session(other)
    every, without = np.arange(20), np.delete(np.arange(20), 8)
    assert one.sensor_said_the_same(one, (every, every))
    assert not one.sensor_said_the_same(two, (every, every))
    assert one.sensor_said_the_same(two, (without, without))
    assert not one.sensor_said_the_same(one, (every[1:], every[:-1]))


def test_a_sensor_without_answers_said_nothing_that_could_be_the_same(answered):
    one, none = ComparedSession.from_session(answered), ComparedSession.from_session(session(20))
    every = np.arange(20)
    assert not one.sensor_said_the_same(none, (every, every))
    assert not none.sensor_said_the_same(one, (every, every))
    assert not none.sensor_said_the_same(none, (every, every))
