"""An unknown capture looked at: which framings, lengths and checksums its bytes fit.

Frames are cut at a sync word, found as the most frequent sequences of 2 and 4 bytes, at the END bytes of SLIP and of
each other delimiter, between two words with one escape byte, at the ends of lines, or by the lengths of space packets.
Each checksum that a description can name is tried on them, in both byte orders, with and without the sync word. One of
16 bits is right by chance once in 65,536 frames; three frames of hundreds are no fit, so shares are given.
"""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.errors import CaptureError
from drivers.playback import is_session
from drivers.session_file.reader import read_capture
from drivers.session_file.records import RX, RecordedMessage
from protocols import built_in_names, load_protocol
from protocols.checksum import CHECKSUMS
from protocols.delimiter import DELIMITERS
from protocols.frame import Frame
from protocols.framing import FrameDecoder

SCHEMA = "gse.decode.try/1"
MOST_BYTES = 4 << 20
"""As much of the capture is looked at: minutes at any rate."""

_MOST_FRAMES = 400
_FEWEST_FRAMES = 5
_LONGEST_FRAME = 4096
_SYNC_WORDS = 12
"""Most frequent sequences that are tried as sync words."""

_WORDS = 64
"""Most frequent sequences of two bytes that are tried as start and end of stuffed frames."""
_SAMPLE = 1 << 18
_LEAST_SHARE = 0.5
_MOST_LENGTHS = 5


@dataclass(frozen=True, slots=True)
class FramingFit:
    """A framing and a checksum, and how many of the frames tried it is right for.

    ``lengths`` are the most frequent lengths of frames in bytes, sync word or END bytes not counted, with their number.
    """

    framing: str
    checksum: str
    byte_order: str
    covers_sync_word: bool
    right: int
    frames: int
    lengths: tuple[tuple[int, int], ...]

    @property
    def share(self) -> float:
        """Of the frames tried."""
        return self.right / self.frames


@dataclass(frozen=True, slots=True)
class Looked:
    """What was found in so many ``bytes``: fits, best first, and built-in descriptions with the share they decode."""

    bytes: int
    fits: tuple[FramingFit, ...]
    built_in: tuple[tuple[str, float], ...]

    def document(self) -> dict[str, Any]:
        """The JSON of schema gse.decode.try/1."""
        fits = [
            {name: getattr(fit, name) for name in FramingFit.__slots__} | {"share": round(fit.share, 4)}
            for fit in self.fits
        ]
        return {"schema": SCHEMA, "bytes": self.bytes, "fits": fits, "built_in": dict(self.built_in)}

    def lines(self) -> list[str]:
        """The same for a person."""
        found = [f"{self.bytes} bytes"]
        for name, share in self.built_in:
            found.append(f"built-in description {name}: decodes {100 * share:.1f} % of the bytes")
        for fit in self.fits:
            lengths = ", ".join(f"{length} ({count})" for length, count in fit.lengths)
            found.append(
                f"{fit.framing}, {fit.checksum} {fit.byte_order}-endian"
                f"{', sync word covered' if fit.covers_sync_word else ''}: "
                f"right in {fit.right} of {fit.frames} frames; bytes of header to checksum (frames): {lengths}"
            )
        if not self.fits:
            found.append(
                "no framing with a known checksum fits: wrong baud rate, another checksum, or too few frames; "
                f"known are {', '.join(CHECKSUMS)}"
            )
        return found


def look(path: Path) -> Looked:
    """Look at a session or a raw capture; CaptureError where it cannot be read."""
    data = _received(path)
    fits = sorted(set(_fits(data)), key=lambda fit: (-fit.share * fit.frames, fit.framing, fit.checksum))
    return Looked(len(data), tuple(_without_shadows(fits)), tuple(_built_in(data)))


def _received(path: Path) -> bytes:
    if not path.exists():
        raise CaptureError(f"there is no capture {path}")
    if not is_session(path):
        try:
            with path.open("rb") as file:
                return file.read(MOST_BYTES)
        except OSError as error:
            raise CaptureError(f"cannot read {path}: {error.strerror}") from error
    data = bytearray()
    for record in read_capture(path):
        if isinstance(record, RecordedMessage) and record.topic == RX:
            data += record.data
        if len(data) >= MOST_BYTES:
            break
    return bytes(data[:MOST_BYTES])


def _fits(data: bytes) -> Iterator[FramingFit]:
    for name, delimiter in DELIMITERS.items():
        packets = filter(None, data.split(delimiter.end))
        yield from _checked(name, b"", [frame for one in packets if (frame := delimiter.unpacked(one)) is not None])
    yield from _lines(data)
    yield from _checked("CCSDS space packets (kind: length)", b"", _space_packets(data))
    for start, end in _stuffing_words(data):
        escape = start[:1]
        inside = re.findall(
            re.escape(start) + b"((?:[^%b]|%b%b)*)" % (3 * (re.escape(escape),)) + re.escape(end), data[:_SAMPLE]
        )
        name = f"stuffed, start {start.hex().upper()}, end {end.hex().upper()}, escape {escape.hex().upper()}"
        yield from _checked(name, b"", [part.replace(2 * escape, escape) for part in inside])
    for word in _sync_words(data):
        parts = data.split(word)[1:-1]
        yield from _checked(f"sync word {word.hex().upper()}", word, parts)


