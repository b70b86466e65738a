"""Stream of received bytes: the frames in it, each with the host time of its first byte."""

import hashlib
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from itertools import accumulate
from typing import NamedTuple

from drivers.chunk import Chunk
from gse.station.results import LinkCounters
from gse.station.translated_bytes import ByteMarks
from protocols import Discard, Frame, FrameDecoder, Protocol
from protocols.frame import ECHO


class FrameAt(NamedTuple):
    """A frame with the stamps of the chunk that holds its first byte, and the UTC of the chunk that completed it.

    ``completed_by`` is the place of that chunk among those which came together.
    """

    frame: Frame
    utc_ns: int
    mono_ns: int
    completed_utc_ns: int
    completed_by: int


class ByteStream:
    """Finds frames in chunks and counts every byte.

    Chunks are kept with the offset of their first byte until a frame begins in a later one. However the stream is cut,
    and however many chunks come together, a frame finds the same chunk. ``latest_reasons`` are of the discards that
    the latest chunks made known, by the place of the chunk.
    """

    def __init__(self, protocol: Protocol, counters: LinkCounters, *, echoes: bool = False) -> None:
        """With ``echoes`` commands are recognised that come back; ``latest_echoes`` are those of the latest chunks."""
        self.latest_reasons: dict[int, set[str]] = {}
        self.latest_echoes: list[Discard] = []
        self.marks = ByteMarks(protocol)
        self._counters = counters
        self._decoder = FrameDecoder(protocol, from_sensor=True, echoes=echoes)
        self._chunks: list[Chunk] = []
        self._starts: list[int] = []
        self._sha256 = hashlib.sha256()

    @property
    def raw_sha256(self) -> str:
        """SHA-256 of all bytes received."""
        return self._sha256.hexdigest()

    def feed(self, *chunks: Chunk) -> list[FrameAt]:
        """The frames that chunks complete."""
        counters = self._counters
        kept = len(self._chunks)
        self._chunks += chunks
        *starts, end = accumulate((len(chunk.data) for chunk in chunks), initial=counters.bytes_in)
        self._starts += starts
        counters.bytes_in = end
        data = b"".join([chunk.data for chunk in chunks])
        self._sha256.update(data)
        self.marks.feed(data)
        frames = self._take(self._decoder.feed(data), kept)
        decoded = bisect_right(self._starts, end - self._decoder.pending) - 1
        del self._chunks[:decoded], self._starts[:decoded]
        return frames

    def finish(self) -> list[FrameAt]:
        """The frames in the bytes left at the end of the stream."""
        return self._take(self._decoder.finish(), len(self._chunks) - 1)

    def _take(self, pieces: Sequence[Frame | Discard], kept: int) -> list[FrameAt]:
        """The frames of pieces; ``kept`` chunks are older than those that completed them."""
        self.latest_reasons, self.latest_echoes = {}, []
        chunks, starts, counters = self._chunks, self._starts, self._counters
        frames = []
        for piece in pieces:
            completed = bisect_left(starts, piece.known_at) - 1
            if isinstance(piece, Discard):
                self._count_discard(piece)
                if piece.reason == ECHO:
                    self.latest_echoes.append(piece)
                self.latest_reasons.setdefault(completed - kept, set()).add(piece.reason)
                continue
            utc_ns, mono_ns, _ = chunks[bisect_right(starts, piece.start) - 1]
            frames.append(FrameAt(piece, utc_ns, mono_ns, chunks[completed].utc_ns, completed - kept))
        counters.frames += len(frames)
        counters.bytes_framed += sum(at.frame.size for at in frames)
        return frames

    def _count_discard(self, discard: Discard) -> None:
        self._counters.bytes_discarded += len(discard.data)
        by_reason = self._counters.discarded_bytes_by_reason
        by_reason[discard.reason] = by_reason.get(discard.reason, 0) + len(discard.data)
