"""Events that results bring: of the sky, of a camera that is not as stated, of an external identifier."""

from collections.abc import Iterator
from dataclasses import dataclass
from operator import itemgetter

from drivers.chunk import LinkEvent
from gse.external.answers import Failure, FailureKind
from gse.identifier import Reason
from gse.station.camera_watch import CameraWatch
from gse.station.event_kinds import StationKind
from gse.station.frame_results import FrameResults
from gse.station.session_data import SessionData
from gse.station.sky_watch import SkyWatch


@dataclass(frozen=True, slots=True)
class ResultEvents:
    """Finds the events of results, in their order, with what the session showed before."""

    sky: SkyWatch
    camera: CameraWatch

    def of(self, results: FrameResults, session: SessionData, first: int) -> list[tuple[int, LinkEvent]]:
        """The events of results whose first is row ``first`` of the session, each with the result that it precedes."""
        events: list[tuple[int, LinkEvent]] = []
        if session.station.mount.inertial is None:  # before a star simulator there is no sky
            taken = self.sky.take(session.frames.columns, first)
            events += [(row - first, event) for row, found in taken for event in found]
        events += _external(results, session)
        for k, answer in results.answers.unidentified.items():
            if answer.reason is Reason.MIRRORED:
                events.append((k, _event(results, k, StationKind.MIRRORED, answer.detail)))
        events += [(k, _event(results, k, *said)) for k, said in self.camera.look(results)]
        return sorted(events, key=itemgetter(0))

    def finish(self, session: SessionData) -> list[LinkEvent]:
        """The events that the end of a session brings."""
        frames = session.frames.columns
        events: list[LinkEvent] = []
        if said := self.camera.finish():
            events.append(LinkEvent(int(frames["utc_ns"][-1]), 0, *said))
        if session.station.mount.inertial is None:
            events += self.sky.finish(frames)
        return events


def _external(results: FrameResults, session: SessionData) -> Iterator[tuple[int, LinkEvent]]:
    """What an external identifier did is counted; its failures are events."""
    for k, given in results.given.items():
        session.external_counts.count(given)
        if isinstance(given.answer, Failure):
            kind, text = _failure_words(given.answer, int(results.panoramas.frame_no[k]))
            if kind is StationKind.IDENTIFIER_FAULT or session.external_counts.failures[FailureKind.GIVEN_UP] == 1:
                yield k, _event(results, k, kind, text)


def _failure_words(failure: Failure, frame_no: int) -> tuple[StationKind, str]:
    """Kind and text of an event; a kind of its own where no more answers come, so that it is announced too."""
    if failure.kind is FailureKind.GIVEN_UP:
        return StationKind.IDENTIFIER_GIVEN_UP, f"no answer from frame {frame_no} on: {failure.detail}"
    return StationKind.IDENTIFIER_FAULT, f"{failure.kind} at frame {frame_no}: {failure.detail}"


def _event(results: FrameResults, k: int, kind: str, text: str) -> LinkEvent:
    return LinkEvent(int(results.panoramas.utc_ns[k]), 0, kind, text)
