"""Frames between END bytes, such as SLIP's, found in a stream of bytes.

    END | header, payload and checksum, packed | END

A packet is what stands between two END bytes. The END after a packet belongs to it, and so does one END before it,
where there is one; idle ENDs beyond that are `no sync`, as are bytes before the first END and a packet that is longer
than the longest frame can be.
"""

from protocols.delimiter import Delimiter
from protocols.frame import (
    BAD_CRC,
    BAD_LENGTH,
    ECHO,
    MAX_DISCARD_BYTES,
    NO_SYNC,
    TRUNCATED,
    UNKNOWN_TYPE,
    Discard,
    Frame,
    HeldBytes,
    Reason,
    discards,
)
from protocols.layout import FrameLayout


class DelimitedScanner(HeldBytes):
    """Holds at most one incomplete packet, or one incomplete discard; any byte may end a packet."""

    def __init__(self, layout: FrameLayout, delimiter: Delimiter) -> None:
        super().__init__()
        self._layout = layout
        self._delimiter = delimiter
        self._largest = 2 * layout.largest
        self._ends = 0
        self._synced = False
        self._overlong = False

    def feed(self, data: bytes) -> list[Frame | Discard]:
        """Frames and discards that these bytes complete."""
        self._buffer += data
        out: list[Frame | Discard] = []
        at, mark = 0, self._delimiter.end
        while (end := self._buffer.find(mark, self._scan)) >= 0:
            self._scan = end + 1
            at = self._close(out, at, end)
        self._scan = len(self._buffer)
        since = self._overlong_since(at)
        self._overlong = self._scan >= since
        if self._overlong:
            self._ends = 0
            whole = (self._scan - at) // MAX_DISCARD_BYTES * MAX_DISCARD_BYTES
            at = self._discard(out, at, at + whole, NO_SYNC, full_since=since)
        self._drop(at)
        return out

    def finish(self) -> list[Frame | Discard]:
        """Frames and discards at the end of the stream: a packet without its END is truncated."""
        out: list[Frame | Discard] = []
        at = self._discard(out, 0, max(0, self._ends - 1), NO_SYNC)
        known = not self._overlong and (self._synced or self._ends > 0)
        at = self._discard(out, at, len(self._buffer), TRUNCATED if known else NO_SYNC)
        self._drop(at)
        self._ends, self._synced, self._overlong = 0, False, False
        return out

    def _overlong_since(self, at: int) -> int:
        """Where in the buffer what began at ``at`` becomes longer than a frame can be."""
        return 0 if self._overlong else at + self._ends + self._largest + 1

    def _discard(
        self, out: list[Frame | Discard], at: int, end: int, reason: Reason, *, full_since: int | None = None
    ) -> int:
        """Discard bytes that are known now; with ``full_since`` full pieces were known before the END was."""
        if end > at:
            full_since = None if full_since is None else self._start + full_since
            known_at = self._start + self._scan
            out += discards(self._start + at, bytes(self._buffer[at:end]), reason, known_at, full_since=full_since)
        return end

    def _close(self, out: list[Frame | Discard], at: int, end: int) -> int:
        """Takes the packet that this END closes; returns where in the buffer the rest begins."""
        if end == at + self._ends and not self._overlong:
            return self._idle(out, at)
        if end >= (since := self._overlong_since(at)):
            at = self._discard(out, at, end + 1, NO_SYNC, full_since=since)
        else:
            at = self._discard(out, at, at + max(0, self._ends - 1), NO_SYNC)
            opened = min(self._ends, 1)
            begun = self._buffer.rfind(self._layout.begin, at + opened, end) if self._layout.begin else -1
            if begun > at + opened:  # what stands before the first byte of a line is noise
                at, opened = self._discard(out, at, begun, NO_SYNC), 0
            synced = self._synced or self._ends > 0 or begun >= 0
            verdict = self._examine(at, at + opened, end)
            if isinstance(verdict, Frame):
                out.append(verdict)
                at = end + 1
            else:
                at = self._discard(out, at, end + 1, verdict if synced else NO_SYNC)
        self._ends, self._synced, self._overlong = 0, True, False
        return at

    def _idle(self, out: list[Frame | Discard], at: int) -> int:
        self._ends += 1
        if self._ends > MAX_DISCARD_BYTES:
            at = self._discard(out, at, at + MAX_DISCARD_BYTES, NO_SYNC)
            self._ends -= MAX_DISCARD_BYTES
        return at

    def _examine(self, start: int, at: int, end: int) -> Frame | Reason:
        """The frame of the packet from ``at`` to ``end``, or why there is none; ``start`` is its opening END."""
        packet = bytes(self._buffer[at:end])
        content = self._delimiter.unpacked(packet)
        if content is None:
            return self._unpackable(packet)
        layout = self._layout
        found = layout.examine(content)
        if isinstance(found, str):
            is_echo = layout.other is not None and not isinstance(layout.other.examine(content), str)
            return ECHO if is_echo else found
        name, flags, sequence, payload = found
        known_at = self._start + end + 1
        return Frame(self._start + start, end + 1 - start, name, flags, sequence, payload, known_at)

    def _unpackable(self, packet: bytes) -> Reason:
        """Why what cannot be unpacked is no frame: what its first bytes say of it as they are."""
        layout = self._layout
        if len(packet) < layout.header.size:
            return BAD_LENGTH
        return BAD_CRC if layout.header.read(packet, 0)[0] in layout.sizes else UNKNOWN_TYPE
