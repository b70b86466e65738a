"""Steps of the host's clock by hand: which clock stamped which frames, and which of them was wrong."""

import numpy as np
import pytest

from drivers.chunk import LinkEvent
from gse.station.columns import FRAME
from gse.station.events import ClockStep, StationKind
from gse.station.host_clock import (
    ClockStretch,
    clock_steps,
    clock_stretches,
    first_rows,
    instants_ns,
    wrong_by_ns,
)
from gse.values.instant import LAST_NS, NS_PER_S, from_text

SECOND = NS_PER_S


def step(utc_ns, step_ns, *, utc_kept=False):
    return ClockStep(utc_ns, 0, StationKind.CLOCK_STEP, "", step_ns, utc_kept)


@pytest.mark.parametrize(
    ("offset_ns", "is_wrong"),
    [(0, False), (10 * SECOND, False), (10 * SECOND + 1, True), (-10 * SECOND, False), (-10 * SECOND - 1, True)],
)
def test_a_clock_that_was_off_by_more_than_ten_seconds_was_wrong(offset_ns, is_wrong):
    assert ClockStretch(0, 5, offset_ns).is_wrong is is_wrong


def test_steps_are_picked_out_of_the_events_in_their_order():
    one, other = step(1, 5), step(0, 6)
    assert clock_steps([LinkEvent(0, 0, "LOST", ""), one, LinkEvent(0, 0, "CLOCK_STEP", ""), other]) == [one, other]


@pytest.mark.parametrize(
    ("host", "step_at", "by", "row"),
    [
        ([], 5, 1, 0),
        ([980], 1002, 20, 1),
        ([1002], 1002, 20, 0),
        ([980, 981, 1002, 1003], 1002, 20, 2),  # forward: the new clock's first stamp
        ([980, 981, 1003, 1004], 1002, 20, 2),
        ([980, 981, 1001], 1002, 20, 3),  # nothing follows
        ([1002, 1003], 1002, 20, 0),  # the step came before the first frame
        ([998, 999, 980, 981], 980, -20, 2),  # back: the row at which the stamps fall
        ([998, 999, 985, 980, 981], 980, -20, 2),  # of two falls the larger one
        ([998, 1000, 980, 981], 980, -20, 0),  # the old clock was past the step: no later row belongs to it
        ([999, 979, 980], 980, -20, 0),
        ([990, 991, 992, 993], 991, 1, 1),
    ],
)
def test_the_first_row_of_a_new_clock_is_where_the_old_one_had_not_come_to_the_step_and_the_new_one_has(
    host, step_at, by, row
):
    """In seconds; ``step_at`` is the new clock's first instant."""
    host_utc_ns = np.array(host, dtype=np.int64) * SECOND
    assert first_rows(host_utc_ns, [step(step_at * SECOND, by * SECOND)]) == [row]


def test_a_step_from_beyond_the_last_instant_finds_the_rows_that_stand_there():
    """A clock that showed more than an instant can be is kept as the last one, which the old clock may have."""
    host_utc_ns = np.array([LAST_NS, LAST_NS, 1000, 1001])
    assert first_rows(host_utc_ns, [step(1000, -2 * LAST_NS)]) == [2]


def test_each_step_is_sought_behind_the_one_before():
    """A clock that is set forward by 100 s and back again."""
    host_utc_ns = np.array([10, 11, 112, 113, 14, 15], dtype=np.int64) * SECOND
    steps = [step(112 * SECOND, 100 * SECOND), step(14 * SECOND, -100 * SECOND)]
    assert first_rows(host_utc_ns, steps) == [2, 4]
    assert clock_stretches(host_utc_ns, steps) == [
        ClockStretch(0, 2, 0),
        ClockStretch(2, 4, 100 * SECOND),
        ClockStretch(4, 6, 0),
    ]
    assert first_rows(host_utc_ns, []) == []
    assert clock_stretches(host_utc_ns, []) == [ClockStretch(0, 6, 0)]


def test_how_far_a_clock_was_off_is_the_sum_of_all_steps_that_were_still_to_come():
    """Set forward by 3 s and by 20 s: at first it was 23 s behind. A host that slept put no clock right."""
    host_utc_ns = np.array([10, 14, 60], dtype=np.int64) * SECOND
    steps = [step(14 * SECOND, 3 * SECOND), step(60 * SECOND, 20 * SECOND)]
    assert [one.offset_ns for one in clock_stretches(host_utc_ns, steps)] == [-23 * SECOND, -20 * SECOND, 0]
    slept = [steps[0], step(60 * SECOND, 20 * SECOND, utc_kept=True)]
    assert [one.offset_ns for one in clock_stretches(host_utc_ns, slept)] == [-3 * SECOND, 0, 0]


def test_instants_are_those_that_no_wrong_clock_stamped_and_all_where_there_are_no_others():
    frames = np.zeros(6, dtype=FRAME)
    frames["host_utc_ns"] = np.array([10, 11, 112, 113, 14, 15]) * SECOND
    frames["utc_ns"] = frames["host_utc_ns"] - 5
    steps = [step(112 * SECOND, 100 * SECOND), step(14 * SECOND, -100 * SECOND)]
    assert instants_ns(frames, steps).tolist() == frames["utc_ns"][[0, 1, 4, 5]].tolist()
    assert instants_ns(frames, []).tolist() == frames["utc_ns"].tolist()
    late = [step(500 * SECOND, 100 * SECOND)]  # set after the last frame
    assert instants_ns(frames, late).tolist() == frames["utc_ns"].tolist()


JULY = from_text("2012-07-01T00:00:00Z")


@pytest.mark.parametrize(
    ("utc_ns", "step_ns", "is_leap"),
    [
        (JULY, -SECOND, True),
        (JULY, SECOND, True),
        (JULY, -SECOND - SECOND // 10, True),
        (JULY, -SECOND - SECOND // 10 - 1, False),
        (JULY, -SECOND + SECOND // 10, True),
        (JULY, -SECOND + SECOND // 10 + 1, False),
        (JULY + 3 * SECOND, -SECOND, True),
        (JULY + 3 * SECOND + 1, -SECOND, False),
        (JULY - 3 * SECOND, -SECOND, True),
        (JULY - 3 * SECOND - 1, -SECOND, False),
        (JULY + 12 * 3600 * SECOND, -SECOND, False),
        (from_text("2017-01-01T00:00:00Z"), -SECOND, True),
        (from_text("2016-12-31T23:59:59Z"), -SECOND, True),
        (from_text("2016-12-31T00:00:00Z"), -SECOND, False),
        (from_text("2017-01-02T00:00:00Z"), -SECOND, False),
        (from_text("2012-06-30T00:00:00Z"), -SECOND, False),
        (from_text("2012-10-01T00:00:00Z"), -SECOND, False),
        (from_text("2012-04-01T00:00:00Z"), -SECOND, False),
    ],
)
def test_a_second_at_the_end_of_june_or_december_put_no_clock_right(utc_ns, step_ns, is_leap):
    """To a tenth of a second, and within three seconds of midnight."""
    assert wrong_by_ns(step(utc_ns, step_ns)) == (0 if is_leap else step_ns)


def test_a_host_that_was_suspended_had_no_wrong_clock():
    assert wrong_by_ns(step(0, 20 * SECOND, utc_kept=True)) == 0
    assert wrong_by_ns(step(0, 20 * SECOND)) == 20 * SECOND
