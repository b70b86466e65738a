"""Decoding of recorded bytes: each frame and each discard in order, with the bytes around it."""

import dataclasses
import math
from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from drivers.playback import check_recording, is_session, refuse_dump
from drivers.session_file.reader import Capture, read_capture
from drivers.session_file.records import RX, TX, Attachment, Damage
from gse.recording.session_format import PROTOCOL
from gse.station.reception import Arrivals
from gse.station.results import LinkCounters
from gse.values import instant
from protocols import (
    Arrival,
    Discard,
    Frame,
    FrameDecoder,
    Message,
    PanoramaMessage,
    Protocol,
    load_protocol,
    parse_protocol,
)
from protocols.layout import FrameLayout
from protocols.text import TextLayout

CONTEXT_BYTES = 16
"""Bytes shown before and after a discard."""

_BLOCK_BYTES = 65_536
_DEFAULT_PROTOCOL = "panorama-v1"


@dataclass(frozen=True, slots=True)
class DecodedPiece:
    """A frame with its message, or a discard with the bytes around it.

    ``direction`` is ``rx`` (from the sensor) or ``tx``; ``utc_ns`` is the time of its first byte, None in a raw
    capture; ``arrival`` the class of its sequence number.
    """

    direction: str
    utc_ns: int | None
    item: Frame | Discard
    message: Message | None = None
    arrival: Arrival | None = None
    before: bytes = b""
    after: bytes = b""


@dataclass(slots=True)
class Totals:
    """Totals of one direction; bytes_in == bytes_framed + bytes_discarded at the end of the stream."""

    bytes_in: int = 0
    bytes_framed: int = 0
    bytes_discarded: int = 0
    frames: Counter[str] = field(default_factory=Counter)
    discards: Counter[str] = field(default_factory=Counter)
    discarded_by_reason: Counter[str] = field(default_factory=Counter)
    frames_lost: int = 0
    duplicates: int = 0
    resets: int = 0
    frames_with_problems: int = 0


class _Stream:
    """One direction; pieces are held back until the bytes after them are there, or the stream ends."""

    def __init__(self, direction: str, protocol: Protocol) -> None:
        self.totals = Totals()
        self._direction = direction
        self._protocol = protocol
        self._decoder = FrameDecoder(protocol, from_sensor=direction == "rx")
        self._counters = LinkCounters()
        self._arrivals: Arrivals | None = None
        self._recent = bytearray()
        self._recent_start = 0
        self._stamps: deque[tuple[int, int | None]] = deque()
        self._waiting: deque[Frame | Discard] = deque()

    def feed(self, data: bytes, utc_ns: int | None) -> Iterator[DecodedPiece]:
        """The pieces that these bytes complete."""
        self._stamps.append((self._decoder.bytes_in, utc_ns))
        self._recent += data
        self._waiting += self._decoder.feed(data)
        yield from self._release(self._decoder.bytes_in - CONTEXT_BYTES)
        needed = self._waiting[0].start if self._waiting else self._decoder.bytes_in - self._decoder.pending
        cut = max(0, needed - CONTEXT_BYTES - self._recent_start)
        del self._recent[:cut]
        self._recent_start += cut

    def finish(self) -> Iterator[DecodedPiece]:
        """The rest, at the end of the stream."""
        self._waiting += self._decoder.finish()
        yield from self._release(self._decoder.bytes_in)

    def _release(self, up_to: int) -> Iterator[DecodedPiece]:
        while self._waiting and self._waiting[0].end <= up_to:
            yield self._piece(self._waiting.popleft())

    def _piece(self, item: Frame | Discard) -> DecodedPiece:
        while len(self._stamps) > 1 and self._stamps[1][0] <= item.start:
            self._stamps.popleft()
        utc_ns = self._stamps[0][1]
        totals = self.totals
        totals.bytes_in = item.end
        if isinstance(item, Frame):
            return self._frame(item, utc_ns)
        totals.bytes_discarded += item.size
        totals.discards[item.reason] += 1
        totals.discarded_by_reason[item.reason] += item.size
        start, end = item.start - self._recent_start, item.end - self._recent_start
        before, after = self._recent[max(0, start - CONTEXT_BYTES) : start], self._recent[end : end + CONTEXT_BYTES]
        return DecodedPiece(self._direction, utc_ns, item, before=bytes(before), after=bytes(after))

    def _frame(self, frame: Frame, utc_ns: int | None) -> DecodedPiece:
        message = self._protocol.decode(frame)
        arrival = self._arrival(frame, message, utc_ns)
        totals, counters = self.totals, self._counters
        totals.bytes_framed += frame.size
        totals.frames[frame.type] += 1
        totals.frames_with_problems += bool(message.problems)
        totals.frames_lost, totals.duplicates = counters.frames_lost, counters.duplicates
        totals.resets = counters.sensor_resets
        return DecodedPiece(self._direction, utc_ns, frame, message, arrival)

    def _arrival(self, frame: Frame, message: Message, utc_ns: int | None) -> Arrival:
        if self._arrivals is None:
            self._arrivals = Arrivals(self._protocol, self._counters, has_times=utc_ns is not None)
        # As the reception does it: only the tags of panoramas tell a restart.
        panorama = message if isinstance(message, PanoramaMessage) else None
        return self._arrivals.accept(
            frame,
            utc_ns or 0,
            panorama.time_us if panorama else None,
            restarted=panorama is not None and "clock reset" in panorama.flags,
        )


