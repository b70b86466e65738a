"""Stretches of a session that are left out of the figures, each by name."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkEvent
from gse.errors import UsageError
from gse.instant import NS_PER_S, from_text
from gse.station.event_kinds import ClockStep

AROUND_STEP_NS = 5 * NS_PER_S
"""On either side of a step of the host clock."""
_SETTLES_WITHIN_NS = 30 * NS_PER_S
_LATE_NS = 20_000_000
"""A third of an arcsecond of the sky, and the latency that a USB adapter may have."""

_LATE_RATE = 0.1
"""Of the time that passed: what waited is read in no time at all, and no clock drifts like that."""

_EXAMPLE = "expected for example 2026-03-20T18:30:00Z/2026-03-20T18:31:00Z=clouds"


@dataclass(frozen=True, slots=True)
class Exclusion:
    """From one instant until before another, UTC in nanoseconds, and why."""

    from_ns: int
    until_ns: int
    reason: str


def exclusions(events: Iterable[LinkEvent], frames: NDArray[np.void]) -> tuple[Exclusion, ...]:
    """What must be left out: frames around each step of the clock, as either clock stamps them, and late starts.

    ``frames`` are rows of FRAME.
    """
    steps = [event for event in events if isinstance(event, ClockStep)]
    return (*(_around_step(event) for event in steps), *_late_starts(frames, {event.utc_ns for event in steps}))


def _late_starts(frames: NDArray[np.void], steps_ns: set[int]) -> Iterator[Exclusion]:
    """Frames that had waited in a buffer when the port was opened: their bytes were read long after they came.

    Until a frame comes that is read at once, nothing tells how late they are; then the offset of the sensor's clock,
    which is the least seen so far, falls.
    """
    time_ns = frames["time_us"].astype(np.int64) * 1000
    begins = np.flatnonzero((np.diff(time_ns) < 0) | (np.diff(time_ns) > _SETTLES_WITHIN_NS)) + 1
    for part in np.split(np.arange(len(frames)), begins):
        first = part[time_ns[part] - time_ns[part[0]] <= _SETTLES_WITHIN_NS] if len(part) else part
        stepped = np.flatnonzero(np.isin(frames["host_utc_ns"][first], list(steps_ns)))
        first = first[: stepped[0]] if len(stepped) else first
        if len(first) == 0:
            continue
        utc_ns = frames["utc_ns"][first]
        offset_ns = utc_ns - time_ns[first]
        settled = int(np.argmax(offset_ns - offset_ns.min() <= _LATE_NS))
        fall_ns = offset_ns[:settled] - offset_ns[settled]
        late = fall_ns > _LATE_RATE * (time_ns[first[settled]] - time_ns[first[:settled]])
        if late.any():
            reason = (
                f"read up to {fall_ns[late].max() / NS_PER_S:.2f} s late: these frames waited in a buffer before the "
                "port was read"
            )
            waited_ns = utc_ns[:settled][late]
            yield Exclusion(int(waited_ns.min()), int(waited_ns.max()) + 1, reason)


def _around_step(event: ClockStep) -> Exclusion:
    before, after = max(event.step_ns, 0), max(-event.step_ns, 0)
    return Exclusion(event.utc_ns - before - AROUND_STEP_NS, event.utc_ns + after + AROUND_STEP_NS, event.text)


def parse_exclusion(text: str) -> Exclusion:
    """The stretch that an operator writes: FROM/TO or FROM/TO=why, with UTC instants; UsageError shows an example."""
    stretch, _, reason = text.partition("=")
    begin, _, end = stretch.partition("/")
    try:
        stated = Exclusion(from_text(begin), from_text(end), reason.strip() or "left out by the operator")
    except ValueError:
        raise UsageError(f"{text!r} is no stretch to leave out; {_EXAMPLE}") from None
    if stated.until_ns <= stated.from_ns:
        raise UsageError(f"{text!r} ends before it begins; {_EXAMPLE}")
    return stated


def excluded(utc_ns: NDArray[np.int64], named: Iterable[Exclusion]) -> NDArray[np.bool_]:
    """Which instants (M,) lie in any of the stretches."""
    out = np.zeros(len(utc_ns), dtype=bool)
    for item in named:
        out |= (utc_ns >= item.from_ns) & (utc_ns < item.until_ns)
    return out
