"""How late frames are read against the sensor's time tags."""

import numpy as np
import pytest
from skies.known_nights import START_NS

from drivers.chunk import LinkEvent
from gse.diagnosis.late_frames import LateFrames
from gse.instant import NS_PER_S
from gse.station.event_kinds import ClockStep, StationKind
from gse.station.frame_table import FRAME

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
    at_ns, step_s = LateFrames.of(frames(late_s), ()).step(START_NS + near_s * NS_PER_S)
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
    assert (LateFrames.of(made, events) is None) == (event == "step")
    made["host_utc_ns"] = 0
    assert LateFrames.of(made, events) is None
