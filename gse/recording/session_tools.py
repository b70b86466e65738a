"""Tools for session files: information, verification, recovery, trimming."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.errors import CaptureError
from drivers.session_file.reader import Capture, FileCheck, SessionCheck, read_capture, session_file, verify
from drivers.session_file.records import EVENTS, RX, Attachment, Damage, Record, RecordedMessage
from drivers.session_file.writer import write_compact
from gse.recording.session_format import MOST_KINDS, OTHER
from gse.values import instant

INFO_SCHEMA = "gse.session/1"
VERIFY_SCHEMA = "gse.session.verify/1"


@dataclass(frozen=True, slots=True)
class Copied:
    """A new session made from an old one: its path, its content, and the parts of the old one that are missing."""

    path: Path
    messages: int
    attachments: int
    rx_bytes: int
    damaged_bytes: int
    damaged_places: int
    missing: tuple[str, ...]
    foreign: tuple[str, ...]
    truncated: bool

    @property
    def is_all(self) -> bool:
        """Whether the old session was complete and undamaged."""
        return not (self.damaged_places or self.missing or self.truncated)


def session_info(path: Path) -> dict[str, Any]:
    """Content of a session, schema gse.session/1; CaptureError where there is none."""
    check = verify(path)
    events: dict[str, int] = {}
    for record in read_capture(path):
        if isinstance(record, RecordedMessage) and record.topic == EVENTS:
            kind = record.event().kind
            kind = kind if kind in events or len(events) < MOST_KINDS else OTHER
            events[kind] = events.get(kind, 0) + 1
    first_ns = min((file.first_ns for file in check.files if file.first_ns is not None), default=None)
    last_ns = max((file.last_ns for file in check.files if file.last_ns is not None), default=None)
    seconds = None if first_ns is None or last_ns is None else (last_ns - first_ns) / instant.NS_PER_S
    return {
        "schema": INFO_SCHEMA,
        "path": str(session_file(path)),
        "files": [file.name for file in check.files],
        "bytes": sum(file.size for file in check.files),
        "closed": check.files[-1].closed,
        "whole": check.is_whole,
        "start": instant.to_text(first_ns) if first_ns is not None else None,
        "end": instant.to_text(last_ns) if last_ns is not None else None,
        "seconds": None if seconds is None else round(seconds, 3),
        "rx_bytes": sum(file.rx_bytes for file in check.files),
        "tx_bytes": sum(file.tx_bytes for file in check.files),
        "messages": dict(sorted(sum((file.messages for file in check.files), start=Counter[str]()).items())),
        "attachments": list(dict.fromkeys(name for file in check.files for name in file.attachments)),
        "events": events,
    }


def verify_json(check: SessionCheck) -> dict[str, Any]:
    """Result of the verification, schema gse.session.verify/1."""
    return {
        "schema": VERIFY_SCHEMA,
        "whole": check.is_whole,
        "missing": list(check.missing),
        "foreign": list(check.foreign),
        "damaged_bytes": check.damaged_bytes,
        "files": [_file_json(file) for file in check.files],
    }


def _file_json(file: FileCheck) -> dict[str, Any]:
    return {
        "name": file.name,
        "bytes": file.size,
        "closed": file.closed,
        "checksums": file.checksums,
        "messages": sum(file.messages.values()),
        "rx_bytes": file.rx_bytes,
        "damaged_places": file.damage_count,
        "damages": [{"offset": d.offset, "bytes": d.size, "reason": d.reason} for d in file.damages],
    }


def describe(check: SessionCheck) -> list[str]:
    """Result of the verification as text."""
    lines = []
    for file in check.files:
        state = "whole" if file.is_whole else "cut off" if not file.closed else "damaged"
        lines.append(f"{file.name}: {state}, {sum(file.messages.values())} messages, {file.rx_bytes} received bytes")
        lines += [f"  {d.size} bytes from {d.offset} on: {d.reason}" for d in file.damages]
        if file.damage_count > len(file.damages):
            lines.append(f"  and {file.damage_count - len(file.damages)} more damaged places")
        if not file.closed:
            lines.append("  it was not closed: the session still runs, was killed, or its end is missing")
        elif not file.checksums and not file.damage_count:
            lines.append("  a checksum of the whole file is wrong, but every record is intact: no data is lost")
    return [*lines, *(f"missing: {name}" for name in check.missing), *check.foreign]


def recover(path: Path, out: Path) -> Copied:
    """Write every intact record of a session to a new file; CaptureError where that is not possible."""
    return _copy(read_capture(path), out, None, None)


def trim(path: Path, out: Path, from_utc_ns: int | None, to_utc_ns: int | None) -> Copied:
    """Write the records within [from, to), with the attachments, to a new session."""
    return _copy(read_capture(path), out, from_utc_ns, to_utc_ns)


class _Count:
    """Counts records on their way into the new file."""

    def __init__(self) -> None:
        self.messages = self.attachments = self.rx_bytes = 0

    def pass_on(self, records: Iterator[Record], from_ns: int, to_ns: int | None) -> Iterator[Record]:
        for record in records:
            if isinstance(record, Damage):
                continue
            if isinstance(record, Attachment):
                self.attachments += 1
            elif record.utc_ns < from_ns or (to_ns is not None and record.utc_ns >= to_ns):
                continue
            else:
                self.messages += 1
                self.rx_bytes += len(record.data) if record.topic == RX else 0
            yield record


def _copy(capture: Capture, out: Path, from_utc_ns: int | None, to_utc_ns: int | None) -> Copied:
    count = _Count()
    try:
        write_compact(out, count.pass_on(iter(capture), from_utc_ns or 0, to_utc_ns))
    except FileExistsError:
        raise CaptureError(f"{out} exists already; a session is never overwritten: choose another name") from None
    except OSError as error:
        raise CaptureError(f"cannot write {out}: {error.strerror}") from error
    return Copied(
        out,
        count.messages,
        count.attachments,
        count.rx_bytes,
        capture.damaged_bytes,
        capture.damage_count,
        tuple(capture.missing),
        tuple(capture.foreign),
        capture.truncated,
    )
