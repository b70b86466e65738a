"""UTC from the sensor's own time tags: the least delay seen lately is the clock's offset."""

import pytest

from gse.station.reception import SensorClock
from gse.values.instant import NS_PER_S

UTC_MINUS_MONO_NS = 1_700_000_000 * NS_PER_S


def told_ns(clock, time_us, late_ns):
    """By how much the time told for a tag is late, of a sensor that began with the host's monotonic clock."""
    utc_ns = clock.utc_ns(time_us, arrived_mono_ns=time_us * 1000 + late_ns, utc_minus_mono_ns=UTC_MINUS_MONO_NS)
    return utc_ns - UTC_MINUS_MONO_NS - time_us * 1000


def test_the_least_delay_up_to_now_counts():
    clock = SensorClock()
    late_ns = [900, 300, 800, 300, 200, 1000]
    assert [told_ns(clock, 1000 * number, late) for number, late in enumerate(late_ns)] == [
        900,
        300,
        300,
        300,
        200,
        200,
    ]


def test_a_least_delay_counts_for_two_hundred_frames():
    clock = SensorClock()
    told = [told_ns(clock, 1000 * number, 500 + 100 * (number > 0)) for number in range(201)]
    assert told == [500] * 200 + [600]


@pytest.mark.parametrize(("after_ns", "told"), [(30 * NS_PER_S, 500), (30 * NS_PER_S + 1000, 600)])
def test_a_least_delay_counts_for_thirty_seconds(after_ns, told):
    clock = SensorClock()
    assert told_ns(clock, 0, 500) == 500
    assert told_ns(clock, after_ns // 1000, 600) == told


def test_what_left_the_window_gives_way_to_the_next_least():
    clock = SensorClock()
    for number, late_ns in enumerate((500, 700, 600, 900)):
        told_ns(clock, 10_000_000 * number, late_ns)
    assert told_ns(clock, 30_001_000, 900) == 600


def test_a_clock_that_began_anew_knows_nothing_of_the_old_one():
    clock = SensorClock()
    told_ns(clock, 0, 500)
    clock.reset()
    assert told_ns(clock, 1000, 800) == 800
    assert [told_ns(clock, 1000 * number, 900) for number in range(2, 202)] == [800] * 199 + [900]


def test_a_step_of_the_host_s_utc_moves_the_time_at_once():
    clock = SensorClock()
    first = clock.utc_ns(0, arrived_mono_ns=100, utc_minus_mono_ns=0)
    assert clock.utc_ns(1, arrived_mono_ns=1200, utc_minus_mono_ns=5 * NS_PER_S) == first + 1000 + 5 * NS_PER_S
