"""Seeded faults put into a stream of chunks: of bytes, then frames, then the port, then the computer.

    faults=flip:1e-4,drop_frame:0.01,disconnect:12.5s/3s

    flip, drop, double, insert     probability per byte: a bit is inverted, the byte is lost, doubled, one put before it
    noise                          probability per byte: 8 to 64 random bytes come before it
    split                          probability per byte: the chunk is cut before it
    drop_frame, double_frame, swap_frame
                                   probability per frame: it is lost, comes twice, comes after the next one
    lost_ack                       probability per acknowledgement: it is lost
    stall                          per second: the computer gives nothing for 0.2 to 3 s, then all at once
    disconnect, rename             at 12.5s after the start, or within frame f100; for 2 s, or /3s; with rename the
                                   adapter comes back under another name
    reset                          at 12.5s: clock and sequence jump back. A recording sends again what it sent from
                                   the start on, a simulated sensor starts anew under the sky of then
    baud                           what the sensor speaks, while the port listens at its own rate

Every fault is drawn for the bytes, frames and seconds of the source, by a random stream of its own kind: the same
seed gives the same bytes in every process, and switching one kind on does not move the others. Each fault that is made
comes as an event FAULT; those of the port as LOST and REOPENED, as they would. Nothing here needs a port or a clock.

A frame is what begins at ``frame_start``, an acknowledgement what begins at ``ack_start``: bytes in hexadecimal, by
default those of the panorama protocol.
"""

import re
import zlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import groupby, pairwise

import numpy as np

from drivers.chunk import NS_PER_S, Chunk, LinkEvent, LinkKind
from drivers.errors import UrlError
from drivers.mock_ports import Item
from drivers.uart import received_at

BYTE_KINDS = ("flip", "drop", "double", "insert", "noise")
FRAME_KINDS = ("drop_frame", "double_frame", "swap_frame", "lost_ack")
RATE_KINDS = (*BYTE_KINDS, *FRAME_KINDS, "split", "stall")
OUTAGE_KINDS = ("disconnect", "rename")
KINDS = (*RATE_KINDS, *OUTAGE_KINDS, "reset", "baud")
OPTIONS = ("faults", "seed", "frame_start", "ack_start")

OUTAGE_S = 2.0
LONGEST_RESET_S = 3600
_OUTAGE = re.compile(r"(?:(\d+(?:\.\d+)?)s|f(\d+))(?:/(\d+(?:\.\d+)?)s)?")
_SECONDS = re.compile(r"(\d+(?:\.\d+)?)s")


@dataclass(frozen=True, slots=True)
class Outage:
    """The port goes: so many ns after the start, or in the middle of a frame."""

    kind: str
    after_ns: int | None
    frame: int | None
    duration_ns: int


@dataclass(frozen=True, slots=True)
class Faults:
    """The faults that were asked for, and the seed that decides where they come."""

    seed: int = 0
    rates: dict[str, float] = field(default_factory=dict)
    outages: tuple[Outage, ...] = ()
    reset_after_ns: int | None = None
    sensor_baud: int | None = None
    frame_start: bytes = bytes.fromhex("1acffc1d")
    ack_start: bytes = bytes.fromhex("1acffc1d10")

    def random(self, kind: str) -> np.random.Generator:
        """The random stream of one kind of fault."""
        return np.random.default_rng([self.seed, zlib.crc32(kind.encode())])

    def rate(self, kind: str) -> float:
        """The probability of a kind, 0 where it was not asked for."""
        return self.rates.get(kind, 0.0)


