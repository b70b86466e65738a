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
2. *Identify.* Identification depends on one panorama alone, so many that wait are identified together, at most
   MOST_AT_ONCE: their tables are then still in the caches of the processor. The answers are those of one by one.
3. *Conclude.* One panorama after the other, in order, because this stage remembers: the non-stellar objects seen
   before, the fit of the mount. The answer is corrected, compared with sidereal truth and kept; then the listeners see
   it. Events between two panoramas come out between their results.

What is decided on the way:

* **Earth orientation** is looked up at the first panorama, because only then is the date known. A session that has it
  frozen uses its own, so that a later release of the tables changes nothing. Without it (an event NO_TRUTH) panoramas
  are identified, and compared with nothing.
* **The mount** comes from the station file. Under ``align: first N s`` there is no mount at first; results of these
  seconds have no attitude error. The first panorama after them, once 10 frames were identified, fixes the mount for the
  rest of the session (an event ALIGNED). The mount is never judged by the frames that it was fitted on.
* **Identification time** is this host's own in a live session and the recorded one in a replay: it belongs to the run
  that was made, not to the machine that reads it.

At the end of a live session the port is closed first. Bytes that came until then are recorded, so they are identified
too. ``finish`` accounts for what is left in the decoder, and every byte has its place: in a frame or in a discard.

