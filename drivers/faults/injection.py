"""Faults put into a stream of chunks: bytes, then frames, then the port, then the computer."""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import groupby

from drivers.chunk import Chunk, LinkEvent, LinkKind
from drivers.faults.byte_faults import ByteFaults
from drivers.faults.frame_faults import FrameFaults, FrameFinder, Piece
from drivers.faults.options import NS_PER_S, Faults, Outage, Places
from drivers.mock.timestamped_port import Item
from drivers.uart import received_at

_STALL_S = (0.2, 3.0)
_Part = Piece | LinkEvent


def inject(
    items: Iterator[Item], faults: Faults, listening_baud: int, *, device_resets: bool = False
) -> Iterator[Item]:
    """The items with the faults, and an event FAULT before the chunk that each first shows in.

    With ``device_resets`` the device behind the port does the reset itself, and only the event is made here.
    """
    outages = _Outages(faults)
    framed = _framed(_split(_reset(items, faults, device_resets), faults), faults)
    items = (item for parts in framed for item in _joined(passed for part in parts for passed in outages.pass_on(part)))
    items = _stalled(items, faults)
    return items if faults.sensor_baud is None else _misread(items, faults.sensor_baud, listening_baud)


def _fault_event(chunk: Chunk, text: str) -> LinkEvent:
    return LinkEvent(chunk.utc_ns, chunk.mono_ns, LinkKind.FAULT, text)


def _reset(items: Iterator[Item], faults: Faults, device_resets: bool) -> Iterator[Item]:
    """From the reset on, the bytes of the start again, chunk by chunk at the times of the present ones."""
    if faults.reset_after_ns is None:
        yield from items
        return
    start_bytes: deque[bytes] = deque()
    due_ns: int | None = None
    is_reset = False
    for item in items:
        if isinstance(item, LinkEvent):
            yield item
            continue
        due_ns = item.mono_ns + faults.reset_after_ns if due_ns is None else due_ns
        if item.mono_ns >= due_ns and not is_reset:
            is_reset = True
            yield _fault_event(item, "reset: the sensor begins again")
        if not device_resets:
            start_bytes.append(item.data)
            item = Chunk(item.utc_ns, item.mono_ns, start_bytes.popleft()) if is_reset else item
        yield item


def _split(items: Iterator[Item], faults: Faults) -> Iterator[Item]:
    """Chunks cut at random places, each part with the stamps of the whole."""
    places = Places(faults.random("split"), faults.rate("split"))
    offset = 0
    for item in items:
        if isinstance(item, LinkEvent):
            yield item
            continue
        begin = 0
        for place in places.before(offset + len(item.data)):
            if place - offset > begin:
                yield Chunk(item.utc_ns, item.mono_ns, item.data[begin : place - offset])
                begin = place - offset
        yield Chunk(item.utc_ns, item.mono_ns, item.data[begin:])
        offset += len(item.data)


def _framed(items: Iterator[Item], faults: Faults) -> Iterator[list[_Part]]:
    """Faults of bytes and of frames; what one item gives comes together."""
    finder, byte_faults, frame_faults = FrameFinder(faults), ByteFaults(faults), FrameFaults(faults)

    def edited(pieces: list[Piece]) -> Iterator[_Part]:
        for piece in pieces:
            data, texts = byte_faults.edit(piece.offset, piece.chunk.data)
            chunk = Chunk(piece.chunk.utc_ns, piece.chunk.mono_ns, data)
            yield from (_fault_event(chunk, text) for text in texts)
            yield from frame_faults.pass_on(replace(piece, chunk=chunk))
            yield from (_fault_event(chunk, text) for text in frame_faults.texts)
            frame_faults.texts.clear()

    for item in items:
        if isinstance(item, LinkEvent):
            yield [*edited(finder.finish()), item]
        elif item.data:
            yield list(edited(finder.feed(item)))
        else:
            # Time that passes in silence.
            yield [finder.nothing(item)]
    yield [*edited(finder.finish()), *frame_faults.finish()]


