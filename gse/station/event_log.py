"""Which events of a session are kept: all of an ordinary one, the first of a flood, each counted."""

from collections import Counter
from dataclasses import replace

from drivers.chunk import LinkEvent
from gse.recording.session_format import MOST_KINDS, OTHER

MOST_OF_A_KIND = 1000
MOST_EVENTS = 20_000


class EventLog:
    """Counts events by kind, and says which are kept."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()

    def named(self, event: LinkEvent) -> LinkEvent:
        """The event, or one of kind OTHER where there are too many kinds to tell apart."""
        is_known = event.kind in self._counts or len(self._counts) < MOST_KINDS
        return event if is_known else replace(event, kind=OTHER)

    def keeps(self, event: LinkEvent) -> bool:
        """Whether this event, which is counted hereby, is among those that are kept."""
        self._counts[event.kind] += 1
        return self._counts[event.kind] <= MOST_OF_A_KIND and self._counts.total() <= MOST_EVENTS
