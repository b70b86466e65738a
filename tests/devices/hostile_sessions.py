"""Session files as somebody who means harm makes them, each below 20 kB unless it says otherwise."""

import json
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Channel
from mcap.records import Chunk as McapChunk

from drivers.chunk import LinkEvent, LinkKind
from drivers.session_file.record_scanner import MAGIC
from drivers.session_file.records import CLOCK, EVENTS, RX, RecordedMessage, checksum, event_message
from drivers.session_file.writer import CaptureWriter
from gse.config.station import BUILT_IN_TEXT
from gse.recording.session_format import STATED, TIMING_TOPIC, RecorderKind
from gse.station.events import StationKind
from protocols import PanoramaMessage, load_protocol

HEAD = MAGIC + bytes.fromhex("0122000000000000000b000000") + b"gse-session" + b"\x0f\0\0\0" + b"gse-star-sensor"
PROTOCOL = load_protocol("panorama-v1")
START_NS = 1_774_018_800_000_000_000
STEERING = "\x1b]0;owned\x07\x1b[2J\x9b31m\u202e=cmd|' /C calc'!A0 \ud800"


def channel(number: int, topic: str) -> bytes:
    """A channel record."""
    builder = RecordBuilder()
    Channel(id=number, topic=topic, message_encoding="json", metadata={}, schema_id=0).write(builder)
    return bytes(builder.end())


def message(number: int, topic: str, data: bytes) -> bytes:
    """A message record with its right checksum."""
    content = struct.pack("<HIQQ", number, checksum(topic, START_NS, 1, data), START_NS, 1) + data
    return struct.pack("<BQ", 5, len(content)) + content


def chunk(data: bytes) -> bytes:
    """A chunk record with its right checksum."""
    builder = RecordBuilder()
    McapChunk(
        compression="zstd",
        data=zstandard.compress(data),
        message_start_time=0,
        message_end_time=1,
        uncompressed_crc=zlib.crc32(data),
        uncompressed_size=len(data),
    ).write(builder)
    return bytes(builder.end())


def _nested(depth: int) -> bytes:
    inner = channel(1, RX)
    for _ in range(depth):
        inner = chunk(inner)
    return inner


