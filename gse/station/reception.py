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
Where that offset moves by 5 ms or more between two frames, the UTC clock was stepped, not slewed: an event CLOCK_STEP.
Frames around it are left out of the statistics, see ``gse.station.exclusions``. Where the sensor's clock went along
with UTC, by a second or more, UTC was right: a host that is suspended stops its monotonic clock. Then the differences
begin anew.

**Sequence numbers** tell duplicates (dropped, counted), gaps (frames lost) and restarts. A restart is also told by a
time tag of a panorama that jumps back, or by the sensor's own flag. Then the sensor clock is forgotten and learned anew
(an event SENSOR_RESET). Time tags of other messages are not asked: a STATUS may carry a later one than the panorama
behind it. Frames marked as stored are older than what came before them and never look like a restart.

**Raw captures** have no host times. With ``anchor_utc_ns`` the first panorama has that instant, and the others follow
by the sensor's clock. Where this clock starts anew, or leaps by a year, it goes on from the latest panorama: a restart
never turns time back.

Objects leave here brightest first, equal ones in the order of the wire. Nothing is judged: a panorama with impossible
values keeps its ``problems`` and becomes a SENSOR_FAULT later.
"""

import hashlib
import math
from collections import deque

import numpy as np

from drivers.chunk import Chunk, LinkEvent
from gse.instant import LAST_NS, NS_PER_S
from gse.panorama import Panorama
from gse.station.event_kinds import ClockStep, StationKind
from gse.station.results import LinkCounters, OwnAnswer
from gse.station.sensor_clock import SensorClock
from protocols import (
    Ack,
    Arrival,
    AttitudeMessage,
    Discard,
    Frame,
    FrameDecoder,
    Message,
    Nak,
    PanoramaMessage,
    Protocol,
    SequenceTracker,
    StatusMessage,
)
from protocols.sequence import RECENT

BITS_PER_BYTE = 10
"""8N1: a start bit, eight data bits, a stop bit."""

LONGEST_EXPOSURE_S = 3600.0
HOTTEST_C = 1e6
"""Larger numbers of the sensor are invalid."""

CLOCK_STEP_NS = 5_000_000
"""UTC that moves this much against the monotonic clock between two frames was stepped, not slewed."""

SHORTEST_SUSPENSION_NS = NS_PER_S
"""Steps that are smaller are always those of UTC: time tags and arrivals do not tell."""

FROZEN_AFTER = 3
"""Copies of one panorama with no other between them: no line makes so many."""

LONGEST_PAUSE_NS = 366 * 86_400 * NS_PER_S
"""A sensor clock that is this far ahead of the panorama before is out of order: no capture pauses for a year."""

_TAGGED = PanoramaMessage | StatusMessage | AttitudeMessage
"""Messages with the sensor's time: it tells a step of UTC from a host that was suspended."""

_Stamp = tuple[int, int, int]
"""Offset of a chunk in the stream, UTC and monotonic time at which it was read, as they came."""

Received = Panorama | OwnAnswer | StatusMessage | Ack | Nak | LinkEvent


