"""The table of a sensor's own answers: every value of a message, whatever its size."""

import math

import numpy as np
import pytest

from gse.station.session_tables import OWN_ANSWER, AttitudeTable, has_answer
from protocols import AttitudeMessage

ANGLES = {"time_us": 5, "ra_deg": 10.0, "de_deg": -20.0, "roll_deg": 30.0}
NONE = {"time_us": 5, "ra_deg": math.nan, "de_deg": math.nan, "roll_deg": math.nan}


def row(**values):
    table = AttitudeTable()
    table.append(7, AttitudeMessage(**ANGLES | values))
    return table.columns[0]


def test_a_row_is_what_came():
    found = row(frame_no=3, matched=12, state="acquired", latency_s=0.08, q1=0.1, q2=0.2, q3=0.3, q4=0.9)
    assert found.tolist() == (7, 5, 3, 12, True, pytest.approx(80.0), 10.0, -20.0, 30.0, 0.1, 0.2, 0.3, 0.9)


@pytest.mark.parametrize(
    ("name", "came", "kept"),
    [
        ("matched", 65_535, 65_535),
        ("matched", 65_536, 65_535),
        ("matched", -1, 0),
        ("frame_no", 2**32 - 1, 2**32 - 1),
        ("frame_no", 2**32, 2**32 - 1),
        ("frame_no", -1, 0),
    ],
)
def test_a_number_that_no_column_holds_is_the_nearest_that_it_does(name, came, kept):
    assert row(**{name: came})[name] == kept


@pytest.mark.parametrize(
    ("values", "is_answer"),
    [
        (ANGLES, True),
        (ANGLES | {"state": "acquired"}, True),
        (ANGLES | {"state": "lost"}, False),
        (ANGLES | {"problems": ("RA is 400 deg",)}, False),
        (ANGLES | {"de_deg": math.nan}, False),
        (ANGLES | {"roll_deg": math.nan}, True),
        (NONE, False),
        (NONE | {"q1": 0.0, "q2": 0.0, "q3": 0.0, "q4": 1.0}, True),
        (NONE | {"q1": 0.0, "q2": 0.0, "q3": 0.0, "q4": 0.0}, False),
        (NONE | {"q1": math.inf, "q2": 0.0, "q3": 0.0, "q4": 1.0}, False),
        (NONE | {"q1": math.nan, "q2": 0.0, "q3": 0.0, "q4": 1.0}, False),
        (NONE | {"q1": 0.0, "q2": 0.0, "q3": 0.0, "q4": 1.0, "state": "lost"}, False),
        (NONE | {"q1": 1e-9, "q2": 0.0, "q3": 0.0, "q4": 0.0}, True),  # a quaternion may have any length
        (ANGLES | {"ra_deg": math.nan}, False),
        (ANGLES | {"de_deg": math.inf}, False),
        (ANGLES | {"ra_deg": math.nan, "q1": 0.0, "q2": 0.0, "q3": 0.0, "q4": 0.5}, True),
    ],
)
def test_a_message_is_an_answer_where_it_holds_an_attitude(values, is_answer):
    assert has_answer(AttitudeMessage(**values)) is is_answer


def test_a_table_has_room_for_1024_answers_and_then_for_twice_as_many():
    """Where its columns lie in memory shows it."""
    table, moved = AttitudeTable(), []
    for number in range(3000):
        before = table.columns.ctypes.data
        table.append(number, AttitudeMessage(**ANGLES | {"frame_no": number}))
        moved += [number] if table.columns.ctypes.data != before else []
    assert moved == [1024, 2048]
    assert table.columns["frame_no"].tolist() == list(range(3000))


@pytest.mark.parametrize("count", [0, 1, 3])
def test_a_table_of_given_rows_takes_more(count):
    rows = np.zeros(count, dtype=OWN_ANSWER)
    rows["frame_no"] = 5
    table = AttitudeTable.from_rows(rows)
    assert (len(table), table.columns.dtype) == (count, OWN_ANSWER)
    for number in (6, 7):
        table.append(number, AttitudeMessage(**ANGLES | {"frame_no": number}))
    assert table.columns["frame_no"].tolist() == [5] * count + [6, 7]
