"""Stretches of a session that its statistics leave out, each with its cause.

The sky, the link and the clock may be a cause, the answers never: a false star identification counts whatever the time
of its frame.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum

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

_AT_ONCE = 0.5
"""Frames out of a buffer follow each other within this share of the usual time between frames."""

_EXAMPLE = "expected for example 2026-03-20T18:30:00Z/2026-03-20T18:31:00Z=clouds"


class Cause(StrEnum):
    """Why a stretch is left out."""

    CLOCK_STEP = "clock step"
    BACKLOG = "backlog"
    NO_SKY = "no sky"
    NO_OBJECTS = "no objects"
    OPERATOR = "operator"


@dataclass(frozen=True, slots=True)
class Exclusion:
    """From one instant until before another, UTC in nanoseconds; the cause, and the reason in words.

    ``time_error_s`` is how far the times of these frames may be off, which explains as much of their error.
    """

    from_ns: int
    until_ns: int
    reason: str
    cause: Cause
    time_error_s: float = 0.0


def exclusions(events: Iterable[LinkEvent], frames: NDArray[np.void]) -> tuple[Exclusion, ...]:
    """Frames around each step of the clock, as either clock stamps them, and frames that waited in a buffer.

    ``frames`` are rows of FRAME.
    """
    steps = [event for event in events if isinstance(event, ClockStep)]
    return (*(_around_step(event) for event in steps), *_late_starts(frames, {event.utc_ns for event in steps}))


def _late_starts(frames: NDArray[np.void], steps_ns: set[int]) -> Iterator[Exclusion]:
    """Frames that had waited in a buffer when the port was opened: their bytes were read long after they came.

    Until a frame comes that is read at once, nothing shows how late they are; then the offset of the sensor's clock,
    which is the least seen so far, falls. A sensor clock that leaps or runs fast makes the same fall. Only frames out
    of a buffer are read faster than they are taken: the host's own stamps show it.
    """
    time_ns = frames["time_us"].astype(np.int64) * 1000
    at_once = _read_at_once(frames["host_utc_ns"])
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
        late = (fall_ns > _LATE_NS) & at_once[first[:settled]]
        if late.any():
            reason = (
                f"read up to {fall_ns[late].max() / NS_PER_S:.2f} s late: these frames waited in a buffer before the "
                "port was read"
            )
            waited_ns = utc_ns[:settled][late]
            late_s = float(fall_ns[late].max()) / NS_PER_S
            yield Exclusion(int(waited_ns.min()), int(waited_ns.max()) + 1, reason, Cause.BACKLOG, late_s)


def _read_at_once(host_utc_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which frames (M,) were read together with a neighbour, far faster than frames usually come."""
    at_once = np.zeros(len(host_utc_ns), dtype=bool)
    gaps_ns = np.diff(host_utc_ns)
    if len(gaps_ns):
        together = gaps_ns < _AT_ONCE * np.median(gaps_ns)
        at_once[:-1] |= together
        at_once[1:] |= together
    return at_once


def _around_step(event: ClockStep) -> Exclusion:
    from_ns = event.utc_ns - max(event.step_ns, 0) - AROUND_STEP_NS
    until_ns = event.utc_ns + max(-event.step_ns, 0) + AROUND_STEP_NS
    return Exclusion(from_ns, until_ns, event.text, Cause.CLOCK_STEP, abs(event.step_ns) / NS_PER_S)


def parse_exclusion(text: str) -> Exclusion:
    """The stretch that an operator writes: FROM/TO or FROM/TO=why, with UTC instants; UsageError shows an example."""
    stretch, _, reason = text.partition("=")
    begin, _, end = stretch.partition("/")
    reason = reason.strip() or "left out by the operator"
    try:
        stated = Exclusion(from_text(begin), from_text(end), reason, Cause.OPERATOR)
    except ValueError:
        raise UsageError(f"{text!r} is no stretch to leave out; {_EXAMPLE}") from None
    if stated.until_ns <= stated.from_ns:
        raise UsageError(f"{text!r} ends before it begins; {_EXAMPLE}")
    return stated


def excluded(utc_ns: NDArray[np.int64], stretches: Iterable[Exclusion]) -> NDArray[np.bool_]:
    """Which instants (M,) lie in any of the stretches."""
    mask = np.zeros(len(utc_ns), dtype=bool)
    for item in stretches:
        mask |= (utc_ns >= item.from_ns) & (utc_ns < item.until_ns)
    return mask
