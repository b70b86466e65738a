"""The health of the host clock."""

import gc
import sys
import threading
import time

import pytest

from drivers.clock import ClockReading, _reading, _Timex, now, read_clock


def test_a_reading_is_stamped_with_both_clocks_between_two_looks_at_them():
    utc_ns, mono_ns = time.time_ns(), time.monotonic_ns()
    reading = read_clock()
    assert mono_ns <= reading.mono_ns <= time.monotonic_ns()
    assert abs(reading.utc_ns - utc_ns) < 5_000_000_000


def test_both_clocks_show_one_instant_however_busy_the_computer_is():
    stop, interval_s = threading.Event(), sys.getswitchinterval()

    def compute():
        while not stop.is_set():
            pass

    others = [threading.Thread(target=compute) for _ in range(2)]
    sys.setswitchinterval(1e-4)
    try:
        for other in others:
            other.start()
        differences_ns = [utc_ns - mono_ns for utc_ns, mono_ns in (now() for _ in range(200_000))]
    finally:
        stop.set()
        sys.setswitchinterval(interval_s)
        for other in others:
            other.join()
    assert max(differences_ns) - min(differences_ns) < 1_000_000


@pytest.mark.skipif(sys.platform != "linux", reason="adjtimex is Linux's")
def test_the_kernel_says_what_disciplines_the_clock_and_how_wrong_it_may_be():
    reading = read_clock()
    assert 0 <= reading.error_bound_s <= 16.0  # NTP_PHASE_LIMIT
    assert abs(reading.offset_s) < 1
    assert reading.synchronised == (reading.source != "unsynchronised")


def test_a_reading_leaves_nothing_that_only_the_garbage_collector_frees():
    read_clock()
    gc.collect()
    gc.disable()
    try:
        for _ in range(100):
            read_clock()
        assert gc.collect() < 100
    finally:
        gc.enable()


@pytest.mark.parametrize(
    ("state", "status", "source", "synchronised", "offset_s"),
    [
        (0, 0x2001, "kernel PLL", True, -0.0015),
        (0, 0x0001, "kernel PLL", True, -1.5),  # before STA_NANO the kernel counted in microseconds
        (0, 0x2008, "kernel FLL", True, -0.0015),
        (0, 0x2003, "kernel PPS", True, -0.0015),
        (0, 0x2000, "time daemon (frequency)", True, -0.0015),
        (0, 0x2041, "unsynchronised", False, -0.0015),
        (5, 0x2001, "unsynchronised", False, -0.0015),
    ],
)
def test_the_kernels_answer_is_read_in_its_units(state, status, source, synchronised, offset_s):
    timex = _Timex(offset=-1_500_000, maxerror=20_000, status=status)
    assert _reading(7, 9, state, timex) == ClockReading(7, 9, source, synchronised, offset_s, 0.02)
