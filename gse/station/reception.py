"""Reception: bytes with their host times become panoramas in UTC.

Theory of operation
-------------------

A chunk carries bytes and the host time at which they were read. The bytes go through the frame decoder, frames become
messages, and a PANORAMA message becomes a ``Panorama`` with the UTC of its mid-exposure. One second of error in this
UTC is 15 arcsec of right ascension, so this module is where the accuracy of a session is made or lost.

**Every byte is counted.** The decoder gives each byte back in exactly one frame or one discard with its reason; the sum
of both is ``bytes_in`` once the stream has ended. The SHA-256 of all bytes says which stream a report is about.

**The host time of a frame** is that of its first byte: of the chunk which holds it. Chunks are kept with the offset of
their first byte until a frame begins in a later one. However the stream is cut, a frame finds the same chunk.

**From host time to mid-exposure.** A sensor sends a frame when its exposure ends. The first byte takes 10 bits on the
wire, so mid-exposure is half an exposure and one byte time before the byte was read:

    exposure            |<------ exposure ------>|
    wire                                         |<-byte->|
    host                                                  |<- latency ->| read
                                    ^
                              mid-exposure

The latency of host and adapter is unknown and changes from frame to frame: some 0.1 to 20 ms. A byte can be read late,
never early. The time tag of the sensor has no such jitter, but its zero and rate are the sensor's own. ``SensorClock``
takes the least difference (host - sensor) of the last 200 frames or 30 s as the offset of the sensor's clock, and the
tag plus this offset is the time of the frame.

**Steps of UTC.** The differences are taken on the host's monotonic clock, and the offset UTC - monotonic is added last.
``gse.station.arrivals`` tells steps of that offset, restarts of the sensor, and copies. After a restart, and where a
host that was suspended stopped its monotonic clock, the differences begin anew.

**Raw captures** have no host times. With ``anchor_utc_ns`` the first panorama has that instant, and the others follow
by the sensor's clock. Where this clock starts anew, or leaps by a year, it goes on from the latest panorama: a restart
never turns time back.

Objects leave here brightest first, equal ones in the order of the wire. Nothing is judged: a panorama with impossible
values keeps its ``problems`` and becomes a SENSOR_FAULT later.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkEvent
from gse.instant import LAST_NS, NS_PER_S, bounded
from gse.panorama import Panorama, Panoramas
from gse.parts import Parts
from gse.station.arrivals import Arrivals, chaos_in_words
from gse.station.byte_stream import ByteStream, FrameAt
from gse.station.event_kinds import StationKind
from gse.station.results import LinkCounters, OwnAnswer
from gse.station.sensor_clock import SensorClock
from protocols import (
    Ack,
    Arrival,
    AttitudeMessage,
    Message,
    Nak,
    PanoramaColumns,
    Protocol,
    StatusMessage,
)

BITS_PER_BYTE = 10
"""8N1: a start bit, eight data bits, a stop bit."""

LONGEST_EXPOSURE_S = 3600.0
HOTTEST_C = 1e6
"""Larger numbers of the sensor are invalid."""

LONGEST_PAUSE_NS = 366 * 86_400 * NS_PER_S
"""A sensor clock that is this far ahead of the panorama before is out of order: no capture pauses for a year."""

HostedStatus = tuple[int, StatusMessage]
"""The host's UTC at which a STATUS was complete, and its message."""

News = OwnAnswer | HostedStatus | Ack | Nak | LinkEvent
"""What came beside panoramas."""


@dataclass(frozen=True, slots=True)
class Received:
    """What some frames brought: panoramas, and news in their order, each with the number of panoramas before it."""

    news: Sequence[tuple[int, News]]
    panoramas: Panoramas

    def __iter__(self) -> Iterator[Panorama | News]:
        first = 0
        for before, item in self.news:
            yield from self.panoramas.part(first, before)
            first = before
            yield item
        yield from self.panoramas.part(first, len(self.panoramas))


