"""The latest events of a session, each kind as one line with its count."""

from dataclasses import dataclass, replace

from drivers.chunk import LinkEvent
from gse import instant

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
