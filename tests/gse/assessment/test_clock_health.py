"""What is known of the clocks: the host's by its readings, the sensor's against the host's."""

import math

import numpy as np
import pytest
from skies.known_nights import session

from drivers.clock import ClockReading
from gse.assessment.clock_health import clock_health


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