Listeners (``Listener``) get each result and each event on this thread. A listener that is slow delays the loop; the
live view has a queue and a thread of its own for that reason. Raw bytes do not pass here on their way to the file: the
link hands them to the recorder before the loop sees them.
"""

from array import array
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import groupby
from typing import Protocol

from drivers.chunk import Chunk, LinkEvent, LinkKind
from drivers.clock import ClockReading
from drivers.link import SerialLink
from drivers.link_state import LinkMonitor
from gse.errors import TruthError
from gse.external.answers import Failure
from gse.external.identifier import Given
from gse.panorama import Panorama
from gse.recording.session_format import RecordedTimings
from gse.station.camera_watch import CameraWatch
from gse.station.event_kinds import ClockStep, StationKind
from gse.station.event_log import EventLog
from gse.station.frame_processor import Answer, FrameProcessor
from gse.station.housekeeping import fill_housekeeping
from gse.station.left_out_stars import LeftOutStars
from gse.station.mount_alignment import FirstSeconds
from gse.station.non_stellar import NonStellarObjects
from gse.station.own_answer_results import OwnAnswerProcessor
from gse.station.reception import Received, Reception
from gse.station.results import FrameResult, OwnAnswer, Subject
from gse.station.session_data import SessionData
from gse.station.setup import Setup, versions
from gse.station.sky_watch import SkyWatch
from gse.station.unreadable_bytes import what_fits
from gse.truth import EarthOrientation, InertialTruth, SiderealTruth
from gse.truth.iers_tables import GivenTables
from protocols import StatusMessage

RECEIVE_TIMEOUT_S = 0.2
MOST_STATUSES = 50_000
"""One a second for 14 h; those that follow are decoded and dropped."""
MOST_AT_ONCE = 64
"""Panoramas that are identified before the first of them is shown, where so many wait."""


_News = Panorama | OwnAnswer | LinkEvent
"""What has a place in the order of a session."""


class Listener(Protocol):
    """Receiver of each result and event of a session: a view, a stream of JSON, a calibration."""

    def on_result(self, result: FrameResult, session: SessionData) -> None:
        """Receive the result of a panorama."""
        ...

    def on_event(self, event: LinkEvent) -> None:
        """Receive an event."""
        ...


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
        subject = Subject.ONBOARD if setup.protocol.slots else Subject.SENSOR
        self.session = SessionData(station, setup.station_text, setup.protocol.name, subject=subject)
        self.session.catalog = setup.catalog_facts()
        self.session.stars = setup.identifier.catalog.listed
        self.session.versions = versions()
        self.reception = Reception(setup.protocol, baudrate=station.port.baudrate, anchor_utc_ns=anchor_utc_ns)
        self.session.link = self.reception.counters
        self.session.earth_orientation = earth_orientation
        self._is_frozen = earth_orientation is not None
        self._given_orientation = given_orientation
        self.own_elapsed_us: array[float] = array("d")
        self._recorded = recorded
        self.listeners: Sequence[Listener] = ()
        align_s = station.mount.align_s
        self._first_seconds = FirstSeconds(align_s, self.session) if align_s is not None else None
        mount = station.mount if align_s is None else None
        self._frame_processor = FrameProcessor(
            camera=setup.camera,
            index_max=station.sensor.index_max,
            identifier=setup.identifier,
            reference=setup.reference,
            non_stellar=NonStellarObjects(setup.camera, station.site, station.sensor.hot_pixels),
            truth=None,
            mount=mount,
            paper_mean=station.identifier.attitude == "paper-mean",
            left_out=LeftOutStars(setup.camera, setup.identifier.catalog),
        )
        self._own_answers = OwnAnswerProcessor(station.sensor.attitude)
        baudrate = station.port.baudrate
        self._monitor = LinkMonitor(baudrate, explain=lambda sample: what_fits(sample, setup.protocol, baudrate))
        self._camera_watch = CameraWatch(setup.camera, setup.identifier.catalog)
        self._truth_sought = False
        self._event_log = EventLog()
        self.sky = SkyWatch(station.site, setup.camera, setup.identifier.catalog, mount)

    def run(
        self,
        link: SerialLink,
        first: Sequence[Chunk | LinkEvent] = (),
        *,
        stop: Callable[[], bool] = lambda: False,
        each: Callable[[list[FrameResult]], None] = lambda results: None,
    ) -> SessionData:
        """Receive until the link is at its end or ``stop`` says so.

        ``first`` is what was received already, ``each`` gets the results of every round.
        """
        try:
            each(self.take(first))
            while not link.at_end and not stop():
                each(self.take(link.receive(RECEIVE_TIMEOUT_S)))
            each(self._drain(link) + self.finish())
        finally:
            self._close_external()
        return self.session

    def _close_external(self) -> None:
        """End an external identifier; what it said of itself belongs to the session."""
        if self.setup.external is not None:
            self.setup.external.close()
            self.session.external = self.setup.external.identity

    def _drain(self, link: SerialLink) -> list[FrameResult]:
        """Process the bytes that a live port gave until it was closed: they are recorded, so they count."""
        results: list[FrameResult] = []
        if link.is_live:
            link.close()
            while items := link.receive(0):
                results += self.take(items)
        return results

    def take(self, items: Sequence[Chunk | LinkEvent]) -> list[FrameResult]:
        """Decode the items and identify the panoramas that are complete."""
        news: list[_News] = []
        for item in items:
            news += self._port_event(item) if isinstance(item, LinkEvent) else self._decoded(item)
        return self._identify(news)

    def _port_event(self, event: LinkEvent) -> list[LinkEvent]:
        """The changes of state by the silence before the event, the event, and the changes of state by it."""
        silence = self._monitor.pass_time(event.utc_ns, event.mono_ns)
        return [*silence, event, *self._monitor.port_event(event)]

    def _decoded(self, chunk: Chunk) -> list[_News]:
        frames = self.reception.counters.frames
        received = self.reception.receive(chunk)
        frames = self.reception.counters.frames - frames
        changes = self._monitor.received(chunk, frames, self.reception.latest_reasons)
        return [*changes, *self._for_identification(received)] if changes or received else []

    def _for_identification(self, received: list[Received]) -> list[_News]:
        """Panoramas, events and answers without a panorama, in order; STATUS and ATTITUDE messages are stored."""
        news: list[_News] = []
        for item in received:
            if isinstance(item, Panorama | LinkEvent):
                news.append(item)
            elif isinstance(item, StatusMessage) and len(self.session.statuses) < MOST_STATUSES:
                self.session.statuses.append((self.reception.last_host_utc_ns, item))
            elif isinstance(item, OwnAnswer):
                self.session.sensor_attitudes.append(item.host_utc_ns, item.message)
                news += [item] if item.utc_ns is not None else []
        return news

    def pass_time(self, utc_ns: int, mono_ns: int) -> None:
        """Update the state of the link: no bytes came until now."""
        self._log_all(self._monitor.pass_time(utc_ns, mono_ns))

    def finish(self) -> list[FrameResult]:
        """Process the bytes left in the decoder at the end of the stream."""
        results = self._identify(self._for_identification(self.reception.finish()))
        self._log_camera(self._camera_watch.finish())
        if self.session.station.mount.inertial is None:
            self._log_all(self.sky.finish(self.session.frames.columns))
        fill_housekeeping(self.session.frames.columns, self.session.statuses)
        self.session.raw_sha256 = self.reception.raw_sha256
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
            self._truth_sought = self._truth_reaches(event.utc_ns)
        for listener in self.listeners:
            listener.on_event(event)

    def _log_all(self, events: list[LinkEvent]) -> None:
        for event in events:
            self.on_event(event)

    def _log_camera(self, text: str) -> None:
        if text:
            self.on_event(LinkEvent(int(self.session.frames.columns["utc_ns"][-1]), 0, StationKind.WRONG_CAMERA, text))

    def read_clock(self, reading: ClockReading) -> None:
        """Store a reading of the host clock."""
        self.session.clock.append(reading)

    def _identify(self, news: list[_News]) -> list[FrameResult]:
        """Identify the panoramas, many at once where many wait; results and events come out in their order."""
        results = []
        for begin in range(0, len(news), MOST_AT_ONCE):
            part = news[begin : begin + MOST_AT_ONCE]
            answers = iter(self._frame_processor.identify([item for item in part if isinstance(item, Panorama)]))
            for kind, items in groupby(part, type):
                if kind is Panorama:
                    results += self._conclude([(item, next(answers)) for item in items if isinstance(item, Panorama)])
                    continue
                for item in items:
                    if isinstance(item, OwnAnswer):
                        results.append(self._conclude_own(item))
                    elif isinstance(item, LinkEvent):
                        self.on_event(item)
        return results

    def observe(self, panorama: Panorama) -> FrameResult:
        """Process one panorama and store the result."""
        return self._identify([panorama])[0]

    def _conclude(self, answered: list[tuple[Panorama, Answer | str]]) -> list[FrameResult]:
        """Compare answers that follow each other with truth, store the results and pass them to the listeners.

        One by one while the mount is not fitted: the next panorama may bring it.
        """
        results: list[FrameResult] = []
        while answered:
            panorama, _ = answered[0]
            if not self._truth_sought:
                self._seek_truth(panorama)
            if self._first_seconds is not None:
                self._align(self._first_seconds, panorama)
            count = len(answered) if self._first_seconds is None else 1
            results += self._conclude_some(answered[:count])
            answered = answered[count:]
        return results

    def _conclude_some(self, answered: list[tuple[Panorama, Answer | str]]) -> list[FrameResult]:
        panoramas, answers = zip(*answered, strict=True)
        elapsed_us = [self._elapsed_us(panorama, answer) for panorama, answer in answered]
        results = self._frame_processor.conclude(panoramas, answers, elapsed_us)
        first = len(self.session.frames)
        self.session.frames.extend(results)
        for row, (answer, result) in enumerate(zip(answers, results, strict=True), first):
            self._log_all(self._sky_at(row + 1))
            if given := (answer.given if isinstance(answer, Answer) else None):
                self._count_given(result.panorama, given)
            if isinstance(answer, Answer) and answer.is_mirrored:
                self.on_event(LinkEvent(result.panorama.utc_ns, 0, StationKind.MIRRORED, result.detail))
            self._log_camera(self._camera_watch.look(result))
            if self._first_seconds is not None and self._frame_processor.truth is not None:
                self._first_seconds.add(result, self._frame_processor.truth)
            for listener in self.listeners:
                listener.on_result(result, self.session)
        return results

    def _count_given(self, panorama: Panorama, given: Given) -> None:
        """Count what an external identifier gave; its failures are events."""
        self.session.external_counts.count(given)
        if isinstance(given.answer, Failure):
            text = f"{given.answer.kind} at frame {panorama.frame_no}: {given.answer.detail}"
            self.on_event(LinkEvent(panorama.utc_ns, 0, StationKind.IDENTIFIER_FAULT, text))

    def _conclude_own(self, answer: OwnAnswer) -> FrameResult:
        """Compare an answer of a sensor that sends no panoramas with truth; store the result and pass it on."""
        panorama = self._own_answers.panorama(answer)
        if not self._truth_sought:
            self._seek_truth(panorama)
        if self._first_seconds is not None:
            self._align(self._first_seconds, panorama)
        truth, mount = self._frame_processor.truth, self._frame_processor.mount
        result = self._own_answers.result(panorama, answer.message, truth, mount)
        self.sky.sees_objects = False
        self.session.frames.append(result)
        self._log_all(self._sky_at(len(self.session.frames)))
        if self._first_seconds is not None and truth is not None:
            self._first_seconds.add(result, truth)
        for listener in self.listeners:
            listener.on_result(result, self.session)
        return result

    def _elapsed_us(self, panorama: Panorama, answer: Answer | str) -> float | None:
        """The recorded identification time in a replay, otherwise this host's own."""
        own = None if isinstance(answer, str) else answer.elapsed_us
        if own is not None:
            self.own_elapsed_us.append(own)
        return own if self._recorded is None else self._recorded.take(panorama.time_us)

    def _sky_at(self, rows: int) -> list[LinkEvent]:
        """What the newest of so many frames shows of the sky; before a star simulator there is none."""
        if self.session.station.mount.inertial is not None:
            return []
        return self.sky.take(self.session.frames.columns[:rows])

    def _align(self, first_seconds: FirstSeconds, panorama: Panorama) -> None:
        """Fit the mount after the first seconds; the frames of the fit are not compared with it."""
        alignment = first_seconds.alignment(panorama.utc_ns)
        if alignment is None:
            return
        self._first_seconds = None
        self._frame_processor = replace(self._frame_processor, mount=alignment.mount)
        self.session.alignment = alignment
        self.on_event(LinkEvent(panorama.utc_ns, 0, StationKind.ALIGNED, str(alignment)))

    def _truth_reaches(self, utc_ns: int) -> bool:
        """Whether the Earth orientation at hand is good for an instant to which the clock was set."""
        try:
            orientation = self.session.earth_orientation
            return (
                self._frame_processor.truth is not None and orientation is not None and not orientation.warning(utc_ns)
            )
        except TruthError:
            return False

    def _seek_truth(self, panorama: Panorama) -> None:
        """Find the Earth orientation: that of the session, or from disk for the date of the first panorama.

        After a clock step beyond its reach it is sought again; there is none for an unknown date.
        """
        self._truth_sought = True
        shown = self.session.station.mount.inertial
        if shown is not None:
            self._frame_processor = replace(self._frame_processor, truth=InertialTruth(shown))
            return
        try:
            orientation, warning = self._orientation(panorama.utc_ns)
        except TruthError as error:
            self._frame_processor = replace(self._frame_processor, truth=None)
            self.on_event(LinkEvent(panorama.utc_ns, 0, StationKind.NO_TRUTH, str(error)))
            return
        if warning:
            self.on_event(LinkEvent(panorama.utc_ns, 0, StationKind.EARTH_ORIENTATION, warning))
        self.session.earth_orientation = orientation
        truth = SiderealTruth(self.session.station.site, orientation)
        self._frame_processor = replace(self._frame_processor, truth=truth)

    def _orientation(self, utc_ns: int) -> tuple[EarthOrientation, str | None]:
        """The Earth orientation for an instant, and a warning where it does not reach it."""
        at_hand = self.session.earth_orientation
        if at_hand is not None and (self._is_frozen or not at_hand.warning(utc_ns)):
            return at_hand, at_hand.warning(utc_ns)
        found = EarthOrientation.from_disk(utc_ns, given=self._given_orientation)
        warning = found.warning(utc_ns)
        return (at_hand if at_hand is not None and warning else found), warning