class Reception:
    """Frames of its ``stream`` in, panoramas and events out.

    A frame is stamped with the host time of its first byte: mid-exposure is half an exposure and one byte earlier.
    With ``anchor_utc_ns`` the host times mean nothing (a raw capture): the first panorama is given that instant, the
    others follow by the sensor's clock. Where that clock starts anew or leaps, it goes on from the latest panorama.
    """

    def __init__(self, protocol: Protocol, *, baudrate: int, anchor_utc_ns: int | None = None) -> None:
        self.counters = LinkCounters()
        self.stream = ByteStream(protocol, self.counters)
        self._protocol = protocol
        self._panorama_type = "PANORAMA" if protocol.slots else ""
        self._byte_ns = BITS_PER_BYTE * NS_PER_S // baudrate
        self._clock = SensorClock()
        self._arrivals = Arrivals(protocol, self.counters, has_times=anchor_utc_ns is None)
        self._anchor_utc_ns = anchor_utc_ns
        self._anchor_time_us: int | None = None
        self._latest_utc_ns = 0

    @property
    def others_lost(self) -> int:
        """How many of the frames that are counted as lost were certainly no panoramas."""
        return self._arrivals.others_lost

    def receive(self, stream: Sequence[FrameAt | LinkEvent]) -> Received:
        """What frames bring, with the events between them in their places."""
        frames = [item.frame for item in stream if isinstance(item, FrameAt) and item.frame.type == self._panorama_type]
        columns = self._protocol.decode_panoramas(frames) if frames else None
        news: list[tuple[int, News]] = []
        made: list[_Made] = []
        row = 0
        for item in stream:
            if isinstance(item, LinkEvent):
                news.append((len(made), item))
            elif columns is not None and item.frame.type == self._panorama_type:
                before = len(made)
                if events := self._panorama(item, columns, row, made):
                    news += [(before, event) for event in events]
                row += 1
            else:
                news += [(len(made), found) for found in self._other(item, self._protocol.decode(item.frame))]
        return Received(news, _columns(columns, made) if columns and made else Panoramas.of([]))

    def _panorama(self, at: FrameAt, columns: PanoramaColumns, row: int, made: list["_Made"]) -> list[LinkEvent]:
        """The events before a panorama, row ``row`` of its block; one that is not a copy is appended to ``made``."""
        time_us, host_utc_ns, mono_ns = columns.time_us[row], bounded(at.utc_ns), bounded(at.mono_ns)
        events = self._steps(at, time_us)
        restarted = "clock reset" in columns.flags[row]
        if self._arrived(at, host_utc_ns, mono_ns, time_us, events, restarted=restarted) is Arrival.DUPLICATE:
            return events + self._arrivals.repeated(at.frame, columns.frame_no[row], host_utc_ns, mono_ns)
        self._arrivals.new_panorama(columns.frame_no[row])
        # Invalid numbers (NaN, infinity, an age) are listed in the panorama's problems.
        exposure_s = columns.exposure_s[row]
        exposure_s = exposure_s if 0 <= exposure_s <= LONGEST_EXPOSURE_S else math.nan
        utc_ns = bounded(self._utc_of(time_us, exposure_s, host_utc_ns, mono_ns))
        self._latest_utc_ns = max(self._latest_utc_ns, utc_ns)
        host_utc_ns = host_utc_ns if self._anchor_utc_ns is None else 0
        made.append((row, utc_ns, host_utc_ns, max(at.frame.sequence, 0), exposure_s))
        return events

    def _other(self, at: FrameAt, message: Message) -> Iterator[News]:
        """The news of any other frame."""
        host_utc_ns, mono_ns = bounded(at.utc_ns), bounded(at.mono_ns)
        events = self._steps(at, message.time_us if isinstance(message, StatusMessage | AttitudeMessage) else None)
        # Only time tags of exposures show a restart.
        time_tag = message.time_us if isinstance(message, AttitudeMessage) and not self._panorama_type else None
        kind = self._arrived(at, host_utc_ns, mono_ns, time_tag, events, restarted=False)
        yield from events
        if kind is Arrival.DUPLICATE:
            return
        if isinstance(message, AttitudeMessage):
            yield self._own_answer(message, at, host_utc_ns, mono_ns)
        elif isinstance(message, StatusMessage):
            yield bounded(at.completed_utc_ns), message
        elif isinstance(message, Ack | Nak):
            yield message

    def _steps(self, at: FrameAt, time_us: int | None) -> list[LinkEvent]:
        """The step of the host's clock before a frame."""
        step = self._arrivals.clock_step(at, time_us)
        if step is None:
            return []
        if step.utc_kept:
            self._clock.reset()
        return [step]

    def _arrived(
        self,
        at: FrameAt,
        host_utc_ns: int,
        mono_ns: int,
        time_us: int | None,
        events: list[LinkEvent],
        *,
        restarted: bool,
    ) -> Arrival:
        """The class of a frame by its sequence number; its event is added to ``events``."""
        before = self._arrivals.last
        arrival = self._arrivals.accept(at.frame, mono_ns, time_us, restarted=restarted)
        utc_ns = host_utc_ns if self._anchor_utc_ns is None else max(self._anchor_utc_ns, self._latest_utc_ns)
        if arrival is Arrival.CHAOS:
            text = chaos_in_words(at.frame.sequence, before)
            events.append(LinkEvent(utc_ns, mono_ns, StationKind.SEQUENCE_CHAOS, text))
        elif arrival is Arrival.RESET:
            self._clock.reset()
            self._anchor_time_us = None
            text = f"the sensor started anew: frame {at.frame.sequence} on the wire, its clock or counter jumped back"
            events.append(LinkEvent(utc_ns, mono_ns, StationKind.SENSOR_RESET, text))
        return arrival

    def _own_answer(self, message: AttitudeMessage, at: FrameAt, host_utc_ns: int, mono_ns: int) -> OwnAnswer:
        """The UTC of its exposure is that of its panorama; a sensor without panoramas is given one by its time tag.

        Its answer comes later than the exposure by the time that it states for its processing.
        """
        utc_ns = None
        if not self._panorama_type:
            processing_s = message.latency_s if 0 <= message.latency_s <= LONGEST_EXPOSURE_S else 0.0
            utc_ns = bounded(self._utc_of(message.time_us, 2 * processing_s, host_utc_ns, mono_ns))
            self._latest_utc_ns = max(self._latest_utc_ns, utc_ns)
        host_utc_ns = host_utc_ns if self._anchor_utc_ns is None else 0
        return OwnAnswer(message, host_utc_ns, utc_ns, max(at.frame.sequence, 0))

    def _utc_of(self, time_us: int, exposure_s: float, utc_ns: int, mono_ns: int) -> int:
        """UTC of a time tag that came half of ``exposure_s`` and a byte before its frame was read."""
        if self._anchor_utc_ns is None:
            # A panorama whose exposure is out of order is placed where its first byte came.
            half_ns = 0 if math.isnan(exposure_s) else round(exposure_s * NS_PER_S / 2)
            arrived_ns = mono_ns - self._byte_ns - half_ns
            return self._clock.utc_ns(time_us, arrived_mono_ns=arrived_ns, utc_minus_mono_ns=utc_ns - mono_ns)
        return self._anchored_utc_ns(time_us)

    def _anchored_utc_ns(self, time_us: int) -> int:
        assert self._anchor_utc_ns is not None
        latest_ns = max(self._anchor_utc_ns, self._latest_utc_ns)
        if self._anchor_time_us is not None:
            utc_ns = self._anchor_utc_ns + (time_us - self._anchor_time_us) * 1000
            if utc_ns <= min(latest_ns + LONGEST_PAUSE_NS, LAST_NS):
                return utc_ns
        self._anchor_utc_ns, self._anchor_time_us = latest_ns, time_us
        return latest_ns