def parse_faults(options: dict[str, str]) -> Faults | None:
    """The faults of a mock port's URL, None where it asks for none; UrlError says what was expected."""
    text = options.get("faults", "")
    if not text:
        return None
    rates: dict[str, float] = {}
    outages: list[Outage] = []
    reset_after_ns = sensor_baud = None
    entries = [entry.strip() for entry in text.split(",")]
    for number, entry in enumerate(entries):
        kind, _, value = entry.partition(":")
        if kind not in OUTAGE_KINDS and any(other.startswith(f"{kind}:") for other in entries[:number]):
            raise UrlError(f"faults: {kind} is given twice")
        if kind in RATE_KINDS:
            rates[kind] = _rate(kind, value)
        elif kind in OUTAGE_KINDS:
            outages.append(_outage(kind, value))
        elif kind == "reset":
            reset_after_ns = _seconds(kind, value)
        elif kind == "baud":
            sensor_baud = _whole(kind, value)
        else:
            raise UrlError(f"faults: there is no kind {kind!r}; known are {', '.join(KINDS)}")
    return Faults(
        seed=_whole("seed", options.get("seed", "0")),
        rates=rates,
        outages=tuple(outages),
        reset_after_ns=reset_after_ns,
        sensor_baud=sensor_baud,
        frame_start=_hex("frame_start", options.get("frame_start", "1acffc1d")),
        ack_start=_hex("ack_start", options.get("ack_start", "1acffc1d10")),
    )


def _rate(kind: str, text: str) -> float:
    try:
        rate = float(text)
    except ValueError:
        rate = -1.0
    if not 0 <= rate <= 1:
        raise UrlError(f"faults: {kind}:{text} does not work: expected a probability from 0 to 1, e.g. {kind}:1e-4")
    return rate


def _outage(kind: str, text: str) -> Outage:
    match = _OUTAGE.fullmatch(text)
    if match is None:
        raise UrlError(
            f"faults: {kind}:{text} does not work: expected e.g. {kind}:12.5s, {kind}:f100 or {kind}:f100/3s"
        )
    after, frame, duration = match.groups()
    return Outage(
        kind,
        after_ns=round(float(after) * NS_PER_S) if after else None,
        frame=int(frame) if frame else None,
        duration_ns=round(float(duration or OUTAGE_S) * NS_PER_S),
    )


def _seconds(kind: str, text: str) -> int:
    match = _SECONDS.fullmatch(text)
    if match is None:
        raise UrlError(f"faults: {kind}:{text} does not work: expected e.g. {kind}:12.5s")
    if float(match[1]) > LONGEST_RESET_S:
        raise UrlError(
            f"faults: {kind}:{text} does not work: all bytes until then are kept, at most {LONGEST_RESET_S} s"
        )
    return round(float(match[1]) * NS_PER_S)


def _whole(name: str, text: str) -> int:
    if not re.fullmatch(r"\d{1,18}", text) or (name == "baud" and int(text) == 0):
        raise UrlError(f"faults: {name} {text!r} does not work: expected a whole number of up to 18 digits")
    return int(text)


def _hex(name: str, text: str) -> bytes:
    try:
        data = bytes.fromhex(text)
    except ValueError:
        data = b""
    if not 1 <= len(data) <= 16:
        raise UrlError(f"faults: {name}={text} does not work: expected 1 to 16 bytes in hexadecimal, e.g. 1acffc1d")
    return data


class Places:
    """Where a fault of some probability strikes: whole numbers, drawn once and in order."""

    def __init__(self, random: np.random.Generator, rate: float) -> None:
        self._random, self._rate = random, rate
        self._next = self._gap() - 1 if rate > 0 else -1

    def before(self, end: int) -> Iterator[int]:
        """All places before ``end`` that have not been given yet."""
        while 0 <= self._next < end:
            place = self._next
            self._next += self._gap()
            yield place

    def _gap(self) -> int:
        return int(self._random.geometric(self._rate))


# Faults of single bytes: inverted, lost, doubled, inserted, drowned in noise.

_NOISE_BYTES = (8, 64)


class ByteFaults:
    """Edits the bytes of a stream at places given by their offset in the source."""

    def __init__(self, faults: Faults) -> None:
        self._kinds = [
            (kind, Places(faults.random(f"{kind} places"), faults.rate(kind)), faults.random(f"{kind} values"))
            for kind in BYTE_KINDS
            if faults.rate(kind) > 0
        ]

    def edit(self, offset: int, data: bytes) -> tuple[bytes, list[str]]:
        """The bytes from ``offset`` of the source on with their faults, and a description of each fault."""
        edits = [
            (place, kind, random) for kind, places, random in self._kinds for place in places.before(offset + len(data))
        ]
        if not edits:
            return data, []
        pieces = [data[n : n + 1] for n in range(len(data))]
        texts = []
        # By kind, each kind in order of place: every kind draws from its own stream, whatever the others do.
        for place, kind, random in edits:
            n = place - offset
            pieces[n], text = _EDITS[kind](pieces[n], random)
            texts.append(f"{text} at byte {place}")
        return b"".join(pieces), texts


