"""Frames that begin with a sync word, found in a stream of bytes.

    sync word | header | payload | checksum | end word, where there is one
    start     | the same, with each escape doubled  | end

The second is the framing of the kind `stuffed`, in which start and end begin with the escape.

What follows a sync word is a frame if its type is known, its length is the one that the type allows, and its checksum
is right; else the scan goes on one byte further, so that a frame inside a broken frame is found. The bytes from a
refused sync word up to the next one are one discard.
"""

import re
from collections.abc import Callable

from protocols.frame import (
    BAD_CRC,
    BAD_LENGTH,
    ECHO,
    MAX_DISCARD_BYTES,
    NO_SYNC,
    NOT_FOR_US,
    TRUNCATED,
    UNKNOWN_TYPE,
    Discard,
    Frame,
    HeldBytes,
    Reason,
    discards,
)
from protocols.layout import FrameLayout, Refused


class SyncWordScanner(HeldBytes):
    """Holds at most one incomplete frame, or one incomplete discard with the start of a sync word."""

    def __init__(self, layout: FrameLayout) -> None:
        super().__init__()
        self._layout = layout
        self._sync_word = layout.sync_word
        self._headed = len(layout.sync_word) + layout.header.size
        self._claimed = 0
        is_plain = layout.other is None and layout.addresses is None and not layout.escape
        self._examine_any: Callable[[int], Frame | Refused | Reason]
        self._examine_any = self._examine if is_plain else self._examine_both
        self._longest = 2 * layout.largest + 2
        escape = re.escape(layout.escape)
        self._inside = re.compile(b"(?:[^%b]|%b%b)*" % (escape, escape, escape) if escape else b"", re.DOTALL)

    @property
    def refused(self) -> Discard | None:
        """What is held back, where it is known already that it begins with no frame, and why."""
        is_known = self._reason not in (NO_SYNC, TRUNCATED)
        known_at = self._start + len(self._buffer)
        return Discard(self._start, bytes(self._buffer), self._reason, known_at) if is_known else None

    def feed(self, data: bytes) -> list[Frame | Discard]:
        """Frames and discards that these bytes complete."""
        self._buffer += data
        out: list[Frame | Discard] = []
        if len(self._buffer) < self._wanted:
            return out  # The frame that has begun is not whole yet.
        self._wanted = self._claimed = 0
        if at := self._take(out, final=False):
            self._drop(at)
        return out

    def finish(self) -> list[Frame | Discard]:
        """Frames and discards at the end of the stream: an incomplete frame is truncated."""
        out: list[Frame | Discard] = []
        self._claimed = len(self._buffer)
        at = self._take(out, final=True)
        tail = max(self._scan, len(self._buffer) - self._begun_sync_word())
        if self._reason is TRUNCATED:
            tail = len(self._buffer)
        known_at = self._start + len(self._buffer)
        out += discards(self._start + at, bytes(self._buffer[at:tail]), self._reason, known_at)
        out += discards(self._start + tail, bytes(self._buffer[tail:]), TRUNCATED, known_at)
        self._drop(len(self._buffer))
        self._scan, self._reason, self._wanted = 0, NO_SYNC, 0
        return out

    def _begun_sync_word(self) -> int:
        """How many bytes at the end of the buffer may be the start of a sync word."""
        lengths = range(len(self._sync_word) - 1, 0, -1)
        return next((n for n in lengths if self._buffer.endswith(self._sync_word[:n])), 0)

    def _take(self, out: list[Frame | Discard], *, final: bool) -> int:
        """Appends what is complete; returns where in the buffer the rest begins."""
        buffer, at, scan, reason = self._buffer, 0, self._scan, self._reason
        examine = self._examine_any
        while True:
            found = buffer.find(self._sync_word, scan)
            if found < 0:
                scan = max(scan, len(buffer) - len(self._sync_word) + 1)
                whole = (scan - at) // MAX_DISCARD_BYTES * MAX_DISCARD_BYTES
                if whole:
                    out += self._discards(at, at + whole, reason)
                    at, reason = at + whole, NO_SYNC
                if at == scan:
                    self._wanted = at + len(self._sync_word)
                break
            if found > at:
                out += self._discards(at, found, reason)
            at, scan = found, found
            verdict = examine(found)
            if isinstance(verdict, Frame):
                out.append(verdict)
                at = scan = found + verdict.size
                reason = NO_SYNC
            elif isinstance(verdict, Refused):
                out += discards(
                    self._start + found,
                    bytes(buffer[found : found + verdict.size]),
                    verdict.reason,
                    self._start + self._claimed,
                )
                at = scan = found + verdict.size
                reason = NO_SYNC
            elif verdict is TRUNCATED and not final:
                reason = NO_SYNC
                break
            else:
                scan, reason = found + 1, verdict
        self._scan, self._reason = scan, reason
        return at

    def _discards(self, at: int, end: int, reason: Reason) -> list[Discard]:
        """The bytes before a sync word, which tells their end; a full piece is known once none can begin in it."""
        start, mark = self._start, len(self._sync_word)
        known_at, full_since = start + max(self._claimed, end + mark), start + self._claimed
        return discards(
            start + at, bytes(self._buffer[at:end]), reason, known_at, full_since=full_since, behind=mark - 1
        )

    def _examine_both(self, at: int) -> Frame | Refused | Reason:
        """The same where frames of the other direction are looked for too: those are echoes."""
        found = self._examine_one(self._layout, at)
        if self._layout.other is None or isinstance(found, Frame) or found is TRUNCATED:
            return found
        echo = self._examine_one(self._layout.other, at)
        if isinstance(echo, Frame):
            return Refused(echo.size, ECHO)
        return TRUNCATED if echo is TRUNCATED else found

    def _examine_one(self, layout: FrameLayout, at: int) -> Frame | Refused | Reason:
        found = self._stuffed(layout, at) if layout.escape else self._examine(at, layout)
        if isinstance(found, Frame) and not layout.is_for_us(self._buffer, at + len(self._sync_word)):
            return Refused(found.size, NOT_FOR_US)
        return found

    def _examine(self, at: int, layout: FrameLayout | None = None) -> Frame | Reason:
        """The frame at a sync word, or why there is none; nothing after it is known before what it claims has come."""
        layout, buffer = self._layout if layout is None else layout, self._buffer
        payload_at = at + self._headed
        if len(buffer) < payload_at:
            self._wanted = payload_at
            return TRUNCATED
        self._claimed = max(self._claimed, payload_at)
        code, flags, length, sequence = layout.header.read(buffer, at + len(self._sync_word))
        size = layout.exact.get(code)
        if size is None:
            counted = layout.counted.get(code)
            if counted is None:
                return UNKNOWN_TYPE
            if length is not None and not counted.can_be(length):
                return BAD_LENGTH
            if len(buffer) < (end := payload_at + counted.base):
                self._wanted = end
                return TRUNCATED
            self._claimed = max(self._claimed, end)
            size = counted.stated(buffer, payload_at)
            if size < 0:
                return BAD_LENGTH
        if length is not None and length != size:
            return BAD_LENGTH
        end = payload_at + size + layout.tail
        if len(buffer) < end:
            self._wanted = end
            return TRUNCATED
        self._claimed = max(self._claimed, end)
        frame = bytes(buffer[at:end])
        if not layout.is_checksum_right(frame):
            return BAD_CRC
        payload = frame[self._headed : self._headed + size]
        start, known_at = self._start + at, self._start + self._claimed
        return Frame(start, len(frame), layout.names[code], flags, sequence, payload, known_at)

    def _stuffed(self, layout: FrameLayout, at: int) -> Frame | Reason:
        """The same where each escape within a frame is doubled, and one with another byte is its end."""
        buffer, first = self._buffer, at + len(self._sync_word)
        last = first + self._longest
        found = self._inside.match(buffer, first, last)
        assert found is not None
        end = min(found.end() + 2, last)
        if len(buffer) < end:
            self._wanted = end
            return TRUNCATED
        self._claimed = max(self._claimed, end)
        if buffer[found.end() : end] != layout.end_word:
            return BAD_LENGTH
        content = found[0].replace(2 * layout.escape, layout.escape)
        inner = layout.examine(layout.sync_word + content + layout.end_word)
        if isinstance(inner, str):
            return inner
        name, flags, sequence, payload = inner
        return Frame(self._start + at, end - at, name, flags, sequence, payload, self._start + self._claimed)
