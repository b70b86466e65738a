"""What is known of the clocks: the host's by its readings, the sensor's against the host's."""

import math

import numpy as np
import pytest
import scipy.stats
from skies.known_nights import START_NS, session

from drivers.clock import ClockReading
from gse.errors import UsageError
from gse.station.events import ClockStep, StationKind
from gse.statistics.clock_health import _longest_stretch, clock_health, stated_error_s


def reading(offset_s, error_bound_s, *, source="kernel PLL", synchronised=True):
    return ClockReading(0, 0, source, synchronised, offset_s, error_bound_s)


def health(*readings, made=None, **options):
    made = session(0) if made is None else made
    return clock_health(readings, made.events, made.frames.columns, **options)


def test_the_worst_reading_bounds_the_error_of_the_host_clock():
    found = health(reading(0.001, 0.002), reading(-0.010, 0.001), reading(0.002, 0.003))
    assert found.error_bound_s == pytest.approx(0.011)
    assert found.offset_s == -0.010
    assert (found.synchronised, found.readings, found.stated) == (True, 3, False)


@pytest.mark.parametrize("readings", [(), (reading(0.0, 0.001), reading(0.0, 0.001, synchronised=False))])
def test_nothing_bounds_a_clock_that_was_not_read_or_once_not_synchronised(readings):
    found = health(*readings)
    assert found.error_bound_s == math.inf
    assert not found.synchronised


def test_the_bound_that_the_operator_states_takes_the_place_of_the_readings():
    found = health(reading(0.0, 5.0, synchronised=False), stated_error_s=0.25)
    assert (found.error_bound_s, found.stated) == (0.25, True)


def test_sources_are_named_once_each():
    assert health(reading(0, 1), reading(0, 1, source="chrony"), reading(0, 1)).source == "kernel PLL, chrony"
    assert health().source == "not recorded"


@pytest.mark.parametrize("ppm", [120.0, -120.0])
def test_a_sensor_clock_that_is_slow_drifts_by_positive_parts_in_a_million(ppm):
    found = health(made=session(2000, sensor_ppm=ppm))
    assert found.sensor_drift_ppm == pytest.approx(ppm, abs=3)
    assert 0 < found.sensor_drift_error_ppm < 10


def test_a_short_session_tells_nothing_of_the_sensor_clock():
    assert np.isnan(health(made=session(50)).sensor_drift_ppm)


def counted_by(host_s, sensor_s):
    """Frames with these stamps of the host and of the sensor's clock (M,) in s."""
    frames = session(1).frames.columns.rows().repeat(len(host_s))
    frames["host_utc_ns"] = START_NS + np.rint(np.asarray(host_s) * 1e9).astype(np.int64)
    frames["time_us"] = np.rint(np.asarray(sensor_s) * 1e6).astype(np.uint64)
    return frames


def drift_of(host_s, sensor_s):
    return clock_health((), (), counted_by(host_s, sensor_s)).sensor_drift_ppm


@pytest.mark.parametrize(("frames", "duration_s", "is_told"), [(119, 60, False), (120, 60, True), (400, 29.9, False)])
def test_a_drift_takes_120_frames_and_half_a_minute(frames, duration_s, is_told):
    sensor_s = np.linspace(0, duration_s, frames)
    assert math.isfinite(drift_of(sensor_s * 1.0002, sensor_s)) is is_told


def test_half_a_minute_is_enough_for_a_drift():
    sensor_s = np.linspace(0, 30, 301)
    assert drift_of(sensor_s * 1.0002, sensor_s) == pytest.approx(200, abs=0.1)


def test_a_drift_follows_the_earliest_arrivals_and_not_the_late_ones():
    """One frame of ten comes at once, the others by up to 20 ms later, and the later in the session the more."""
    sensor_s = np.arange(1200) * 0.1
    late_s = 0.02 * sensor_s / 120 * (np.arange(1200) % 10 != 3)
    assert drift_of(sensor_s * (1 + 50e-6) + late_s, sensor_s) == pytest.approx(50, abs=0.1)


def test_a_drift_that_is_exact_has_no_uncertainty_and_a_noisy_one_has_that_of_scipy():
    """Of sixty equal parts of the time of the sensor, here of two frames each."""
    sensor_s = np.arange(120) * 1.0
    late_s = np.repeat(np.random.default_rng(6).uniform(0, 1e-3, 60), 2)
    found = clock_health((), (), counted_by(sensor_s * 1.0001 + late_s, sensor_s))
    earliest = np.r_[0:119:2]
    host_s = np.rint((sensor_s * 1.0001 + late_s) * 1e9) / 1e9
    slope = scipy.stats.theilslopes((host_s - host_s[0] - sensor_s)[earliest], sensor_s[earliest])
    assert found.sensor_drift_ppm == pytest.approx(slope.slope * 1e6, abs=0.5)
    assert found.sensor_drift_error_ppm == pytest.approx((slope.high_slope - slope.low_slope) / 2 * 1e6, rel=0.1)
    exact = clock_health((), (), counted_by(sensor_s * 1.0001, sensor_s))
    assert exact.sensor_drift_error_ppm < 1e-3