class _Outages:
    """Outages of the port; bytes that the sensor sends meanwhile are lost."""

    def __init__(self, faults: Faults) -> None:
        self._waiting = list(faults.outages)
        self._random = faults.random("disconnect")
        self._start_ns: int | None = None
        self._back: LinkEvent | None = None

    def pass_on(self, part: _Part) -> Iterator[_Part]:
        """The part of a piece that is received."""
        if isinstance(part, LinkEvent):
            yield part
            return
        now_ns = part.chunk.mono_ns
        self._start_ns = now_ns if self._start_ns is None else self._start_ns
        if self._back is not None and now_ns < self._back.mono_ns:
            return
        if self._back is not None:
            yield self._back
            self._back = None
        due = next((outage for outage in self._waiting if _is_due(outage, part, self._start_ns)), None)
        if due is None:
            yield part
        else:
            self._waiting.remove(due)
            yield from self._begin(due, part)

    def _begin(self, outage: Outage, piece: Piece) -> Iterator[_Part]:
        chunk = piece.chunk
        received = int(self._random.integers(len(chunk.data) + 1))
        yield replace(piece, chunk=Chunk(chunk.utc_ns, chunk.mono_ns, chunk.data[:received]))
        yield _fault_event(chunk, f"{outage.kind}: for {outage.duration_ns / NS_PER_S:g} s, in frame {piece.frame}")
        yield LinkEvent(chunk.utc_ns, chunk.mono_ns, LinkKind.LOST, "the port is gone; waiting for it to come back")
        name = "the port, now under another name," if outage.kind == "rename" else "the port"
        utc_ns, mono_ns = chunk.utc_ns + outage.duration_ns, chunk.mono_ns + outage.duration_ns
        self._back = LinkEvent(utc_ns, mono_ns, LinkKind.REOPENED, f"{name} is open")


def _is_due(outage: Outage, piece: Piece, start_ns: int) -> bool:
    if outage.after_ns is not None:
        return piece.chunk.mono_ns >= start_ns + outage.after_ns
    return outage.frame is not None and piece.frame >= outage.frame


def _joined(parts: Iterable[_Part]) -> Iterator[Item]:
    """Pieces that follow each other with the same stamps are one chunk again."""
    for stamps, group in groupby(parts, _stamps):
        if stamps is None:
            yield from (part for part in group if isinstance(part, LinkEvent))
        else:
            yield Chunk(*stamps, b"".join(part.chunk.data for part in group if isinstance(part, Piece)))


def _stamps(part: _Part) -> tuple[int, int] | None:
    return None if isinstance(part, LinkEvent) else (part.chunk.utc_ns, part.chunk.mono_ns)


def _stalled(items: Iterator[Item], faults: Faults) -> Iterator[Item]:
    """The computer gives nothing for a while, then everything at once."""
    rate = faults.rate("stall")
    if rate == 0:
        yield from items
        return
    random = faults.random("stall")
    begins_ns = ends_ns = 0
    is_started = is_told = False
    for item in items:
        while not is_started or item.mono_ns >= ends_ns:
            calm_from_ns = ends_ns if is_started else item.mono_ns
            begins_ns = calm_from_ns + round(random.exponential(1 / rate) * NS_PER_S)
            ends_ns = begins_ns + round(random.uniform(*_STALL_S) * NS_PER_S)
            is_started, is_told = True, False
        late_ns = ends_ns - item.mono_ns if item.mono_ns >= begins_ns else 0
        utc_ns, mono_ns = item.utc_ns + late_ns, item.mono_ns + late_ns
        if late_ns and not is_told:
            is_told = True
            yield LinkEvent(
                utc_ns, mono_ns, LinkKind.FAULT, f"stall: nothing for {(ends_ns - begins_ns) / NS_PER_S:.3f} s"
            )
        if isinstance(item, LinkEvent):
            yield LinkEvent(utc_ns, mono_ns, item.kind, item.text)
        else:
            yield Chunk(utc_ns, mono_ns, item.data)


def _misread(items: Iterator[Item], sensor_baud: int, listening_baud: int) -> Iterator[Item]:
    """Each chunk as a port at another baud rate receives it, after an event FAULT."""
    is_told = False
    for item in items:
        if isinstance(item, LinkEvent):
            yield item
            continue
        if not is_told:
            is_told = True
            yield _fault_event(item, f"baud: the sensor speaks at {sensor_baud}, the port listens at {listening_baud}")
        yield Chunk(item.utc_ns, item.mono_ns, received_at(item.data, sensor_baud, listening_baud))