class Decoding:
    """The pieces of a recording: iterate over it once; ``totals`` by direction fill as it goes.

    ``damages`` lists what was damaged in the session file itself, when the iteration is over.
    """

    def __init__(self, path: Path, protocol_name: str | None = None) -> None:
        """CaptureError where there is no such recording, DescriptionError for a wrong protocol."""
        _check_readable(path)
        self._path = path
        self._capture: Capture | None = None
        self.protocol = _protocol_of(path, protocol_name)
        self._streams = {name: _Stream(name, self.protocol) for name in ("rx", "tx")}

    @property
    def totals(self) -> dict[str, Totals]:
        """The totals of each direction that had any bytes, and of ``rx`` always."""
        return {name: s.totals for name, s in self._streams.items() if name == "rx" or s.totals.bytes_in}

    @property
    def is_damaged(self) -> bool:
        """Whether the session file lacks its end or has damaged places."""
        return self._capture is not None and self._capture.is_damaged

    @property
    def damages(self) -> list[Damage]:
        """The first damaged places of the session file."""
        return self._capture.damages if self._capture else []

    def __iter__(self) -> Iterator[DecodedPiece]:
        for direction, data, utc_ns in self._bytes():
            yield from self._streams[direction].feed(data, utc_ns)
        for stream in self._streams.values():
            yield from stream.finish()

    def _bytes(self) -> Iterator[tuple[str, bytes, int | None]]:
        if not is_session(self._path):
            with self._path.open("rb") as file:
                while block := file.read(_BLOCK_BYTES):
                    yield "rx", block, None
            return
        self._capture = read_capture(self._path)
        for record in self._capture:
            if not isinstance(record, Attachment | Damage) and record.topic in (RX, TX):
                yield ("rx" if record.topic == RX else "tx"), record.data, record.utc_ns


def _check_readable(path: Path) -> None:
    check_recording(path)
    if path.is_file() and not is_session(path):
        refuse_dump(path)


def _protocol_of(path: Path, name: str | None) -> Protocol:
    """The protocol of the option, else that of the session, else the reference protocol."""
    if name is not None:
        return load_protocol(name)
    if is_session(path):
        for record in read_capture(path):
            if isinstance(record, Attachment) and record.name == PROTOCOL:
                return parse_protocol(record.data.decode("utf-8", "replace"), f"{path}: protocol.yaml")
    return load_protocol(_DEFAULT_PROTOCOL)


# Frames and discards as lines for a person, and as JSON.

SCHEMA = "gse.decode/1"
_ROW_BYTES = 16
_FIRST_ROWS, _LAST_ROWS = 4, 1
"""Rows of bytes shown of a discard; the number of omitted rows stands between them."""


def line(piece: DecodedPiece, protocol: Protocol) -> str:
    """One line: direction, time, offset, size, content."""
    time = "" if piece.utc_ns is None else instant.to_text(piece.utc_ns) + "  "
    item = piece.item
    if isinstance(item, Discard):
        return f"{piece.direction}  {time}{item.start:>10} {item.size:>5}  discarded: {item.reason}"
    number = f" {item.sequence}" if item.sequence >= 0 else ""
    arrival = piece.arrival.value if piece.arrival and piece.arrival.value != "next" else ""
    items = ", ".join(f"{name} {_text(value)}" for name, value in _items(item, protocol).items())
    notes = [_shown(piece.message), items, *sorted(protocol.flags_of(item)), arrival, *_problems(piece.message)]
    text = "  ".join(note for note in notes if note)
    return f"{piece.direction}  {time}{item.start:>10} {item.size:>5}  {item.type}{number}  {text}".rstrip()


