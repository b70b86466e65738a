"""Panoramas that come in several frames, joined.

The frames of one panorama carry the same time and number of the exposure, and their own number among them: first to
last, with no other panorama's between them. The first one takes the objects of all; the others are frames of the type
PART. Where one is missing or out of order, all of that panorama are discarded as `part missing`: it never becomes a
short one.
"""

from typing import Protocol as Interface

from protocols.codec import PanoramaCodec
from protocols.frame import PART_MISSING, Discard, Frame

PART = "PART"
"""The type of the second and later frames of a panorama."""
PANORAMA = "PANORAMA"
MAX_PARTS = 256
MAX_HELD_BYTES = 1 << 20
"""What may come between the first and the last part of a panorama; more than a second at the fastest rates."""


class Scanner(Interface):
    """What finds frames in a stream."""

    @property
    def pending(self) -> int:
        """Bytes held back."""
        ...

    @property
    def wanted(self) -> int:
        """How many bytes must come before anything can be found."""
        ...

    @property
    def refused(self) -> Discard | None:
        """What is held back, where it is known to begin with no frame."""
        ...

    def feed(self, data: bytes) -> list[Frame | Discard]:
        """Frames and discards that these bytes complete."""
        ...

    def finish(self) -> list[Frame | Discard]:
        """Frames and discards at the end of the stream."""
        ...


class PartsJoiner:
    """Holds what came since the first part of a panorama, until the last one is there or cannot come any more."""

    def __init__(self, scanner: Scanner, codec: PanoramaCodec) -> None:
        self._scanner = scanner
        self._codec = codec
        self._bytes = bytearray()
        self._start = 0
        self._held: list[Frame | Discard] = []
        self._parts: list[int] = []
        self._own = b""
        self._of = 0
        self._slots = bytearray()

    @property
    def pending(self) -> int:
        """Bytes held back."""
        return len(self._bytes)

    @property
    def wanted(self) -> int:
        """As the scanner says."""
        return self._scanner.wanted

    @property
    def refused(self) -> Discard | None:
        """As the scanner says."""
        return self._scanner.refused

    def feed(self, data: bytes) -> list[Frame | Discard]:
        """Frames and discards that these bytes complete."""
        self._bytes += data
        return self._take(self._scanner.feed(data))

    def finish(self) -> list[Frame | Discard]:
        """Frames and discards at the end of the stream."""
        out = self._take(self._scanner.finish())
        end = self._start + len(self._bytes)
        return out + self._release(end)

    def _take(self, found: list[Frame | Discard]) -> list[Frame | Discard]:
        out: list[Frame | Discard] = []
        for item in found:
            if isinstance(item, Frame) and item.type == PANORAMA:
                out += self._part(item)
            elif not self._held:
                out += self._pass(item)
            else:
                self._held.append(item)
                if item.end - self._held[0].start > MAX_HELD_BYTES:
                    out += self._release(item.known_at)
        return out

    def _part(self, frame: Frame) -> list[Frame | Discard]:
        own, part, of, slots = self._codec.part_of(frame.payload)
        out = []
        if self._held and (own != self._own or of != self._of or part != len(self._parts)):
            out += self._release(frame.known_at)
        if not self._held and (part != 0 or not 1 <= of <= MAX_PARTS):
            return out + self._pass(self._discard(frame, frame.known_at))
        if not self._held:
            self._own, self._of = own, of
        self._parts.append(len(self._held))
        self._held.append(frame)
        self._slots += slots
        return out + self._join(frame.known_at) if len(self._parts) == of else out

    def _join(self, known_at: int) -> list[Frame | Discard]:
        first = self._held[self._parts[0]]
        assert isinstance(first, Frame)
        payload = self._codec.joined(first.payload, bytes(self._slots))
        for place in self._parts[1:]:
            self._held[place] = self._held[place]._replace(type=PART)  # type: ignore[union-attr]
        self._held[self._parts[0]] = first._replace(payload=payload)
        return self._give(known_at)

    def _release(self, known_at: int) -> list[Frame | Discard]:
        """What is held, without a panorama: the next part did not come."""
        for place in self._parts:
            part = self._held[place]
            assert isinstance(part, Frame)
            self._held[place] = self._discard(part, known_at)
        return self._give(known_at)

    def _give(self, known_at: int) -> list[Frame | Discard]:
        held, self._held, self._parts, self._slots = self._held, [], [], bytearray()
        out: list[Frame | Discard] = []
        for item in held:
            if isinstance(item, Frame):
                out += self._pass(item._replace(known_at=known_at))
            else:
                out += self._pass(Discard(item.start, item.data, item.reason, known_at))
        return out

    def _discard(self, frame: Frame, known_at: int) -> Discard:
        at = frame.start - self._start
        return Discard(frame.start, bytes(self._bytes[at : at + frame.size]), PART_MISSING, known_at)

    def _pass(self, item: Frame | Discard) -> list[Frame | Discard]:
        end = item.end
        del self._bytes[: end - self._start]
        self._start = end
        return [item]
