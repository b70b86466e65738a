"""Telling the operator: each kind of event once, then counted."""

from collections import Counter
from collections.abc import Callable

from drivers.chunk import LinkEvent, LinkKind
from gse import instant
from gse.station.results import FrameResult
from gse.station.session_data import SessionData

_ROUTINE = {LinkKind.OPENED, LinkKind.WAITING, LinkKind.SYNCING, LinkKind.STREAMING}
"""The ordinary course of things: told each time until the first repetition, never counted at the end."""

_EACH_TIME = {"RECORDER_REFUSED", "RECORDER_RECOVERED"}
"""Data are at stake, and the recorder tells few of them."""


class Announcer:
    """A sink of the station loop that says events in words: the first of each kind, and how many more came.

    A link that flaps all night gives two lines, not ten thousand.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._seen: Counter[str] = Counter()

    def on_result(self, result: FrameResult, session: SessionData) -> None:
        """Panoramas are not told."""

    def on_event(self, event: LinkEvent) -> None:
        """Say an event if it is the first of its kind."""
        self._seen[event.kind] += 1
        if self._seen[event.kind] == 1 or event.kind in _EACH_TIME:
            self._say(f"{instant.to_text(event.utc_ns, 1)} {event.kind}: {event.text}")

    def conclude(self) -> None:
        """Say how many more there were of each kind."""
        excluded = _ROUTINE | _EACH_TIME
        more = [f"{kind} {count - 1} x" for kind, count in self._seen.items() if count > 1 and kind not in excluded]
        if more:
            self._say(f"and again, not said each time: {', '.join(more)}")