@pytest.mark.parametrize("first", [True, False])
def test_a_drift_is_that_of_the_longest_stretch_between_restarts_of_the_sensor(first):
    """Eight minutes at 40 ppm and four at 90."""
    counts = (480, 240) if first else (240, 480)
    parts = [
        np.arange(count) * (1 - ppm * 1e-6) for count, ppm in zip(counts, (40, 90) if first else (90, 40), strict=True)
    ]
    host_s = np.arange(720) * 1.0
    assert drift_of(host_s, np.concatenate(parts)) == pytest.approx(40, abs=0.1)


def test_frames_without_a_stamp_of_the_host_tell_no_drift():
    frames = counted_by(np.arange(600.0) * 1.0001, np.arange(600.0))
    frames["host_utc_ns"][::2] = 0
    assert clock_health((), (), frames).sensor_drift_ppm == pytest.approx(100, abs=0.1)
    frames["host_utc_ns"] = 0
    assert np.isnan(clock_health((), (), frames).sensor_drift_ppm)


def stepped(step_s, at_s):
    """Ten minutes of frames of a host whose clock is set by so much at that second; the sensor's clock goes on."""
    second = np.arange(600.0)
    frames = counted_by(second + step_s * (second >= at_s), second)
    at_ns = START_NS + round((at_s - 0.5 + step_s) * 1e9)
    step = ClockStep(at_ns, 0, StationKind.CLOCK_STEP, "it was set", round(step_s * 1e9))
    return clock_health((reading(0.0, 0.25),), (step,), frames)


@pytest.mark.parametrize(
    ("step_s", "at_s", "error_bound_s"),
    [(2.0, 300, 2.0), (-2.0, 300, 2.0), (0.1, 300, 0.25), (10.0, 300, 10.0), (11.0, 300, 0.25), (2.0, 0, 0.25)],
    ids=["forward", "back", "small", "all that can be judged", "more than can be judged", "before the first frame"],
)
def test_a_step_that_put_the_clock_of_judged_frames_right_bounds_their_error(step_s, at_s, error_bound_s):
    found = stepped(step_s, at_s)
    assert found.error_bound_s == pytest.approx(error_bound_s)
    assert found.steps == ("it was set",)
    assert found.sensor_drift_ppm == pytest.approx(0, abs=0.01)


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("0.1s", 0.1), ("20ms", 0.02), ("50us", 50e-6), (" 3 s ", 3.0), (".5 ms", 5e-4), ("2.us", 2e-6), ("10s", 10.0)],
)
def test_a_clock_error_is_stated_in_seconds_or_parts_of_them(text, seconds):
    assert stated_error_s(text) == pytest.approx(seconds, rel=1e-12)


@pytest.mark.parametrize("text", ["", "1", "1 m", "-1s", "1e3s", "s", "0.1s 2", "1,5s", "..s"])
def test_what_is_no_time_is_refused_with_an_example(text):
    with pytest.raises(UsageError, match=r"expected for example 0\.1s, 20ms or 50us"):
        stated_error_s(text)


@pytest.mark.parametrize(
    ("time_us", "stepped", "stretch"),
    [
        ([], [], []),
        ([5], [], [0]),
        ([1, 2, 3, 4], [], [0, 1, 2, 3]),
        ([1, 2, 3, 3, 4], [], [0, 1, 2, 3, 4]),
        ([1, 2, 3, 0, 1], [], [0, 1, 2]),
        ([1, 2, 0, 1, 2], [], [2, 3, 4]),
        ([1, 2, 3, 4, 5, 6], [2], [2, 3, 4, 5]),
        ([1, 2, 3, 4, 5, 6], [4], [0, 1, 2, 3]),
        ([1, 2, 3, 4, 0, 1], [2, 6], [0, 1]),
        ([1, 2, 0, 1, 0, 1, 2], [], [4, 5, 6]),
    ],
)
def test_the_longest_stretch_has_neither_a_restart_nor_a_step_in_it(time_us, stepped, stretch):
    rows = _longest_stretch(np.array(time_us, dtype=np.uint64), stepped)
    assert np.arange(len(time_us))[rows].tolist() == stretch


def test_the_bound_of_the_operator_stands_beside_steps_and_a_reading():
    found = health(reading(0.5, 0.25), stated_error_s=0.0)
    assert (found.error_bound_s, found.stated, found.offset_s) == (0.0, True, 0.5)
    assert math.isnan(health().offset_s)
    assert health(reading(-0.25, 0.5)).error_bound_s == 0.75
