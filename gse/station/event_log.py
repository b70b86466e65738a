"""Which events of a session are kept: all of an ordinary one, the first of a flood, each counted."""

from collections import Counter
from dataclasses import replace

from drivers.chunk import LinkEvent
from gse.instant import LAST_NS
from gse.recording.session_format import MOST_KINDS, OTHER

MOST_OF_A_KIND = 1000
MOST_EVENTS = 20_000


class EventLog:
    """Counts events by kind, and says which are kept."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()

    def bounded(self, event: LinkEvent) -> LinkEvent:
        """The event at an instant that can be; of kind OTHER where there are too many kinds to tell apart."""
        is_known = event.kind in self._counts or len(self._counts) < MOST_KINDS
        if is_known and 0 <= event.utc_ns <= LAST_NS:
            return event
        return replace(event, kind=event.kind if is_known else OTHER, utc_ns=min(max(event.utc_ns, 0), LAST_NS))

    def accepts(self, event: LinkEvent) -> bool:
        """Whether this event, which is counted hereby, is among those that are kept."""
        self._counts[event.kind] += 1
        return self._counts[event.kind] <= MOST_OF_A_KIND and self._counts.total() <= MOST_EVENTS
