"""How late frames are read against the sensor's time tags."""

import numpy as np
import pytest
from skies.known_nights import START_NS

from drivers.chunk import LinkEvent
from gse.diagnosis.late_frames import LateFrames
from gse.station.columns import FRAME
from gse.station.events import ClockStep, StationKind
from gse.values.instant import NS_PER_S

AT_S = 120


def frames(late_s):
    """A frame each second, read so late (M,)."""
    made = np.zeros(len(late_s), dtype=FRAME)
    seconds = np.arange(len(late_s))
    made["utc_ns"] = START_NS + seconds * NS_PER_S
    made["time_us"] = 5_000_000 + seconds * 1_000_000
    made["host_utc_ns"] = made["utc_ns"] + np.rint(np.asarray(late_s) * NS_PER_S).astype(np.int64)
    return made


def step_of(late_s, near_s=AT_S):
    at_ns, step_s = LateFrames.from_frames(frames(late_s), ()).step(START_NS + near_s * NS_PER_S)
    return (at_ns - START_NS) / NS_PER_S, step_s


@pytest.mark.parametrize("by_s", [0.3, -0.3])
@pytest.mark.parametrize("away_s", [0, 30])
def test_a_lasting_delay_is_found_with_its_instant_and_size(by_s, away_s):
    jitter_s = np.random.default_rng(1).exponential(3e-4, 240)
    at_s, step_s = step_of(jitter_s + by_s * (np.arange(240) >= AT_S), AT_S + away_s)
    assert abs(at_s - AT_S) <= 1
    assert step_s == pytest.approx(by_s, abs=0.002)


def test_frames_that_are_read_late_now_and_then_are_no_lasting_delay():
    late_s = np.zeros(240)
    late_s[100:107] = late_s[130::3] = 0.4
    assert abs(step_of(late_s)[1]) < 0.002


def test_a_delay_far_from_the_instant_is_not_that_of_it():
    assert step_of(0.3 * (np.arange(400) >= 300))[1] == 0


@pytest.mark.parametrize("rate", [0.018, -0.018])
def test_a_clock_that_runs_fast_or_slow_is_no_delay_that_began(rate):
    jitter_s = np.random.default_rng(1).exponential(3e-4, 240)
    assert step_of(jitter_s + rate * np.arange(240)) == (AT_S, 0)


def test_a_delay_is_told_beside_a_small_drift():
    late_s = 0.3 * (np.arange(240) >= AT_S) + 2e-4 * np.arange(240)
    assert step_of(late_s)[1] == pytest.approx(0.3, abs=0.03)


def test_a_few_frames_tell_no_delay():
    assert step_of(0.3 * (np.arange(15) >= 8), 8) == (8, 0)


@pytest.mark.parametrize("event", ["none", "step", "other"])
def test_a_host_without_stamps_or_with_a_step_of_its_clock_tells_none(event):
    made = frames(np.zeros(40))
    events = {
        "none": [],
        "step": [ClockStep(START_NS, 0, StationKind.CLOCK_STEP, "stepped", NS_PER_S)],
        "other": [LinkEvent(START_NS, 0, StationKind.NOTE, "a note")],
    }[event]
    assert (LateFrames.from_frames(made, events) is None) == (event == "step")
    made["host_utc_ns"] = 0
    assert LateFrames.from_frames(made, events) is None


def at(seconds, late_s):
    """Frames at these seconds, as late as that."""
    return LateFrames(START_NS + np.round(np.asarray(seconds) * NS_PER_S).astype(np.int64), np.asarray(late_s, float))


def test_lateness_is_what_the_host_counts_beyond_the_tags_from_the_first_frame_on():
    made = frames([0.25, 0.5, 0.125, 1.0])
    made["time_us"][3] -= 2_500_000
    found = LateFrames.from_frames(made, ())
    assert found.late_s.tolist() == [0.0, 0.25, -0.125, 3.25]
    assert (found.utc_ns == made["utc_ns"]).all()
    assert LateFrames.from_frames(made[:0], ()) is None
    made["host_utc_ns"][2] = 0
    assert LateFrames.from_frames(made, ()) is None


