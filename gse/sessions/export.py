"""Export of sessions: CSV, NDJSON, bytes."""

import csv
import heapq
import json
import shutil
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, TextIO

import pyarrow as pa
import pyarrow.compute as pc
from mcap.writer import CompressionType, Writer

from drivers.host_files import new_file
from drivers.outside_text import table_cell
from drivers.session_file.reader import read_capture
from drivers.session_file.records import RX, TX, Attachment, Damage, RecordedMessage
from gse.report.parquet import SCHEMA_VERSION, write_parquet
from gse.report.sessions_table import SessionTables
from gse.sessions.replay import ReplayOptions, open_recording
from gse.station.results import Subject
from gse.values import instant
from gse.values.panorama import Panorama

CSV_COLUMNS = ("utc", "frame_no", "time_us", "exposure_s", "temperature_c", "flags", "object", "x_px", "y_px", "index")


class Exported(NamedTuple):
    """How many panoramas, records or bytes were written; whether a part of the session is missing."""

    written: int
    damaged: bool


def export_csv(path: Path, out: TextIO) -> Exported:
    """Write each object of each panorama as one line."""
    recording = open_recording(path, ReplayOptions(), needs_catalog=False)
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(CSV_COLUMNS)
    count = 0
    for panorama in recording.panoramas():
        count += 1
        writer.writerows(_rows(panorama))
    return Exported(count, recording.damaged)


def _rows(panorama: Panorama) -> Iterator[tuple[object, ...]]:
    head = (
        instant.to_text(panorama.utc_ns),
        panorama.frame_no,
        panorama.time_us,
        f"{panorama.exposure_s:.6f}",
        f"{panorama.temperature_c:.2f}",
        table_cell(" ".join(sorted(panorama.flags))),
    )
    if not len(panorama.brightness):
        yield (*head, "", "", "", "")
    for row, ((x, y), brightness) in enumerate(zip(panorama.xy_px.tolist(), panorama.brightness.tolist(), strict=True)):
        yield (*head, row, f"{x:.5f}", f"{y:.5f}", f"{brightness:g}")


def export_ndjson(path: Path, out: TextIO) -> Exported:
    """Write each record as one JSON line, damage included, with bytes in hexadecimal."""
    count, capture = 0, read_capture(path)
    for record in capture:
        out.write(json.dumps(_document(record)) + "\n")
        count += 1
    return Exported(count, capture.is_damaged)


def _document(record: RecordedMessage | Attachment | Damage) -> dict[str, Any]:
    if isinstance(record, Damage):
        return {"damage": record.reason, "file": record.file, "offset": record.offset, "bytes": record.size}
    if isinstance(record, Attachment):
        return {
            "attachment": record.name,
            "media_type": record.media_type,
            "text": record.data.decode("utf-8", "replace"),
        }
    document: dict[str, Any] = {
        "topic": record.topic,
        "utc": instant.to_text(record.utc_ns, 9),
        "mono_ns": record.mono_ns,
    }
    if record.topic in (RX, TX):
        return document | {"hex": record.data.hex()}
    try:
        return document | {"json": json.loads(record.data)}
    except (ValueError, RecursionError):
        return document | {"hex": record.data.hex()}


def export_bytes(path: Path, out: BinaryIO, topic: str = RX) -> Exported:
    """Write the received bytes, or those of another topic, unchanged."""
    count, capture = 0, read_capture(path)
    for record in capture:
        if isinstance(record, RecordedMessage) and record.topic == topic:
            out.write(record.data)
            count += len(record.data)
    return Exported(count, capture.is_damaged)


# Export of results: the tables as Parquet files, or as topics with JSON Schema beside the bytes in a new MCAP file.
#
#     /results/frame     panorama and sky        one message per panorama, at its mid-exposure
#     /results/onboard   answers and errors of the identifier under test
#     /results/sensor    those that the sensor itself sends, where it sends them
#     /results/item      each value of the sensor's housekeeping, when it came
#     /results/name      each star that the sensor names, at the mid-exposure of its panorama
#     /results/verdict   verdict and reasons, once, at the last panorama
#
# Keys are the columns of docs/tables.md without their subject. The records of the session are copied with their
# instants; ``session.mcap`` itself is never touched.

TABLES = ("sessions", "frames", "stars", "housekeeping", "names")
FRAME, VERDICT, ITEM, NAME = "/results/frame", "/results/verdict", "/results/item", "/results/name"
_ROWS_AT_ONCE = 4096
_LIBRARY = "gse-star-sensor"
_VERDICT_SCHEMA = {
    "type": "object",
    "properties": {"verdict": {"type": "string"}, "reasons": {"type": "array", "items": {"type": "string"}}},
}


def export_parquet(tables: SessionTables, folder: Path) -> int:
    """Write a Parquet file for each of TABLES into a new folder; returns the number of rows."""
    folder.mkdir(parents=True)
    try:
        for name in TABLES:
            write_parquet([getattr(tables, name)], folder / f"{name}.parquet")
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return sum(getattr(tables, name).num_rows for name in TABLES)


