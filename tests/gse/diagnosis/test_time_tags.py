"""Time tags that stand still, leap or run away, on frames whose clocks are made by hand."""

import numpy as np
import pytest

from gse.diagnosis.time_tags import time_tag_faults
from gse.instant import NS_PER_S, from_text
from gse.station.event_kinds import ClockStep, StationKind
from gse.station.frame_table import FRAME

START_NS = from_text("2026-03-20T18:30:00Z")


def frames(count=200, step_s=0.1):
    made = np.zeros(count, dtype=FRAME)
    made["frame_no"] = np.arange(count)
    made["host_utc_ns"] = made["utc_ns"] = START_NS + np.round(np.arange(count) * step_s * NS_PER_S).astype(np.int64)
    made["time_us"] = 1_000_000 + np.round(np.arange(count) * step_s * 1e6).astype(np.int64)
    return made


def faults(made, events=()):
    return time_tag_faults(made, events)


def test_sound_tags_are_no_fault():
    assert faults(frames()) == ()
    assert faults(frames(2)) == ()


@pytest.mark.parametrize(("count", "is_told"), [(2, False), (3, True)])
def test_three_frames_are_enough_for_a_leap(count, is_told):
    made = frames(count)
    made["time_us"][count - 1 :] += 60_000_000
    assert [line.startswith("sensor time tag: it leapt by +60.00 s") for line in faults(made)] == [True] * is_told


def test_without_host_times_nothing_is_told():
    made = frames()
    made["time_us"][100:] += 3_000_000
    assert len(faults(made)) == 1
    made["host_utc_ns"][7] = 0
    assert faults(made) == ()


@pytest.mark.parametrize(("still", "is_told"), [(2, False), (3, True)])
def test_a_tag_stands_still_from_three_frames_on(still, is_told):
    made = frames()
    made["time_us"][50 : 50 + still + 1] = made["time_us"][50]
    expected = f"sensor time tag: it stood still in {still} frames while the host's clock went on"
    assert (expected in faults(made)) == is_told


def test_frames_that_are_read_at_once_with_one_tag_do_not_stand_still():
    made = frames()
    made["time_us"][50:60], made["host_utc_ns"][50:60] = made["time_us"][50], made["host_utc_ns"][50]
    assert not any("stood still" in line for line in faults(made))


def test_a_tag_that_does_not_move_has_not_leapt_ahead_of_a_host_that_went_back():
    made = frames()
    made["host_utc_ns"][100:] -= 2 * NS_PER_S
    made["time_us"][100] = made["time_us"][99]
    assert not any("leapt" in line for line in faults(made))


def test_a_step_of_the_host_before_the_first_frame_hides_no_leap():
    made = frames()
    made["time_us"][100:] += 3_000_000
    early = ClockStep(START_NS - NS_PER_S, 0, StationKind.CLOCK_STEP, "", 5 * NS_PER_S)
    assert any("leapt by +3.00 s" in line for line in faults(made, (early,)))


@pytest.mark.parametrize(("leap_s", "is_told"), [(0.6, False), (0.7, True)])
def test_a_leap_is_half_a_second_beyond_a_frame_and_a_half_with_its_size_and_time(leap_s, is_told):
    """Half a second, and one and a half of the usual steps: so much may frames be ahead that are read at once."""
    made = frames()
    made["time_us"][100:] += round(leap_s * 1e6)
    text = f"sensor time tag: it leapt by {leap_s:+.2f} s at 2026-03-20T18:30:10.0Z"
    assert (text in faults(made)) == is_told


def test_later_leaps_are_counted():
    made = frames()
    for row in (0, 100, 150):
        made["time_us"][row + 1 :] += 2_000_000
    (line,) = faults(made)
    assert "leapt by +2.00 s at 2026-03-20T18:30:00.1Z, and 2 times more" in line


def test_missing_frames_are_no_leap_but_what_they_do_not_explain_is():
    made = frames()
    made["frame_no"][100:] += 20
    made["time_us"][100:] += 2_000_000
    assert faults(made) == ()
    made["time_us"][100:] += 2_000_000
    assert any("leapt by +4.00 s" in line for line in faults(made))


@pytest.mark.parametrize("row", [1, 100])
def test_a_step_of_the_hosts_clock_is_no_leap_of_the_tag(row):
    made = frames()
    made["host_utc_ns"][row:] -= 2 * NS_PER_S
    at_ns = int(made["host_utc_ns"][row])
    assert any("it leapt" in line for line in faults(made))
    step = ClockStep(at_ns, 0, StationKind.CLOCK_STEP, "the clock was set", -2 * NS_PER_S)
    assert faults(made, [step]) == ()


@pytest.mark.parametrize(("share", "word"), [(1.06, "6 % fast"), (0.94, "6 % slow"), (1.04, ""), (0.96, "")])
@pytest.mark.parametrize("steps", [40, 39])
def test_tags_that_run_away_for_forty_frames_are_told(share, word, steps):
    made = frames(steps + 1)
    made["time_us"] = 1_000_000 + np.round(np.arange(steps + 1) * 1e5 * share).astype(np.int64)
    expected = (f"sensor time tag: it ran {word} from 2026-03-20T18:30:00.0Z",) if word and steps == 40 else ()
    assert faults(made) == expected


def test_the_worst_stretch_is_told_with_its_begin():
    made = frames()
    made["time_us"][41:81] += np.arange(1, 41, dtype=np.uint64) * 7_000
    made["time_us"][81:] += 280_000
    made["time_us"][121:161] += np.arange(1, 41, dtype=np.uint64) * 20_000
    made["time_us"][161:] += 800_000
    assert faults(made) == ("sensor time tag: it ran 20 % fast from 2026-03-20T18:30:12.0Z",)


def test_arrivals_that_jitter_by_a_third_of_their_period_are_no_fault_of_the_tags():
    told = 0
    for seed in range(20):
        made = frames(step_s=0.05)
        late_ns = np.random.default_rng(seed).normal(0.0, 8e6, len(made))
        made["host_utc_ns"] += np.round(late_ns).astype(np.int64)
        told += len(faults(made))
    assert told == 0
