"""The host clock: the time of an instant, with the kernel's word on how good it is."""

import ctypes
import functools
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

_SAME_INSTANT_NS = 100_000
"""Two clocks read within this time show the same instant."""
_MOST_READINGS = 10


@dataclass(frozen=True, slots=True)
class ClockReading:
    """State of the host clock at an instant, from the kernel.

    ``source`` is its time source (``kernel PLL``, ``simulated``, ``unsynchronised``, ...); ``offset_s`` is the kernel's
    current estimate, ``error_bound_s`` its bound on the error.
    """

    utc_ns: int
    mono_ns: int
    source: str
    synchronised: bool
    offset_s: float
    error_bound_s: float


class _Timeval(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("fraction", ctypes.c_long))


class _Timex(ctypes.Structure):
    """struct timex of <sys/timex.h>, Linux: adjtimex(2)."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        ("offset", ctypes.c_long),  # us, or ns with STA_NANO
        ("freq", ctypes.c_long),
        ("maxerror", ctypes.c_long),  # us
        ("esterror", ctypes.c_long),  # us
        ("status", ctypes.c_int),
        ("constant", ctypes.c_long),
        ("precision", ctypes.c_long),
        ("tolerance", ctypes.c_long),
        ("time", _Timeval),
        ("tick", ctypes.c_long),
        ("ppsfreq", ctypes.c_long),
        ("jitter", ctypes.c_long),
        ("shift", ctypes.c_int),
        ("stabil", ctypes.c_long),
        ("jitcnt", ctypes.c_long),
        ("calcnt", ctypes.c_long),
        ("errcnt", ctypes.c_long),
        ("stbcnt", ctypes.c_long),
        ("tai", ctypes.c_int),
        ("reserved", ctypes.c_int * 11),
    )


_STA_PLL, _STA_PPSFREQ, _STA_PPSTIME, _STA_FLL, _STA_UNSYNC, _STA_NANO = 0x1, 0x2, 0x4, 0x8, 0x40, 0x2000
_TIME_ERROR = 5
_UNKNOWN_S = 16.0
"""The kernel's own bound without synchronisation (NTP_PHASE_LIMIT)."""


def now() -> tuple[int, int]:
    """UTC and monotonic nanoseconds of one instant.

    A busy computer may not run this thread for 100 ms between the two clocks, which would look like a step of UTC: they
    are read again then.
    """
    return min(_readings(), key=lambda reading: reading[0])[1:]


def _readings() -> Iterator[tuple[int, int, int]]:
    """Both clocks and the time that reading them took, until it was short."""
    for _ in range(_MOST_READINGS):
        before_ns = time.monotonic_ns()
        utc_ns = time.time_ns()
        after_ns = time.monotonic_ns()
        yield after_ns - before_ns, utc_ns, (before_ns + after_ns) // 2
        if after_ns - before_ns <= _SAME_INSTANT_NS:
            return


def read_clock() -> ClockReading:
    """Ask the kernel, by adjtimex with modes = 0: that needs no privilege and changes nothing.

    The error bound is the kernel's ``maxerror``, which grows by 500 ppm from one update by the daemon (chrony, ntpd,
    systemd-timesyncd) to the next. Where the system has no adjtimex, the clock counts as not synchronised.
    """
    utc_ns, mono_ns = now()
    answer = _adjtimex()
    if answer is None:
        return ClockReading(utc_ns, mono_ns, f"unknown ({sys.platform} has no adjtimex)", False, 0.0, _UNKNOWN_S)
    return _reading(utc_ns, mono_ns, *answer)


def _reading(utc_ns: int, mono_ns: int, state: int, timex: _Timex) -> ClockReading:
    """What the kernel's answer says of an instant."""
    synchronised = state != _TIME_ERROR and not timex.status & _STA_UNSYNC
    per_s = 1e9 if timex.status & _STA_NANO else 1e6
    return ClockReading(
        utc_ns, mono_ns, _source(timex.status, synchronised), synchronised, timex.offset / per_s, timex.maxerror / 1e6
    )


def _adjtimex() -> tuple[int, _Timex] | None:
    if (call := _adjtimex_call()) is None:
        return None
    timex = _Timex()
    state = int(call(ctypes.byref(timex)))
    return None if state < 0 else (state, timex)


@functools.cache
def _adjtimex_call() -> Callable[..., int] | None:
    """The system's adjtimex, looked up once: each look is a class of its own that only the garbage collector frees."""
    try:
        return ctypes.CDLL(None, use_errno=True).adjtimex
    except (AttributeError, OSError, TypeError):
        return None


def _source(status: int, synchronised: bool) -> str:
    if not synchronised:
        return "unsynchronised"
    if status & (_STA_PPSFREQ | _STA_PPSTIME):
        return "kernel PPS"
    if status & _STA_FLL:
        return "kernel FLL"
    # chrony steers by frequency alone and leaves STA_PLL off
    return "kernel PLL" if status & _STA_PLL else "time daemon (frequency)"
