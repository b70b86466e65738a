"""Stream of received bytes: the frames in it, each with the host time of its first byte.

``ByteMarks`` names what a terminal or a bridge did to the bytes on the way. Each leaves a mark in how often bytes
occur:

    what did it                  what it does to the bytes                    the mark
    flow control by software     takes 11 and 13 (XON, XOFF) out              neither ever occurs
    a terminal's onlcr           sends 0D 0A for 0A                           each 0A stands behind a 0D
    a terminal's icrnl           makes 0A of 0D                               0D never occurs
    a terminal's inlcr           makes 0D of 0A                               0A never occurs
    telnet                       doubles FF                                   FF occurs in pairs only

Numbers of a sensor, and its checksums, have all bytes. How often one should have come is told by those beside it.

``what_fits`` names what bytes without a valid frame may be. Another protocol shows by frames with a right checksum.
Another baud rate shows by the sync word as a UART of ours would read it, for sensors that are slower; of one that is
faster too few bits arrive.
"""

import hashlib
from bisect import bisect_left, bisect_right
from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import NamedTuple

from drivers.chunk import Chunk
from drivers.uart import USUAL_BAUDS, received_at
from gse.station.results import LinkCounters
from protocols import Discard, Frame, FrameDecoder, Protocol, built_in_names, load_protocol
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
        """With ``echoes`` commands that come back are recognised; ``latest_echoes`` are those of the latest chunks."""
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
        self._counters.bytes_discarded += discard.size
        by_reason = self._counters.discarded_bytes_by_reason
        by_reason[discard.reason] = by_reason.get(discard.reason, 0) + discard.size


NONE_OF = 16
"""By chance a byte that should come so often is missing once in nine million sessions (exp(-16))."""
USUAL = 8
"""With fewer of each byte the counts prove nothing."""
PAIRS = 4
"""So many pairs, and no byte alone: by chance once in four thousand million sessions (256 to the power of -4)."""

_COUNTED = (b"\x11", b"\x13", b"\x0a", b"\x0d", b"\xff", b"\r\n", b"\xff\xff")
_BESIDE = (b"\x09", b"\x0b", b"\x0c", b"\x0e", b"\x0f", b"\x10", b"\x12", b"\x14", b"\x15", b"\x16")


class ByteMarks:
    """Counts bytes of a stream; ``said`` names what was done to them."""

    def __init__(self, protocol: Protocol) -> None:
        self._is_text = protocol.description.framing.kind == "line"
        self._counts = dict.fromkeys((*_COUNTED, *_BESIDE), 0)
        self._last = b""
        self._odd = False

    def feed(self, data: bytes) -> None:
        """Count the next bytes; pairs are found across the cuts between them."""
        if self._is_text or not data:
            return
        for mark in self._counts:
            if len(mark) == 1:
                self._counts[mark] += data.count(mark)
        self._counts[b"\r\n"] += data.count(b"\r\n") + (self._last == b"\r" and data[:1] == b"\n")
        self._counts[b"\xff\xff"] += self._pairs(data)
        self._last = data[-1:]

    def _pairs(self, data: bytes) -> int:
        """Pairs of FF, one of which may be cut."""
        if self._odd:
            data = b"\xff" + data
        self._odd = (len(data) - len(data.rstrip(b"\xff"))) % 2 == 1
        return data.count(b"\xff\xff")

    def said(self) -> str:
        """What was done, and how to mend it; empty where all is as it should be."""
        counts = self._counts
        usual = sum(counts[byte] for byte in _BESIDE) / len(_BESIDE)
        return _words(counts, usual) if usual >= USUAL else ""


def _words(counts: Mapping[bytes, int], usual: float) -> str:
    if not counts[b"\x11"] and not counts[b"\x13"]:
        return (
            "the bytes 11 and 13 never occur: flow control by software (XON/XOFF) takes them out; switch it off: "
            "`stty -ixon -ixoff`, port.xonxoff: false, or the setting of the bridge"
        )
    if counts[b"\x0a"] >= PAIRS and counts[b"\r\n"] == counts[b"\x0a"]:
        return "each 0A stands behind a 0D: a terminal sends both for one (onlcr); `stty raw`, or binary mode"
    if not counts[b"\x0d"] and usual >= NONE_OF:
        return "0D never occurs: a terminal makes 0A of it (icrnl); `stty raw`, or binary mode"
    if not counts[b"\x0a"] and usual >= NONE_OF:
        return "0A never occurs: a terminal makes 0D of it (inlcr, or a text mode); `stty raw`, or binary mode"
    if counts[b"\xff\xff"] >= PAIRS and 2 * counts[b"\xff\xff"] == counts[b"\xff"]:
        return "FF occurs in pairs only: telnet doubles it; use the raw mode of the bridge, or an rfc2217:// URL"
    return ""


_FEWEST_FRAMES = 2
_FEWEST_HEADS = 3
_FEWEST_BYTES = 3
"""Fewest bytes of a frame's head that are looked for; fewer are found by chance."""
_ZERO_FROM = 12
"""A sensor so many times slower than the port gives nothing but zeros."""


def what_fits(sample: bytes, protocol: Protocol, baudrate: int) -> str:
    """What would fit some unreadable bytes, for the operator; empty where they do not tell."""
    if name := _other_protocol(sample, protocol):
        return f"they are frames of {name}: write 'protocol: {name}' in the station file"
    if baud := _slower_baud(sample, protocol, baudrate):
        return f"wrong baud rate: they fit port.baudrate: {baud} (here {baudrate})"
    if sample and not any(sample):
        return f"wrong baud rate: they fit {baudrate // _ZERO_FROM} or less (here {baudrate})"
    return ""


def _other_protocol(sample: bytes, protocol: Protocol) -> str:
    for name in built_in_names():
        if name != protocol.name and _frames(sample, load_protocol(name)) >= _FEWEST_FRAMES:
            return name
    return ""


def _frames(sample: bytes, protocol: Protocol) -> int:
    return sum(isinstance(piece, Frame) for piece in FrameDecoder(protocol).feed(sample))


def _slower_baud(sample: bytes, protocol: Protocol, baudrate: int) -> int:
    """The usual rate whose sync words explain most of the bytes; 0 where none is there."""
    sync_word = protocol.frame_layout.sync_word
    slower = [baud for baud in reversed(USUAL_BAUDS) if baud < baudrate]
    explained = {baud: _explained(sample, sync_word, baud, baudrate) for baud in slower}
    return max(slower, key=explained.__getitem__) if any(explained.values()) else 0


def _explained(sample: bytes, sync_word: bytes, baud: int, baudrate: int) -> int:
    head = received_at(sync_word, baud, baudrate)[:-1]
    if len(head) < _FEWEST_BYTES or not any(head):
        return 0
    count = sample.count(head)
    return count * len(head) if count >= _FEWEST_HEADS else 0
