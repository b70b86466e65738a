"""State of the link, from its events and bytes.

    NO_PORT     there is no port
    WAITING     the port is open, nothing has come
    SYNCING     bytes come, valid frames do not
    STREAMING   valid frames come
    STALE       frames came, now nothing does

The states depend on the stamps of the data alone: how chunks are cut, and how often ``pass_time`` is called, changes
neither the changes of state nor their times. A state that ends by silence ends when the silence has lasted SILENCE_S,
even if that is noticed later. A slow sensor may be silent for longer: until two of its frames should have come.
"""

from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import pairwise
from operator import lt, sub

from drivers.chunk import NS_PER_S, Chunk, LinkEvent, LinkKind

UNKNOWN = ""
"""The state before the first event or byte: a simulated port has no event OPENED."""

SILENCE_S = 3.0
"""The slowest sensor known exposes for 2 s."""
_SILENCE_NS = round(SILENCE_S * NS_PER_S)
_LAST_FRAMES = 8
_IN_INTERVALS = 2
"""Intervals between frames for which a slow sensor may be silent."""
SAMPLE_BYTES = 4096
FEW_VALUES = 16
"""A line read with a much too high baud rate gives few byte values, a frame of any protocol many more."""
LOAD_S = 5.0
"""Stretch over which the bytes of a line are counted: an adapter that holds bytes back for 16 ms changes little."""
_FULL, _BEYOND = 0.95, 1.03
"""Shares of what a line carries: clocks of two ends differ by 2 %, and what carries more than that is no such line."""
_NO_START = {"no sync", "truncated"}
_SYNCING = LinkKind.SYNCING  # a look into an enumeration takes a fifth of the time of a chunk here
_BYTES_COME = (LinkKind.SYNCING, LinkKind.STREAMING)


