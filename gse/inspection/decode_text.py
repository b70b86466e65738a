"""Frames and discards as lines for a person, and as JSON."""

import dataclasses
import math
from collections import Counter
from typing import Any

import numpy as np

from gse import instant
from gse.inspection.decode import Piece, Totals
from protocols import Discard, Frame, Message, PanoramaMessage, Protocol
from protocols.explain import explain

SCHEMA = "gse.decode/1"
_ROW_BYTES = 16
_FIRST_ROWS, _LAST_ROWS = 4, 1
"""Rows of bytes shown of a discard; the number of omitted rows stands between them."""


def line(piece: Piece, protocol: Protocol) -> str:
    """One line: direction, time, offset, size, content."""
    time = "" if piece.utc_ns is None else instant.to_text(piece.utc_ns) + "  "
    item = piece.item
    if isinstance(item, Discard):
        return f"{piece.direction}  {time}{item.start:>10} {len(item.data):>5}  discarded: {item.reason}"
    number = f" {item.sequence}" if item.sequence >= 0 else ""
    arrival = piece.arrival.value if piece.arrival and piece.arrival.value != "next" else ""
    notes = [_shown(piece.message), *sorted(protocol.flags_of(item)), arrival, *_problems(piece.message)]
    text = "  ".join(note for note in notes if note)
    return f"{piece.direction}  {time}{item.start:>10} {item.size:>5}  {item.type}{number}  {text}".rstrip()


def explanation(piece: Piece, protocol: Protocol) -> list[str]:
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
    lines += _rows(discard.start + len(discard.data), piece.after, " ")
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


def piece_json(piece: Piece, protocol: Protocol) -> dict[str, Any]:
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
            "size": len(item.data),
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
