"""The host's UTC clock in a session: its steps among the frames, and its word on a sensor's own clock.

UTC may repeat or leap, so instants alone do not tell frames before a step from frames after it. Rows of the frame table
come in the order of arrival, and do.
"""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkEvent
from gse.station.events import ClockStep, StationKind
from gse.station.frame_columns import Columns
from gse.values.instant import LAST_NS, NS_PER_DAY, NS_PER_S
from gse.values.sensor_time import epoch_ns, tag_us_of, utc_ns_of
from protocols.description import TimeDescription

WRONG_CLOCK_NS = 10 * NS_PER_S
"""A clock that was put right by more than this stamped nothing that can be judged."""

_LEAP_TOLERANCE_NS = NS_PER_S // 10
_LEAP_WITHIN_NS = 3 * NS_PER_S


@dataclass(frozen=True, slots=True)
class ClockStretch:
    """Rows of the frame table from ``first`` until before ``until`` that one clock stamped.

    ``offset_ns`` is how far it was ahead of the clock at the end of the session, which was set last; steps in which no
    clock was wrong do not count.
    """

    first: int
    until: int
    offset_ns: int

    @property
    def is_wrong(self) -> bool:
        """Whether nothing of it can be judged."""
        return abs(self.offset_ns) > WRONG_CLOCK_NS


def clock_steps(events: Iterable[LinkEvent]) -> list[ClockStep]:
    """The steps among the events, in their order."""
    return [event for event in events if isinstance(event, ClockStep)]


def clock_stretches(host_utc_ns: NDArray[np.int64], steps: Sequence[ClockStep]) -> list[ClockStretch]:
    """The stretches of frames with host stamps (M,) in order of arrival, one more than there are steps."""
    edges = [0, *first_rows(host_utc_ns, steps), len(host_utc_ns)]
    wrong_ns = [wrong_by_ns(step) for step in steps]
    offsets = [-sum(wrong_ns[place:]) for place in range(len(steps) + 1)]
    return [ClockStretch(a, b, offset) for (a, b), offset in zip(pairwise(edges), offsets, strict=True)]


def instants_ns(frames: Columns, events: Iterable[LinkEvent]) -> NDArray[np.int64]:
    """UTC (M,) of frames (rows of FRAME) that no wrong clock stamped; of all where there are no others."""
    stretches = clock_stretches(frames["host_utc_ns"], clock_steps(events))
    right = [frames["utc_ns"][stretch.first : stretch.until] for stretch in stretches if not stretch.is_wrong]
    found = np.concatenate(right)
    return found if len(found) else np.asarray(frames["utc_ns"])


def first_rows(host_utc_ns: NDArray[np.int64], steps: Sequence[ClockStep]) -> list[int]:
    """The first row after each step; the number of rows where none follows."""
    rows, begin = [], 0
    for step in steps:
        begin += _first_row(host_utc_ns[begin:], step)
        rows.append(begin)
    return rows


def _first_row(host_utc_ns: NDArray[np.int64], step: ClockStep) -> int:
    """The old clock had not come to the step before this row, and the new one has; of such rows the largest fall."""
    old_ns = min(max(step.utc_ns, step.utc_ns - step.step_ns), LAST_NS + 1)
    latest_ns = np.maximum.accumulate(host_utc_ns)
    before = np.ones(len(host_utc_ns), dtype=np.bool_)
    before[1:] = latest_ns[:-1] < old_ns
    rows = np.flatnonzero(before & (host_utc_ns >= step.utc_ns))
    if len(rows) == 0:
        return len(host_utc_ns)
    gaps_ns = np.diff(host_utc_ns, prepend=host_utc_ns[:1])
    return int(rows[np.argmin(gaps_ns[rows])])


def wrong_by_ns(step: ClockStep) -> int:
    """By how much the step put a clock right or wrong: nothing where the host was suspended, or in a leap second."""
    return 0 if step.utc_kept or _is_leap_second(step) else step.step_ns


def _is_leap_second(step: ClockStep) -> bool:
    """A second to or fro at midnight after the last day of June or December, as the IERS sets them."""
    if abs(abs(step.step_ns) - NS_PER_S) > _LEAP_TOLERANCE_NS:
        return False
    midnight = (step.utc_ns + NS_PER_DAY // 2) // NS_PER_DAY
    if abs(step.utc_ns - midnight * NS_PER_DAY) > _LEAP_WITHIN_NS:
        return False
    date = str(np.datetime64(midnight, "D"))
    return date[5:] in ("01-01", "07-01")


LEAST_OFF_S = 0.75
"""A bridge of TCP or Bluetooth delays bytes by up to 0.7 s."""
_WITNESSES = 20
"""Frames whose least difference is judged."""


class ClockWitness:
    """Compares the tags of an absolute clock with the host's, once, after some frames."""

    def __init__(self, time: TimeDescription) -> None:
        self._time = time
        self._least_ns: int | None = None
        self._frames = 0

    def saw(self, host_minus_sensor_ns: int, utc_ns: int, mono_ns: int) -> list[LinkEvent]:
        """The host saw a frame so much later than its tag says that it left; the event, where that makes no sense."""
        self._frames += 1
        least = self._least_ns
        self._least_ns = host_minus_sensor_ns if least is None else min(least, host_minus_sensor_ns)
        if self._frames != _WITNESSES:
            return []
        off_s = self._least_ns / NS_PER_S
        if abs(off_s) < LEAST_OFF_S:
            return []
        looks = looks_like(off_s, self._time, utc_ns)
        text = f"the sensor's clock ({self._time.scale}) is {-off_s:+.3f} s from the host's: {looks}"
        return [LinkEvent(utc_ns, mono_ns, StationKind.SENSOR_CLOCK, text)]


_EPOCHS = (None, date(1958, 1, 1), date(1970, 1, 1), date(1980, 1, 6), date(2000, 1, 1))


def _epoch(time: TimeDescription) -> datetime:
    return datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=epoch_ns(time) // 1000)


def looks_like(off_s: float, time: TimeDescription, utc_ns: int) -> str:
    """What the difference host minus sensor looks like, and what to write; ``utc_ns`` is the host's time."""
    for scale, epoch in itertools.product(("utc", "gps", "tai"), _EPOCHS):
        other = TimeDescription(scale=scale, epoch=epoch or _epoch(time))
        tagged_ns = utc_ns_of(tag_us_of(utc_ns, other), time)
        if tagged_ns != utc_ns and abs(off_s - (utc_ns - tagged_ns) / NS_PER_S) < LEAST_OFF_S:
            words = [f"scale: {scale}"] * (scale != time.scale) + [f"epoch: {epoch}"] * (epoch is not None)
            return f"its tags look like another scale or epoch; try `{', '.join(words)}`"
    if abs(abs(off_s) - 1) < 0.3:
        return "one leap second: its list of leap seconds, or the host's, is old"
    weeks = round(off_s / (1024 * 604_800))
    if weeks and abs(off_s - weeks * 1024 * 604_800) < 100:
        return f"{weeks:+d} times the 1024 weeks after which the week number of GPS rolls over"
    hours = round(off_s / 1800) / 2
    if hours and abs(hours) <= 14 and abs(off_s - hours * 3600) < 30:
        return f"{hours:g} hour{'' if abs(hours) == 1 else 's'}: a time zone, or daylight saving time"
    days = round(off_s / 86_400)
    if days and abs(off_s - days * 86_400) < 30:
        return f"{days:+d} days: the date of one of the two clocks is wrong"
    return "one of the two clocks is wrong, or scale and epoch of the tags are others"
