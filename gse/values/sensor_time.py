"""What a sensor's time tag says: which moment of the exposure, in which scale.

An absolute tag (utc, unix, gps, tai) counts from its epoch in its own scale; UTC follows by the leap seconds. utc and
unix count no leap seconds, as the clocks of computers.
"""

import functools
import math
from bisect import bisect_right
from datetime import UTC, date, datetime, timedelta

import erfa

from gse.values.instant import NS_PER_S
from protocols import Protocol
from protocols.description import TimeDescription

_EPOCHS = {
    "utc": datetime(1970, 1, 1, tzinfo=UTC),
    "unix": datetime(1970, 1, 1, tzinfo=UTC),
    "gps": datetime(1980, 1, 6, tzinfo=UTC),
    "tai": datetime(1958, 1, 1, tzinfo=UTC),
}
_1970 = _EPOCHS["unix"]
_DAY_NS = 86_400 * NS_PER_S
GPS_MINUS_TAI_S = -19


def epoch_ns(time: TimeDescription) -> int:
    """The epoch of an absolute scale, in that scale, as nanoseconds since 1970."""
    stated = time.epoch
    if stated is None:
        at = _EPOCHS[time.scale]
    elif isinstance(stated, datetime):
        at = stated if stated.tzinfo else stated.replace(tzinfo=UTC)
    else:
        at = datetime(stated.year, stated.month, stated.day, tzinfo=UTC)
    return (at - _1970) // timedelta(microseconds=1) * 1000


def utc_ns_of(time_us: int, time: TimeDescription) -> int:
    """UTC of an absolute tag."""
    at_ns = epoch_ns(time) + time_us * 1000
    return at_ns - _ahead_of_utc_s(at_ns, time.scale) * NS_PER_S


def tag_us_of(utc_ns: int, time: TimeDescription) -> int:
    """The absolute tag of an instant: what a simulated sensor sends."""
    return (utc_ns + _ahead_of_utc_s(utc_ns, time.scale) * NS_PER_S - epoch_ns(time)) // 1000


def _ahead_of_utc_s(at_ns: int, scale: str) -> int:
    if scale in ("utc", "unix"):
        return 0
    return _tai_minus_utc_s(at_ns // _DAY_NS) + (GPS_MINUS_TAI_S if scale == "gps" else 0)


def _tai_minus_utc_s(day: int) -> int:
    """Of a day since 1970; before 1972 there were no leap seconds."""
    days, seconds = _leap_seconds()
    return seconds[max(bisect_right(days, day) - 1, 0)]


@functools.cache
def _leap_seconds() -> tuple[list[int], list[int]]:
    """The days on which TAI - UTC changed, and its value from then on: the list that ERFA brings."""
    table = erfa.leap_seconds.get()
    whole = [row for row in table.tolist() if row[0] >= 1972]
    days = [(date(row[0], row[1], 1) - date(1970, 1, 1)).days for row in whole]
    return days, [round(row[2]) for row in whole]


def to_middle_us(time: TimeDescription, exposure_s: float, delay_s: float) -> int:
    """What is added to a tag to have that of mid-exposure."""
    half_us = round(exposure_s * 500_000) if math.isfinite(exposure_s) else 0
    match time.tag_of:
        case "start":
            return half_us
        case "end":
            return -half_us
        case "sent":
            return -half_us - round(delay_s * 1e6)
        case _:
            return 0


def time_of(sensor_time: TimeDescription | None, protocol: Protocol) -> TimeDescription:
    """What a sensor's tags tell: as the station file says, else as the protocol does."""
    return sensor_time or protocol.time
