"""Arrivals: duplicates, losses and restarts by the frames' sequence numbers, and steps of the host's clock.

**Sequence numbers** tell duplicates (dropped, counted), gaps (frames lost) and restarts. A restart is also told by a
time tag of a panorama that jumps back, or by the sensor's own flag: an event SENSOR_RESET. Time tags of other messages
are not asked: a STATUS may carry a later one than the panorama behind it. Frames marked as stored are older than what
came before them and never look like a restart.

**Steps of UTC.** Where the offset UTC - monotonic moves by 5 ms or more between two frames, the UTC clock was stepped,
not slewed: an event CLOCK_STEP. Frames around it are left out of the statistics, see ``gse.station.exclusions``. Where
the sensor's clock went along with UTC, by a second or more, UTC was right: a host that is suspended stops its monotonic
clock.
"""

from collections import deque

from drivers.chunk import LinkEvent
from gse.instant import NS_PER_S, bounded
from gse.station.byte_stream import FrameAt
from gse.station.event_kinds import ClockStep, StationKind
from gse.station.results import LinkCounters
from protocols import Arrival, Frame, Protocol, SequenceTracker
from protocols.sequence import RECENT

CLOCK_STEP_NS = 5_000_000
"""UTC that moves this much against the monotonic clock between two frames was stepped, not slewed."""
_SLEWED_SHARE, _SLEWED_MOST_NS = 1000, NS_PER_S // 20
"""And by a thousandth of the time between them, at most: Linux slews by 500 ppm beside a frequency of up to 500."""

SHORTEST_SUSPENSION_NS = NS_PER_S
"""Steps that are smaller are always those of UTC: time tags and arrivals do not tell."""

FROZEN_AFTER = 3
"""Copies of one panorama with no other between them: no line makes so many."""

_Stamped = tuple[int, int, int | None]
"""UTC and monotonic time of a frame as they came, and its time tag in ns, None without one."""


class Arrivals:
    """Classifies the frames of a stream, in their order; ``has_times`` where the host's stamps mean something.

    ``others_lost`` of the lost frames were certainly no panoramas.
    """

    def __init__(self, protocol: Protocol, counters: LinkCounters, *, has_times: bool) -> None:
        self._protocol = protocol
        self._counters = counters
        self._has_times = has_times
        self._sequence = SequenceTracker(protocol.sequence_modulus)
        self._latest: deque[bytes] = deque(maxlen=RECENT)
        self._before: _Stamped | None = None
        self._frame_mono_ns: int | None = None
        self._repeats = 0
        self._panorama_before: tuple[int, int] | None = None
        self._resets = 0
        self.others_lost = 0

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
        if self._has_times and self._frame_mono_ns is not None:
            elapsed_s = (mono_ns - self._frame_mono_ns) / NS_PER_S
        if frame.flags and "stored" in self._protocol.flags_of(frame):
            time_us, restarted = None, False
        # What bears a number again need not be a copy: that has the same bytes as one of the latest frames.
        arrival = self._sequence.accept(
            frame.sequence,
            time_us=time_us,
            restarted=restarted,
            elapsed_s=elapsed_s,
            is_copy=lambda: frame.payload in self._latest,
        )
        self._latest.append(frame.payload)
        if arrival is not Arrival.DUPLICATE:
            self._frame_mono_ns = mono_ns
        self._counters.duplicates = self._sequence.duplicates
        self._counters.frames_lost = self._sequence.lost
        self._counters.sensor_resets = self._sequence.resets
        return arrival

    @property
    def last(self) -> int | None:
        """The sequence number of the latest frame; None before the first."""
        return self._sequence.last

    def new_panorama(self, frame_no: int) -> None:
        """A panorama came that is not a copy.

        Frames of all types share their sequence numbers, so a gap does not say what is lost. But each exposure has a
        number: between panoramas of consecutive ones no panorama is lost.
        """
        self._repeats = 0
        lost, before = self._sequence.lost, self._panorama_before
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
    return (
        f"frame {sequence} on the wire follows frame {before}: more than can have been sent in the time between; its "
        "sequence number makes no sense, and no frames count as lost"
    )


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
