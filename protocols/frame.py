"""Parts of a stream of bytes: frames, and discards with their reason."""

from dataclasses import dataclass
from typing import Literal, NamedTuple

Reason = Literal["no sync", "unknown type", "bad length", "bad crc", "truncated", "echo", "not for us", "part missing"]

NO_SYNC: Reason = "no sync"
UNKNOWN_TYPE: Reason = "unknown type"
BAD_LENGTH: Reason = "bad length"
BAD_CRC: Reason = "bad crc"
TRUNCATED: Reason = "truncated"
ECHO: Reason = "echo"
NOT_FOR_US: Reason = "not for us"
PART_MISSING: Reason = "part missing"
REASONS: tuple[Reason, ...] = (
    NO_SYNC, UNKNOWN_TYPE, BAD_LENGTH, BAD_CRC, TRUNCATED, ECHO, NOT_FOR_US, PART_MISSING,
)  # fmt: skip

MAX_DISCARD_BYTES = 4096
"""A discard is reported when its end is known, or when it has this many bytes: 0.4 s of garbage at 115200 baud."""


class Frame(NamedTuple):
    """A frame whose type, length and checksum are right; a tuple, because a night has a million of them.

    ``start`` is its offset in the stream, ``size`` its bytes there; ``type`` the name of its message; ``sequence`` is
    -1 in a protocol without sequence numbers. ``known_at`` is how many bytes of the stream had to come until it was
    known: up to its last one, or more where the begin of a broken frame before it claims them.
    """

    start: int
    size: int
    type: str
    flags: int
    sequence: int
    payload: bytes
    known_at: int

    @property
    def end(self) -> int:
        """The offset behind its last byte."""
        return self.start + self.size


@dataclass(frozen=True, slots=True)
class Discard:
    """Bytes from offset ``start`` on that are not a frame, and the reason; ``known_at`` as of a frame."""

    start: int
    data: bytes
    reason: Reason
    known_at: int

    @property
    def size(self) -> int:
        """How many bytes."""
        return len(self.data)

    @property
    def end(self) -> int:
        """The offset behind the last byte."""
        return self.start + self.size


class HeldBytes:
    """The bytes of a stream that a scanner holds until it is known what they are.

    The first of them is at the offset ``_start`` of the stream. Up to ``_scan`` they were looked at, ``_reason`` is why
    no frame was found there, and of a frame that has begun ``_wanted`` bytes must come.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._start = 0
        self._scan = 0
        self._wanted = 0
        self._reason: Reason = NO_SYNC

    @property
    def pending(self) -> int:
        """Bytes held back."""
        return len(self._buffer)

    @property
    def wanted(self) -> int:
        """How many bytes must come before anything can be found: those that are missing of a frame that has begun."""
        return max(self._wanted - len(self._buffer), 1)

    @property
    def refused(self) -> Discard | None:
        """What is held back, where it is known already that it begins with no frame; None where that never is."""
        return None

    def _drop(self, count: int) -> None:
        """Forget the first bytes, which were given on."""
        del self._buffer[:count]
        self._start += count
        self._scan -= count
        self._wanted = max(0, self._wanted - count)


def discards(
    start: int, data: bytes, reason: Reason, known_at: int, *, full_since: int | None = None, behind: int = 0
) -> list[Discard]:
    """These bytes in pieces; what follows the first piece is garbage that no frame began.

    All are known at ``known_at``, but a full piece from ``full_since`` on, ``behind`` so many bytes after its end.
    """
    full_since = known_at if full_since is None else full_since
    pieces = []
    for at in range(start, start + len(data), MAX_DISCARD_BYTES):
        piece = data[at - start : at - start + MAX_DISCARD_BYTES]
        is_full = len(piece) == MAX_DISCARD_BYTES
        piece_known_at = max(full_since, at + MAX_DISCARD_BYTES + behind) if is_full else known_at
        pieces.append(Discard(at, piece, NO_SYNC if at > start else reason, piece_known_at))
    return pieces
