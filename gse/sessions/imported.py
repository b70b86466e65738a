"""Raw captures and tables of other programs as sessions: their bytes, a station file, and the UTC of their first frame.

A capture has no host times. The session says so (``start_utc`` in stated.json): its panoramas follow from that instant
by the sensor's clock, as in a replay of the capture itself, and its report is the same.

A table has UTC: it holds panoramas of a sensor, or the attitudes that one sent from orbit. Each row, or each panorama
of rows, becomes a frame of a protocol that goes into the session with it: the rest of the station reads the session as
any other. The UTC of the table is the sensor's absolute time tag.
"""

import csv
import json
import math
from collections import deque
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from drivers.chunk import Chunk
from drivers.errors import CaptureError
from drivers.host_files import a_file_or_a_shells_pipe
from drivers.playback import is_session, raw_items
from gse.config.station import Station
from gse.errors import TableError, UsageError
from gse.recording.recorder import Recorder
from gse.recording.session_format import PROTOCOL, STATED, STATION
from gse.values import instant
from gse.values.panorama import MAX_OBJECTS
from protocols import AttitudeMessage, PanoramaMessage, Protocol, load_protocol, parse_protocol

_Message = AttitudeMessage | PanoramaMessage
_MOST_LINE = 10_000
_QUATERNION, _ANGLES, _OBJECT = ("q1", "q2", "q3", "q4"), ("ra_deg", "de_deg", "roll_deg"), ("y", "x", "index")
_EXPECTED = (
    "expected a first line with utc, valid and q1, q2, q3, q4; or utc, valid and ra_deg, de_deg, roll_deg; or utc, y, "
    "x, index"
)
_VALID = {"1": True, "true": True, "yes": True, "0": False, "false": False, "no": False}
_SHORTEST_QUATERNION = 1e-6

_HEAD = """\
version: 1
name: {name}
note: made of a table by gse session import
byte_order: big
framing: {{kind: sync, sync_word: "A5C33C5A"}}
header:
  - {{name: type, type: u8}}
  - {{name: length, type: u16}}
  - {{name: sequence, type: u32}}
checksum: {{name: xxhash32}}
time: {{scale: unix}}
messages:
"""
_ATTITUDE = """\
  ATTITUDE:
    code: 0x01
    direction: from sensor
    fields:
      - {name: time, type: u64, unit: us}
      - {name: frame_no, type: u32}
      - {name: state, type: u8, values: {0: lost, 1: acquired}}
"""
_PANORAMA = """\
  PANORAMA:
    code: 0x01
    direction: from sensor
    fields:
      - {name: time, type: u64, unit: us}
      - {name: frame_no, type: u32}
      - {name: count, type: u8}
    slots:
      count: count
      most: 30
      fields:
        - {name: x, type: f64, unit: px}
        - {name: y, type: f64, unit: px}
        - {name: index, type: f64}
"""


def is_table(path: Path) -> bool:
    """Whether a file is a table: by the end of its name, or by a first line that has a column ``utc``."""
    if path.suffix.lower() == ".csv":
        return True
    with path.open("rb") as file:
        line = file.readline(_MOST_LINE)
    return b"utc" in [name.strip() for name in line.lower().replace(b";", b",").split(b",")]


