"""The latest of a session that a display keeps: values by their number, events by their kind."""

from collections import deque
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

from drivers.chunk import LinkEvent
from gse.values import instant
from gse.values.instant import NS_PER_S

T = TypeVar("T")


class Recent(Generic[T]):
    """At most ``most`` values, none of them ``window_s`` seconds older than the last one."""

    def __init__(self, most: int, window_s: float) -> None:
        self._window_ns = window_s * NS_PER_S
        self._kept: deque[tuple[int, int, T]] = deque(maxlen=most)

    def add(self, number: int, utc_ns: int, value: T) -> None:
        """Keep a value of an instant; numbers grow."""
        self._kept.append((number, utc_ns, value))
        while self._kept[0][1] < utc_ns - self._window_ns:
            self._kept.popleft()

    def after(self, number: int) -> list[T]:
        """The values with greater numbers, in order."""
        return [value for kept, _, value in self._kept if kept > number]


@dataclass(frozen=True, slots=True)
class NextPiece:
    """What a viewer does not have yet: a recording (.rrd), the place to go on from, and its last instant (UTC, ns).

    A new ``layout`` is a recording of its own, for before it.
    """

    rrd: bytes = b""
    place: str = ""
    utc_ns: int = 0
    layout: bytes = b""


# The latest events of a session, each kind as one line with its count.

MOST_LINES = 50
"""Kinds come from outside, too; the line that changed least recently goes."""


@dataclass(frozen=True, slots=True)
class EventLine:
    """The latest event of a kind, and how many there were."""

    utc_ns: int
    kind: str
    text: str
    count: int

    def __str__(self) -> str:
        times = f" ({self.count} x)" if self.count > 1 else ""
        return f"{instant.to_text(self.utc_ns, 0)[11:19]} {self.kind}{times}: {self.text}"


class EventLines:
    """Counts events by kind; the kinds in ``single`` have a line for each event."""

    def __init__(self, single: frozenset[str] = frozenset()) -> None:
        self._single = single
        self._lines: dict[tuple[str, int], EventLine] = {}
        self._numbers = 0

    def add(self, event: LinkEvent) -> EventLine:
        """Count an event; its line as it is now."""
        self._numbers += 1
        key = (event.kind, self._numbers if event.kind in self._single else 0)
        line = EventLine(event.utc_ns, event.kind, event.text, 1)
        before = self._lines.pop(key, None)
        if before is not None:
            line = replace(line, count=before.count + 1)
        self._lines[key] = line
        if len(self._lines) > MOST_LINES:
            del self._lines[next(iter(self._lines))]
        return line

    def latest(self, count: int) -> list[EventLine]:
        """The lines that changed last, newest first."""
        return list(reversed(self._lines.values()))[:count]
