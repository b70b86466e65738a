"""Framings whose frames end with a byte that never stands in them: how each packs a frame, in one table.

A frame here is [header payload checksum]. SLIP (RFC 1055) sends

    C0 | the frame, with C0 sent as DB DC and DB sent as DB DD | C0

One more such framing is an entry of DELIMITERS with its two functions; ``protocols/delimited.py`` finds its frames.
"""

from collections.abc import Callable
from dataclasses import dataclass

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


def _slip_packed(frame: bytes) -> bytes:
    """An END on both sides: what noise left in the receiver ends at the first."""
    return _END + frame.replace(_ESCAPE, _ESCAPED_ESCAPE).replace(_END, _ESCAPED_END) + _END


def _slip_unpacked(packet: bytes) -> bytes | None:
    """None if an ESC byte is not followed as it must be."""
    escapes = packet.count(_ESCAPE)
    if escapes != packet.count(_ESCAPED_END) + packet.count(_ESCAPED_ESCAPE):
        return None
    return packet.replace(_ESCAPED_END, _END).replace(_ESCAPED_ESCAPE, _ESCAPE) if escapes else packet


SLIP = Delimiter("SLIP", _END, _slip_packed, _slip_unpacked, "an ESC byte is followed by neither DC nor DD")

DELIMITERS = {"slip": SLIP}
"""By the word for it in a description."""
