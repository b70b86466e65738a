"""The station: the one loop that serves live, replayed and simulated sessions.

Theory of operation
-------------------

``StationLoop`` turns chunks of a ``SerialLink`` into a ``SessionData``. It has no thread and no clock of its own: it
does what the chunks and events bring, in their order, on the thread of its caller. So a session gives the same results
whether it comes live, from a file or from the simulator, and at any speed.

One turn of the loop (``take``) has three stages:

1. *Receive.* ``Reception`` makes panoramas, events and other messages of the bytes. ``LinkMonitor`` makes events of the
   silence before a chunk and of what the chunk brings (WAITING, STREAMING, STALE ...). The order is that of the data:
   first the silence before an event, then the event, then its consequence. A replay, which never waits, and a live
   session, which does, therefore give their events in the same order. STATUS and ATTITUDE messages are kept with the
   host time of their bytes and go no further.
2. *Identify.* Panoramas that follow each other are identified together, as columns, at most MOST_AT_ONCE. The answers
   are those of one by one: each depends on its panorama, and the search for its stars on how many before had none
   (``ThinnedSearch``). A replay may give this stage to another thread (``ahead``), which takes the parts in their
   order, and works on what came while the loop concludes what came before, and receives more.
3. *Conclude.* Answers are corrected, compared with sidereal truth and kept, as columns too; what this stage remembers,
   the non-stellar objects seen before, it meets in their order. Then the listeners see the results. Events between two
   panoramas come out between their results. While the mount is not fitted yet, stages 2 and 3 take one at a time.

What is decided on the way:

* **Earth orientation** is looked up at the first panorama, because only then is the date known. A session that has it
  frozen uses its own, so that a later release of the tables changes nothing. Without it (an event NO_TRUTH) panoramas
  are identified, and compared with nothing.
* **The mount** comes from the station file. Under ``align: first N s`` there is no mount at first; results of these
  seconds have no attitude error. The seconds are those of a sky that shows its stars. The first panorama after them,
  once 10 frames were identified and the fit is good enough, fixes the mount for the rest of the session (an event
  ALIGNED). The mount is never judged by the frames that it was fitted on.
* **Identification time** is this host's own in a live session and the recorded one in a replay: it belongs to the run
  that was made, not to the machine that reads it.

At the end of a live session the port is closed first. Bytes that came until then are recorded, so they are identified
too. ``finish`` accounts for what is left in the decoder, and every byte has its place: in a frame or in a discard.

Listeners (``Listener``) get each result and each event on this thread. A listener that is slow delays the loop; the
live view has a queue and a thread of its own for that reason. Raw bytes do not pass here on their way to the file: the
link hands them to the recorder before the loop sees them.
"""

import math
import time
from array import array
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import Chunk, LinkEvent, LinkKind
from drivers.clock import ClockReading
from drivers.link import ITEMS_AT_ONCE, SerialLink
from drivers.link_state import LinkMonitor
from drivers.playback import cut
from drivers.ports import has_baud_rate
from gse.errors import TruthError
from gse.external.answers import Failure, FailureKind
from gse.identifier import Reason
from gse.identifier.robust import RobustIdentifier
from gse.recording.session_format import RecordedTimings
from gse.station.byte_stream import FrameAt, what_fits
from gse.station.camera_watch import CameraWatch
from gse.station.events import ClockStep, EventLog, StationKind
from gse.station.frame_processor import FrameProcessor, Identified
from gse.station.frame_results import FrameResult, FrameResults
from gse.station.housekeeping import Housekeeping, fill_housekeeping
from gse.station.mount_alignment import FirstSeconds
from gse.station.non_stellar import NonStellarObjects
from gse.station.own_answers import OwnAnswerProcessor
from gse.station.reception import News, Received, Reception
from gse.station.results import OwnAnswer, Subject
from gse.station.session_data import SessionData
from gse.station.setup import Setup, versions
from gse.station.shown_stars import LeftOutStars
from gse.station.sky_condition import SkyWatch
from gse.station.thinned_search import ThinnedSearch
from gse.truth import EarthOrientation, InertialTruth, SiderealTruth
from gse.truth.orientation import GivenTables
from gse.values.mount import InertialDirection, Mount
from gse.values.panorama import Panorama, Panoramas
from gse.values.screen import ShownSky
from gse.values.sensor_time import time_of
from gse.values.site import Site
from protocols import Frame, StarsMessage, StatusMessage
from protocols.description import TimeDescription