def export_mcap(session: Path, tables: SessionTables, out: Path) -> int:
    """Write the records of a session and its results to a new file; returns the number of results."""
    count = 0
    with new_file(out) as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(library=_LIBRARY)
        topics = _Topics(writer, [*_topics(tables.frames)])
        others = [
            (table, _Topic(name, tuple(column for column in table.schema if column.name != "key"), ""))
            for table, name in ((tables.housekeeping, ITEM), (tables.names, NAME))
        ]
        for _, topic_of_rows in others:
            topics.describe(topic_of_rows)
        for utc_ns, topic, data in heapq.merge(
            _bytes(session, writer),
            _results(tables, topics.of_frames),
            *(_rows_of(table, [topic_of_rows]) for table, topic_of_rows in others),
            key=lambda message: message[0],
        ):
            count += topic.startswith("/results/")
            writer.add_message(topics.channel(topic), log_time=utc_ns, publish_time=utc_ns, data=data)
        writer.finish()
    return count


_Item = tuple[int, str, bytes]
"""Instant (log time and publish time), topic, content. A session has the monotonic clock as publish time."""


@dataclass(frozen=True, slots=True)
class _Topic:
    """A topic of results: its columns of the table of frames, and the prefix that its keys go without."""

    name: str
    columns: tuple[pa.Field, ...]
    prefix: str

    def key(self, column: pa.Field) -> str:
        return str(column.name).removeprefix(self.prefix)

    @property
    def schema(self) -> dict[str, Any]:
        """JSON Schema: the unit is the description."""
        return {
            "type": "object",
            "properties": {
                self.key(column): {"type": [_json_type(column.type), "null"], "description": _unit(column)}
                for column in self.columns
            },
        }


def _topics(frames: pa.Table) -> Iterator[_Topic]:
    """One topic for what is of no subject, one for each subject with an answer."""
    columns = [column for column in frames.schema if column.name != "key"]
    by_subject = {subject: f"{subject.value}_" for subject in Subject}
    common = tuple(column for column in columns if not column.name.startswith(tuple(by_subject.values())))
    yield _Topic(FRAME, common, "")
    for subject, prefix in by_subject.items():
        own = tuple(column for column in columns if column.name.startswith(prefix))
        if any(frames[column.name].null_count < len(frames) for column in own):
            yield _Topic(f"/results/{subject.value}", own, prefix)


class _Topics:
    """Channels of the file by topic, made when they are first needed."""

    def __init__(self, writer: Writer, of_frames: list[_Topic]) -> None:
        self._writer = writer
        self.of_frames = of_frames
        self._schemas = {topic.name: topic.schema for topic in of_frames} | {VERDICT: _VERDICT_SCHEMA}
        self._channels: dict[str, int] = {}

    def describe(self, topic: _Topic) -> None:
        """Give a further topic its schema."""
        self._schemas[topic.name] = topic.schema

    def channel(self, topic: str) -> int:
        if topic not in self._channels:
            self._channels[topic] = self._register(topic)
        return self._channels[topic]

    def _register(self, topic: str) -> int:
        schema_id = 0
        if topic in self._schemas:
            name = f"gse{topic.replace('/', '.')}/{SCHEMA_VERSION}"
            content = json.dumps({"title": name, **self._schemas[topic]}).encode()
            schema_id = self._writer.register_schema(name, "jsonschema", content)
        encoding = "octet-stream" if topic in (RX, TX) else "json"
        return int(self._writer.register_channel(topic, encoding, schema_id))


def _bytes(session: Path, writer: Writer) -> Iterator[_Item]:
    """The messages of the session; its attachments are written as they come."""
    for record in read_capture(session):
        if isinstance(record, Attachment):
            writer.add_attachment(0, 0, record.name, record.media_type, record.data)
        elif isinstance(record, RecordedMessage):
            yield record.utc_ns, record.topic, record.data


def _results(tables: SessionTables, topics: list[_Topic]) -> Iterator[_Item]:
    last_ns = 0
    for utc_ns, topic, data in _rows_of(tables.frames, topics):
        last_ns = max(last_ns, utc_ns)
        yield utc_ns, topic, data
    verdict = {name: tables.sessions[name][0].as_py() for name in ("verdict", "reasons")}
    yield last_ns, VERDICT, json.dumps(verdict).encode()


def _rows_of(table: pa.Table, topics: list[_Topic]) -> Iterator[_Item]:
    """The rows of a table, in order, as messages of topics that are some of its columns each."""
    for batch in table.to_batches(max_chunksize=_ROWS_AT_ONCE):
        instants_ns = batch["utc"].cast(pa.int64()).to_pylist()
        rows = {topic.name: _documents(batch, topic) for topic in topics}
        for number, utc_ns in enumerate(instants_ns):
            for topic in topics:
                yield utc_ns, topic.name, json.dumps(rows[topic.name][number]).encode()


def _documents(batch: pa.RecordBatch, topic: _Topic) -> list[dict[str, Any]]:
    columns = [_values(batch[column.name]) for column in topic.columns]
    keys = [topic.key(column) for column in topic.columns]
    return [dict(zip(keys, row, strict=True)) for row in zip(*columns, strict=True)]


def _values(column: pa.Array) -> Iterable[Any]:
    """Values as JSON has them; instants in RFC 3339."""
    if pa.types.is_timestamp(column.type):
        return list(pc.strftime(column, format="%Y-%m-%dT%H:%M:%SZ").to_pylist())
    return list(column.to_pylist())


def _json_type(kind: pa.DataType) -> str:
    if pa.types.is_boolean(kind):
        return "boolean"
    if pa.types.is_integer(kind):
        return "integer"
    return "number" if pa.types.is_floating(kind) else "string"


def _unit(column: pa.Field) -> str:
    return str((column.metadata or {}).get(b"unit", b"").decode())
