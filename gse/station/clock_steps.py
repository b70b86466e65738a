"""Steps of the host's UTC clock in the frames of a session: which clock stamped which frames.

UTC may repeat or leap, so instants alone do not tell frames before a step from frames after it. Rows of the frame table
come in the order of arrival, and do.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkEvent
from gse.station.events import ClockStep
from gse.station.frame_columns import Columns
from gse.values.instant import LAST_NS, NS_PER_DAY, NS_PER_S

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
