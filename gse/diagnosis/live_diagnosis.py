"""Live diagnosis: findings of a running session, announced when they first show."""

from collections.abc import Callable
from dataclasses import dataclass, field

from drivers.chunk import LinkEvent
from gse.instant import NS_PER_S
from gse.station.event_kinds import FindingEvent, StationKind
from gse.station.frame_results import FrameResults
from gse.station.session_data import SessionData

FIRST_AFTER_S = 10.0
"""Of the data's time, after the first panorama; then after 20 s, and whenever a third more has passed, 20 s at least: a
look costs half a second of the loop's thread."""
_SHARE, _LEAST_S = 3, 20.0


@dataclass(slots=True)
class LiveDiagnosis:
    """A listener that looks for causes now and then; ``announce`` gets an event for each that is new.

    The findings of the report come from the whole session: one that was announced may be gone at the end.
    """

    announce: Callable[[LinkEvent], None]
    _begun_ns: int | None = None
    _due_ns: int = 0
    _known: set[str] = field(default_factory=set)

    def on_results(self, results: FrameResults, session: SessionData) -> None:
        """Look, where it is time."""
        for utc_ns in results.rows["utc_ns"].tolist():
            self._look(utc_ns, session)

    def _look(self, utc_ns: int, session: SessionData) -> None:
        if self._begun_ns is None:
            self._begun_ns, self._due_ns = utc_ns, utc_ns + round(FIRST_AFTER_S * NS_PER_S)
        if utc_ns < self._due_ns:
            return
        elapsed_ns = utc_ns - self._begun_ns
        self._due_ns = utc_ns + min(elapsed_ns, max(elapsed_ns // _SHARE, round(_LEAST_S * NS_PER_S)))
        from gse.diagnosis.diagnosis import causes_so_far  # the first frames are shown before it is imported

        for finding in causes_so_far(session):
            if finding.cause not in self._known:
                self._known.add(finding.cause)
                self.announce(FindingEvent(utc_ns, 0, StationKind.FINDING, str(finding), finding))

    def on_event(self, event: LinkEvent) -> None:
        """Events are not frames."""