class Table:
    """A table with UTC, read row by row: one of a gigabyte needs no more memory than a short one."""

    def __init__(self, path: Path, file: TextIO) -> None:
        self._path, self._file, self._number = path, file, 0
        first = next(self._lines(), "")
        if not first:
            raise TableError(f"{path} is empty: {_EXPECTED}")
        self._separator = ";" if ";" in first else ","
        self._names = [name.strip().lower() for name in self._split(first)]
        found = [names for names in (_QUATERNION, _ANGLES, _OBJECT) if {"utc", *names} <= set(self._names)]
        if not found:
            raise self._error(f"{first:.60} is no such head: {_EXPECTED}")
        self._values, self.is_panoramas = found[0], found[0] == _OBJECT
        if not self.is_panoramas and "valid" not in self._names:
            raise self._error("there is no column valid: expected 1 where the row holds an attitude, else 0")
        if len(set(self._names)) < len(self._names):
            raise self._error("two columns have one name: expected each column once")
        self._frames = 0
        self.protocol = _protocol(self._values)

    def chunks(self) -> Iterator[Chunk]:
        """The frames of the table, each at its UTC; TableError as for ``messages``."""
        for utc_ns, message in self.messages():
            yield Chunk(utc_ns, utc_ns, self.protocol.encode(message, message.frame_no - 1))

    def messages(self) -> Iterator[tuple[int, _Message]]:
        """What the frames say, each with its UTC; TableError names the line that cannot be read."""
        yield from self._panoramas() if self.is_panoramas else self._attitudes()
        if not self._frames:
            raise self._error("the table ends after its head: expected a row for each instant")

    def _attitudes(self) -> Iterator[tuple[int, _Message]]:
        before_ns = -1
        for row in self._rows():
            utc_ns = self._utc_ns(row, before_ns)
            if utc_ns // 1000 == before_ns // 1000:
                raise self._error(f"{row['utc']} stands on the line before, too: expected one row for each microsecond")
            before_ns = utc_ns
            valid = _VALID.get(row["valid"].lower())
            if valid is None:
                raise self._error(f"valid is {row['valid']!r:.60}: expected 1 or 0")
            values = [self._number_of(row, name) for name in self._values] if valid else []
            if valid and self._values == _QUATERNION and math.hypot(*values) < _SHORTEST_QUATERNION:
                raise self._error("the quaternion has length 0: expected numbers that say a direction, or valid 0")
            if valid and self._values == _ANGLES and abs(values[1]) > 90:
                raise self._error(f"de_deg is {values[1]:g}: expected -90 to 90")
            state = "acquired" if valid else "lost"
            named: dict[str, Any] = dict(zip(self._values, values, strict=valid))
            self._frames += 1
            yield utc_ns, AttitudeMessage(time_us=utc_ns // 1000, frame_no=self._frames, state=state, **named)

    def _panoramas(self) -> Iterator[tuple[int, _Message]]:
        """Rows of one UTC, one after the other, are a panorama."""
        at_ns, objects = -1, list[list[float]]()
        for row in self._rows():
            utc_ns = self._utc_ns(row, at_ns)
            if utc_ns != at_ns and objects:
                yield self._panorama(at_ns, objects)
                objects = []
            at_ns = utc_ns
            objects.append([self._number_of(row, name) for name in self._values])
            if len(objects) > MAX_OBJECTS:
                raise self._error(f"more than {MAX_OBJECTS} objects have one UTC; a panorama holds up to {MAX_OBJECTS}")
        if objects:
            yield self._panorama(at_ns, objects)

    def _panorama(self, utc_ns: int, objects: list[list[float]]) -> tuple[int, _Message]:
        """As in a single table, a line of zeros is no object: so a panorama without one is told, too."""
        table = np.array([one for one in objects if any(one)]).reshape(-1, 3)
        table = table[np.argsort(-table[:, 2], kind="stable")]
        self._frames += 1
        return utc_ns, PanoramaMessage(
            time_us=utc_ns // 1000,
            frame_no=self._frames,
            exposure_s=math.nan,
            flags=frozenset(),
            temperature_c=math.nan,
            xy_px=table[:, 1::-1],
            index=table[:, 2],
        )

    def _rows(self) -> Iterator[dict[str, str]]:
        for line in self._lines():
            fields = self._split(line)
            if len(fields) != len(self._names):
                comma = "; numbers have a decimal point, not a comma" if len(fields) > len(self._names) else ""
                raise self._error(f"{len(fields)} columns, expected {len(self._names)} as in the first line{comma}")
            yield {name: field.strip() for name, field in zip(self._names, fields, strict=True)}

    def _utc_ns(self, row: dict[str, str], before_ns: int) -> int:
        try:
            utc_ns = instant.from_text(row["utc"])
        except ValueError as error:
            raise self._error(str(error)) from error
        if utc_ns < before_ns:
            raise self._error(f"{row['utc']} is before the row above: expected rows in the order of time")
        return utc_ns

    def _number_of(self, row: dict[str, str], name: str) -> float:
        text = row[name]
        try:
            value = float(text)
        except ValueError:
            point = f": write the decimal point as {text.replace(',', '.')}" if text.count(",") == 1 else ""
            raise self._error(f"{name} is {text!r:.60}, expected a number{point}") from None
        if not math.isfinite(value):
            otherwise = "" if self.is_panoramas else ", or valid 0 where there is no attitude"
            raise self._error(f"{name} is {text!r:.60}, expected a finite number{otherwise}")
        return value

    def _split(self, line: str) -> list[str]:
        return next(csv.reader([line], delimiter=self._separator), [])

    def _lines(self) -> Iterator[str]:
        """The lines that are neither empty nor a comment."""
        while True:
            self._number += 1
            try:
                line = self._file.readline(_MOST_LINE + 1)
            except UnicodeDecodeError as error:
                raise self._error("this is not UTF-8 text: expected a table") from error
            if not line:
                return
            if len(line) > _MOST_LINE:
                raise self._error(f"more than {_MOST_LINE} characters: expected a row of a table")
            if text := line.partition("#")[0].strip():
                yield text

    def _error(self, text: str) -> TableError:
        return TableError(f"{self._path}, line {self._number}: {text}")


def open_table(path: Path) -> TextIO:
    """The text of a table."""
    try:
        return open(path, encoding="utf-8-sig", opener=a_file_or_a_shells_pipe)
    except OSError as error:
        raise TableError(f"cannot read {path}: {error.strerror}") from error


def _protocol(values: tuple[str, ...]) -> Protocol:
    """The protocol of the frames that hold these columns."""
    if values == _OBJECT:
        return parse_protocol(_HEAD.format(name="panorama-table") + _PANORAMA, "panorama-table")
    unit = ", unit: deg" if values == _ANGLES else ""
    fields = "".join(f"      - {{name: {name.removesuffix('_deg')}, type: f64{unit}}}\n" for name in values)
    return parse_protocol(_HEAD.format(name="attitude-table") + _ATTITUDE + fields, "attitude-table")


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
