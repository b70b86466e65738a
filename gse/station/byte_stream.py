"""Stream of received bytes: the frames in it, each with the host time of its first byte."""

import hashlib
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from drivers.chunk import Chunk
from gse.station.results import LinkCounters
from protocols import Discard, Frame, FrameDecoder, Protocol

_Stamp = tuple[int, int, int]
"""Offset of a chunk in the stream, UTC and monotonic time at which it was read, as they came."""


class FrameAt(NamedTuple):
    """A frame with the stamps of the chunk that holds its first byte, and the UTC of the chunk that completed it."""

    frame: Frame
    utc_ns: int
    mono_ns: int
    completed_utc_ns: int


class ByteStream:
    """Finds frames in chunks and counts every byte; ``latest_reasons`` are of the latest chunk's discards.

    Chunks are kept with the offset of their first byte until a frame begins in a later one. However the stream is cut,
    a frame finds the same chunk.
    """

    def __init__(self, protocol: Protocol, counters: LinkCounters) -> None:
        self.latest_reasons: set[str] = set()
        self._counters = counters
        self._decoder = FrameDecoder(protocol, from_sensor=True)
        self._stamps: deque[_Stamp] = deque()
        self._held: list[bytes] = []
        self._wanted = 1
        self._completed_utc_ns = 0
        self._sha256 = hashlib.sha256()

    @property
    def raw_sha256(self) -> str:
        """SHA-256 of all bytes received."""
        return self._sha256.hexdigest()

    def feed(self, chunk: Chunk) -> list[FrameAt]:
        """The frames that a chunk completes."""
        utc_ns, mono_ns, data = chunk
        if self.latest_reasons:
            self.latest_reasons.clear()
        counters = self._counters
        self._stamps.append((counters.bytes_in, utc_ns, mono_ns))
        counters.bytes_in += len(data)
        self._held.append(data)
        self._wanted -= len(data)
        if self._wanted > 0:
            return []
        self._completed_utc_ns = utc_ns
        pieces = self._decode_held()
        if not pieces:
            return []
        frames = self._take(pieces)
        self._forget_before(self._counters.bytes_in - self._decoder.pending)
        return frames

    def finish(self) -> list[FrameAt]:
        """The frames in the bytes left at the end of the stream."""
        return self._take([*self._decode_held(), *self._decoder.finish()])

    def _decode_held(self) -> list[Frame | Discard]:
        """What the bytes held back complete: most chunks only bring a part of a frame, which need not be looked at."""
        data = b"".join(self._held)
        self._held.clear()
        self._sha256.update(data)
        pieces = self._decoder.feed(data)
        self._wanted = self._decoder.wanted
        return pieces

    def _take(self, pieces: Sequence[Frame | Discard]) -> list[FrameAt]:
        frames = []
        for piece in pieces:
            if isinstance(piece, Discard):
                self._count_discard(piece)
                continue
            self._counters.frames += 1
            self._counters.bytes_framed += piece.size
            self._forget_before(piece.start)
            _, utc_ns, mono_ns = self._stamps[0]
            frames.append(FrameAt(piece, utc_ns, mono_ns, self._completed_utc_ns))
        return frames

    def _count_discard(self, discard: Discard) -> None:
        self._counters.bytes_discarded += len(discard.data)
        self.latest_reasons.add(discard.reason)
        by_reason = self._counters.discarded_bytes_by_reason
        by_reason[discard.reason] = by_reason.get(discard.reason, 0) + len(discard.data)

    def _forget_before(self, start: int) -> None:
        """Drop the stamps of decoded bytes; the rest belongs to one frame or discard at most."""
        while len(self._stamps) > 1 and self._stamps[1][0] <= start:
            self._stamps.popleft()