def explanation(piece: DecodedPiece, protocol: Protocol) -> list[str]:
    """Lines below a discard: what was expected, and its bytes between those before and after it."""
    discard = piece.item
    assert isinstance(discard, Discard)
    lines = [explain(protocol.frame_layout, discard)]
    lines += _rows(discard.start - len(piece.before), piece.before, " ")
    rows = _rows(discard.start, discard.data, ">")
    if len(rows) > _FIRST_ROWS + _LAST_ROWS:
        excluded = f"  ... {len(rows) - _FIRST_ROWS - _LAST_ROWS} rows of {_ROW_BYTES} bytes"
        rows = [*rows[:_FIRST_ROWS], excluded, *rows[-_LAST_ROWS:]]
    lines += rows
    lines += _rows(discard.end, piece.after, " ")
    return [f"      {text}" for text in lines]


def _rows(start: int, data: bytes, mark: str) -> list[str]:
    parts = [(at, data[at : at + _ROW_BYTES]) for at in range(0, len(data), _ROW_BYTES)]
    return [f"{mark} {start + at:>10}  {part.hex(' ').upper():<47}  {_ascii(part)}" for at, part in parts]


def _ascii(data: bytes) -> str:
    return "".join(chr(byte) if 32 <= byte < 127 else "." for byte in data)


def _problems(message: Message | None) -> list[str]:
    return [f"[{problem}]" for problem in message.problems] if message else []


def _shown(message: Message | None) -> str:
    if message is None:
        return ""
    parts = [f"{name} {_text(value)}" for name, value in _values(message).items()]
    if isinstance(message, PanoramaMessage):
        parts.append(f"objects {len(message.index)}")
    return ", ".join(parts)


def _values(message: Message) -> dict[str, Any]:
    """Scalars of a message, without arrays, problems and absent values."""
    names = (field.name for field in dataclasses.fields(message) if field.name != "problems")
    values = {name: getattr(message, name) for name in names}
    return {
        name: value
        for name, value in values.items()
        if not isinstance(value, np.ndarray) and value not in ("", (), frozenset()) and not _is_nan(value)
    }


def _items(frame: Frame, protocol: Protocol) -> dict[str, Any]:
    """The items that the description of a message names beside its standard fields."""
    message = protocol.description.every_message.get(frame.type)
    names = {item.name for item in message.items} if message else ()
    return {name: _plain(value) for name, value in protocol.items_of(frame).items() if name in names} if names else {}


def _is_nan(value: Any) -> bool:
    return isinstance(value, float) and math.isnan(value)


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.10g}"
    if isinstance(value, tuple):
        return ".".join(str(part) for part in value)
    if isinstance(value, frozenset):
        return "+".join(sorted(value))
    return value.hex(" ").upper() if isinstance(value, bytes) else str(value)


def piece_json(piece: DecodedPiece, protocol: Protocol) -> dict[str, Any]:
    """A frame or a discard as JSON, schema gse.decode/1."""
    item = piece.item
    document: dict[str, Any] = {
        "schema": SCHEMA,
        "kind": "frame" if isinstance(item, Frame) else "discard",
        "direction": piece.direction,
        "utc": None if piece.utc_ns is None else instant.to_text(piece.utc_ns),
        "start": item.start,
    }
    if isinstance(item, Discard):
        return document | {
            "size": item.size,
            "reason": item.reason,
            "explanation": explain(protocol.frame_layout, item),
            "before": piece.before.hex(),
            "hex": item.data.hex(),
            "after": piece.after.hex(),
        }
    assert piece.message is not None
    return document | {
        "size": item.size,
        "type": item.type,
        "sequence": None if item.sequence < 0 else item.sequence,
        "arrival": piece.arrival.value if piece.arrival else None,
        "flags": sorted(protocol.flags_of(item)),
        "message": _message_json(piece.message),
        **({"items": items} if (items := _items(item, protocol)) else {}),
        "problems": list(piece.message.problems),
    }


def _message_json(message: Message) -> dict[str, Any]:
    document = {name: _plain(value) for name, value in _values(message).items()}
    if isinstance(message, PanoramaMessage):
        rows = np.column_stack((message.xy_px, message.index)).tolist()
        document["objects"] = [{"x_px": _plain(x), "y_px": _plain(y), "index": _plain(i)} for x, y, i in rows]
    return document


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, frozenset):
        return sorted(value)
    return value.hex() if isinstance(value, bytes) else value


def totals_json(totals: dict[str, Totals], protocol: Protocol) -> dict[str, Any]:
    """The totals of all directions as JSON, schema gse.decode/1."""
    return {
        "schema": SCHEMA,
        "kind": "totals",
        "protocol": protocol.name,
        **{direction: _total_json(total) for direction, total in totals.items()},
    }


def _total_json(total: Totals) -> dict[str, Any]:
    values = {field.name: getattr(total, field.name) for field in dataclasses.fields(total)}
    return {name: dict(value) if isinstance(value, Counter) else value for name, value in values.items()}


