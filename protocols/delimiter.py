"""Framings whose frames end with a byte that never stands in them: how each packs a frame, in one table.

A frame here is [header payload checksum].

    SLIP (RFC 1055)    C0 | the frame, with C0 sent as DB DC and DB sent as DB DD | C0
    HDLC (RFC 1662)    7E | the frame, with 7E sent as 7D 5E and 7D sent as 7D 5D | 7E
    COBS               the frame in groups of up to 254 bytes, each with its length before it instead of a 00 | 00

KISS is SLIP whose first byte, a command, is one of the header's.

One more such framing is an entry of DELIMITERS with its two functions; ``protocols/framing.py`` finds its frames.
Where the end is sent twice, ``packed`` writes it twice: the second one stands before the next frame, as HDLC's does.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass

from cobs import cobs

_END = b"\xc0"
_ESCAPE = b"\xdb"
_ESCAPED_END = b"\xdb\xdc"
_ESCAPED_ESCAPE = b"\xdb\xdd"


@dataclass(frozen=True, slots=True)
class Delimiter:
    """One framing: the ``end`` byte of each packet, and how frames become packets, at most twice as long.

    ``packed`` gives the bytes on the wire, ends included; ``unpacked`` the frame between two ends, or None where it was
    packed by no sensor, which ``fault`` says in words.
    """

    name: str
    end: bytes
    packed: Callable[[bytes], bytes]
    unpacked: Callable[[bytes], bytes | None]
    fault: str

    def __post_init__(self) -> None:
        if len(self.end) != 1:
            raise ValueError(
                f"{self.name}: the end has {len(self.end)} bytes, expected one; where it is sent twice, packed writes "
                "it twice"
            )


def _slip_packed(frame: bytes) -> bytes:
    """An END on both sides: what noise left in the receiver ends at the first."""
    return _END + frame.replace(_ESCAPE, _ESCAPED_ESCAPE).replace(_END, _ESCAPED_END) + _END


def _slip_unpacked(packet: bytes) -> bytes | None:
    """None if an ESC byte is not followed as it must be."""
    escapes = packet.count(_ESCAPE)
    if escapes != packet.count(_ESCAPED_END) + packet.count(_ESCAPED_ESCAPE):
        return None
    return packet.replace(_ESCAPED_END, _END).replace(_ESCAPED_ESCAPE, _ESCAPE) if escapes else packet


def _hdlc_packed(frame: bytes) -> bytes:
    """A flag on both sides."""
    return b"\x7e" + frame.replace(b"\x7d", b"\x7d\x5d").replace(b"\x7e", b"\x7d\x5e") + b"\x7e"


_ESCAPED_HDLC = re.compile(b"\x7d(.?)", re.DOTALL)


def _hdlc_unpacked(packet: bytes) -> bytes | None:
    """Any byte may be escaped; None if the last one is the escape itself, which aborts a frame."""
    if packet.endswith(b"\x7d"):
        return None
    return _ESCAPED_HDLC.sub(lambda found: bytes([found[1][0] ^ 0x20]), packet)


def _cobs_unpacked(packet: bytes) -> bytes | None:
    """None if a group claims more bytes than there are."""
    try:
        return bytes(cobs.decode(packet))
    except cobs.DecodeError:
        return None


SLIP = Delimiter("SLIP", _END, _slip_packed, _slip_unpacked, "an ESC byte is followed by neither DC nor DD")

HDLC = Delimiter("HDLC", b"\x7e", _hdlc_packed, _hdlc_unpacked, "the escape 7D is followed by the end of the frame")
COBS = Delimiter(
    "COBS",
    b"\0",
    lambda frame: cobs.encode(frame) + b"\0",
    _cobs_unpacked,
    "a group is shorter than its first byte says",
)

DELIMITERS = {"slip": SLIP, "hdlc": HDLC, "cobs": COBS}
"""By the word for it in a description."""