def _flip(piece: bytes, random: np.random.Generator) -> tuple[bytes, str]:
    bit = int(random.integers(8))
    return bytes([piece[0] ^ 1 << bit]) + piece[1:], f"flip: bit {bit}"


def _drop(piece: bytes, random: np.random.Generator) -> tuple[bytes, str]:
    return b"", "drop: a byte lost"


def _double(piece: bytes, random: np.random.Generator) -> tuple[bytes, str]:
    return piece * 2, "double: twice the byte"


def _insert(piece: bytes, random: np.random.Generator) -> tuple[bytes, str]:
    return random.bytes(1) + piece, "insert: a byte more"


def _noise(piece: bytes, random: np.random.Generator) -> tuple[bytes, str]:
    burst = random.bytes(int(random.integers(_NOISE_BYTES[0], _NOISE_BYTES[1] + 1)))
    return burst + piece, f"noise: {len(burst)} bytes"


_EDITS: dict[str, Callable[[bytes, np.random.Generator], tuple[bytes, str]]] = {
    "flip": _flip,
    "drop": _drop,
    "double": _double,
    "insert": _insert,
    "noise": _noise,
}


# Faults of whole frames: lost, doubled, swapped; acknowledgements lost.

MAX_HELD_BYTES = 4096
"""Longest frame; a longer one is a stream without frame starts and is passed on."""


@dataclass(frozen=True, slots=True)
class FramePiece:
    """Bytes of one chunk within one frame: ``offset`` is theirs in the source, ``frame`` counts frame starts."""

    chunk: Chunk
    offset: int
    frame: int
    is_start: bool = False
    is_ack: bool = False


class FrameFinder:
    """Cuts chunks at the starts of frames; a start that is cut by the end of a chunk is held until the next."""

    def __init__(self, faults: Faults) -> None:
        self._start, self._ack_start = faults.frame_start, faults.ack_start
        self._head_bytes = max(len(self._start), len(self._ack_start))
        self._held: list[Chunk] = []
        self._offset = 0
        self._frame = 0

    def feed(self, chunk: Chunk) -> list[FramePiece]:
        """The pieces that are certain now, in order, each with the stamps of its chunk."""
        self._held.append(chunk)
        text = b"".join(held.data for held in self._held)
        keep = self._undecided(text)
        return self._release(text, len(text) - keep)

    def nothing(self, chunk: Chunk) -> FramePiece:
        """An empty chunk as the piece it is."""
        return FramePiece(chunk, self._offset, self._frame)

    def finish(self) -> list[FramePiece]:
        """What was held."""
        text = b"".join(held.data for held in self._held)
        return self._release(text, len(text))

    def _undecided(self, text: bytes) -> int:
        """How many bytes at the end may be the beginning of a start, or of a frame's head."""
        last = text.rfind(self._start)
        if last >= 0 and len(text) - last < self._head_bytes:
            return len(text) - last
        for size in range(min(len(self._start) - 1, len(text)), 0, -1):
            if text.endswith(self._start[:size]):
                return size
        return 0

    def _release(self, text: bytes, size: int) -> list[FramePiece]:
        starts = set()
        place = text.find(self._start)
        while 0 <= place < size:
            starts.add(place)
            place = text.find(self._start, place + 1)
        pieces: list[FramePiece] = []
        begin = 0
        while self._held and begin < size:
            chunk = self._held.pop(0)
            end = begin + len(chunk.data)
            edges = sorted({begin, min(end, size), *(start for start in starts if begin < start < min(end, size))})
            for left, right in pairwise(edges):
                is_start = left in starts
                self._frame += is_start
                part = Chunk(chunk.utc_ns, chunk.mono_ns, text[left:right])
                is_ack = is_start and text.startswith(self._ack_start, left)
                pieces.append(FramePiece(part, self._offset + left, self._frame, is_start, is_ack))
            if end > size:
                self._held.insert(0, Chunk(chunk.utc_ns, chunk.mono_ns, text[size:end]))
            begin = end
        self._offset += size
        return pieces