if TYPE_CHECKING:
    from concurrent.futures import Executor


# Events that results bring: of the sky, of a camera that is not as stated, of an external identifier.


@dataclass(frozen=True, slots=True)
class ResultEvents:
    """Finds the events of results, in their order, with what the session showed before."""

    sky: SkyWatch
    camera: CameraWatch

    def brought_by(self, results: FrameResults, session: SessionData, first: int) -> list[tuple[int, LinkEvent]]:
        """The events of results whose first is row ``first`` of the session, each with the result that it precedes."""
        events: list[tuple[int, LinkEvent]] = []
        if session.station.is_under_sky:
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
        if session.station.is_under_sky:
            events += self.sky.finish(frames)
        return events


def _external(results: FrameResults, session: SessionData) -> Iterator[tuple[int, LinkEvent]]:
    """What an external identifier did is counted; its failures are events."""
    for k, given in results.given.items():
        session.external_counts.count(given, int(results.answers.parts.counts[k]))
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


# Truth for the instants of a session: of the sky with the Earth's orientation, or of a star simulator.
#
# The Earth orientation is that of the session, which is frozen with it, or is read for the date of the first panorama.
# After a step of the clock beyond its reach it is sought again; for a date that is not known there is none.


class TruthSource:
    """Gives truth at the first panorama; ``given`` tables replace the installed ones, a ``frozen`` orientation both.

    Without a site there is none.
    """

    def __init__(
        self,
        site: Site | None,
        inertial: InertialDirection | None,
        frozen: EarthOrientation | None,
        given: GivenTables | None,
        shown: ShownSky | None = None,
    ) -> None:
        self._site, self._inertial, self._shown = site, inertial, shown
        self._is_frozen, self._given = frozen is not None, given
        self.orientation = frozen

    def at(self, utc_ns: int) -> tuple[SiderealTruth | InertialTruth | None, LinkEvent | None]:
        """Truth for an instant, None where there is none, and the event that says what it lacks, if anything."""
        if self._inertial is not None:
            return InertialTruth(self._inertial, self._shown), None
        if self._site is None:
            return None, LinkEvent(utc_ns, 0, StationKind.NO_TRUTH, "the station file says subject: sensor")
        try:
            self.orientation, warning = self._found(utc_ns)
        except TruthError as error:
            return None, LinkEvent(utc_ns, 0, StationKind.NO_TRUTH, str(error))
        event = LinkEvent(utc_ns, 0, StationKind.EARTH_ORIENTATION, warning) if warning else None
        return SiderealTruth(self._site, self.orientation), event

    def reaches(self, utc_ns: int) -> bool:
        """Whether the Earth orientation at hand is good for an instant."""
        try:
            return self.orientation is not None and not self.orientation.warning(utc_ns)
        except TruthError:
            return False

    def _found(self, utc_ns: int) -> tuple[EarthOrientation, str | None]:
        """The Earth orientation for an instant, and a warning where it does not reach it."""
        at_hand = self.orientation
        if at_hand is not None and (self._is_frozen or not at_hand.warning(utc_ns)):
            return at_hand, at_hand.warning(utc_ns)
        found = EarthOrientation.from_disk(utc_ns, given=self._given)
        warning = found.warning(utc_ns)
        return (at_hand if at_hand is not None and warning else found), warning


