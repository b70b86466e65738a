"""Raw captures and tables of other programs as sessions: their bytes, a station file, and the UTC of their first frame.

A capture has no host times. The session says so (``start_utc`` in stated.json): its panoramas follow from that instant
by the sensor's clock, as in a replay of the capture itself, and its report is the same.
"""

import json
from collections import deque
from collections.abc import Iterator, Mapping
from pathlib import Path

from drivers.chunk import Chunk
from drivers.errors import CaptureError
from drivers.mock.playback import is_session, raw_items
from gse.config.station import Station
from gse.errors import UsageError
from gse.recording.recorder import Recorder
from gse.recording.session_format import PROTOCOL, STATED, STATION
from gse.sessions.tables import Table, is_table, open_table
from gse.values import instant
from protocols import Protocol, load_protocol


def import_capture(
    capture: Path, path: Path, station: Station, station_text: str, start_utc: str | None, clock_error_s: float | None
) -> int:
    """Write a new session of a capture's bytes or of a table; how many bytes. CaptureError or UsageError where it
    cannot be."""
    if not capture.is_file():
        raise CaptureError(f"there is no capture {capture}; expected a file of received bytes")
    if is_session(capture):
        raise UsageError(f"{capture} is a session already: gse report, view and why take it as it is")
    if path.exists():
        raise UsageError(f"{path} exists; nothing is overwritten: choose another --out")
    if is_table(capture):
        return _import_table(capture, path, station_text, start_utc, clock_error_s)
    if start_utc is None:
        raise UsageError(
            f"{capture} has no times of its own: give the UTC of its first panorama, e.g. --start-utc "
            "2026-03-20T18:30:00Z"
        )
    try:
        start_ns = instant.from_text(start_utc)
    except ValueError as error:
        raise UsageError(f"--start-utc: {error}") from error
    protocol = load_protocol(station.protocol)
    items = raw_items(capture, start_ns)
    return _write(path, station_text, protocol, start_utc, clock_error_s, items)  # type: ignore[arg-type]  # no events


def _import_table(
    table_path: Path, path: Path, station_text: str, start_utc: str | None, clock_error_s: float | None
) -> int:
    """The table is read once before the session is made: a line that cannot be read leaves no half of one."""
    if start_utc is not None:
        raise UsageError(f"{table_path} is a table with UTC: leave --start-utc out")
    with open_table(table_path) as file:
        messages = Table(table_path, file).messages()
        first_utc = instant.to_text(next(messages)[0], 9)
        deque(messages, maxlen=0)
    with open_table(table_path) as file:
        table = Table(table_path, file)
        return _write(path, station_text, table.protocol, first_utc, clock_error_s, table.chunks())


def _write(
    path: Path,
    station_text: str,
    protocol: Protocol,
    start_utc: str,
    clock_error_s: float | None,
    chunks: Iterator[Chunk],
) -> int:
    size = 0
    with Recorder(path, live=False) as recorder:
        recorder.attach(STATION, "application/yaml", station_text.encode())
        recorder.attach(PROTOCOL, "application/yaml", protocol.text.encode())
        stated = {"start_utc": start_utc, "clock_error_s": clock_error_s}
        recorder.attach(STATED, "application/json", json.dumps(stated).encode())
        for chunk in chunks:
            recorder.rx(chunk)
            size += len(chunk.data)
    return size


def stated_start_ns(attachments: Mapping[str, str]) -> int | None:
    """The UTC of the first panorama of an imported session; None of one that was recorded here."""
    try:
        return instant.from_text(str(json.loads(attachments.get(STATED) or "{}")["start_utc"]))
    except (ValueError, KeyError, TypeError, RecursionError):
        return None
