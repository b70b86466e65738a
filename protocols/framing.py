"""A sans-I/O frame decoder: bytes in, frames and discards out, every byte in exactly one of them.

A protocol's frames begin with a sync word, stand between delimiters, or are told apart by type, length and checksum
alone: a scanner for each finds them.
"""

import re
from collections.abc import Callable

from protocols.delimiter import Delimiter
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
from protocols.parts import PartsJoiner, Scanner
from protocols.protocol import Protocol
from protocols.wire_class import ClassLayout, ClassScanner


class FrameDecoder:
    """Finds the frames in a stream: those that the sensor sends, those that it is sent, or both (``from_sensor`` None).

    A message that goes the other way is no frame there: it is of an unknown type, or with ``echoes``, which is for a
    line that may give back what is sent, an `echo`.
    However the stream is cut into pieces, the same frames and the same discards come out, in the order of the stream.
    Always bytes_in == bytes_framed + bytes_discarded + pending.
    """

    def __init__(self, protocol: Protocol, *, from_sensor: bool | None = None, echoes: bool = False) -> None:
        self.bytes_in = 0
        self.bytes_framed = 0
        self.bytes_discarded = 0
        self._scanner = _scanner(protocol, from_sensor=from_sensor, echoes=echoes)

    @property
    def pending(self) -> int:
        """Bytes held back until it is known what they are; bounded by the largest frame and discard."""
        return self._scanner.pending

    @property
    def wanted(self) -> int:
        """How many bytes must come before anything can be found: what comes until then may come at once."""
        return self._scanner.wanted

    @property
    def refused(self) -> Discard | None:
        """What is held back, where it is known already that it begins with no frame; it comes as a discard later.

        For a sensor, which answers such a frame at once: its end is only known when the next one begins.
        """
        return self._scanner.refused

    def feed(self, data: bytes) -> list[Frame | Discard]:
        """Frames and discards that these bytes complete."""
        self.bytes_in += len(data)
        return self._count(self._scanner.feed(data))

    def finish(self) -> list[Frame | Discard]:
        """Frames and discards of the last bytes, at the end of the stream; afterwards nothing is pending."""
        return self._count(self._scanner.finish())

    def _count(self, found: list[Frame | Discard]) -> list[Frame | Discard]:
        for item in found:
            if isinstance(item, Frame):
                self.bytes_framed += item.size
            else:
                self.bytes_discarded += item.size
        return found


def _scanner(protocol: Protocol, *, from_sensor: bool | None, echoes: bool) -> Scanner:
    layout = protocol.frame_layout
    if from_sensor is not None:
        layout = protocol.one_way_layout(from_sensor=from_sensor, echoes=echoes)
    if isinstance(layout, ClassLayout):
        scanner: Scanner = ClassScanner(layout)
    elif layout.delimiter:
        scanner = DelimitedScanner(layout, layout.delimiter)
    else:
        scanner = SyncWordScanner(layout) if layout.sync_word else UnmarkedScanner(layout)
    return PartsJoiner(scanner, protocol.panoramas) if protocol.panoramas and protocol.panoramas.in_parts else scanner


class SyncWordScanner(HeldBytes):
    """Finds frames that begin with a sync word.

        sync word | header | payload | checksum | end word, where there is one
        start     | the same, with each escape doubled  | end

    The second is the framing of the kind `stuffed`, in which start and end begin with the escape.

    What follows a sync word is a frame if its type is known, its length is the one that the type allows, and its
    checksum is right; else the scan goes on one byte further, so that a frame inside a broken frame is found. The bytes
    from a refused sync word up to the next one are one discard.

    Holds at most one incomplete frame, or one incomplete discard with the start of a sync word.
    """

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


class UnmarkedScanner(HeldBytes):
    """Finds frames that are told apart by type, length and checksum alone.

        header | payload | checksum | end word, where there is one

    A frame may begin at each byte: it is one if its type is known, its length is one that the type allows, and its
    checksum and end word are right. Where no frame begins the scan goes on one byte further. What lies between two
    frames is `no sync`, but from a header with a right type and length on, whose checksum is wrong, it is `bad crc`.
    That something begins with no frame is never known early (``refused``): only its checksum tells, which any bytes may
    have.

    Holds at most one incomplete frame, and the discard before it.
    """

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


class DelimitedScanner(HeldBytes):
    """Finds frames between END bytes, such as SLIP's.

        END | header, payload and checksum, packed | END

    A packet is what stands between two END bytes. The END after a packet belongs to it, and so does one END before it,
    where there is one; idle ENDs beyond that are `no sync`, as are bytes before the first END and a packet that is
    longer than the longest frame can be.

    Holds at most one incomplete packet, or one incomplete discard; any byte may end a packet.
    """

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
