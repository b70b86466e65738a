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
``Arrivals`` finds steps of that offset, restarts of the sensor, and copies. After a restart, and where a
host that was suspended stopped its monotonic clock, the differences begin anew.

**Raw captures** have no host times. With ``anchor_utc_ns`` the first panorama has that instant, and the others follow
by the sensor's clock. Where this clock starts anew, or leaps by a year, it goes on from the latest panorama: a restart
never turns time back.

Objects leave here brightest first, equal ones in the order of the wire. Nothing is judged: a panorama with impossible
values keeps its ``problems`` and becomes a SENSOR_FAULT later.
"""

import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkEvent, LinkKind
from drivers.uart import BITS_PER_BYTE
from gse.station.byte_stream import ByteStream, FrameAt
from gse.station.events import ClockStep, StationKind
from gse.station.host_clock import ClockWitness
from gse.station.housekeeping import NO_ITEMS, FrameWithItems, ItemReader
from gse.station.polling import Polling
from gse.station.results import LinkCounters, OwnAnswer
from gse.values.instant import LAST_NS, NS_PER_S, bounded
from gse.values.panorama import MAX_OBJECTS, Panorama, Panoramas, Parts
from gse.values.sensor_time import to_middle_us, utc_ns_of
from protocols import (
    Ack,
    Arrival,
    AttitudeMessage,
    Frame,
    Message,
    Nak,
    PanoramaColumns,
    Protocol,
    SequenceTracker,
    StarsMessage,
    StatusMessage,
)
from protocols.description import TimeDescription
from protocols.parts import PART
from protocols.sequence import RECENT

# The sensor's clock against the host's: UTC of an exposure from the sensor's own time tag.
#
# A first byte is read some 0.1-20 ms late, never early; the sensor's tag has no such jitter. So the least (host -
# sensor) difference of the last frames is the clock offset, and the tag gives the time. Differences are taken on the
# host's monotonic clock: a step of its UTC clock moves no frame against another.

WINDOW_FRAMES = 200
"""Frames that the least difference is taken over: good to some 30 us."""

WINDOW_NS = 30 * NS_PER_S
"""Nothing older counts: a sensor clock that drifts by 50 ppm moves 1.5 ms in this time."""


class SensorClock:
    """Turns the sensor's time tags into UTC, from what was seen up to now."""

    def __init__(self) -> None:
        self._least: deque[tuple[int, int, int]] = deque()
        self._count = 0

    def reset(self) -> None:
        """Forget all: the sensor's clock has started anew."""
        self._least.clear()

    def utc_ns(self, time_us: int, *, arrived_mono_ns: int, utc_minus_mono_ns: int) -> int:
        """UTC of a time tag whose event would have been seen at ``arrived_mono_ns`` or a little before."""
        sensor_ns = time_us * 1000
        difference = arrived_mono_ns - sensor_ns
        while self._least and self._least[-1][0] >= difference:
            self._least.pop()
        self._least.append((difference, self._count, sensor_ns))
        self._count += 1
        while self._least[0][1] < self._count - WINDOW_FRAMES or self._least[0][2] < sensor_ns - WINDOW_NS:
            self._least.popleft()
        return sensor_ns + self._least[0][0] + utc_minus_mono_ns


# Arrivals: duplicates, losses and restarts by the frames' sequence numbers, and steps of the host's clock.
#
# **Sequence numbers** tell duplicates (dropped, counted), gaps (frames lost) and restarts. A restart is also told by a
# time tag of a panorama that jumps back, or by the sensor's own flag: an event SENSOR_RESET. Time tags of other
# messages are not asked: a STATUS may carry a later one than the panorama behind it. Frames marked as stored are older
# than what came before them and never look like a restart.
#
# **Steps of UTC.** Where the offset UTC - monotonic moves by 5 ms or more between two frames, the UTC clock was
# stepped, not slewed: an event CLOCK_STEP. Frames around it are left out of the statistics, see
# ``gse.station.exclusions``. Where the sensor's clock went along with UTC, by a second or more, UTC was right: a host
# that is suspended stops its monotonic clock.