class Reception:
    """Bytes in, panoramas and events out; every byte is counted.

    A frame is stamped with the host time of its first byte: mid-exposure is half an exposure and one byte earlier.
    With ``anchor_utc_ns`` the host times mean nothing (a raw capture): the first panorama is given that instant, the
    others follow by the sensor's clock. Where that clock starts anew or leaps, it goes on from the latest panorama.
    """

    def __init__(self, protocol: Protocol, *, baudrate: int, anchor_utc_ns: int | None = None) -> None:
        self.counters = LinkCounters()
        self.last_host_utc_ns = 0
        self.latest_reasons: set[str] = set()
        self._protocol = protocol
        self._decoder = FrameDecoder(protocol)
        self._sequence = SequenceTracker(protocol.sequence_modulus)
        self._byte_ns = BITS_PER_BYTE * NS_PER_S // baudrate
        self._stamps: deque[_Stamp] = deque()
        self._sha256 = hashlib.sha256()
        self._clock = SensorClock()
        self._anchor_utc_ns = anchor_utc_ns
        self._anchor_time_us: int | None = None
        self._latest_utc_ns = 0
        self._latest: deque[bytes] = deque(maxlen=RECENT)
        self._before: tuple[int, int, int | None] | None = None
        self._frame_mono_ns: int | None = None
        self._repeats = 0

    @property
    def raw_sha256(self) -> str:
        """SHA-256 of all bytes received."""
        return self._sha256.hexdigest()

    def receive(self, chunk: Chunk) -> list[Received]:
        """Panoramas, events and other messages that the chunk completes; ``latest_reasons`` are of its discards."""
        self.latest_reasons.clear()
        utc_ns = _an_instant(chunk.utc_ns)
        self._stamps.append((self.counters.bytes_in, chunk.utc_ns, chunk.mono_ns))
        self.counters.bytes_in += len(chunk.data)
        self._sha256.update(chunk.data)
        self.last_host_utc_ns = utc_ns
        received = self._take(self._decoder.feed(chunk.data))
        self._forget_before(self.counters.bytes_in - self._decoder.pending)
        return received

    def finish(self) -> list[Received]:
        """Messages from the bytes left at the end of the stream."""
        return self._take(self._decoder.finish())

    def _take(self, pieces: list[Frame | Discard]) -> list[Received]:
        received: list[Received] = []
        for piece in pieces:
            if isinstance(piece, Discard):
                self._count_discard(piece)
            else:
                self.counters.frames += 1
                self.counters.bytes_framed += piece.size
                received += self._take_frame(piece)
        return received

    def _count_discard(self, discard: Discard) -> None:
        self.counters.bytes_discarded += len(discard.data)
        self.latest_reasons.add(discard.reason)
        by_reason = self.counters.discarded_bytes_by_reason
        by_reason[discard.reason] = by_reason.get(discard.reason, 0) + len(discard.data)

    def _take_frame(self, frame: Frame) -> list[Received]:
        self._forget_before(frame.start)
        _, stamped_utc_ns, stamped_mono_ns = self._stamps[0]
        message = self._protocol.decode(frame)
        received: list[Received] = list(self._clock_step(stamped_utc_ns, stamped_mono_ns, message))
        host_utc_ns, mono_ns = _an_instant(stamped_utc_ns), _an_instant(stamped_mono_ns)
        before = self._sequence.last
        arrival = self._arrival(frame, message, mono_ns)
        if arrival is Arrival.DUPLICATE:
            return received + self._repeated(message, frame.sequence, host_utc_ns, mono_ns)
        utc_ns = host_utc_ns if self._anchor_utc_ns is None else max(self._anchor_utc_ns, self._latest_utc_ns)
        if arrival is Arrival.CHAOS:
            text = _chaos_in_words(frame.sequence, before)
            received.append(LinkEvent(utc_ns, mono_ns, StationKind.SEQUENCE_CHAOS, text))
        if arrival is Arrival.RESET:
            self._clock.reset()
            self._anchor_time_us = None
            text = f"the sensor started anew: frame {frame.sequence} on the wire, its clock or counter jumped back"
            received.append(LinkEvent(utc_ns, mono_ns, StationKind.SENSOR_RESET, text))
        if isinstance(message, PanoramaMessage):
            self._repeats = 0
            received.append(self._panorama(message, frame, host_utc_ns, mono_ns))
        elif isinstance(message, AttitudeMessage):
            received.append(self._own_answer(message, frame, host_utc_ns, mono_ns))
        elif isinstance(message, StatusMessage | Ack | Nak):
            received.append(message)
        return received

    def _arrival(self, frame: Frame, message: Message, mono_ns: int) -> Arrival:
        """Classify the sequence number. Only time tags of exposures show a restart: a STATUS may carry a later one."""
        elapsed_s = None
        if self._anchor_utc_ns is None and self._frame_mono_ns is not None:
            elapsed_s = (mono_ns - self._frame_mono_ns) / NS_PER_S
        copy = self._is_copy(frame)
        of_exposure = PanoramaMessage if self._protocol.slots else AttitudeMessage
        if isinstance(message, of_exposure) and "stored" not in self._protocol.flags_of(frame):
            restarted = isinstance(message, PanoramaMessage) and "clock reset" in message.flags
            arrival = self._sequence.accept(
                frame.sequence, time_us=message.time_us, restarted=restarted, elapsed_s=elapsed_s, copy=copy
            )
        else:
            arrival = self._sequence.accept(frame.sequence, elapsed_s=elapsed_s, copy=copy)
        if arrival is not Arrival.DUPLICATE:
            self._frame_mono_ns = mono_ns
        self.counters.duplicates = self._sequence.duplicates
        self.counters.frames_lost = self._sequence.lost
        self.counters.sensor_resets = self._sequence.resets
        return arrival

    def _repeated(self, message: Message, sequence: int, host_utc_ns: int, mono_ns: int) -> list[Received]:
        """Count a panorama that came before; an event where nothing else comes any more.

        A line that doubles frames goes on with new ones. The copies of a frozen sensor stand where new panoramas are
        expected, so they count as missing.
        """
        if not isinstance(message, PanoramaMessage) or sequence != self._sequence.last:
            return []
        self._repeats += 1
        if self._repeats < FROZEN_AFTER:
            return []
        self.counters.frames_repeated += FROZEN_AFTER if self._repeats == FROZEN_AFTER else 1
        if self._repeats > FROZEN_AFTER:
            return []
        text = f"the sensor repeats panorama {message.frame_no}, byte for byte, instead of new ones: it is frozen"
        return [LinkEvent(host_utc_ns, mono_ns, StationKind.FROZEN, text)]

    def _is_copy(self, frame: Frame) -> bool:
        """Whether the same bytes came among the latest frames: what bears a number again need not be a copy."""
        found = frame.payload in self._latest
        self._latest.append(frame.payload)
        return found

    def _forget_before(self, start: int) -> None:
        """Drop the stamps of decoded bytes; the rest belongs to one frame or discard at most."""
        while len(self._stamps) > 1 and self._stamps[1][0] <= start:
            self._stamps.popleft()

    def _clock_step(self, utc_ns: int, mono_ns: int, message: Message) -> list[LinkEvent]:
        """The step since the frame before, by the stamps as they came: stamps that no clock has may stand still."""
        tag_ns = message.time_us * 1000 if isinstance(message, _TAGGED) else None
        before, self._before = self._before, (utc_ns, mono_ns, tag_ns)
        if before is None or self._anchor_utc_ns is not None:
            return []
        step_ns = utc_ns - mono_ns - (before[0] - before[1])
        if abs(step_ns) < CLOCK_STEP_NS:
            return []
        utc_kept = abs(step_ns) >= SHORTEST_SUSPENSION_NS and _went_with_utc(before, (utc_ns, mono_ns, tag_ns))
        if utc_kept:
            self._clock.reset()
        text = _step_in_words(step_ns, utc_kept)
        stamp = _an_instant(utc_ns), _an_instant(mono_ns)
        return [ClockStep(*stamp, StationKind.CLOCK_STEP, text, step_ns, utc_kept)]

    def _panorama(self, message: PanoramaMessage, frame: Frame, host_utc_ns: int, mono_ns: int) -> Panorama:
        # Invalid numbers (NaN, infinity, an age) are listed in the panorama's problems.
        exposure_s = message.exposure_s if 0 <= message.exposure_s <= LONGEST_EXPOSURE_S else math.nan
        temperature_c = message.temperature_c if abs(message.temperature_c) <= HOTTEST_C else math.nan
        utc_ns = min(max(self._utc_of(message, exposure_s, host_utc_ns, mono_ns), 0), LAST_NS)
        brightest_first = np.argsort(-message.index, kind="stable")
        self._latest_utc_ns = max(self._latest_utc_ns, utc_ns)
        return Panorama(
            utc_ns=utc_ns,
            xy_px=message.xy_px.take(brightest_first, axis=0),
            brightness=message.index.take(brightest_first),
            frame_no=message.frame_no,
            exposure_s=exposure_s,
            time_us=message.time_us,
            temperature_c=temperature_c,
            flags=message.flags,
            host_utc_ns=host_utc_ns if self._anchor_utc_ns is None else 0,
            sequence=max(frame.sequence, 0),  # a frame without a number has -1
            problems=message.problems,
            wire_rows=brightest_first,
        )

    def _own_answer(self, message: AttitudeMessage, frame: Frame, host_utc_ns: int, mono_ns: int) -> OwnAnswer:
        """The UTC of its exposure is that of its panorama; a sensor without panoramas is given one by its time tag.

        Its answer comes later than the exposure by the time that it states for its processing.
        """
        utc_ns = None
        if not self._protocol.slots:
            processing_s = message.latency_s if 0 <= message.latency_s <= LONGEST_EXPOSURE_S else 0.0
            utc_ns = self._utc_of(message, 2 * processing_s, host_utc_ns, mono_ns)
            utc_ns = min(max(utc_ns, 0), LAST_NS)
            self._latest_utc_ns = max(self._latest_utc_ns, utc_ns)
        host_utc_ns = host_utc_ns if self._anchor_utc_ns is None else 0
        return OwnAnswer(message, host_utc_ns, utc_ns, max(frame.sequence, 0))

    def _utc_of(self, message: PanoramaMessage | AttitudeMessage, exposure_s: float, utc_ns: int, mono_ns: int) -> int:
        """UTC of a time tag that came half of ``exposure_s`` and a byte before its frame was read."""
        if self._anchor_utc_ns is None:
            # A panorama whose exposure is out of order is placed where its first byte came.
            half_ns = 0 if math.isnan(exposure_s) else round(exposure_s * NS_PER_S / 2)
            arrived_ns = mono_ns - self._byte_ns - half_ns
            return self._clock.utc_ns(message.time_us, arrived_mono_ns=arrived_ns, utc_minus_mono_ns=utc_ns - mono_ns)
        return self._anchored_utc_ns(message.time_us)

    def _anchored_utc_ns(self, time_us: int) -> int:
        assert self._anchor_utc_ns is not None
        latest_ns = max(self._anchor_utc_ns, self._latest_utc_ns)
        if self._anchor_time_us is not None:
            utc_ns = self._anchor_utc_ns + (time_us - self._anchor_time_us) * 1000
            if utc_ns <= min(latest_ns + LONGEST_PAUSE_NS, LAST_NS):
                return utc_ns
        self._anchor_utc_ns, self._anchor_time_us = latest_ns, time_us
        return latest_ns


