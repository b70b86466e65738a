"""Messages to the operator: the first event of each kind, then a count."""

from collections import Counter
from collections.abc import Callable

from drivers.chunk import LinkEvent, LinkKind
from gse import instant
from gse.station.event_kinds import StationKind
from gse.station.frame_results import FrameResults
from gse.station.session_data import SessionData

_ROUTINE = {LinkKind.OPENED, LinkKind.WAITING, LinkKind.SYNCING, LinkKind.STREAMING}
"""Routine events: announced once, left out of the repeat counts."""

_EACH_TIME = {"RECORDER_REFUSED", "RECORDER_RECOVERED", StationKind.FINDING, StationKind.NOTE}
"""Announced each time, because data may be lost, or because each is another; their makers limit their number."""


class Announcer:
    """A listener of the station loop that prints the first event of each kind, and the number of further ones at the
    end.

    A link that fails ten thousand times gives two lines.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._seen: Counter[str] = Counter()
        self._said = ""

    def on_results(self, results: FrameResults, session: SessionData) -> None:
        """Panoramas are not announced."""

    def on_event(self, event: LinkEvent) -> None:
        """Print an event if it is the first of its kind, and says more than the one before (LOST, then NO_PORT)."""
        self._seen[event.kind] += 1
        is_new, self._said = event.text != self._said, event.text
        if is_new and (self._seen[event.kind] == 1 or event.kind in _EACH_TIME):
            when = instant.to_text(event.utc_ns, 1) if event.utc_ns else "before the first byte"
            self._say(f"{when} {event.kind}: {event.text}")

    def conclude(self) -> None:
        """Print the number of further events of each kind."""
        excluded = _ROUTINE | _EACH_TIME
        more = [f"{kind} {count - 1} x" for kind, count in self._seen.items() if count > 1 and kind not in excluded]
        if more:
            self._say(f"repeated events: {', '.join(more)}")
