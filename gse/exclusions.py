"""Stretches of a session that are left out of the figures, each by name."""

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkEvent
from gse.errors import UsageError
from gse.instant import NS_PER_S, from_text

AROUND_STEP_NS = 5 * NS_PER_S
"""On either side of a step of the host clock."""
_STEP = re.compile(r"[+-]\d+(\.\d+)?(?= s\b)")

_EXAMPLE = "expected for example 2026-03-20T18:30:00Z/2026-03-20T18:31:00Z=clouds"


@dataclass(frozen=True, slots=True)
class Exclusion:
    """From one instant until before another, UTC in nanoseconds, and why."""

    from_ns: int
    until_ns: int
    reason: str


def exclusions(events: Iterable[LinkEvent]) -> tuple[Exclusion, ...]:
    """What events say must be left out: frames around each step of the clock, as either clock stamps them."""
    return tuple(_around_step(event) for event in events if event.kind == "CLOCK_STEP")


def _around_step(event: LinkEvent) -> Exclusion:
    found = _STEP.search(event.text)
    step_ns = round(float(found[0]) * NS_PER_S) if found else 0
    before, after = max(step_ns, 0), max(-step_ns, 0)
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


def left_out(utc_ns: NDArray[np.int64], named: Iterable[Exclusion]) -> NDArray[np.bool_]:
    """Which instants (M,) lie in any of the stretches."""
    out = np.zeros(len(utc_ns), dtype=bool)
    for item in named:
        out |= (utc_ns >= item.from_ns) & (utc_ns < item.until_ns)
    return out
