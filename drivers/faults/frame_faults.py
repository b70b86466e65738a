"""Faults of whole frames: lost, doubled, swapped; acknowledgements lost."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

from drivers.chunk import Chunk
from drivers.faults.options import FRAME_KINDS, Faults

MAX_HELD_BYTES = 4096
"""Longest frame; a longer one is a stream without frame starts and is passed on."""


@dataclass(frozen=True, slots=True)
class Piece:
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

    def feed(self, chunk: Chunk) -> list[Piece]:
        """The pieces that are certain now, in order, each with the stamps of its chunk."""
        self._held.append(chunk)
        text = b"".join(held.data for held in self._held)
        keep = self._undecided(text)
        return self._release(text, len(text) - keep)

    def nothing(self, chunk: Chunk) -> Piece:
        """An empty chunk as the piece it is."""
        return Piece(chunk, self._offset, self._frame)

    def finish(self) -> list[Piece]:
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

    def _release(self, text: bytes, size: int) -> list[Piece]:
        starts = set()
        place = text.find(self._start)
        while 0 <= place < size:
            starts.add(place)
            place = text.find(self._start, place + 1)
        pieces: list[Piece] = []
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
                pieces.append(Piece(part, self._offset + left, self._frame, is_start, is_ack))
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
        self._again: list[Piece] = []
        self._held: list[Piece] = []
        self._held_for = 0
        self.texts: list[str] = []

    def pass_on(self, piece: Piece) -> Iterator[Piece]:
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

    def finish(self) -> Iterator[Piece]:
        """What was held for a frame that never came."""
        held, self._held = self._held, []
        yield from held

    def _end_of_frame(self, now: Chunk) -> Iterator[Piece]:
        again, self._again = self._again, []
        yield from _restamped(again, now)
        if self._held and self._held_for == 0:
            self._held_for = 1
        elif self._held:
            held, self._held = self._held, []
            yield from _restamped(held, now)

    def _decide(self, piece: Piece) -> None:
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


def _restamped(pieces: list[Piece], now: Chunk) -> Iterator[Piece]:
    for piece in pieces:
        yield replace(piece, chunk=Chunk(now.utc_ns, now.mono_ns, piece.chunk.data))