def _an_instant(stamp_ns: int) -> int:
    """A stamp within what an instant can be."""
    return min(max(stamp_ns, 0), LAST_NS)


def _went_with_utc(before: tuple[int, int, int | None], now: tuple[int, int, int | None]) -> bool:
    """Whether the sensor's clock went on as UTC did, not as the monotonic clock; stamps and tags of two frames."""
    if before[2] is None or now[2] is None or now[2] < before[2]:
        return False
    tag_ns = now[2] - before[2]
    return abs(tag_ns - (now[0] - before[0])) < abs(tag_ns - (now[1] - before[1]))


def _chaos_in_words(sequence: int, before: int | None) -> str:
    if sequence == before:
        return f"frame {sequence} on the wire follows another frame {before}: its sequence number stands still"
    return (
        f"frame {sequence} on the wire follows frame {before}: more than can have been sent in the time between; its "
        "sequence number makes no sense, and no frames count as lost"
    )


def _step_in_words(step_ns: int, utc_kept: bool) -> str:
    step_s = step_ns / NS_PER_S
    if not utc_kept:
        return f"the host's UTC clock stepped by {step_s:+.3f} s"
    if step_ns > 0:
        return (
            f"the host was suspended: its monotonic clock stood still for {step_s:.3f} s, in which UTC and "
            "the sensor's clock went on"
        )
    return f"the host's monotonic clock leapt by {-step_s:+.3f} s; UTC and the sensor's clock did not"