class FrameFaults:
    """Loses, doubles and swaps frames."""

    def __init__(self, faults: Faults) -> None:
        self._rates = {kind: faults.rate(kind) for kind in FRAME_KINDS}
        self._random = {kind: faults.random(kind) for kind in FRAME_KINDS}
        self._fate: set[str] = set()
        self._again: list[FramePiece] = []
        self._held: list[FramePiece] = []
        self._held_for = 0
        self.texts: list[str] = []

    def pass_on(self, piece: FramePiece) -> Iterator[FramePiece]:
        """The pieces that come out when this one goes in."""
        if piece.is_start:
            yield from self._end_of_frame(piece.chunk)
            self._decide(piece)
        if self._fate & {"drop_frame", "lost_ack"}:
            return
        if "swap_frame" in self._fate and sum(len(held.chunk.data) for held in self._held) < MAX_HELD_BYTES:
            self._held.append(piece)
            return
        if "double_frame" in self._fate and len(self._again) < MAX_HELD_BYTES:
            self._again.append(piece)
        yield piece

    def finish(self) -> Iterator[FramePiece]:
        """What was held for a frame that never came."""
        held, self._held = self._held, []
        yield from held

    def _end_of_frame(self, now: Chunk) -> Iterator[FramePiece]:
        again, self._again = self._again, []
        yield from _restamped(again, now)
        if self._held and self._held_for == 0:
            self._held_for = 1
        elif self._held:
            held, self._held = self._held, []
            yield from _restamped(held, now)

    def _decide(self, piece: FramePiece) -> None:
        draws = {kind: self._random[kind].random() for kind in FRAME_KINDS}
        self._fate = {kind for kind, value in draws.items() if value < self._rates[kind]}
        if not piece.is_ack:
            self._fate.discard("lost_ack")
        if self._held:
            # One frame at a time is on its way behind the next.
            self._fate.discard("swap_frame")
        elif "swap_frame" in self._fate:
            self._held_for = 0
        self.texts += [f"{kind}: frame {piece.frame}" for kind in FRAME_KINDS if kind in self._fate]


def _restamped(pieces: list[FramePiece], now: Chunk) -> Iterator[FramePiece]:
    for piece in pieces:
        yield replace(piece, chunk=Chunk(now.utc_ns, now.mono_ns, piece.chunk.data))


_STALL_S = (0.2, 3.0)
_Part = FramePiece | LinkEvent


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

    def edited(pieces: list[FramePiece]) -> Iterator[_Part]:
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

    def _begin(self, outage: Outage, piece: FramePiece) -> Iterator[_Part]:
        chunk = piece.chunk
        received = int(self._random.integers(len(chunk.data) + 1))
        yield replace(piece, chunk=Chunk(chunk.utc_ns, chunk.mono_ns, chunk.data[:received]))
        yield _fault_event(chunk, f"{outage.kind}: for {outage.duration_ns / NS_PER_S:g} s, in frame {piece.frame}")
        yield LinkEvent(chunk.utc_ns, chunk.mono_ns, LinkKind.LOST, "the port is gone; waiting for it to come back")
        name = "the port, now under another name," if outage.kind == "rename" else "the port"
        utc_ns, mono_ns = chunk.utc_ns + outage.duration_ns, chunk.mono_ns + outage.duration_ns
        self._back = LinkEvent(utc_ns, mono_ns, LinkKind.REOPENED, f"{name} is open")


def _is_due(outage: Outage, piece: FramePiece, start_ns: int) -> bool:
    if outage.after_ns is not None:
        return piece.chunk.mono_ns >= start_ns + outage.after_ns
    return outage.frame is not None and piece.frame >= outage.frame


def _joined(parts: Iterable[_Part]) -> Iterator[Item]:
    """Pieces that follow each other with the same stamps are one chunk again."""
    for stamps, group in groupby(parts, _stamps):
        if stamps is None:
            yield from (part for part in group if isinstance(part, LinkEvent))
        else:
            yield Chunk(*stamps, b"".join(part.chunk.data for part in group if isinstance(part, FramePiece)))


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
