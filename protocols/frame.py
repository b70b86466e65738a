"""Parts of a stream of bytes: frames, and discards with their reason."""

from dataclasses import dataclass
from typing import Literal, NamedTuple

Reason = Literal["no sync", "unknown type", "bad length", "bad crc", "truncated"]

NO_SYNC: Reason = "no sync"
UNKNOWN_TYPE: Reason = "unknown type"
BAD_LENGTH: Reason = "bad length"
BAD_CRC: Reason = "bad crc"
TRUNCATED: Reason = "truncated"
REASONS: tuple[Reason, ...] = (NO_SYNC, UNKNOWN_TYPE, BAD_LENGTH, BAD_CRC, TRUNCATED)

MAX_DISCARD_BYTES = 4096
"""A discard is reported when its end is known, or when it has this many bytes: 0.4 s of garbage at 115200 baud."""


class Frame(NamedTuple):
    """A frame whose type, length and checksum are right; a tuple, because a night has a million of them.

    ``start`` is its offset in the stream, ``size`` its bytes there; ``type`` the name of its message; ``sequence`` is
    -1 in a protocol without sequence numbers.
    """

    start: int
    size: int
    type: str
    flags: int
    sequence: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class Discard:
    """Bytes from offset ``start`` on that are not a frame, and the reason."""

    start: int
    data: bytes
    reason: Reason


def discards(start: int, data: bytes, reason: Reason) -> list[Discard]:
    """These bytes in pieces; what follows the first piece is garbage that no frame began."""
    return [
        Discard(start + at, data[at : at + MAX_DISCARD_BYTES], NO_SYNC if at else reason)
        for at in range(0, len(data), MAX_DISCARD_BYTES)
    ]