CLOCK_STEP_NS = 5_000_000
"""UTC that moves this much against the monotonic clock between two frames was stepped, not slewed."""
_SLEWED_SHARE, _SLEWED_MOST_NS = 1000, NS_PER_S // 20
"""Slewing may add a thousandth of the time between the frames, and 50 ms at most: Linux slews by 500 ppm, on top of a
frequency that it corrects by up to 500 ppm."""

SHORTEST_SUSPENSION_NS = NS_PER_S
"""Steps that are smaller are always those of UTC: time tags and arrivals do not tell."""

FROZEN_AFTER = 3
"""Copies of one panorama with no other between them: no line makes so many."""

_Stamped = tuple[int, int, int | None]
"""UTC and monotonic time of a frame as they came, and its time tag in ns, None without one."""


class Arrivals:
    """Classifies the frames of a stream, in their order; ``has_times`` where the host's stamps mean something.

    ``others_lost`` of the lost frames were certainly no panoramas; ``before`` is the number before that of the latest.
    """

    def __init__(self, protocol: Protocol, counters: LinkCounters, *, has_times: bool) -> None:
        self._protocol = protocol
        self._counters = counters
        self._has_times = has_times
        self._trackers: dict[str, SequenceTracker] = {}
        self._sequence = self._tracker("")
        self._latest: deque[bytes] = deque(maxlen=RECENT)
        self._before: _Stamped | None = None
        self._frame_mono_ns: dict[SequenceTracker, int] = {}
        self._repeats = 0
        self._panorama_before: tuple[int, int] | None = None
        self._resets = 0
        self.others_lost = 0
        self.before: int | None = None

    def _tracker(self, type_name: str) -> SequenceTracker:
        """What counts the frames of a type: one for all, but where the protocol counts each message by itself."""
        name = type_name if self._protocol.counts_each_message else ""
        if name not in self._trackers:
            self._trackers[name] = SequenceTracker(self._protocol.sequence_modulus, self._protocol.sequence_step)
        return self._trackers[name]

    def clock_step(self, at: FrameAt, time_us: int | None) -> ClockStep | None:
        """The step since the frame before, by the stamps as they came: stamps that no clock has may stand still.

        ``time_us`` is the sensor's time, None where the message has none: it tells a step of UTC from a host that was
        suspended.
        """
        now = at.utc_ns, at.mono_ns, None if time_us is None else time_us * 1000
        before, self._before = self._before, now
        if before is None or not self._has_times:
            return None
        step_ns = at.utc_ns - at.mono_ns - (before[0] - before[1])
        slewed_ns = min(max(at.mono_ns - before[1], 0) // _SLEWED_SHARE, _SLEWED_MOST_NS)
        if abs(step_ns) < CLOCK_STEP_NS + slewed_ns:
            return None
        utc_kept = abs(step_ns) >= SHORTEST_SUSPENSION_NS and _went_with_utc(before, now)
        stamp = bounded(at.utc_ns), bounded(at.mono_ns)
        return ClockStep(*stamp, StationKind.CLOCK_STEP, _step_in_words(step_ns, utc_kept), step_ns, utc_kept)

    def accept(self, frame: Frame, mono_ns: int, time_us: int | None, *, restarted: bool) -> Arrival:
        """Classify a frame, counted; ``time_us`` is that of an exposure, ``restarted`` the sensor's own word."""
        elapsed_s = None
        if self._protocol.counts_each_message:
            self._sequence = self._tracker("PANORAMA" if frame.type == PART else frame.type)
        self.before = self._sequence.last
        before_ns = self._frame_mono_ns.get(self._sequence)
        if self._has_times and before_ns is not None:
            elapsed_s = (mono_ns - before_ns) / NS_PER_S
        if frame.flags and "stored" in self._protocol.flags_of(frame):
            time_us, restarted = None, False
        # A number that came before does not prove a copy: a copy has the same bytes as one of the latest frames.
        arrival = self._sequence.accept(
            frame.sequence,
            time_us=time_us,
            restarted=restarted,
            elapsed_s=elapsed_s,
            is_copy=lambda: frame.payload in self._latest,
        )
        self._latest.append(frame.payload)
        if arrival is not Arrival.DUPLICATE:
            self._frame_mono_ns[self._sequence] = mono_ns
        if arrival is Arrival.RESET:
            for tracker in self._trackers.values():
                if tracker is not self._sequence:
                    tracker.start_anew()
        trackers = self._trackers.values()
        self._counters.duplicates = sum(of.duplicates for of in trackers)
        self._counters.frames_lost = sum(of.lost for of in trackers)
        self._counters.sensor_resets = sum(of.resets for of in trackers)
        return arrival

    def start_anew(self) -> None:
        """The sensor is known to have started anew: its supply was switched on."""
        for tracker in self._trackers.values():
            tracker.start_anew()
        self._latest.clear()
        self._panorama_before = None

    def new_panorama(self, frame_no: int) -> None:
        """A panorama came that is not a copy.

        Frames of all types share their sequence numbers, so a gap does not say what is lost. But each exposure has a
        number: between panoramas of consecutive ones no panorama is lost.
        """
        self._repeats = 0
        lost, before = self._counters.frames_lost, self._panorama_before
        if before is not None and before[0] < frame_no and self._counters.sensor_resets == self._resets:
            exposures = frame_no - before[0] - 1
            self.others_lost += max(lost - before[1] - exposures, 0)
        self._panorama_before, self._resets = (frame_no, lost), self._counters.sensor_resets

    def repeated(self, frame: Frame, frame_no: int, utc_ns: int, mono_ns: int) -> list[LinkEvent]:
        """Count a panorama that came before; an event where nothing else comes any more.

        A line that doubles frames goes on with new ones. The copies of a frozen sensor stand where new panoramas are
        expected, so they count as missing.
        """
        if frame.sequence != self._sequence.last:
            return []
        self._repeats += 1
        if self._repeats < FROZEN_AFTER:
            return []
        self._counters.frames_repeated += FROZEN_AFTER if self._repeats == FROZEN_AFTER else 1
        if self._repeats > FROZEN_AFTER:
            return []
        text = f"the sensor repeats panorama {frame_no}, byte for byte, instead of new ones: it is frozen"
        return [LinkEvent(utc_ns, mono_ns, StationKind.FROZEN, text)]


def chaos_in_words(sequence: int, before: int | None) -> str:
    """Why a sequence number makes no sense after the one before."""
    if sequence == before:
        return f"frame {sequence} on the wire follows another frame {before}: its sequence number stands still"
    if before is not None and (bits := _bits_that_count(before, sequence)):
        return (
            f"frame {sequence} on the wire follows frame {before}: its lowest {bits} bits count on, those above stand "
            f"still; give the sequence number `mask: 0x{(1 << bits) - 1:X}` in the protocol description"
        )
    return (
        f"frame {sequence} on the wire follows frame {before}: more than can have been sent in the time between; its "
        "sequence number makes no sense, and no frames count as lost"
    )


def _bits_that_count(before: int, sequence: int) -> int:
    """How many of the lowest bits wrapped from one number to the next while those above stood still; 0 for none."""
    wrapped = range(before.bit_length() - 1, 3, -1)
    return next((n for n in wrapped if before >> n == sequence >> n and (before + 1) % 2**n == sequence % 2**n == 0), 0)


def _went_with_utc(before: _Stamped, now: _Stamped) -> bool:
    """Whether the sensor's clock went on as UTC did, not as the monotonic clock."""
    if before[2] is None or now[2] is None or now[2] < before[2]:
        return False
    tag_ns = now[2] - before[2]
    return abs(tag_ns - (now[0] - before[0])) < abs(tag_ns - (now[1] - before[1]))


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


NOT_LOCKED = "clock not locked"
"""The status bit of an absolute clock that is none at the time."""
LONGEST_EXPOSURE_S = 3600.0
HOTTEST_C = 1e6
"""Larger numbers of the sensor are invalid."""

LONGEST_PAUSE_NS = 366 * 86_400 * NS_PER_S
"""A sensor clock that is this far ahead of the panorama before is out of order: no capture pauses for a year."""

_TEST_STREAM = "the frames say that they come from no detector: an emulator is at work, and the session is a simulation"
HostedStatus = tuple[int, StatusMessage]
"""The host's UTC at which a STATUS was complete, and its message."""

News = OwnAnswer | HostedStatus | StarsMessage | Ack | Nak | LinkEvent
"""Everything that comes beside panoramas."""


@dataclass(frozen=True, slots=True)
class Received:
    """What some frames brought: panoramas, and news in their order, each with the number of panoramas before it.

    ``items`` are the values of housekeeping, rows of ITEM.
    """

    news: Sequence[tuple[int, News]]
    panoramas: Panoramas
    items: NDArray[np.void] = field(default_factory=lambda: NO_ITEMS)

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

    def __init__(
        self,
        protocol: Protocol,
        *,
        baudrate: int,
        bits_per_byte: float = BITS_PER_BYTE,
        anchor_utc_ns: int | None = None,
        asks: bool = False,
        timeout_ns: int | None = None,
        time: TimeDescription | None = None,
    ) -> None:
        """``asks`` where the station sends commands, ``timeout_ns`` where it polls, after which an answer is late."""
        self.counters = LinkCounters()
        self.stream = ByteStream(protocol, self.counters, echoes=asks)
        self._items = ItemReader(protocol)
        self._polling = Polling(protocol, self.counters, timeout_ns)
        self._protocol = protocol
        self._panorama_type = "PANORAMA" if protocol.slots else ""
        self._byte_ns = round(bits_per_byte * NS_PER_S) // baudrate
        self._clock = SensorClock()
        self._time = time or protocol.time
        delay = self._time.delay_ms
        self._delay_s = (delay.value or 0.0) / 1000 if delay else 0.0
        self._witness = ClockWitness(self._time)
        self.is_unlocked = False
        self._arrivals = Arrivals(protocol, self.counters, has_times=anchor_utc_ns is None)
        self._anchor_utc_ns = anchor_utc_ns
        self._anchor_time_us: int | None = None
        self._latest_utc_ns = 0
        self._is_test = False

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
        with_items: list[FrameWithItems] = []
        row = 0
        for item in stream:
            if isinstance(item, LinkEvent):
                found = self._polling.sent(item) if item.kind == LinkKind.SENT else [item]
                if item.kind == StationKind.POWER_ON:
                    self._arrivals.start_anew()
                    self._clock.reset()
                news += [(len(made), event) for event in found]
            elif columns is not None and item.frame.type == self._panorama_type:
                before = len(made)
                if events := self._panorama(item, columns, row, made):
                    news += [(before, event) for event in events]
                row += 1
                if self._panorama_type in self._items.types and len(made) > before:
                    with_items.append(self._with_items(item, len(news), before))
            else:
                others, is_copy = self._other(item, self._protocol.decode(item.frame))
                news += [(len(made), found) for found in others]
                if item.frame.type in self._items.types and not is_copy:
                    with_items.append(self._with_items(item, len(news), len(made)))
        for echo in self.stream.latest_echoes:
            at_ns = (bounded(stream[-1].utc_ns), bounded(stream[-1].mono_ns)) if stream else (0, 0)
            news += [(len(made), event) for event in self._polling.echoed(echo.data, *at_ns)]
        items, events_of_items = self._items.read(with_items) if with_items else (NO_ITEMS, [])
        for frame, event in reversed(events_of_items):
            news.insert(frame.place, (frame.before, event))
        return Received(news, _columns(columns, made) if columns and made else Panoramas.from_panoramas([]), items)

    def _with_items(self, at: FrameAt, place: int, before: int) -> FrameWithItems:
        """A frame with items, at the host time at which it was complete."""
        utc_ns = at.completed_utc_ns
        if self._anchor_utc_ns is not None:  # host times mean nothing
            utc_ns = max(self._anchor_utc_ns, self._latest_utc_ns)
        return FrameWithItems(at.frame.type, at.frame.payload, bounded(utc_ns), bounded(at.mono_ns), place, before)

    def _panorama(self, at: FrameAt, columns: PanoramaColumns, row: int, made: list["_Made"]) -> list[LinkEvent]:
        """The events before a panorama, row ``row`` of its block; one that is not a copy is appended to ``made``."""
        time_us, host_utc_ns, mono_ns = columns.time_us[row], bounded(at.utc_ns), bounded(at.mono_ns)
        if self._time.scale == "host":
            time_us = bounded(at.utc_ns if self._anchor_utc_ns is None else self._anchor_utc_ns) // 1000
        events = self._steps(at, time_us)
        restarted = "clock reset" in columns.flags[row]
        if self._arrived(at, host_utc_ns, mono_ns, time_us, events, restarted=restarted) is Arrival.DUPLICATE:
            return events + self._arrivals.repeated(at.frame, columns.frame_no[row], host_utc_ns, mono_ns)
        self._arrivals.new_panorama(columns.frame_no[row])
        self._polling.answered(mono_ns)
        # Invalid numbers (NaN, infinity, an age) are listed in the panorama's problems.
        exposure_s = columns.exposure_s[row]
        exposure_s = exposure_s if 0 <= exposure_s <= LONGEST_EXPOSURE_S else math.nan
        delay_s = self._delay_s
        if columns.processing_s is not None and 0 <= columns.processing_s[row] <= LONGEST_EXPOSURE_S:
            delay_s = columns.processing_s[row]
        middle_us = time_us + to_middle_us(self._time, exposure_s, delay_s)
        if self._time.is_absolute and NOT_LOCKED not in columns.flags[row]:
            utc_ns = bounded(utc_ns_of(middle_us, self._time))
            if self._anchor_utc_ns is None:
                left_ns = utc_ns + round((delay_s + (0.0 if math.isnan(exposure_s) else exposure_s / 2)) * NS_PER_S)
                events += self._witness.saw(host_utc_ns - self._byte_ns - left_ns, host_utc_ns, mono_ns)
        else:
            self.is_unlocked |= self._time.is_absolute
            after_s = exposure_s + 2 * delay_s
            utc_ns = bounded(self._utc_of(middle_us, after_s, host_utc_ns, mono_ns))
        self._latest_utc_ns = max(self._latest_utc_ns, utc_ns)
        host_utc_ns = host_utc_ns if self._anchor_utc_ns is None else 0
        objects = int(columns.first[row + 1] - columns.first[row])
        self.counters.objects_beyond += max(objects - MAX_OBJECTS, 0)
        made.append((row, utc_ns, host_utc_ns, max(at.frame.sequence, 0), exposure_s, time_us))
        return events

    def _other(self, at: FrameAt, message: Message) -> tuple[list[News], bool]:
        """The news of any other frame, and whether it is a copy of one that came before."""
        host_utc_ns, mono_ns = bounded(at.utc_ns), bounded(at.mono_ns)
        events = self._steps(at, message.time_us if isinstance(message, StatusMessage | AttitudeMessage) else None)
        # Only time tags of exposures show a restart.
        time_tag = message.time_us if isinstance(message, AttitudeMessage) and not self._panorama_type else None
        kind = self._arrived(at, host_utc_ns, mono_ns, time_tag, events, restarted=False)
        news: list[News] = [*events]
        if kind is Arrival.DUPLICATE:
            return news, True
        if isinstance(message, AttitudeMessage):
            news.append(self._own_answer(message, at, host_utc_ns, mono_ns))
        elif isinstance(message, StatusMessage):
            news.append((bounded(at.completed_utc_ns), message))
        elif isinstance(message, StarsMessage | Ack | Nak):
            news.append(message)
        return news, False

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
        arrival = self._arrivals.accept(at.frame, mono_ns, time_us, restarted=restarted)
        utc_ns = host_utc_ns if self._anchor_utc_ns is None else max(self._anchor_utc_ns, self._latest_utc_ns)
        may_say = not self._is_test and (at.frame.flags or at.frame.type == "STATUS")
        if may_say and self._protocol.is_test(at.frame):
            self._is_test = True
            events.append(LinkEvent(utc_ns, mono_ns, StationKind.TEST_STREAM, _TEST_STREAM))
        if arrival is Arrival.CHAOS:
            text = chaos_in_words(at.frame.sequence, self._arrivals.before)
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
        if not self._panorama_type and self._time.is_absolute:
            utc_ns = bounded(utc_ns_of(message.time_us, self._time))
        elif not self._panorama_type:
            processing_s = message.latency_s if 0 <= message.latency_s <= LONGEST_EXPOSURE_S else 0.0
            utc_ns = bounded(self._utc_of(message.time_us, 2 * processing_s, host_utc_ns, mono_ns))
        if utc_ns is not None:
            self._latest_utc_ns = max(self._latest_utc_ns, utc_ns)
        host_utc_ns = host_utc_ns if self._anchor_utc_ns is None else 0
        return OwnAnswer(message, host_utc_ns, utc_ns, max(at.frame.sequence, 0))

    def _utc_of(self, time_us: int, exposure_s: float, utc_ns: int, mono_ns: int) -> int:
        """UTC of a time tag that came half of ``exposure_s`` and a byte before its frame was read."""
        if self._time.scale == "host" and self._anchor_utc_ns is None:
            return utc_ns - self._byte_ns - (0 if math.isnan(exposure_s) else round(exposure_s * NS_PER_S / 2))
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


_Made = tuple[int, int, int, int, float, int]
"""A panorama: its row in the block, UTC, host's UTC, sequence number, exposure in s, time tag in us."""


def _columns(columns: PanoramaColumns, made: Sequence[_Made]) -> Panoramas:
    """The panoramas that were made of messages, each with its objects brightest first, equal ones as on the wire."""
    rows, utc_ns, host_utc_ns, sequence, exposure_s, time_us = zip(*made, strict=True)
    counts = np.diff(columns.first)[list(rows)]
    parts = Parts.of_counts(counts)
    wire_rows = np.arange(parts.first[-1]) - np.repeat(parts.first[:-1], counts)
    at = wire_rows + np.repeat(columns.first[list(rows)], counts)
    order = _brightest_first(columns.index.take(at), parts)
    if counts.max(initial=0) > MAX_OBJECTS:
        kept = wire_rows < MAX_OBJECTS  # the place in the panorama is that of the order, too
        order = np.arange(len(at))[order][kept]
        parts = Parts.of_counts(np.minimum(counts, MAX_OBJECTS))
    temperature_c = np.array([columns.temperature_c[row] for row in rows], dtype=np.float64)
    return Panoramas(
        parts,
        columns.xy_px.take(at[order], axis=0),
        columns.index.take(at[order]),
        wire_rows[order],
        np.array(utc_ns, dtype=np.int64),
        np.array(host_utc_ns, dtype=np.int64),
        np.array(time_us, dtype=np.int64),
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
