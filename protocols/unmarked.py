"""Frames told apart by type, length and checksum alone, found in a stream of bytes.

    header | payload | checksum | end word, where there is one

A frame may begin at each byte: it is one if its type is known, its length is one that the type allows, and its checksum
and end word are right. Where no frame begins the scan goes on one byte further. What lies between two frames is `no
sync`, but from a header with a right type and length on, whose checksum is wrong, it is `bad crc`. That something
begins with no frame is never known early (``refused``): only its checksum tells, which any bytes may have.
"""

from protocols.frame import (
    BAD_CRC,
    ECHO,
    MAX_DISCARD_BYTES,
    NO_SYNC,
    NOT_FOR_US,
    TRUNCATED,
    Discard,
    Frame,
    HeldBytes,
    Reason,
    discards,
)
from protocols.layout import FrameLayout, Refused


class UnmarkedScanner(HeldBytes):
    """Holds at most one incomplete frame, and the discard before it."""

    def __init__(self, layout: FrameLayout) -> None:
        super().__init__()
        self._layout = layout
        self._headed = layout.header.size
        self._claimed = 0

    def feed(self, data: bytes) -> list[Frame | Discard]:
        """Frames and discards that these bytes complete."""
        self._buffer += data
        out: list[Frame | Discard] = []
        if len(self._buffer) >= self._wanted:
            self._drop(self._take(out))
        return out

    def finish(self) -> list[Frame | Discard]:
        """Frames and discards at the end of the stream: what may have been a frame is none."""
        out: list[Frame | Discard] = []
        self._claimed = len(self._buffer)
        at = self._take(out, final=True)
        known_at = self._start + len(self._buffer)
        out += discards(self._start + at, bytes(self._buffer[at:]), self._reason, known_at)
        self._drop(len(self._buffer))
        self._scan, self._reason, self._wanted, self._claimed = 0, NO_SYNC, 0, 0
        return out

    def _drop(self, count: int) -> None:
        super()._drop(count)
        self._claimed -= count

    def _take(self, out: list[Frame | Discard], *, final: bool = False) -> int:
        """Appends what is complete; returns where in the buffer the rest begins."""
        at, scan, reason = 0, self._scan, self._reason
        while scan < len(self._buffer):
            verdict = self._examine(scan)
            if verdict is TRUNCATED and not final:
                break
            if isinstance(verdict, Frame | Refused):
                at = self._discard(out, at, scan, reason)
                reason = NO_SYNC
                if isinstance(verdict, Frame):
                    out.append(verdict)
                    at = scan + verdict.size
                else:
                    at = self._discard(out, at, scan + verdict.size, verdict.reason)
                scan = at
                continue
            begins = verdict is TRUNCATED and reason is NO_SYNC and scan + self._headed <= len(self._buffer)
            if verdict is BAD_CRC or begins:
                at = self._discard(out, at, scan, reason)
                reason = verdict
            scan += 1
            if scan - at == MAX_DISCARD_BYTES:
                at, reason = self._discard(out, at, scan, reason), NO_SYNC
        self._scan, self._reason = scan, reason
        return at

    def _discard(self, out: list[Frame | Discard], at: int, end: int, reason: Reason) -> int:
        if end > at:
            known_at = self._start + max(self._claimed, end)
            out += discards(self._start + at, bytes(self._buffer[at:end]), reason, known_at)
        return end

    def _examine(self, at: int) -> Frame | Refused | Reason:
        """The frame that begins here, or why there is none."""
        found = self._examine_one(self._layout, at)
        if isinstance(found, Frame) and not self._layout.is_for_us(self._buffer, at):
            found = Refused(found.size, NOT_FOR_US)
        if self._layout.other is None or isinstance(found, Frame) or found is TRUNCATED:
            return found
        echo = self._examine_one(self._layout.other, at)
        if isinstance(echo, Frame) and self._layout.other.is_for_us(self._buffer, at):
            return Refused(echo.size, ECHO)
        return TRUNCATED if echo is TRUNCATED else found

    def _examine_one(self, layout: FrameLayout, at: int) -> Frame | Refused | Reason:
        buffer = self._buffer
        if not self._has_come(at + self._headed):
            return TRUNCATED
        code, flags, length, sequence = layout.header.read(buffer, at)
        size = layout.exact.get(code)
        if size is None:
            counted = layout.counted.get(code)
            if counted is None or (length is not None and not counted.can_be(length)):
                return NO_SYNC
            if not self._has_come(at + self._headed + counted.base):
                return TRUNCATED
            size = counted.stated(buffer, at + self._headed)
        if size < 0 or (length is not None and length != size):
            return NO_SYNC
        end = at + self._headed + size + layout.tail
        if not self._has_come(end):
            return TRUNCATED
        frame = bytes(buffer[at:end])
        if not layout.is_checksum_right(frame):
            return BAD_CRC
        payload = frame[self._headed : self._headed + size]
        known_at = self._start + self._claimed
        return Frame(self._start + at, len(frame), layout.names[code], flags, sequence, payload, known_at)

    def _has_come(self, end: int) -> bool:
        """Whether the bytes up to ``end`` are there; nothing after them is known before they are."""
        if len(self._buffer) < end:
            self._wanted = end
            return False
        self._claimed = max(self._claimed, end)
        return True
