"""Recordings as items of a timestamped port: sessions and raw captures, cut out, cut up, repeated."""

import re
from collections.abc import Iterator
from datetime import UTC, datetime
from itertools import chain
from pathlib import Path

from drivers.chunk import NS_PER_S, Chunk, LinkEvent, LinkKind
from drivers.errors import CaptureError, UrlError
from drivers.mock_ports import Item
from drivers.session_file.reader import Capture, read_capture
from drivers.session_file.record_scanner import MAGIC, refuse_special
from drivers.session_file.records import EVENTS, RX, TX, Damage, RecordedMessage

RAW_CHUNK_BYTES = 4096
_NEVER_NS = 1 << 64
"""Beyond every stamp of a session file."""


def session_items(path: Path, from_utc_ns: int | None = None, to_utc_ns: int | None = None) -> Iterator[Item]:
    """Chunks and events of a session in their order, within [from, to); CaptureError at once if it is none.

    What was sent comes as events SENT. Damage in the file and a missing end are events DAMAGED and TRUNCATED, in the
    place where they are.
    """
    capture = read_capture(path, from_utc_ns=from_utc_ns, only=(RX, TX, EVENTS))
    parts = _session_parts(path, capture, from_utc_ns or 0, _NEVER_NS if to_utc_ns is None else to_utc_ns)
    return chain.from_iterable(parts)


def _session_parts(path: Path, capture: Capture, from_utc_ns: int, to_utc_ns: int) -> Iterator[list[Item]]:
    """The items of each part of the file, and of its end."""
    stamp = (from_utc_ns, 0)
    for part in capture.parts():
        items: list[Item] = []
        for record in part:
            if isinstance(record, RecordedMessage):
                topic, utc_ns, mono_ns, data = record
                if from_utc_ns <= utc_ns < to_utc_ns:
                    stamp = (utc_ns, mono_ns)
                    items.append(Chunk(utc_ns, mono_ns, data) if topic == RX else _event(record))
            elif isinstance(record, Damage) and record.reason != "cut off":
                text = f"{record.file}: {record.size} bytes from {record.offset} on are damaged: {record.reason}"
                items.append(LinkEvent(*stamp, LinkKind.DAMAGED, text))
        yield items
    if capture.foreign:
        yield [LinkEvent(*stamp, LinkKind.DAMAGED, text) for text in capture.foreign]
    if capture.missing:
        yield [LinkEvent(*stamp, LinkKind.DAMAGED, f"missing: {', '.join(capture.missing)}")]
    elif capture.truncated and not capture.foreign:
        yield [LinkEvent(*stamp, LinkKind.TRUNCATED, f"{path.name} was not closed: its end may be missing")]


def _event(record: RecordedMessage) -> LinkEvent:
    if record.topic == TX:
        return LinkEvent(record.utc_ns, record.mono_ns, LinkKind.SENT, record.data.hex())
    return record.event()


_DUMPS = (
    (re.compile(rb"\x1f\x8b\x08"), "packed by gzip", "gunzip"),
    (re.compile(rb"(?:[0-9A-Fa-f]{4,8}:?[ \t]+(?:[0-9A-Fa-f]{2,4}[ \t]+){4,16}[^\n]*\n){2}"), "a hex dump", "xxd -r"),
    (re.compile(rb"(?:(?:0x)?[0-9A-Fa-f]{2}[\s,:;]*){64}"), "hexadecimal digits", "xxd -r -p"),
    (re.compile(rb"(?:[A-Za-z0-9+/]{60,76}\r?\n){2}"), "base64", "base64 -d"),
)
_HEAD_BYTES = 4096


def refuse_dump(path: Path) -> None:
    """CaptureError where a raw capture holds the bytes in another form, with the program that undoes it."""
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    for form, what, program in _DUMPS:
        if form.match(head):
            raise CaptureError(
                f"{path} is no raw capture: it is {what}; make one of it: {program} {path.name} > capture.bin"
            )


def raw_items(path: Path, start_utc_ns: int) -> Iterator[Item]:
    """The bytes of a raw capture, all stamped with the UTC of its start: the sensor's time tags give the rest."""
    refuse_dump(path)
    return _raw_items(path, start_utc_ns)


def _raw_items(path: Path, start_utc_ns: int) -> Iterator[Item]:
    with path.open("rb") as file:
        while data := file.read(RAW_CHUNK_BYTES):
            yield Chunk(start_utc_ns, 0, data)


def check_recording(path: Path) -> None:
    """CaptureError where there is nothing, or nothing was recorded."""
    if not path.exists():
        raise CaptureError(f"there is no recording {path}; expected a session (.mcap or its folder) or a raw capture")
    if path.is_file() and path.stat().st_size == 0:
        raise CaptureError(f"{path} is empty: nothing was recorded in it")


def is_session(path: Path) -> bool:
    """Whether a path is to be read as a session: a folder, a .mcap file, or anything that begins as MCAP."""
    if path.is_dir() or path.suffix == ".mcap":
        return True
    refuse_special(path)
    try:
        with path.open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except OSError as error:
        raise CaptureError(f"cannot read {path}: {error.strerror}") from error


def cut(items: Iterator[Item], most: int) -> Iterator[Item]:
    """The same bytes in chunks of at most ``most``, each part with the stamps of its whole."""
    for item in items:
        if isinstance(item, LinkEvent) or len(item.data) <= most:
            yield item
        else:
            for start in range(0, len(item.data), most):
                yield Chunk(item.utc_ns, item.mono_ns, item.data[start : start + most])


def utc_option(name: str, text: str | None) -> int | None:
    """UTC nanoseconds of an RFC 3339 option, None where it is absent."""
    if not text:
        return None
    try:
        if not text.endswith("Z"):
            raise ValueError
        instant = datetime.fromisoformat(text[:-1] + "+00:00").astimezone(UTC)
    except ValueError:
        message = f"{name}={text} is not a UTC instant: expected for example 2026-03-20T18:30:00Z"
        raise UrlError(message) from None
    return int(instant.replace(microsecond=0).timestamp()) * NS_PER_S + instant.microsecond * 1000