def _lines(data: bytes) -> Iterator[FramingFit]:
    """Lines of printable characters; those with a checksum have it behind an asterisk."""
    lines = [line.rstrip(b"\r") for line in data.split(b"\n")[1:-1]][:_MOST_FRAMES]
    text = [line for line in lines if line and all(32 <= byte < 127 for byte in line)]
    if len(text) < max(_FEWEST_FRAMES, _LEAST_SHARE * len(lines)):
        return
    lengths = tuple(Counter(map(len, text)).most_common(_MOST_LENGTHS))
    stated = [line[1:].rsplit(b"*", 1) for line in text if b"*" in line]
    for checksum in CHECKSUMS.values() if len(stated) >= _LEAST_SHARE * len(text) else ():
        right = sum(b"%0*X" % (2 * checksum.size, checksum.compute(body)) == sent.upper() for body, sent in stated)
        if checksum.size and right >= max(_LEAST_SHARE * len(stated), _FEWEST_FRAMES):
            yield FramingFit(f"line, begin {chr(text[0][0])}", checksum.name, "big", False, right, len(stated), lengths)
    if not stated:
        yield FramingFit("line", "none", "big", False, len(text), len(lines), lengths)


def _space_packets(data: bytes) -> list[bytes]:
    """Packets whose lengths lead from one to the next, CRC included."""
    packets: list[bytes] = []
    at = 0
    while at + 6 < len(data) and len(packets) < _MOST_FRAMES:
        end = at + 7 + int.from_bytes(data[at + 4 : at + 6], "big")
        follows = end + 3 > len(data) or (data[end] == data[at] and data[end + 2] >> 6 == 3)
        if (
            data[at] >> 5 == 0
            and data[at + 2] >> 6 == 3
            and end - at <= _LONGEST_FRAME
            and follows
            and end <= len(data)
        ):
            packets.append(data[at:end])
            at = end
        else:
            at += 1
    return packets


def _stuffing_words(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Pairs of words that begin with one byte and are about as frequent: the start and the end of stuffed frames."""
    part = data[:_SAMPLE]
    counts = Counter(part[at : at + 2] for at in range(len(part) - 1))
    common = [(word, count) for word, count in counts.most_common(_WORDS) if word[0] != word[1]]
    for start, often in common:
        for end, count in common:
            if start[0] == end[0] and start != end and often / 2 <= count <= 2 * often:
                yield start, end


def _sync_words(data: bytes) -> list[bytes]:
    """The most frequent sequences of 4 and of 2 bytes that are no run of one byte, the longer first."""
    found: list[bytes] = []
    part = data[:_SAMPLE]
    for size in (4, 2):
        counts = Counter(part[at : at + size] for at in range(len(part) - size + 1))
        found += [word for word, _ in counts.most_common(_SYNC_WORDS) if len(set(word)) > 1]
    return found


def _checked(framing: str, word: bytes, parts: list[bytes]) -> Iterator[FramingFit]:
    frames = [part for part in parts if 3 <= len(part) <= _LONGEST_FRAME][:_MOST_FRAMES]
    if len(frames) < _FEWEST_FRAMES or len(frames) < len(parts[:_MOST_FRAMES]) / 2:
        return
    lengths = tuple(Counter(map(len, frames)).most_common(_MOST_LENGTHS))
    for checksum in (of for of in CHECKSUMS.values() if of.size):
        for covers in (False, True) if word else (False,):
            sums = [
                (checksum.compute((word if covers else b"") + frame[: -checksum.size]), frame[-checksum.size :])
                for frame in frames
                if len(frame) > checksum.size
            ]
            for order in ("big", "little"):
                right = sum(value == int.from_bytes(sent, order) for value, sent in sums)
                if sums and right >= max(_LEAST_SHARE * len(sums), _FEWEST_FRAMES):
                    yield FramingFit(framing, checksum.name, order, covers, right, len(sums), lengths)


def _without_shadows(fits: list[FramingFit]) -> Iterator[FramingFit]:
    """Not the same frames again by a part of their sync word, or of what follows it."""
    seen: set[tuple[str, str]] = set()
    for fit in fits:
        key = (fit.checksum, fit.byte_order)
        if key not in seen:
            seen.add(key)
            yield fit


def _built_in(data: bytes) -> Iterator[tuple[str, float]]:
    shares = []
    for name in built_in_names():
        decoder = FrameDecoder(load_protocol(name))
        pieces = [*decoder.feed(data), *decoder.finish()]
        framed = sum(piece.size for piece in pieces if isinstance(piece, Frame))
        shares.append((name, round(framed / max(len(data), 1), 4)))
    yield from ((name, share) for name, share in sorted(shares, key=lambda item: -item[1]) if share > 0)