def totals_lines(totals: dict[str, Totals]) -> list[str]:
    """The totals as a few lines that add up."""
    lines = []
    for direction, total in totals.items():
        lines.append(
            f"{direction}: {total.bytes_in} bytes in = {total.bytes_framed} framed + {total.bytes_discarded} discarded"
        )
        frames = ", ".join(f"{count} {name}" for name, count in sorted(total.frames.items())) or "none"
        lines.append(f"    {total.frames.total()} frames: {frames}")
        discards = ", ".join(
            f"{count} {reason} ({total.discarded_by_reason[reason]} bytes)"
            for reason, count in sorted(total.discards.items())
        )
        lines.append(f"    {total.discards.total()} discards: {discards or 'none'}")
        lines.append(
            f"    frames lost: {total.frames_lost}; duplicates: {total.duplicates}; sensor resets: {total.resets}; "
            f"frames with values out of order: {total.frames_with_problems}"
        )
    return lines


# Explanation of discarded bytes: the expected frame against the received bytes.


def explain(layout: FrameLayout, discard: Discard) -> str:
    """One line: what was expected and what came, as far as the discarded bytes show it."""
    match discard.reason:
        case "no sync":
            return f"no frame begins in these {discard.size} bytes"
        case "echo":
            return "a frame that goes to the sensor: an adapter gives back what is sent, or another master is there"
        case "not for us":
            return "a frame between other addresses than port.address and port.host_address"
        case "part missing":
            return "a part of a panorama of which another part did not come, or not in order"
        case _ if isinstance(layout, TextLayout):
            return _explain_line(layout, discard)
        case _ if layout.escape:
            return f"{discard.size} bytes from a start word on"
    content = discard.data[len(layout.sync_word) :]
    if layout.delimiter:
        unpacked = layout.delimiter.unpacked(content.strip(layout.delimiter.end))
        if unpacked is None:
            return layout.delimiter.fault
        content = unpacked
    if len(content) < layout.header.size:
        return f"{len(content)} bytes of a header of {layout.header.size}"
    code, _, length, sequence = layout.header.read(content, 0)
    if code not in layout.sizes:
        return f"no message has type {code:02X}; known are {', '.join(f'{c:02X}' for c in sorted(layout.sizes))}"
    name = layout.names[code] + (f", sequence {sequence}" if sequence >= 0 else "")
    if discard.reason == "unknown type":
        return f"{name}: this message goes the other way; is it an echo, or a capture of both directions?"
    size = _size(layout, code, content)
    if size is None:
        return f"{name}: its count says more objects than the {layout.counted[code].most} that it can have"
    there = len(content) - layout.header.size - layout.tail
    match discard.reason:
        case "bad length" if length is not None and length != size:
            return f"{name}: the header says {length} bytes of payload; it has {size}"
        case "bad length":
            return f"{name}: {max(there, 0)} bytes of payload came; it has {size}"
        case "bad crc" if there >= size:
            return f"{name}: {_checksums(layout, content, size)}"
        case "bad crc":
            return f"{name}: {layout.checksum.name} is wrong; the next sync word comes {size - there} bytes too early"
        case _:
            return f"{name}: the stream ends {size - there} bytes before the frame does"


def _size(layout: FrameLayout, code: int, content: bytes) -> int | None:
    """The bytes of payload that a frame says it has; None where its count is over the most."""
    counted = layout.counted.get(code)
    if counted is None or len(content) < layout.header.size + counted.base:
        return layout.sizes[code]
    size = counted.stated(content, layout.header.size)
    return None if size < 0 else size


def _explain_line(layout: TextLayout, discard: Discard) -> str:
    match discard.reason:
        case "unknown type":
            return f"the first field is none of {', '.join(sorted(layout.words))}"
        case "bad crc":
            body = discard.data.strip().removeprefix(layout.begin).partition(b"*")[0]
            expected = f"{layout.checksum.compute(body):0{2 * layout.checksum.size}X}"
            return f"{layout.checksum.name} should be {expected}, by the characters before *"
        case "truncated":
            return "the stream ends before the line does"
        case _:
            return (
                "not as many fields as this line has, or a field that is no number: a time with a point needs `digits`"
            )


def _checksums(layout: FrameLayout, content: bytes, size: int) -> str:
    end = layout.header.size + size
    expected = layout.checksum_of(layout.sync_word + content[:end])
    found = content[end : end + layout.checksum.size]
    if expected == found:
        return f"the end word {layout.end_word.hex().upper()} is missing"
    return (
        f"{layout.checksum.name} is {found.hex().upper()} on the wire, {expected.hex().upper()} by the bytes before it"
    )