RECEIVE_TIMEOUT_S = 0.2
MOST_STATUSES = 50_000
"""One a second for 14 h; those that follow are decoded and dropped."""
WORK_S = 0.2
"""Time of work between two looks whether to stop: few frames where the computer is overloaded, hundreds where not."""
_FIRST_ITEMS = 8
_PIECE_BYTES = 1024
MOST_AT_ONCE = 1024
"""Panoramas that are processed before the first of them is shown, where so many wait."""
MOST_AHEAD = 2
"""Most parts that another thread may be ahead: one is identified while one is concluded and more come."""


class _Asked(NamedTuple):
    """Panoramas that follow each other, and what identifies them or waits for the thread that does."""

    panoramas: Panoramas
    identified: Callable[[], Identified]


class Listener(Protocol):
    """Receiver of each result and event of a session: a view, a stream of JSON, a calibration."""

    def on_results(self, results: FrameResults, session: SessionData) -> None:
        """Receive the results of panoramas that follow each other."""
        ...

    def on_event(self, event: LinkEvent) -> None:
        """Receive an event."""
        ...


def _in_pieces(items: Sequence[Chunk | LinkEvent], *, may_stop: bool) -> Sequence[Chunk | LinkEvent]:
    """What was received, where a stop may come in pieces of few frames: a network port gives hundreds at once."""
    return list(cut(iter(items), _PIECE_BYTES)) if may_stop else items


def _session_of(setup: Setup) -> SessionData:
    """The empty session of a station."""
    subject = Subject.ONBOARD if setup.protocol.slots else Subject.SENSOR
    session = SessionData(setup.station, setup.station_text, setup.protocol.name, subject=subject)
    session.housekeeping = Housekeeping(setup.protocol.items, setup.protocol.parameters)
    session.catalog = setup.catalog_facts()
    session.stars = setup.identifier.catalog.listed
    session.versions = versions()
    session.time = time_of(setup.station.sensor.time, setup.protocol)
    return session


def _frame_processor_of(setup: Setup, mount: Mount | None, search: ThinnedSearch | None) -> FrameProcessor:
    """What is done with each panorama; the truth is set once its first instant is known."""
    station = setup.station
    return FrameProcessor(
        camera=setup.camera,
        index_max=station.sensor.index_max,
        identifier=setup.identifier,
        reference=setup.reference,
        non_stellar=NonStellarObjects(setup.camera, station.site, station.sensor.hot_pixels),
        truth=None,
        mount=mount,
        paper_mean=station.identifier.attitude == "paper-mean",
        left_out=LeftOutStars(setup.camera, setup.identifier.catalog),
        false_arcsec=station.limits.false_beyond_arcsec,
        search=search,
    )


def _reception_of(setup: Setup, anchor_utc_ns: int | None, time: TimeDescription) -> Reception:
    sensor, port = setup.station.sensor, setup.station.port
    return Reception(
        setup.protocol,
        baudrate=port.baudrate,
        bits_per_byte=port.line.bits_per_byte,
        anchor_utc_ns=anchor_utc_ns,
        asks=(sensor.start or sensor.poll) is not None,
        timeout_ns=round(sensor.poll.timeout_ms * 1e6) if sensor.poll else None,
        time=time,
    )


def _monitor_of(setup: Setup, *, is_stamped: bool) -> LinkMonitor:
    """A capture without stamps says nothing of how fast its bytes came."""
    port = setup.station.port
    return LinkMonitor(
        port.baudrate,
        explain=lambda sample: what_fits(sample, setup.protocol, port.baudrate),
        bytes_per_s=port.baudrate / port.line.bits_per_byte if has_baud_rate(port.url) and is_stamped else None,
    )


