"""The health of the host clock."""

import sys
import time

import pytest

from drivers.clock import read_clock


def test_a_reading_is_stamped_with_both_clocks_between_two_looks_at_them():
    utc_ns, mono_ns = time.time_ns(), time.monotonic_ns()
    reading = read_clock()
    assert mono_ns <= reading.mono_ns <= time.monotonic_ns()
    assert abs(reading.utc_ns - utc_ns) < 5_000_000_000


@pytest.mark.skipif(sys.platform != "linux", reason="adjtimex is Linux's")
def test_the_kernel_says_what_disciplines_the_clock_and_how_wrong_it_may_be():
    reading = read_clock()
    assert 0 <= reading.error_bound_s <= 16.0  # NTP_PHASE_LIMIT
    assert abs(reading.offset_s) < 1
    assert reading.synchronised == (reading.source != "unsynchronised")
