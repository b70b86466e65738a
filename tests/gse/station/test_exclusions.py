"""Stretches that are left out: frames that waited in a buffer, steps of the clock, what an operator states."""

import numpy as np
import pytest

from gse.errors import UsageError
from gse.station.columns import FRAME
from gse.station.events import ClockStep, StationKind
from gse.station.exclusions import AROUND_STEP_NS, Cause, Exclusion, excluded, exclusions, parse_exclusion
from gse.values.instant import LAST_NS, NS_PER_S, from_text

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
    ("first", "step_rows"),
    [(0, ()), (0, (150,)), (150, ()), (150, (150,)), (150, (150, 250))],
)
def test_a_buffer_is_told_wherever_it_stands(first, step_rows):
    causes = {item.cause for item in frames_with_a_burst_at(first, step_rows=step_rows)}
    assert Cause.BACKLOG in causes
    assert (Cause.CLOCK_STEP in causes) == bool(step_rows)


@pytest.mark.parametrize(("step_s", "side"), [(-20.0, "ahead of"), (20.0, "behind")])
def test_all_frames_of_a_clock_that_was_far_off_are_left_out_and_which_way_it_was_off_is_told(step_s, side):
    (wrong,) = [
        item for item in frames_with_a_burst_at(250, step_rows=(150,), step_s=step_s) if "clock was" in item.reason
    ]
    assert wrong.reason == f"the host's clock was 20 s {side} what it was set to"
    assert (wrong.from_ns, wrong.until_ns) == (START_NS, START_NS + 149 * NS_PER_S // 10 + 1)
    assert (wrong.cause, wrong.time_error_s) == (Cause.CLOCK_STEP, 20.0)


@pytest.mark.parametrize(
    ("late_ns", "time_error_s"),
    [
        ([20_000_000], None),
        ([20_000_001], 0.020000001),
        ([50_000_000, 20_000_000], 0.05),
        ([50_000_000, 20_000_001], 0.05),
        ([20_000_000, 20_000_000], None),
    ],
)
def test_twenty_milliseconds_are_no_wait_to_the_nanosecond(late_ns, time_error_s):
    """The first frames are read in one go, so much later than those behind them."""
    made = np.zeros(60, dtype=FRAME)
    taken_ns = np.arange(60) * NS_PER_S
    made["time_us"], made["utc_ns"] = taken_ns // 1000, START_NS + taken_ns
    made["utc_ns"][: len(late_ns)] += np.array(late_ns)
    made["host_utc_ns"] = START_NS + np.where(np.arange(60) < 3, np.arange(60) * 1000, taken_ns)
    found = [item.time_error_s for item in exclusions([], made)]
    assert found == ([] if time_error_s is None else [time_error_s])


@pytest.mark.parametrize("rows", [(1,), (0,), (299,), (300,), (0, 1, 299)])
def test_steps_beside_a_single_frame_or_none_leave_out_what_is_around_them_alone(rows):
    """Frames at 10 Hz that nothing is wrong with."""
    made = np.zeros(300, dtype=FRAME)
    made["time_us"] = np.arange(300) * 100_000
    made["utc_ns"] = made["host_utc_ns"] = START_NS + np.arange(300) * NS_PER_S // 10
    events = [ClockStep(START_NS + row * NS_PER_S // 10, 0, StationKind.CLOCK_STEP, "", -1000) for row in rows]
    assert [item.time_error_s for item in exclusions(events, made)] == [1e-6] * len(rows)


# Frames out of a buffer, by hand

SECOND = NS_PER_S


def read_late(waited, *, frames=100, tag_step=SECOND, read_step=0):
    """Frames of one a second: the first ``waited`` are read in one go with the next, the others as they come."""
    taken_ns = np.arange(frames) * tag_step
    read_ns = taken_ns.copy()
    read_ns[:waited] = taken_ns[waited] - read_step * np.arange(waited, 0, -1)
    made = np.zeros(frames, dtype=FRAME)
    made["time_us"] = taken_ns // 1000
    made["utc_ns"] = made["host_utc_ns"] = START_NS + read_ns
    return made


def test_a_buffer_is_told_with_its_first_frame_its_last_and_how_late_it_was():
    """Three frames, read at 3.000 s less 3, 2 and 1 us: the first is 3 s late."""
    (told,) = exclusions([], read_late(3, read_step=1000))
    assert (told.from_ns, told.until_ns) == (START_NS + 3 * SECOND - 3000, START_NS + 3 * SECOND - 1000 + 1)
    assert told.reason == "read up to 3.00 s late: these frames waited in a buffer before the port was read"
    assert (told.cause, told.time_error_s) == (Cause.BACKLOG, pytest.approx(2.999997, abs=1e-9))


@pytest.mark.parametrize(("waited", "late_s", "last"), [(29, 29.0, 28), (30, 30.0, 29), (31, 31.0, 30)])
def test_a_buffer_may_hold_any_time(waited, late_s, last):
    (told,) = exclusions([], read_late(waited, read_step=1000))
    assert told.time_error_s == pytest.approx(late_s, abs=1e-4)
    assert told.until_ns == START_NS + waited * SECOND - 1000 * (waited - last) + 1


@pytest.mark.parametrize(("step_us", "late_s"), [(0, 2.0), (1, 5.0), (30_000_000, 5.0), (30_000_001, 2.0)])
def test_the_next_frame_tells_how_late_a_buffer_was_where_the_sensors_clock_goes_on(step_us, late_s):
    """Frames of one a second: three that were read at once, 5, 4 and 3 s late; after a step the others as they come."""
    time_us = np.concatenate([np.arange(3), np.arange(60)]) * 10**6
    time_us[3:] += 2_000_000 + step_us
    made = np.zeros(63, dtype=FRAME)
    made["time_us"], made["utc_ns"] = time_us, START_NS + time_us * 1000
    made["utc_ns"][:3] = START_NS + 5 * SECOND
    made["host_utc_ns"] = made["utc_ns"]
    made["host_utc_ns"][3:] += 10 * SECOND
    assert [item.time_error_s for item in exclusions([], made)] == [late_s]


@pytest.mark.parametrize(
    ("read_s", "second_taken_s", "told"),
    [
        ([0.51], 1.0, [(0.51, 0.51)]),
        ([0.5], 1.0, []),  # half of the mean time between frames
        ([1.0], 1.0, [(1.0, 1.0)]),
        ([1.01], 1.0, []),  # the clock went back
        ([1.000000001], 1.0, []),
        ([0.45], 0.9, []),  # half of the time between these two exposures
        ([0.46], 0.9, [(0.46, 0.46)]),
        ([3.0, 3.0, 3.0, 3.7, 4.1], 1.0, [(3.0, 3.0), (4.1, 0.7)]),  # read in two bursts, until the frame behind both
        ([4.2, 4.2, 5.0, 5.0, 6.2, 6.2, 6.3], 1.0, [(4.2, 4.2), (5.0, 3.0), (6.3, 2.2)]),  # in three
        ([1.5, 2.3, 2.4], 1.0, [(1.5, 1.5), (2.4, 1.3)]),  # one that was read by itself before it
    ],
)
def test_frames_waited_that_followed_each_other_within_half_of_the_usual_time(read_s, second_taken_s, told):
    """Frames of one a second, but the second; those that ``read_s`` does not tell are read as they are taken."""
    taken_ns = np.arange(100) * SECOND
    taken_ns[1] = round(second_taken_s * SECOND)
    read_ns = taken_ns.copy()
    read_ns[: len(read_s)] = np.round(np.array(read_s) * SECOND)
    made = np.zeros(100, dtype=FRAME)
    made["time_us"], made["utc_ns"] = taken_ns // 1000, START_NS + read_ns
    made["host_utc_ns"] = made["utc_ns"]
    found = [((item.until_ns - 1 - START_NS) / SECOND, item.time_error_s) for item in exclusions([], made)]
    assert found == [pytest.approx(one) for one in told]


def test_a_burst_before_a_leap_of_the_sensors_clock_is_as_late_as_its_own_frames_show():
    """Frames of one a second; the first two are read 1 s after the second; those after the leap wait for 4 s."""
    time_us = np.concatenate([np.arange(2), 100 + np.arange(60)]) * 10**6
    read_ns = np.concatenate([[2, 2], 20 + np.maximum(np.arange(60), 4)]) * SECOND
    made = np.zeros(62, dtype=FRAME)
    made["time_us"], made["utc_ns"], made["host_utc_ns"] = time_us, START_NS + read_ns, START_NS + read_ns
    assert [item.time_error_s for item in exclusions([], made)] == [1.0, 4.0]


def test_frames_are_not_late_where_every_second_one_is_read_with_the_one_before():
    """An adapter that holds 10 ms back, at 100 Hz: the median time between two reads is 0."""
    made = np.zeros(400, dtype=FRAME)
    taken_ns = np.arange(400) * SECOND // 100
    made["time_us"], made["utc_ns"] = taken_ns // 1000, START_NS + taken_ns
    made["host_utc_ns"] = START_NS + np.repeat(taken_ns[1::2], 2)
    assert exclusions([], made) == ()
    made["utc_ns"][100] += SECOND  # the first of two that were read at once
    assert [item.time_error_s for item in exclusions([], made)] == [1.0]


# Steps of the clock, by hand


def around(utc_ns, step_ns, *, utc_kept=False):
    event = ClockStep(utc_ns, 0, StationKind.CLOCK_STEP, "it stepped", step_ns, utc_kept)
    return [(item.from_ns, item.until_ns) for item in exclusions([event], np.zeros(0, FRAME))]


AROUND = AROUND_STEP_NS


@pytest.mark.parametrize(
    ("step_ns", "utc_kept", "expected"),
    [
        (2 * AROUND, False, [(-3 * AROUND, AROUND)]),  # both sides meet
        (2 * AROUND + 1, False, [(-3 * AROUND - 1, -AROUND - 1), (-AROUND, AROUND)]),
        (-2 * AROUND, False, [(-AROUND, 3 * AROUND)]),
        (-2 * AROUND - 1, False, [(AROUND + 1, 3 * AROUND + 1), (-AROUND, AROUND)]),
        (2 * AROUND + 1, True, [(-3 * AROUND - 1, -AROUND - 1), (-AROUND, AROUND)]),  # the host slept
        (-2 * AROUND - 1, True, [(-AROUND, AROUND)]),  # its monotonic clock leapt
    ],
)
def test_seconds_around_a_step_are_left_out_by_the_old_and_by_the_new_clock(step_ns, utc_kept, expected):
    found = around(START_NS, step_ns, utc_kept=utc_kept)
    assert [(begin - START_NS, end - START_NS) for begin, end in found] == expected


@pytest.mark.parametrize(
    ("utc_ns", "expected"),
    [
        (AROUND + SECOND + 1, [(1, 2 * AROUND + SECOND + 1)]),
        (AROUND, [(0, 2 * AROUND)]),
        (-AROUND, []),
        (1 - AROUND, [(0, 1)]),
        (LAST_NS - AROUND, [(LAST_NS - 2 * AROUND - SECOND, LAST_NS)]),
        (LAST_NS + AROUND + SECOND, []),
        (LAST_NS + AROUND + SECOND - 1, [(LAST_NS - 1, LAST_NS)]),
    ],
)
def test_what_is_left_out_around_a_step_stays_within_the_instants_that_there_are(utc_ns, expected):
    """A step by a second forward."""
    assert around(utc_ns, SECOND) == expected


def test_five_seconds_before_and_after_a_step_are_left_out():
    assert around(START_NS, 0) == [(START_NS - 5 * SECOND, START_NS + 5 * SECOND)]


def test_what_is_left_out_around_a_step_may_be_off_by_the_step_and_bears_its_words():
    event = ClockStep(START_NS, 0, StationKind.CLOCK_STEP, "it stepped", -2_500_000_000)
    (item,) = exclusions([event], np.zeros(0, FRAME))
    assert (item.reason, item.cause, item.time_error_s) == ("it stepped", Cause.CLOCK_STEP, 2.5)


# What an operator leaves out


def test_an_operator_writes_a_stretch_and_why():
    stated = parse_exclusion("2026-03-20T18:30:00Z/2026-03-20T18:31:00Z= clouds = many ")
    assert stated == Exclusion(START_NS, START_NS + 60 * SECOND, "clouds = many", Cause.OPERATOR, 0.0)


@pytest.mark.parametrize("why", ["", "=", "=  "])
def test_a_stretch_without_a_reason_is_left_out_by_the_operator(why):
    stated = parse_exclusion(f"2026-03-20T18:30:00Z/2026-03-20T18:31:00Z{why}")
    assert (stated.reason, stated.time_error_s) == ("left out by the operator", 0.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("2026-03-20T18:30:00Z/2026-03-20T18:30:00Z", "ends before it begins"),
        ("2026-03-20T18:30:01Z/2026-03-20T18:30:00Z=x", "ends before it begins"),
        ("2026-03-20T18:30:00Z", "is not a stretch"),
        ("yesterday/today=clouds", "is not a stretch"),
    ],
)
def test_a_stretch_that_is_none_is_refused_with_an_example(text, message):
    with pytest.raises(UsageError, match=rf"{message}.*; expected for example 2026-03-20T18:30:00Z/") as refused:
        parse_exclusion(text)
    assert repr(text) in str(refused.value)


def test_an_instant_is_left_out_that_lies_in_any_of_the_stretches():
    stretches = [Exclusion(10, 20, "", Cause.OPERATOR), Exclusion(15, 30, "", Cause.OPERATOR)]
    instants = np.array([9, 10, 19, 20, 29, 30])
    assert excluded(instants, stretches).tolist() == [False, True, True, True, True, False]
    assert excluded(instants, []).tolist() == [False] * 6
