"""Instants: UTC as integer nanoseconds since 1970, and as text.

Leap seconds are not counted, as in POSIX time; inside a leap second the instant is that of the second before.
"""

import functools
import re
from datetime import UTC, datetime, timedelta

from gse.values.constants import J2000_NS

NS_PER_S = 1_000_000_000
NS_PER_DAY = 86_400 * NS_PER_S
UNIX_EPOCH_MJD = 40_587
UNIX_EPOCH_JD = 2_440_587.5
LAST_NS = 9_000_000_000 * NS_PER_S
"""Last instant that is accepted, in the year 2255; nanoseconds of 64 bits end in 2262."""
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_RFC_3339 = re.compile(r"(\d{4}-\d{2}-\d{2})[T ](\d{2}:\d{2}:\d{2})(?:\.(\d{1,9}))?Z")


def bounded(stamp_ns: int) -> int:
    """A stamp within what an instant can be."""
    if 0 <= stamp_ns <= LAST_NS:  # min and max take three times as long, and a frame has five stamps
        return stamp_ns
    return 0 if stamp_ns < 0 else LAST_NS


def to_text(utc_ns: int, digits: int = 6) -> str:
    """RFC 3339 with Z, cut (not rounded) to ``digits`` decimals of a second."""
    seconds, ns = divmod(utc_ns, NS_PER_S)
    whole = _second_text(seconds)
    return f"{whole}.{ns:09d}"[: 20 + digits] + "Z" if digits else whole + "Z"


@functools.lru_cache(maxsize=64)
def _second_text(seconds: int) -> str:
    """Kept for the panoramas of the same second: it is most of the time that a text takes."""
    return (_EPOCH + timedelta(seconds=seconds)).isoformat()[:19]


def from_text(text: str) -> int:
    """UTC nanoseconds of an RFC 3339 text that ends in Z, from 1970 to LAST_NS; ValueError says what was expected."""
    found = _RFC_3339.fullmatch(text.strip())
    try:
        if found is None:
            raise ValueError
        whole = datetime.fromisoformat(f"{found[1]}T{found[2]}+00:00")
    except ValueError:
        raise ValueError(f"{text!r} is not a UTC instant: expected for example 2026-03-20T18:30:00Z") from None
    utc_ns = int(whole.timestamp()) * NS_PER_S + int((found[3] or "").ljust(9, "0"))
    if not 0 <= utc_ns <= LAST_NS:
        raise ValueError(f"{text!r} is too far away: expected an instant from 1970 to {to_text(LAST_NS, 0)}")
    return utc_ns


def to_julian_date(utc_ns: int) -> tuple[float, float]:
    """The two-part UTC (quasi) Julian date that ERFA takes: midnight, and the fraction of the day."""
    days, ns = divmod(utc_ns, NS_PER_DAY)
    return UNIX_EPOCH_JD + days, ns / NS_PER_DAY


def to_julian_year(utc_ns: int) -> float:
    """The Julian year of an instant, to within the minute between UTC and TT: 2026.22."""
    return 2000.0 + (utc_ns - J2000_NS) / NS_PER_DAY / 365.25
