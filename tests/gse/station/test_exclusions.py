"""Frames that waited in a buffer: told where a session begins, and not where the host's clock was stepped."""

import numpy as np
import pytest

from gse.errors import UsageError
from gse.station.columns import FRAME
from gse.station.events import ClockStep, StationKind
from gse.station.exclusions import Cause, Exclusion, _burst, _read_at_once, excluded, exclusions, parse_exclusion
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


@pytest.mark.parametrize(
    ("late_ns", "time_error_s"),
    [
        ([20_000_000], None),
        ([20_000_001], 0.020000001),
        ([50_000_000, 20_000_000], 0.03),  # the second is near enough to the least that is seen
        ([50_000_000, 20_000_001], 0.05),
        ([40_000_000, 20_000_000], None),
        ([40_000_001, 20_000_000], 0.020000001),
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


def test_frames_read_at_the_very_same_instant_waited_too():
    (told,) = exclusions([], read_late(3))
    assert (told.from_ns, told.until_ns, told.time_error_s) == (START_NS + 3 * SECOND, START_NS + 3 * SECOND + 1, 3.0)


@pytest.mark.parametrize(("waited", "late_s", "last"), [(29, 29.0, 28), (30, 30.0, 29), (31, 30.0, 29)])
def test_a_buffer_settles_within_thirty_seconds_of_the_sensors_clock(waited, late_s, last):
    """The frame of the 30th second still shows how late the ones before it were; the one of the 31st does not."""
    (told,) = exclusions([], read_late(waited, read_step=1000))
    assert told.time_error_s == pytest.approx(late_s, abs=1e-4)
    assert told.until_ns == START_NS + waited * SECOND - 1000 * (waited - last) + 1


@pytest.mark.parametrize(("pause_ns", "is_told"), [(30 * SECOND, False), (30 * SECOND + 1000, True)])
def test_a_pause_of_more_than_half_a_minute_begins_anew(pause_ns, is_told):
    """Three frames at 1 Hz, a pause, and then a buffer of three."""
    before, after = np.arange(50) * SECOND, np.arange(51) * SECOND
    taken_ns = np.concatenate([before, before[-1] + pause_ns + after])
    read_ns = taken_ns.copy()
    read_ns[50:53] = read_ns[53]
    made = np.zeros(101, dtype=FRAME)
    made["time_us"], made["utc_ns"], made["host_utc_ns"] = taken_ns // 1000, START_NS + read_ns, START_NS + read_ns
    assert bool(exclusions([], made)) is is_told


@pytest.mark.parametrize(("back_us", "is_told"), [(0, False), (1, True)])
def test_only_a_time_tag_that_falls_is_a_new_start_of_the_sensor(back_us, is_told):
    made = read_late(3, frames=101)
    late = made[:51].copy()
    for name in ("utc_ns", "host_utc_ns"):
        late[name] += 50 * SECOND
        made[name][:50] = START_NS + np.arange(50) * SECOND
    made["time_us"] = np.arange(101) * 10**6
    made[50:] = late
    made["time_us"][50:] += made["time_us"][49] - back_us
    assert bool(exclusions([], made)) is is_told


@pytest.mark.parametrize(
    ("read_ns", "tag_ns", "expected"),
    [
        ([0], [0], [False]),
        ([0, 100, 149, 249, 349], [0, 100, 200, 300, 400], [False, False, True, False, False]),
        ([0, 100, 150, 250, 350], [0, 100, 200, 300, 400], [False] * 5),  # half of the usual time
        ([0, 100, 100, 200, 300], [0, 100, 200, 300, 400], [False, False, True, False, False]),
        ([0, 100, 99, 199, 299], [0, 100, 200, 300, 400], [False] * 5),  # the clock went back
        ([0, 100, 149, 249, 349], [0, 100, 190, 290, 390], [False] * 5),  # taken soon after each other themselves
    ],
)
def test_a_frame_is_read_at_once_within_half_of_the_usual_time_and_of_the_time_between_exposures(
    read_ns, tag_ns, expected
):
    assert _read_at_once(np.array(read_ns), np.array(tag_ns)).tolist() == expected


@pytest.mark.parametrize(
    ("at_once", "expected"),
    [
        ([], []),
        ([False], [False]),
        ([True], [False]),
        ([False, True], [True, True]),
        ([True, False], [False, False]),
        ([False, True, True, False, True], [True, True, True, False, False]),
        ([False, False, True], [False, False, False]),
    ],
)
def test_a_burst_lasts_from_the_first_frame_to_the_last_that_followed_at_once(at_once, expected):
    assert _burst(np.array(at_once, dtype=bool)).tolist() == expected


# Steps of the clock, by hand


def around(utc_ns, step_ns, *, utc_kept=False):
    event = ClockStep(utc_ns, 0, StationKind.CLOCK_STEP, "it stepped", step_ns, utc_kept)
    return [(item.from_ns, item.until_ns) for item in exclusions([event], np.zeros(0, FRAME))]


@pytest.mark.parametrize(
    ("step_ns", "utc_kept", "expected"),
    [
        (10 * SECOND, False, [(-15 * SECOND, 5 * SECOND)]),  # both sides meet
        (10 * SECOND + 1, False, [(-15 * SECOND - 1, -5 * SECOND - 1), (-5 * SECOND, 5 * SECOND)]),
        (-10 * SECOND, False, [(-5 * SECOND, 15 * SECOND)]),
        (-10 * SECOND - 1, False, [(5 * SECOND + 1, 15 * SECOND + 1), (-5 * SECOND, 5 * SECOND)]),
        (SECOND, False, [(-6 * SECOND, 5 * SECOND)]),
        (SECOND, True, [(-6 * SECOND, 5 * SECOND)]),
        (-SECOND, True, [(-5 * SECOND, 5 * SECOND)]),
    ],
)
def test_five_seconds_around_a_step_are_left_out_by_the_old_and_by_the_new_clock(step_ns, utc_kept, expected):
    found = around(START_NS, step_ns, utc_kept=utc_kept)
    assert [(begin - START_NS, end - START_NS) for begin, end in found] == expected


@pytest.mark.parametrize(
    ("utc_ns", "expected"),
    [
        (5 * SECOND + 1_000_000_001, [(1, 11_000_000_001)]),
        (6 * SECOND, [(0, 11 * SECOND)]),
        (3 * SECOND, [(0, 8 * SECOND)]),
        (-5 * SECOND, []),
        (1 - 5 * SECOND, [(0, 1)]),
        (LAST_NS - 5 * SECOND, [(LAST_NS - 11 * SECOND, LAST_NS)]),
        (LAST_NS, [(LAST_NS - 6 * SECOND, LAST_NS)]),
        (LAST_NS + 6 * SECOND, []),
        (LAST_NS + 6 * SECOND - 1, [(LAST_NS - 1, LAST_NS)]),
    ],
)
def test_what_is_left_out_around_a_step_stays_within_the_instants_that_there_are(utc_ns, expected):
    """A step by a second forward."""
    assert around(utc_ns, SECOND) == expected


def test_what_is_left_out_around_a_step_may_be_off_by_the_step_and_bears_its_words():
    event = ClockStep(START_NS, 0, StationKind.CLOCK_STEP, "it stepped", -2_500_000_000)
    (item,) = exclusions([event], np.zeros(0, FRAME))
    assert (item.reason, item.cause, item.time_error_s) == ("it stepped", Cause.CLOCK_STEP, 2.5)


@pytest.mark.parametrize(("step_s", "side"), [(-20.0, "ahead of"), (20.0, "behind")])
def test_a_clock_that_was_far_off_is_told_in_whole_seconds_and_its_side(step_s, side):
    (wrong,) = [item for item in frames_with_a_burst_at(250, step_rows=(150,), step_s=step_s) if "was" in item.reason]
    assert wrong.reason == f"the host's clock was 20 s {side} what it was set to"


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