def _nested_wide() -> bytes:
    inner = chunk(channel(1, RX) * 3000)
    for _ in range(3):
        inner = chunk(inner * min(5000, (4 << 20) // len(inner) - 1))
    return inner


_CANDIDATE = bytes([5, 4, 0x0F, 0, 0, 0, 0, 0, 0])
FILES: dict[str, Callable[[], bytes]] = {
    "chunks within chunks": _nested_wide,
    "chunks 150 deep": lambda: _nested(150),
    "90 chunks of zeros": lambda: chunk(bytes(4 << 20)) * 90,
    "a hundred thousand empty messages": lambda: chunk(channel(1, RX) + message(1, RX, b"") * 100_000) * 10,
    "what looks like records everywhere": lambda: channel(1, RX) + _CANDIDATE * 2000,
    "the same, packed": lambda: chunk(b"\1" + _CANDIDATE * 400_000) * 8,
    "channels without end": lambda: b"".join(channel(n, f"/t{n}") for n in range(300)) + _CANDIDATE * 500,
    "a topic that steers": lambda: channel(1, "/\x1b[2J") + message(1, "/\x1b[2J", b""),
}


def write_file(path: Path, name: str) -> Path:
    """One of FILES."""
    path.write_bytes(HEAD + FILES[name]())
    return path


def frames(count: int, rng: np.random.Generator, *, sequences: bool = False) -> list[bytes]:
    """Frames at 10 Hz with objects where no stars are, and sequence numbers in order or without sense."""
    return [
        PROTOCOL.encode(
            PanoramaMessage(
                time_us=100_000 * number,
                frame_no=number,
                exposure_s=0.05,
                flags=frozenset(),
                temperature_c=20.0,
                xy_px=np.floor(rng.uniform(10, 1000, (8, 2))),
                index=np.arange(800.0, 0.0, -100.0),
            ),
            int(rng.integers(0, 65536)) if sequences else number,
        )
        for number in range(count)
    ]


def write_times(path: Path) -> Path:
    """Stamps and clocks that no clock has: near 2^64, steps of centuries, backwards."""
    last = 2**64 - 1
    stamps = [(last, 0), (0, last), (last, last), (START_NS, 5), (last - 1, 6), (0, 0), (START_NS, last)] * 3
    with CaptureWriter(path) as writer:
        writer.attach("station.yaml", "application/yaml", BUILT_IN_TEXT.encode())
        for (utc_ns, mono_ns), frame in zip(stamps, frames(len(stamps), np.random.default_rng(1)), strict=True):
            writer.write(RecordedMessage(RX, utc_ns, mono_ns, frame))
            event = {"kind": "CLOCK_STEP", "text": "the host's UTC clock stepped by +9999999999999999999.0 s"}
            writer.write(RecordedMessage(EVENTS, utc_ns, mono_ns, json.dumps(event).encode()))
            for value in (10**400, -(10**30), last):
                reading = {"utc_ns": value, "mono_ns": value, "source": "x", "synchronised": True}
                bad = {**reading, "offset_s": 1e308, "error_bound_s": float("inf")}
                writer.write(RecordedMessage(CLOCK, utc_ns, mono_ns, json.dumps(bad).encode()))
                timing = {"time_us": value, "elapsed_us": float("nan")}
                writer.write(RecordedMessage(TIMING_TOPIC, utc_ns, mono_ns, json.dumps(timing).encode()))
    return path


def write_steering(path: Path) -> Path:
    """Control characters and lone surrogates in every text that a session holds."""
    events = [
        {"kind": STEERING, "text": "x"},
        {"kind": "LOST", "text": STEERING},
        {"kind": "REOPENED", "text": STEERING},
    ]
    clock = {"utc_ns": START_NS, "mono_ns": 1, "source": STEERING, "synchronised": True, "offset_s": 0.0}
    with CaptureWriter(path) as writer:
        writer.attach("station.yaml", "application/yaml", BUILT_IN_TEXT.encode())
        writer.attach("\x1b[2J.txt", "text/\x1b[2J", b"\x1b[2J")
        for document in events:
            writer.write(RecordedMessage(EVENTS, START_NS, 1, json.dumps(document).encode()))
        writer.write(RecordedMessage(CLOCK, START_NS, 1, json.dumps({**clock, "error_bound_s": 0.1}).encode()))
        for number, frame in enumerate(frames(20, np.random.default_rng(2), sequences=True)):
            writer.write(RecordedMessage(RX, START_NS + 100_000_000 * number, 100_000_000 * number, frame))
    return path


def write_kinds(path: Path) -> Path:
    """Events of every kind that the station knows, each with texts that it never writes."""
    with CaptureWriter(path) as writer:
        writer.attach("station.yaml", "application/yaml", BUILT_IN_TEXT.encode())
        for number, frame in enumerate(frames(20, np.random.default_rng(2), sequences=True)):
            writer.write(RecordedMessage(RX, START_NS + 100_000_000 * number, 100_000_000 * number, frame))
        for kind in (*LinkKind, *StationKind, *RecorderKind):
            for text in ("zz", "", "-9e999 s", "9" * 5000, "{}", "a:b:c,d/e=f"):
                writer.write(event_message(LinkEvent(START_NS + 1_000_000_000, 1_000_000_000, kind, text)))
    return path


def write_flood(path: Path, count: int = 30_000) -> Path:
    """Events without end, of kinds without end; some 3 MB."""
    with CaptureWriter(path) as writer:
        writer.attach("station.yaml", "application/yaml", BUILT_IN_TEXT.encode())
        for number in range(count):
            event = {"kind": f"K{number % 5000}", "text": f"the {number}th"}
            writer.put(RecordedMessage(EVENTS, START_NS + number, number, json.dumps(event).encode()))
        writer.flush()
    return path


def write_station(path: Path, text: str, *, stated: str = "{}") -> Path:
    """A session with this station file and these statements of its operator, and nothing else."""
    with CaptureWriter(path) as writer:
        writer.attach("station.yaml", "application/yaml", text.encode())
        writer.attach(STATED, "application/json", stated.encode())
        writer.write(RecordedMessage(RX, START_NS, 1, frames(1, np.random.default_rng(3))[0]))
    return path
