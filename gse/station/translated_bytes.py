"""Bytes that a terminal or a bridge took out or translated on the way: each leaves a mark in how often bytes occur.

    what did it                  what it does to the bytes                    the mark
    flow control by software     takes 11 and 13 (XON, XOFF) out              neither ever occurs
    a terminal's onlcr           sends 0D 0A for 0A                           each 0A stands behind a 0D
    a terminal's icrnl           makes 0A of 0D                               0D never occurs
    a terminal's inlcr           makes 0D of 0A                               0A never occurs
    telnet                       doubles FF                                   FF occurs in pairs only

Numbers of a sensor, and its checksums, have all bytes. How often one should have come is told by those beside it.
"""

from collections.abc import Mapping

from protocols import Protocol

NONE_OF = 16
"""By chance a byte that should come so often is missing once in nine million sessions (exp(-16))."""
USUAL = 8
"""With fewer of each byte nothing is told."""
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