_Made = tuple[int, int, int, int, float]
"""Of a panorama: its row in the block, UTC, host's UTC, sequence number, exposure in s."""


def _columns(columns: PanoramaColumns, made: Sequence[_Made]) -> Panoramas:
    """The panoramas that were made of messages, each with its objects brightest first, equal ones as on the wire."""
    rows, utc_ns, host_utc_ns, sequence, exposure_s = zip(*made, strict=True)
    counts = np.diff(columns.first)[list(rows)]
    parts = Parts.of_counts(counts)
    wire_rows = np.arange(parts.first[-1]) - np.repeat(parts.first[:-1], counts)
    at = wire_rows + np.repeat(columns.first[list(rows)], counts)
    order = _brightest_first(columns.index.take(at), parts)
    temperature_c = np.array([columns.temperature_c[row] for row in rows], dtype=np.float64)
    return Panoramas(
        parts,
        columns.xy_px.take(at[order], axis=0),
        columns.index.take(at[order]),
        wire_rows[order],
        np.array(utc_ns, dtype=np.int64),
        np.array(host_utc_ns, dtype=np.int64),
        np.array([columns.time_us[row] for row in rows], dtype=np.int64),
        np.array([columns.frame_no[row] for row in rows], dtype=np.int64),
        np.array(sequence, dtype=np.int64),
        np.array(exposure_s, dtype=np.float64),
        np.where(np.abs(temperature_c) <= HOTTEST_C, temperature_c, np.nan),
        [columns.flags[row] for row in rows],
        [columns.problems[row] for row in rows],
    )


def _brightest_first(index: NDArray[np.float64], parts: Parts) -> NDArray[np.int64] | slice:
    """The order of objects (M,) in which those of each part stand brightest first, equal ones as they came."""
    is_sorted = np.ones(len(index) + 1, dtype=np.bool_)
    np.less_equal(index[1:], index[:-1], out=is_sorted[1:-1])
    is_sorted[parts.first] = True
    return slice(None) if is_sorted.all() else np.lexsort((-index, parts.of_row))