class LinkMonitor:
    """State machine, fed with every event of the link, and every chunk with its frames and reasons of discards.

    Each call returns the changes of state as events with their times; also ``SILENT`` once per silence, and
    ``NO_FRAMES`` with the probable cause once per stretch of unreadable bytes. ``explain`` says what some such bytes
    are, as far as they tell. Of a line that carries ``bytes_per_s``, ``LINE_FULL`` comes once, where valid frames come
    as fast as that in two stretches of LOAD_S that follow each other: the first may have bytes that waited before it.
    """

    def __init__(
        self,
        baudrate: int,
        *,
        explain: Callable[[bytes], str] = lambda sample: "",
        bytes_per_s: float | None = None,
    ) -> None:
        self.state = UNKNOWN
        self._baudrate = baudrate
        self._explain = explain
        self._load = None if bytes_per_s is None else _Load(bytes_per_s)
        self._frames_ns: deque[int] = deque(maxlen=_LAST_FRAMES)
        self._utc_minus_mono_ns = 0
        self._now_ns = 0
        self._bytes_ns = 0
        self._since_ns = 0
        self._silence_reported = False
        self._sample = bytearray()
        self._unframed_bytes = 0
        self._reasons: set[str] = set()

    def port_event(self, event: LinkEvent) -> list[LinkEvent]:
        """Process an event of the port: opened or lost."""
        changes = self.pass_time(event.utc_ns, event.mono_ns)
        if event.kind in (LinkKind.LOST, LinkKind.NO_PORT):
            self._frames_ns.clear()
            changes += self._change(LinkKind.NO_PORT, event.mono_ns, event.text)
        elif event.kind in (LinkKind.OPENED, LinkKind.REOPENED):
            changes += self._change(LinkKind.WAITING, event.mono_ns, event.text)
        return changes

    def received(self, chunk: Chunk, frames: int, reasons: Collection[str]) -> list[LinkEvent]:
        """Process a chunk, the number of valid frames that it completed, and the reasons of its discards."""
        changes = self.pass_time(chunk.utc_ns, chunk.mono_ns)
        changes += self._weighed(chunk)
        self._bytes_ns = chunk.mono_ns
        if self.state not in _BYTES_COME:
            changes += self._change(LinkKind.SYNCING, chunk.mono_ns, "bytes come")
        if frames:
            changes += self._change(LinkKind.STREAMING, chunk.mono_ns, "valid frames come")
            self._begin(chunk.mono_ns)
            self._frames_ns.append(chunk.mono_ns)
        elif self.state == _SYNCING or chunk.mono_ns > self._since_ns:
            # Bytes with the time of a frame may belong to the frame's own chunk.
            self._unframed_bytes += len(chunk.data)
            self._sample += chunk.data[: SAMPLE_BYTES - len(self._sample)]
            self._reasons.update(reasons)
        return changes

    def received_all(
        self, chunks: Sequence[Chunk], framed: Sequence[int], reasons: Mapping[int, Collection[str]]
    ) -> list[tuple[int, LinkEvent]]:
        """Process chunks that came together, each as by ``received``; each change has the place of its chunk.

        ``framed`` are the places of chunks that completed frames, in order; ``reasons`` are by place.
        """
        first = self._steady(chunks, framed)
        completed = set(framed)
        steady = chunks[:first] if self._load else ()
        full = [(k, change) for k, chunk in enumerate(steady) for change in self._weighed(chunk)]
        return full + [
            (k, change)
            for k in range(first, len(chunks))
            for change in self.received(chunks[k], k in completed, reasons.get(k, ()))
        ]

    def _steady(self, chunks: Sequence[Chunk], framed: Sequence[int]) -> int:
        """Process the chunks up to the last valid frame where no change can be among them; how many those are.

        So it nearly always is, and a look at each of them takes a tenth of a replay's time.
        """
        if not framed or self.state != LinkKind.STREAMING:
            return 0
        begun = chunks[: framed[-1] + 1]
        mono_ns = [chunk.mono_ns for chunk in begun]
        frames_ns = [mono_ns[k] for k in dict.fromkeys(framed)]
        pauses_ns = map(sub, frames_ns, [self._since_ns, *frames_ns])
        if any(map(lt, mono_ns, [self._now_ns, *mono_ns])) or max(pauses_ns) > _SILENCE_NS:
            return 0
        self._utc_minus_mono_ns = begun[-1].utc_ns - begun[-1].mono_ns
        self._now_ns = self._bytes_ns = mono_ns[-1]
        self._begin(mono_ns[-1])
        self._frames_ns += frames_ns
        return len(begun)

    def pass_time(self, utc_ns: int, mono_ns: int) -> list[LinkEvent]:
        """Changes of state by the time without bytes."""
        self._utc_minus_mono_ns = utc_ns - mono_ns
        if mono_ns < self._now_ns:
            # The host was restarted, and its monotonic clock with it: the intervals start again.
            self._bytes_ns = self._since_ns = mono_ns
            self._frames_ns.clear()
        self._now_ns = mono_ns
        changes: list[LinkEvent] = []
        if mono_ns <= self._since_ns + _SILENCE_NS and self.state != _SYNCING:
            return changes
        patience_ns = self._patience_ns
        due_ns = self._since_ns + patience_ns
        if mono_ns > due_ns and not self._silence_reported:
            changes += self._silence_changes(due_ns)
        if self.state == _SYNCING and mono_ns > self._bytes_ns + patience_ns:
            changes += self._change(LinkKind.STALE, self._bytes_ns + patience_ns, self._nothing_comes())
        return changes

    @property
    def _patience_ns(self) -> int:
        """How long this sensor may be silent between frames: one long silence is an outage, two are its way."""
        *_, second, _ = [0, 0, *sorted(after - before for before, after in pairwise(self._frames_ns))]
        return max(_SILENCE_NS, _IN_INTERVALS * second)

    @property
    def _patience_s(self) -> float:
        return self._patience_ns / NS_PER_S

    def _weighed(self, chunk: Chunk) -> list[LinkEvent]:
        """The event, once, where the line has been full up to a chunk."""
        if self._load is None:
            return []
        carried = self._load.bytes_per_s
        came = self._load.came(chunk, streams=self.state == LinkKind.STREAMING)
        if came is None:
            return []
        self._load = None
        text = (
            f"the line carries {carried:,.0f} bytes/s at {self._baudrate} baud and {came:,.0f} arrive: frames may wait "
            "or be left out at the sensor; raise the baud rate or send less"
        )
        return [LinkEvent(chunk.utc_ns, chunk.mono_ns, LinkKind.LINE_FULL, text)]

    def _silence_changes(self, due_ns: int) -> list[LinkEvent]:
        if self.state == LinkKind.STREAMING and self._unframed_bytes == 0:
            return self._change(LinkKind.STALE, due_ns, self._nothing_comes())
        self._silence_reported = True
        if self.state == LinkKind.WAITING:
            text = (
                f"the port is open, but no bytes for {self._patience_s:g} s: check the sensor; one that waits "
                "for a command is asked with `sensor: {start: {period_ms: 100}}` or `poll` in the station file; if "
                "it is another sensor's port, 'gse ports' shows names that stay"
            )
            return [self._event(LinkKind.SILENT, due_ns, text)]
        if self.state == LinkKind.SYNCING:
            return [self._event(LinkKind.NO_FRAMES, due_ns, self._why_no_frames())]
        if self.state == LinkKind.STREAMING:
            self.state = LinkKind.SYNCING
            return [self._event(LinkKind.SYNCING, due_ns, self._why_no_frames())]
        return []

    def _begin(self, mono_ns: int) -> None:
        """Restart the intervals: since the port was opened, since bytes come, since the last frame."""
        self._since_ns = mono_ns
        self._silence_reported = False
        self._sample.clear()
        self._unframed_bytes = 0
        self._reasons.clear()

    def _change(self, state: str, mono_ns: int, text: str) -> list[LinkEvent]:
        if state == self.state:
            return []
        self.state = state
        self._begin(mono_ns)
        return [self._event(state, mono_ns, text)]

    def _event(self, kind: str, mono_ns: int, text: str) -> LinkEvent:
        return LinkEvent(mono_ns + self._utc_minus_mono_ns, mono_ns, kind, text)

    def _nothing_comes(self) -> str:
        return f"nothing comes any more: no bytes for {self._patience_s:g} s"

    def _why_no_frames(self) -> str:
        head = f"{self._unframed_bytes} bytes in {self._patience_s:g} s, but no valid frame: "
        if explained := self._explain(bytes(self._sample)):
            return head + explained
        if reasons := sorted(self._reasons - _NO_START):
            return head + f"frames begin, but none is whole ({', '.join(reasons)}); noise, or another protocol?"
        if len(set(self._sample)) <= FEW_VALUES < len(self._sample):
            return head + f"wrong baud rate: it looks as if the sensor is much slower than {self._baudrate}"
        return head + (
            f"the baud rate is wrong ({self._baudrate} here), or the protocol is another one; gse preflight tries the "
            "usual rates"
        )


class _Load:
    """Bytes of a line in stretches of LOAD_S, each from a chunk to before one with another stamp."""

    def __init__(self, bytes_per_s: float) -> None:
        self.bytes_per_s = bytes_per_s
        self._from_ns = self._bytes = 0
        self._before: tuple[int, int] | None = None
        """Time and bytes of the stretch before, where that was full."""

    def came(self, chunk: Chunk, *, streams: bool) -> float | None:
        """The bytes of a second up to a chunk that ends the second of two full stretches; else None."""
        took_ns = chunk.mono_ns - self._from_ns
        if streams and 0 <= took_ns < LOAD_S * NS_PER_S:
            self._bytes += len(chunk.data)
            return None
        carried = self.bytes_per_s * took_ns / NS_PER_S
        is_full = streams and took_ns > 0 and _FULL * carried <= self._bytes <= _BEYOND * carried
        this, before = (took_ns, self._bytes), self._before
        self._before = this if is_full else None
        self._from_ns, self._bytes = chunk.mono_ns, len(chunk.data)
        return (this[1] + before[1]) * NS_PER_S / (this[0] + before[0]) if is_full and before else None