@pytest.mark.parametrize(
    ("before", "after", "is_told"), [(8, 8, True), (7, 8, False), (8, 7, False), (9, 8, True), (8, 9, True)]
)
def test_eight_frames_on_either_side_are_needed(before, after, is_told):
    seconds = np.arange(before + after, dtype=float)
    found = at(seconds, 0.5 * (seconds >= before)).step(START_NS + before * NS_PER_S)
    assert found == ((START_NS + before * NS_PER_S, 0.5) if is_told else (START_NS + before * NS_PER_S, 0.0))


@pytest.mark.parametrize(("first_s", "is_told"), [(-90.0, False), (-89.999, True)])
def test_a_minute_and_a_half_before_is_near(first_s, is_told):
    """Eight frames before, the first at that time, and eight after."""
    seconds = np.r_[first_s, -7.0:0.0, 0.0:8.0]
    assert (at(seconds, 0.5 * (seconds >= 0)).step(START_NS)[1] == 0.5) == is_told


@pytest.mark.parametrize(("last_s", "is_told"), [(60.0, False), (59.999, True)])
def test_a_minute_after_is_near(last_s, is_told):
    seconds = np.r_[-8.0:0.0, 0.0:7.0, last_s]
    assert (at(seconds, 0.5 * (seconds >= 0)).step(START_NS)[1] == 0.5) == is_told


@pytest.mark.parametrize("rows", [slice(0, 5), slice(5, 10)])
@pytest.mark.parametrize("side", ["before", "after"])
@pytest.mark.parametrize(("more_s", "is_told"), [(0.125, True), (0.126, False)])
def test_a_quarter_of_the_step_may_change_on_either_side_of_it(rows, side, more_s, is_told):
    late_s = np.repeat([0.0, 0.5], 10)
    part = late_s[:10] if side == "before" else late_s[10:]
    part[rows] += more_s
    least_before, least_after = late_s[:10].min(), late_s[10:].min()
    found = at(np.arange(20.0), late_s).step(START_NS + 10 * NS_PER_S)
    assert found == (START_NS + 10 * NS_PER_S, least_after - least_before if is_told else 0.0)


@pytest.mark.parametrize("by_s", [0.5, -0.5])
def test_of_changes_that_are_nearly_as_great_the_first_is_of_a_delay_and_the_last_of_its_end(by_s):
    """Of the least so far a delay shows at its first late frame, and its end at its first frame in time."""
    late_s = np.where(np.arange(40) >= 20, by_s, 0.0)
    late_s[16:20] += 0.3 * (by_s < 0)
    late_s[20:24] += 0.3 * (by_s > 0)
    at_ns, step_s = at(np.arange(40.0), late_s).step(START_NS + 20 * NS_PER_S)
    assert ((at_ns - START_NS) / NS_PER_S, step_s) == (20.0, by_s)


def test_frames_in_time_have_no_step_whatever_the_instant():
    assert at(np.arange(40.0), np.zeros(40)).step(START_NS + 7) == (START_NS + 7, 0.0)


@pytest.mark.parametrize(("count", "is_told"), [(31, False), (32, True), (40, True)])
@pytest.mark.parametrize("rate", [2e-3, -2e-3])
def test_a_drift_is_the_rise_from_quarter_to_quarter_over_three_quarters_of_the_time(count, is_told, rate):
    """The least of a quarter is at its begin where frames become later, at its end where they become earlier."""
    found = at(np.arange(count) * 2.0, rate * np.arange(count) * 2.0)
    quarter = count // 4
    apart_s = 2.0 * (count - quarter)
    assert found.span_s == 2.0 * (count - 1)
    assert found.drift == (pytest.approx(rate * apart_s / (0.75 * found.span_s)) if is_told else 0.0)


def test_frames_of_one_instant_have_no_drift():
    assert at(np.zeros(40), np.arange(40.0)).drift == 0.0


@pytest.mark.parametrize(("first_s", "found"), [(0.3, (24.0, 0.5)), (0.44, (24.0, 0.5)), (0.46, (20.0, 0.46))])
def test_a_delay_that_comes_in_two_stages_is_told_at_that_which_has_nine_tenths_of_it(first_s, found):
    late_s = np.repeat([0.0, first_s, 0.5], [20, 4, 16])
    at_ns, step_s = at(np.arange(40.0), late_s).step(START_NS + 20 * NS_PER_S)
    assert ((at_ns - START_NS) / NS_PER_S, step_s) == found