class StationLoop:
    """Turns chunks of a link into a SessionData; listeners get each result and event.

    ``given_orientation`` are tables of the IERS that replace the installed ones, unless the session has its own
    ``earth_orientation``. ``recorded`` are the identification times of a replayed session; without them each frame has
    this host's own time.
    """

    def __init__(
        self,
        setup: Setup,
        *,
        earth_orientation: EarthOrientation | None = None,
        given_orientation: GivenTables | None = None,
        anchor_utc_ns: int | None = None,
        recorded: RecordedTimings | None = None,
    ) -> None:
        station = setup.station
        self.setup = setup
        self.session = _session_of(setup)
        self.reception = _reception_of(setup, anchor_utc_ns, self.session.time)
        self.session.link = self.reception.counters
        self.session.earth_orientation = earth_orientation
        site = None if station.subject else station.site
        self._truth_source = TruthSource(
            site, station.mount.inertial, earth_orientation, given_orientation, self.session.shown
        )
        self.own_elapsed_us: array[float] = array("d")
        self._recorded = recorded
        self.ahead: Executor | None = None
        self._waiting: deque[_Asked | News] = deque()
        self._serial = 0
        self._items_at_once = _FIRST_ITEMS
        self.in_work_since_ns = 0
        self.left_bytes = self.items_left = 0
        self.listeners: Sequence[Listener] = ()
        self.take_frame: Callable[[Frame], None] | None = None
        """Gets each frame, for a procedure that awaits the answer to a command."""
        self.most_at_once = MOST_AT_ONCE
        align_s = station.mount.align_s
        self._first_seconds = FirstSeconds(align_s, self.session) if align_s is not None else None
        mount = station.mount if align_s is None else None
        robust = setup.reference or setup.identifier
        search = ThinnedSearch(robust, station.site, mount) if isinstance(robust, RobustIdentifier) else None
        self._search = search
        self._frame_processor = _frame_processor_of(setup, mount, search)
        self._lists_stars = "STARS" in setup.protocol.types
        self._own_answers = OwnAnswerProcessor(station.sensor.attitude, station.sensor.camera())
        self._monitor = _monitor_of(setup, is_stamped=anchor_utc_ns is None)
        self._truth_sought = False
        self._event_log = EventLog()
        stated_mag = station.sensor.zero_point_mag
        self.sky = SkyWatch(station.site, setup.camera, setup.identifier.catalog, mount, stated_mag=stated_mag)
        camera = CameraWatch(setup.camera, setup.identifier.catalog, setup.station.identifier, station.screen)
        self._result_events = ResultEvents(self.sky, camera)

    def run(
        self,
        link: SerialLink,
        first: Sequence[Chunk | LinkEvent] = (),
        *,
        stop: Callable[[], bool] | None = None,
        leave: Callable[[], bool] = lambda: False,
        each: Callable[[list[FrameResults]], None] = lambda results: None,
        wait_s: Callable[[], float] = lambda: RECEIVE_TIMEOUT_S,
        most: int = ITEMS_AT_ONCE,
        last: Callable[[], None] = lambda: None,
    ) -> SessionData:
        """Receive until the link is at its end or ``stop`` says so; then process what a live port gave until then.

        ``stop`` is asked after each WORK_S of work. ``first`` is what was received already, ``each`` gets the results
        of every round, ``wait_s`` says how long a round may wait; it takes at ``most`` so many items of the port.
        ``last`` is done when it stops, while the port is still open. Where ``leave`` says so after the stop, the rest
        is left: it is recorded, and ``left_bytes`` says how much.
        """
        items = _in_pieces(first, may_stop=stop is not None)
        try:
            while (items or not link.at_end) and not (stop and stop()):
                items = items or self._received(link, wait_s(), most, may_stop=stop is not None)
                items = self._take_some(items, len(items) if stop is None else self._items_at_once, each)
            last()
            if link.is_live:
                link.close()  # what came is recorded, so it counts
            while (items := items or (self._received(link, 0, most) if link.is_live else [])) and not leave():
                items = self._take_some(items, self._items_at_once, each)
            self.left_bytes = link.backlog_bytes + sum(len(item.data) for item in items if isinstance(item, Chunk))
            if not items:
                each(self.finish())
        finally:
            self._close_external()
        return self.session

    def _received(
        self, link: SerialLink, timeout_s: float, most: int, *, may_stop: bool = True
    ) -> Sequence[Chunk | LinkEvent]:
        """What the link gives."""
        return _in_pieces(link.receive(timeout_s, most), may_stop=may_stop)

    def _take_some(
        self, items: Sequence[Chunk | LinkEvent], most: int, each: Callable[[list[FrameResults]], None]
    ) -> Sequence[Chunk | LinkEvent]:
        """Process the first items, at most so many; returns the others. How many take WORK_S is learnt from them."""
        some, others = items[:most], items[most:]
        self.items_left = len(others)
        began_s = time.monotonic()
        self.in_work_since_ns = some[0].mono_ns if some else 0
        each(self.take(some))
        self.in_work_since_ns = others[0].mono_ns if others else 0
        worked_s = max(time.monotonic() - began_s, 1e-6)
        if some:
            fitting = round(len(some) * WORK_S / worked_s)
            self._items_at_once = min(max(fitting, 1), 2 * self._items_at_once, ITEMS_AT_ONCE)
        return others

    def _close_external(self) -> None:
        """End an external identifier; what it said of itself belongs to the session."""
        if self.setup.external is not None:
            self.setup.external.close()
            self.session.external = self.setup.external.identity

    def take(self, items: Sequence[Chunk | LinkEvent]) -> list[FrameResults]:
        """Decode the items and identify the panoramas that are complete."""
        stream: list[FrameAt | LinkEvent] = []
        chunks: list[Chunk] = []
        for item in items:
            if isinstance(item, LinkEvent):
                stream += self._framed(chunks)
                stream += [item] if item.kind == LinkKind.SENT else self._port_event(item)
                chunks = []
            else:
                chunks.append(item)
        stream += self._framed(chunks)
        if self.take_frame is not None:
            for at in stream:
                if isinstance(at, FrameAt):
                    self.take_frame(at.frame)
        return self._identify(self.reception.receive(stream)) if stream else []

    def _port_event(self, event: LinkEvent) -> list[LinkEvent]:
        """The changes of state by the silence before the event, the event, and the changes of state by it."""
        silence = self._monitor.pass_time(event.utc_ns, event.mono_ns)
        return [*silence, event, *self._monitor.port_event(event)]

    def _framed(self, chunks: Sequence[Chunk]) -> Sequence[FrameAt | LinkEvent]:
        """The changes of state by each chunk, and the frames that it completes."""
        frames = self.reception.stream.feed(*chunks)
        completed_by = [at.completed_by for at in frames]
        changes = self._monitor.received_all(chunks, completed_by, self.reception.stream.latest_reasons)
        if not changes:
            return frames
        found: list[tuple[int, FrameAt | LinkEvent]] = [*changes, *zip(completed_by, frames, strict=True)]
        return [item for _, item in sorted(found, key=itemgetter(0))]

    def pass_time(self, utc_ns: int, mono_ns: int) -> None:
        """Update the state of the link: no bytes came until now."""
        self._log_all(self._monitor.pass_time(utc_ns, mono_ns))

    def finish(self) -> list[FrameResults]:
        """Process the bytes left in the decoder at the end of the stream."""
        results = self._identify(self.reception.receive(self.reception.stream.finish()))
        results += self._conclude_but(0)
        if self._search is not None and (words := self._search.finish()):
            last_utc_ns = int(self.session.frames.columns["utc_ns"][-1])
            self.on_event(LinkEvent(last_utc_ns, 0, StationKind.SEARCH_THINNED, words))
        if self.session.link.bytes_discarded and (said := self.reception.stream.marks.said()):
            rows = self.session.frames.columns["utc_ns"]
            at_ns = int(rows[-1]) if len(rows) else 0
            self.on_event(LinkEvent(at_ns, 0, StationKind.TRANSLATED, said))
        self._log_all(self._result_events.finish(self.session))
        fill_housekeeping(self.session.frames.columns, self.session.statuses)
        self.session.raw_sha256 = self.reception.stream.raw_sha256
        self.session.others_lost = self.reception.others_lost
        if self.reception.is_unlocked:
            self.session.time = TimeDescription()  # a clock that was not locked is a counter
        return results

    def on_event(self, event: LinkEvent) -> None:
        """Store an event and pass it to the listeners."""
        event = self._event_log.bounded(event)
        if self._event_log.accepts(event):
            self.session.events.append(event)
        else:
            self.session.events_not_kept += 1
        self.session.link.reconnects += event.kind == LinkKind.REOPENED
        if isinstance(event, ClockStep):
            self._truth_sought = self._frame_processor.truth is not None and self._truth_source.reaches(event.utc_ns)
        for listener in self.listeners:
            listener.on_event(event)

    def _log_all(self, events: list[LinkEvent]) -> None:
        for event in events:
            self.on_event(event)

    def read_clock(self, reading: ClockReading) -> None:
        """Store a reading of the host clock."""
        self.session.clock.append(reading)

    def _identify(self, received: Received) -> list[FrameResults]:
        """Conclude what came in its order; where panoramas are identified ahead, all but the latest."""
        results: list[FrameResults] = []
        self.session.housekeeping.extend(received.items)
        for step in self._steps(received):
            self._waiting.append(step)
            results += self._conclude_but(0 if self.ahead is None else MOST_AHEAD)
        return results

    def _conclude_but(self, latest: int) -> Iterator[FrameResults]:
        while len(self._waiting) > latest:
            yield from self._conclude(self._waiting.popleft())

    def _steps(self, received: Received) -> Iterator[_Asked | News]:
        """Panoramas that follow each other, with what identifies them, and the news between them."""
        first = 0
        for before, item in received.news:
            placed = self._placed(item)
            if placed is not None:
                yield from self._asked(received.panoramas.part(first, before))
                yield placed
                first = before
        yield from self._asked(received.panoramas.part(first, len(received.panoramas)))

    def _asked(self, panoramas: Panoramas) -> Iterator[_Asked]:
        begin, identify = 0, self._frame_processor.identify
        while begin < len(panoramas):
            # One by one while the mount is not fitted: the next panorama may bring it.
            most = self.most_at_once if self._first_seconds is None else 1
            part = panoramas.part(begin, min(begin + most, len(panoramas)))
            yield _Asked(part, self.ahead.submit(identify, part).result if self.ahead else partial(identify, part))
            begin += len(part)

    def _conclude(self, step: _Asked | News) -> Iterator[FrameResults]:
        """Compare panoramas with truth, store the results and pass them on; pass on an event."""
        if isinstance(step, LinkEvent):
            self.on_event(step)
        elif isinstance(step, OwnAnswer):
            yield self._conclude_own(step)
        elif isinstance(step, _Asked):
            self._prepare(int(step.panoramas.utc_ns[0]))
            identified = step.identified()
            elapsed_us = self._elapsed_us(step.panoramas, identified)
            results = self._frame_processor.conclude(step.panoramas, identified, elapsed_us)
            self._store(results, identified.stretches)
            yield results

    def _placed(self, item: News) -> News | None:
        """What of an item has a place among the results: STATUS messages and answers to panoramas are only stored."""
        if isinstance(item, OwnAnswer):
            self.session.sensor_attitudes.append(item.host_utc_ns, item.message)
            return item if item.utc_ns is not None else None
        if isinstance(item, StarsMessage):
            self.session.star_names.take_list(item)
        if isinstance(item, tuple):
            return self._take_status(*item)
        return item if isinstance(item, LinkEvent) else None

    def _take_status(self, utc_ns: int, message: StatusMessage) -> LinkEvent | None:
        """Store a STATUS message; a serial number that changes is an event."""
        if len(self.session.statuses) < MOST_STATUSES:
            self.session.statuses.append((utc_ns, message))
        before, self._serial = self._serial, message.serial or self._serial
        if before in (0, self._serial):
            return None
        text = f"the sensor says that it is number {self._serial}, it was {before} before: two sensors in one session"
        return LinkEvent(utc_ns, 0, StationKind.OTHER_SENSOR, text)

    def observe(self, panorama: Panorama) -> FrameResult:
        """Process one panorama and store the result."""
        (asked,) = self._asked(Panoramas.from_panoramas([panorama]))
        (results,) = self._conclude(asked)
        return results[0]

    def _prepare(self, utc_ns: int) -> None:
        """Find truth and mount for a panorama, where that is due."""
        if not self._truth_sought:
            self._seek_truth(utc_ns)
        if self._first_seconds is not None:
            self._align(self._first_seconds, utc_ns)

    def _store(self, results: FrameResults, stretches: Sequence[tuple[int, str]] = ()) -> None:
        """Store results; the listeners see them in their order, with the events that they bring between them."""
        first, shown = len(self.session.frames), 0
        self.session.frames.extend(results.rows, results.match_rows(), results.other_rows())
        if self._lists_stars:
            self.session.star_names.take_results(results)
        if self._first_seconds is not None and self._frame_processor.truth is not None:
            for result in results:
                self._first_seconds.add(result, self._frame_processor.truth)
        ended = [(k, _event(results, k, StationKind.SEARCH_THINNED, words)) for k, words in stretches]
        events = ended + self._result_events.brought_by(results, self.session, first)
        for k, event in sorted(events, key=itemgetter(0)):
            self._show(results, shown, k)
            self.on_event(event)
            shown = k
        self._show(results, shown, len(results))

    def _show(self, results: FrameResults, begin: int, end: int) -> None:
        """Pass results from ``begin`` to before ``end`` to the listeners."""
        if begin < end and self.listeners:
            part = results.part(begin, end)
            for listener in self.listeners:
                listener.on_results(part, self.session)

    def _conclude_own(self, answer: OwnAnswer) -> FrameResults:
        """Compare an answer of a sensor that sends no panoramas with truth; store the result and pass it on."""
        panorama = self._own_answers.panorama(answer)
        self._prepare(panorama.utc_ns)
        truth, mount = self._frame_processor.truth, self._frame_processor.mount
        self.sky.sees_objects = False
        results = self._own_answers.results(panorama, answer.message, truth, mount)
        self._store(results)
        return results

    def _elapsed_us(self, panoramas: Panoramas, identified: Identified) -> NDArray[np.float64]:
        """The recorded identification times in a replay, otherwise this host's own."""
        own_us = identified.elapsed_us
        self.own_elapsed_us.extend(own_us[~np.isnan(own_us)].tolist())
        if self._recorded is None:
            return own_us
        times = [self._recorded.take(time_us) for time_us in panoramas.time_us.tolist()]
        return np.array([math.nan if us is None else us for us in times])

    def _align(self, first_seconds: FirstSeconds, utc_ns: int) -> None:
        """Fit the mount after the first seconds; the frames of the fit are not compared with it."""
        alignment = first_seconds.alignment(utc_ns)
        if alignment is None:
            return
        waited_s, self._first_seconds = first_seconds.waited_s, None
        self._frame_processor = replace(self._frame_processor, mount=alignment.mount)
        self.session.alignment = alignment
        waited = f"; it waited {waited_s:.0f} s for a sky that shows its stars" if waited_s > 0 else ""
        self.on_event(LinkEvent(utc_ns, 0, StationKind.ALIGNED, f"{alignment}{waited}"))

    def _seek_truth(self, utc_ns: int) -> None:
        """Find truth for the date of a panorama, and tell what it lacks."""
        self._truth_sought = True
        truth, event = self._truth_source.at(utc_ns)
        if event is not None:
            self.on_event(event)
        self.session.earth_orientation = self._truth_source.orientation
        self._frame_processor = replace(self._frame_processor, truth=truth)
