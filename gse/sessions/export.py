"""Export of sessions: CSV, NDJSON, bytes."""

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, TextIO

from drivers.outside_text import table_cell
from drivers.session_file.reader import read_capture
from drivers.session_file.records import RX, TX, Attachment, Damage, Message
from gse import instant
from gse.panorama import Panorama
from gse.sessions.panoramas import open_recording
from gse.sessions.replay import ReplayOptions

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


def _document(record: Message | Attachment | Damage) -> dict[str, Any]:
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
        if isinstance(record, Message) and record.topic == topic:
            out.write(record.data)
            count += len(record.data)
    return Exported(count, capture.is_damaged)
