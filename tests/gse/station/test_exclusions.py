"""Frames that waited in a buffer: told where a session begins, and not where the host's clock was stepped."""

import numpy as np
import pytest

from gse.instant import NS_PER_S, from_text
from gse.station.event_kinds import ClockStep, StationKind
from gse.station.exclusions import Cause, Exclusion, excluded, exclusions
from gse.station.frame_table import FRAME

START_NS = from_text("2026-03-20T18:30:00Z")


def frames_with_a_burst_at(first, *, step_rows=(), step_s=20.0):
    """Frames at 10 Hz of which 38 were read at once; from each of ``step_rows`` on the clock is ``step_s`` ahead."""
    made = np.zeros(300, dtype=FRAME)
    due_ns = START_NS + np.arange(300) * NS_PER_S // 10
    made["time_us"] = (due_ns - START_NS) // 1000
    made["frame_no"] = np.arange(300)
    for row in step_rows:
        due_ns[row:] += round(step_s * NS_PER_S)
    made["utc_ns"] = made["host_utc_ns"] = due_ns
    burst = slice(first, first + 38)
    made["utc_ns"][burst] = made["host_utc_ns"][burst] = due_ns[first + 38] + 1000 * np.arange(38)
    events = [
        ClockStep(int(made["host_utc_ns"][row]), 0, StationKind.CLOCK_STEP, "", round(step_s * NS_PER_S))
        for row in step_rows
    ]
    return exclusions(events, made)


@pytest.mark.parametrize(
    ("first", "step_rows", "is_told"),
    [(0, (), True), (0, (150,), True), (150, (150,), False), (150, (150, 250), False)],
)
def test_a_buffer_is_told_until_the_first_step_of_the_clock(first, step_rows, is_told):
    causes = {item.cause for item in frames_with_a_burst_at(first, step_rows=step_rows)}
    assert (Cause.BACKLOG in causes) == is_told
    assert (Cause.CLOCK_STEP in causes) == bool(step_rows)


def test_each_step_of_the_clock_is_left_out_on_both_of_its_sides():
    stretches = [item for item in frames_with_a_burst_at(0, step_rows=(150,)) if item.cause is Cause.CLOCK_STEP]
    old_ns, new_ns = START_NS + 15 * NS_PER_S, START_NS + 35 * NS_PER_S
    around = {(item.from_ns, item.until_ns) for item in stretches}
    assert (old_ns - 5 * NS_PER_S, old_ns + 5 * NS_PER_S) in around
    assert (new_ns - 5 * NS_PER_S, new_ns + 5 * NS_PER_S) in around
    assert {item.time_error_s for item in stretches} == {20.0}


@pytest.mark.parametrize(("step_s", "words"), [(-20.0, "20 s ahead of"), (20.0, "20 s behind what")])
def test_all_frames_of_a_clock_that_was_far_off_are_left_out_and_which_way_it_was_off_is_told(step_s, words):
    (wrong,) = [item for item in frames_with_a_burst_at(250, step_rows=(150,), step_s=step_s) if words in item.reason]
    assert (wrong.from_ns, wrong.until_ns) == (START_NS, START_NS + 149 * NS_PER_S // 10 + 1)
    assert (wrong.cause, wrong.time_error_s) == (Cause.CLOCK_STEP, 20.0)


@pytest.mark.parametrize(
    ("step_s", "about_s"),
    [(20.0, [-20, 0]), (-20.0, [0])],
    ids=["the host slept for 20 s", "its monotonic clock leapt"],
)
def test_where_utc_was_right_all_along_only_times_that_frames_may_have_are_left_out(step_s, about_s):
    words = "the host was suspended"
    event = ClockStep(START_NS, 0, StationKind.CLOCK_STEP, words, round(step_s * NS_PER_S), utc_kept=True)
    around = [(item.from_ns - START_NS, item.until_ns - START_NS) for item in exclusions([event], np.zeros(0, FRAME))]
    assert around == [((second - 5) * NS_PER_S, (second + 5) * NS_PER_S) for second in about_s]


@pytest.mark.parametrize("instant", ["from_ns", "until_ns"])
def test_a_stretch_holds_its_first_instant_and_not_its_last(instant):
    stretch = Exclusion(START_NS, START_NS + 10, "clouds", Cause.OPERATOR)
    at_ns = getattr(stretch, instant)
    inside = excluded(np.array([at_ns - 1, at_ns, at_ns + 1]), [stretch])
    assert inside.tolist() == ([False, True, True] if instant == "from_ns" else [True, False, False])


@pytest.mark.parametrize(
    ("pause_s", "restarted", "is_told"),
    [(0.0, False, False), (29.0, False, False), (31.0, False, True), (0.0, True, True)],
)
def test_a_buffer_is_told_again_after_a_pause_of_half_a_minute_or_a_new_start_of_the_sensor(
    pause_s, restarted, is_told
):
    """Frames at 10 Hz; 38 of them, from the 150th on, were read at once."""
    made = np.zeros(300, dtype=FRAME)
    after_ns = np.arange(300) * NS_PER_S // 10
    after_ns[150:] += round(pause_s * NS_PER_S)
    made["time_us"] = after_ns // 1000
    if restarted:
        made["time_us"][150:] -= made["time_us"][150]
    read_ns = START_NS + after_ns
    read_ns[150:188] = read_ns[188] + 1000 * np.arange(38)
    made["utc_ns"] = made["host_utc_ns"] = read_ns
    told = [item for item in exclusions([], made) if item.cause is Cause.BACKLOG]
    assert bool(told) is is_told
    if told:
        assert told[0].from_ns == read_ns[150]
        assert told[0].time_error_s == pytest.approx(3.8, abs=0.1)


@pytest.mark.parametrize(("late_ms", "is_told"), [(19, False), (20, False), (21, True), (200, True)])
def test_frames_that_waited_for_more_than_twenty_milliseconds_are_told(late_ms, is_told):
    """The third frame was read a millisecond late, the fourth at once."""
    made = np.zeros(60, dtype=FRAME)
    taken_ns = np.arange(60) * NS_PER_S
    made["time_us"] = taken_ns // 1000
    late_ns = np.zeros(60, dtype=np.int64)
    late_ns[:2], late_ns[2] = (late_ms + 1) * 10**6, 10**6
    made["utc_ns"] = START_NS + taken_ns + late_ns
    made["host_utc_ns"] = START_NS + np.where(np.arange(60) < 2, np.arange(60) * 1000, taken_ns)
    assert any(item.cause is Cause.BACKLOG for item in exclusions([], made)) is is_told
