"""Event log of a session: stores the first events of each kind, counts all."""

from collections import Counter
from dataclasses import replace

from drivers.chunk import LinkEvent
from gse.instant import LAST_NS
from gse.recording.session_format import MOST_KINDS, OTHER

MOST_OF_A_KIND = 1000
MOST_EVENTS = 20_000


class EventLog:
    """Counts events by kind and decides which are stored."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()

    def bounded(self, event: LinkEvent) -> LinkEvent:
        """The event with a valid instant, and of kind OTHER where there are too many different kinds."""
        is_known = event.kind in self._counts or len(self._counts) < MOST_KINDS
        if is_known and 0 <= event.utc_ns <= LAST_NS:
            return event
        return replace(event, kind=event.kind if is_known else OTHER, utc_ns=min(max(event.utc_ns, 0), LAST_NS))

    def accepts(self, event: LinkEvent) -> bool:
        """Count the event; whether it is to be stored."""
        self._counts[event.kind] += 1
        return self._counts[event.kind] <= MOST_OF_A_KIND and self._counts.total() <= MOST_EVENTS
