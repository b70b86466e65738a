"""The station: the one loop that serves live, replayed and simulated sessions."""

from array import array
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

from drivers.chunk import Chunk, LinkEvent
from drivers.clock import ClockReading
from drivers.link import SerialLink
from drivers.link_state import LinkMonitor
from gse.alignment import FirstSeconds
from gse.equipment import Equipment, versions
from gse.errors import TruthError
from gse.night import Night
from gse.non_stars import NonStars
from gse.observer import Observer
from gse.panorama import Panorama
from gse.reception import Received, Reception
from gse.results import FrameResult
from gse.session import RecordedTimings
from gse.truth import EarthOrientation, SiderealTruth
from protocols import AttitudeMessage, StatusMessage

RECEIVE_TIMEOUT_S = 0.2


class Sink(Protocol):
    """Something that is told of each result and event as they come: a view, a stream of JSON, a calibration."""

    def show(self, result: FrameResult, night: Night) -> None:
        """One more panorama."""
        ...

    def log(self, event: LinkEvent) -> None:
        """One more event."""
        ...


class StationLoop:
    """Chunks of a link become a Night; what comes out on the way goes to the sinks.

    ``recorded`` timings are given to frames of a replay; without them each frame has this host's own time.
    """

    def __init__(
        self,
        equipment: Equipment,
        *,
        earth_orientation: EarthOrientation | None = None,
        anchor_utc_ns: int | None = None,
        recorded: RecordedTimings | None = None,
    ) -> None:
        station = equipment.station
        self.equipment = equipment
        self.night = Night(station, equipment.station_text, equipment.protocol.name)
        self.night.catalog = equipment.catalog_facts()
        self.night.versions = versions()
        self.reception = Reception(equipment.protocol, baudrate=station.port.baudrate, anchor_utc_ns=anchor_utc_ns)
        self.night.link = self.reception.counters
        self.night.earth_orientation = earth_orientation
        self.own_elapsed_us: array[float] = array("d")
        self._recorded = recorded
        self.sinks: Sequence[Sink] = ()
        align_s = station.mount.align_s
        self._first_seconds = FirstSeconds(align_s) if align_s is not None else None
        mount = station.mount if align_s is None else None
        self._observer = Observer(
            camera=equipment.camera,
            index_max=station.sensor.index_max,
            identifier=equipment.identifier,
            judge=equipment.judge,
            non_stars=NonStars(equipment.camera, station.site, station.sensor.hot_pixels),
            truth=None,
            mount=mount,
            paper_mean=station.identifier.attitude == "paper-mean",
        )
        self._monitor = LinkMonitor(station.port.baudrate)
        self._truth_sought = False

    def run(
        self,
        link: SerialLink,
        first: Sequence[Chunk | LinkEvent] = (),
        *,
        stop: Callable[[], bool] = lambda: False,
        each: Callable[[list[FrameResult]], None] = lambda results: None,
    ) -> Night:
        """Receive until the link is at its end or ``stop`` says so.

        ``first`` is what was received already, ``each`` gets the results of every round.
        """
        each([result for item in first for result in self.take(item)])
        while not link.at_end and not stop():
            results: list[FrameResult] = []
            for item in link.receive(RECEIVE_TIMEOUT_S):
                results += self.take(item)
            each(results)
        each(self._drain(link) + self.finish())
        return self.night

    def _drain(self, link: SerialLink) -> list[FrameResult]:
        """What a live port still gave before it was closed: it is recorded, so it counts."""
        results: list[FrameResult] = []
        if link.is_live:
            link.close()
            while items := link.receive(0):
                for item in items:
                    results += self.take(item)
        return results

    def take(self, item: Chunk | LinkEvent) -> list[FrameResult]:
        """Decode and judge what one chunk completes."""
        if isinstance(item, LinkEvent):
            self.pass_time(item.utc_ns, item.mono_ns)  # the silence before it comes first, as it did live
            self.log(item)
            self._log_all(self._monitor.port_event(item))
            return []
        counters = self.reception.counters
        frames, discards = counters.frames, dict(counters.discards_by_reason)
        received = self.reception.receive(item)
        new = {reason: count - discards.get(reason, 0) for reason, count in counters.discards_by_reason.items()}
        self._log_all(self._monitor.received(item, counters.frames - frames, new))
        return self._take(received)

    def pass_time(self, utc_ns: int, mono_ns: int) -> None:
        """Tell the link's state that nothing came until now."""
        self._log_all(self._monitor.pass_time(utc_ns, mono_ns))

    def finish(self) -> list[FrameResult]:
        """Account for what is left when the stream has ended."""
        results = self._take(self.reception.finish())
        self.night.raw_sha256 = self.reception.raw_sha256
        return results

    def log(self, event: LinkEvent) -> None:
        """An event of the link or of the reception."""
        self.night.events.append(event)
        self.night.link.reconnects += event.kind == "REOPENED"
        for sink in self.sinks:
            sink.log(event)

    def _log_all(self, events: list[LinkEvent]) -> None:
        for event in events:
            self.log(event)

    def read_clock(self, reading: ClockReading) -> None:
        """One more reading of the host clock's health."""
        self.night.clock.append(reading)

    def _take(self, received: list[Received]) -> list[FrameResult]:
        results = []
        for item in received:
            if isinstance(item, Panorama):
                results.append(self.observe(item))
            elif isinstance(item, LinkEvent):
                self.log(item)
            elif isinstance(item, StatusMessage):
                self.night.statuses.append((self.reception.last_host_utc_ns, item))
            elif isinstance(item, AttitudeMessage):
                self.night.sensor_attitudes.append((self.reception.last_host_utc_ns, item))
        return results

    def observe(self, panorama: Panorama) -> FrameResult:
        """Judge one panorama and keep the result."""
        if not self._truth_sought:
            self._seek_truth(panorama)
        if self._first_seconds is not None:
            self._align(self._first_seconds, panorama)
        result = self._observer.observe(panorama)
        if result.elapsed_us is not None:
            self.own_elapsed_us.append(result.elapsed_us)
        if self._recorded is not None:
            result = replace(result, elapsed_us=self._recorded.take(panorama.time_us))
        self.night.frames.append(result)
        if result.detail.startswith("the image is mirrored"):
            self.log(LinkEvent(panorama.utc_ns, 0, "MIRRORED", result.detail))
        if self._first_seconds is not None and self._observer.truth is not None:
            self._first_seconds.add(result, self._observer.truth)
        for sink in self.sinks:
            sink.show(result, self.night)
        return result

    def _align(self, first_seconds: FirstSeconds, panorama: Panorama) -> None:
        """Fit the mount once the first seconds are over; the frames that it was fitted on are not judged by it."""
        alignment = first_seconds.alignment(panorama.utc_ns)
        if alignment is None:
            return
        self._first_seconds = None
        self._observer = replace(self._observer, mount=alignment.mount)
        self.night.alignment = alignment
        self.log(LinkEvent(panorama.utc_ns, 0, "ALIGNED", str(alignment)))

    def _seek_truth(self, panorama: Panorama) -> None:
        """The Earth orientation of the night: frozen in the session, or from disk around the first panorama."""
        self._truth_sought = True
        try:
            orientation = self.night.earth_orientation or EarthOrientation.from_disk(panorama.utc_ns)
            warning = orientation.warning(panorama.utc_ns)
        except TruthError as error:
            self.log(LinkEvent(panorama.utc_ns, 0, "NO_TRUTH", str(error)))
            return
        if warning:
            self.log(LinkEvent(panorama.utc_ns, 0, "EARTH_ORIENTATION", warning))
        self.night.earth_orientation = orientation
        truth = SiderealTruth(self.night.station.site, orientation)
        self._observer = replace(self._observer, truth=truth)
