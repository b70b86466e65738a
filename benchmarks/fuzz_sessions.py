"""Coverage-guided fuzzing of sessions as inputs, with atheris (pip install atheris).

    python benchmarks/fuzz_sessions.py -max_total_time=900 -max_len=4096 CORPUS          the reader
    python benchmarks/fuzz_sessions.py --whole -max_total_time=900 -max_len=4096 CORPUS  replay, verdict, report besides

Each input of the reader is read as a session file, as what follows a true head, and behind right checksums as an
attachment and as the inside of a chunk, plain and compressed. With ``--whole`` an input says which protocol, messages
and attachments a session has, with right checksums, and that is judged and exported. Anything but an error of ours is a
find, and so are bytes out of nothing, control characters in what is shown, JSON that is none, more than MOST_MIB of
memory, and more than CPU_S seconds for a MB of input. The inputs that were kept are in
``benchmarks/seeds.zip``, in a folder for each of the two.
"""

import contextlib
import importlib
import io
import json
import pkgutil
import resource
import sys
import tempfile
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import atheris  # type: ignore[import-not-found]

WHOLE = "--whole" in sys.argv
if WHOLE:
    # What numba compiles cannot be instrumented.
    import gse.identifier
    import gse.station.frame_processor
    import gse.station.setup

    for module in pkgutil.iter_modules(gse.identifier.__path__, "gse.identifier."):
        importlib.import_module(module.name)
with atheris.instrument_imports(include=["drivers", "mcap"] + ["gse", "protocols"] * WHOLE):
    import zstandard
    from mcap.data_stream import RecordBuilder
    from mcap.opcode import Opcode
    from mcap.records import Chunk as McapChunk

    from drivers.errors import CaptureError, DriverError
    from drivers.outside_text import is_plain
    from drivers.session_file.reader import read_capture
    from drivers.session_file.record_scanner import MAGIC, BlockWindow, RecordScanner
    from drivers.session_file.records import CLOCK, EVENTS, RX, TX, Damage, Record, RecordedMessage
    from drivers.session_file.writer import CaptureWriter
    from protocols import Protocol
    from protocols.errors import EncodeError, ProtocolError

    if WHOLE:
        import numpy as np

        from gse.config.station import BUILT_IN_TEXT
        from gse.errors import GseError
        from gse.recording.session_format import ANSWER_TOPIC, LOG_TOPIC, TIMING_TOPIC
        from gse.recording.session_tools import session_info
        from gse.report.files import frames_csv, junit_xml
        from gse.report.summary import summarise
        from gse.report.terminal import plain_lines
        from gse.sessions.export import export_csv, export_ndjson
        from gse.sessions.replay import replay_session
        from gse.station.setup import clear_caches
        from gse.verdict.assessment import judge
        from protocols import PanoramaMessage, StatusMessage, load_protocol

MOST_MIB = 400
CPU_S = 10.0
"""Per MB of input; a small one counts as a MB."""
HEAD = MAGIC + bytes.fromhex("0122000000000000000b000000") + b"gse-session" + b"\x0f\0\0\0" + b"gse-star-sensor"


def read(data: bytes) -> list[Record]:
    """All records, damage included; the damage lies within the bytes."""
    walk = RecordScanner(BlockWindow(data), "fuzz")
    with contextlib.suppress(CaptureError):
        walk.check_ours()
    records: list[Record] = []
    with contextlib.suppress(CaptureError):
        records += walk.records()
    for record in records:
        if isinstance(record, Damage) and record.file == "fuzz":
            assert 0 <= record.offset < record.offset + record.size <= len(data)
        elif isinstance(record, RecordedMessage):
            event = record.event()
            assert is_plain(event.kind + event.text + record.topic)
    return records


def record(opcode: Opcode, content: bytes) -> bytes:
    """A record of MCAP."""
    return bytes([opcode]) + len(content).to_bytes(8, "little") + content


def chunk(data: bytes, compression: str) -> bytes:
    """A chunk record with right checksums."""
    builder = RecordBuilder()
    packed = zstandard.compress(data) if compression else data
    McapChunk(
        compression=compression,
        data=packed,
        message_start_time=0,
        message_end_time=1,
        uncompressed_crc=zlib.crc32(data),
        uncompressed_size=len(data),
    ).write(builder)
    return bytes(builder.end())


def one_file(data: bytes) -> None:
    """One input of the reader."""
    read(data)
    read(HEAD + data)
    read(MAGIC + record(Opcode.ATTACHMENT, data + zlib.crc32(data).to_bytes(4, "little")))
    read(HEAD + chunk(data, "") + data)
    read(HEAD + chunk(data, "zstd"))
    read(HEAD + record(Opcode.CHUNK, data))


def one_session(data: bytes) -> None:
    """One input as what a session holds."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "session.mcap"
        write_session(path, atheris.FuzzedDataProvider(data))
        for work in (session_info, _replay, _export):
            with contextlib.suppress(GseError, DriverError, ProtocolError):
                work(path)
            clear_caches()


def write_session(path: Path, given: "atheris.FuzzedDataProvider") -> None:
    """A session with right checksums and whatever else the fuzzer likes."""
    with CaptureWriter(path) as writer:
        if given.ConsumeBool():
            station = BUILT_IN_TEXT.replace("rooftop", given.ConsumeUnicode(10)) + given.ConsumeUnicode(30)
            writer.attach("station.yaml", "application/yaml", station.encode("utf-8", "replace"))
        protocol = PROTOCOLS[given.ConsumeIntInRange(0, len(PROTOCOLS) - 1)]
        writer.attach("protocol.yaml", "application/yaml", protocol.text.encode())
        for name in ("protocol.yaml", "earth_orientation.json", "stated.json", "identifier.json"):
            if given.ConsumeIntInRange(0, 7) == 0:
                writer.attach(name, "application/json", _json(given))
        utc_ns, mono_ns = 1_774_018_800_000_000_000, 0
        while given.remaining_bytes() > 4:
            step = given.ConsumeIntInRange(0, 9)
            utc_ns = given.ConsumeIntInRange(0, 2**64 - 1) if step == 0 else utc_ns + 100_000_000
            mono_ns = given.ConsumeIntInRange(0, 2**64 - 1) if step == 1 else mono_ns + 100_000_000
            topic = given.PickValueInList([RX, RX, RX, RX, TX, EVENTS, CLOCK, TIMING_TOPIC, ANSWER_TOPIC, LOG_TOPIC])
            content = _bytes(given, protocol) if topic in (RX, TX, LOG_TOPIC) else _json(given)
            writer.write(RecordedMessage(topic, min(utc_ns, 2**64 - 1), min(mono_ns, 2**64 - 1), content))


def _bytes(given: "atheris.FuzzedDataProvider", protocol: Protocol) -> bytes:
    kind = given.ConsumeIntInRange(0, 4)
    if kind == 0:
        return bytes(given.ConsumeBytes(40))
    if kind == 4 or "PANORAMA" not in protocol.frame_layout.names.values():
        return _any_message(given, protocol)
    sequence, time_us = (
        given.ConsumeIntInRange(0, 65535),
        given.ConsumeIntInRange(0, 2 ** given.PickValueInList([40, 64]) - 1),
    )
    if kind == 1 and "STATUS" in protocol.frame_layout.names.values():
        return protocol.encode(
            StatusMessage(time_us=time_us, temperature_c=20.0, supply_v=5.0, mode="standby", firmware=(1, 2, 3)),
            sequence,
        )
    count = given.ConsumeIntInRange(0, min(30, protocol.slots))
    rng = np.random.default_rng(given.ConsumeIntInRange(0, 255))
    message = PanoramaMessage(
        time_us=time_us,
        frame_no=given.ConsumeIntInRange(0, 2**32 - 1),
        exposure_s=given.ConsumeIntInRange(0, 60_000) / 1e4,
        flags=frozenset(),
        temperature_c=given.ConsumeIntInRange(-100, 100),
        xy_px=np.floor(rng.uniform(0, 1023, (count, 2))),
        index=np.sort(rng.integers(1, 4096, count))[::-1].astype(float),
    )
    with contextlib.suppress(EncodeError):  # brighter than this protocol can say
        return protocol.encode(message, sequence)
    return b""


def _any_message(given: "atheris.FuzzedDataProvider", protocol: Protocol) -> bytes:
    """Any bytes as any message, behind a right checksum: numbers that are none, words that nobody knows."""
    code = given.PickValueInList(list(protocol.frame_layout.names))
    size = protocol.frame_layout.sizes[code]
    content = bytes(given.ConsumeBytes(size)).ljust(size, b"\0")
    return protocol.encode_payload(protocol.frame_layout.names[code], content, given.ConsumeIntInRange(0, 65535))


def _json(given: "atheris.FuzzedDataProvider") -> bytes:
    keys = ["kind", "text", "utc_ns", "mono_ns", "source", "synchronised", "offset_s", "error_bound_s", "time_us",
            "elapsed_us", "clock_error_s", "frame_no", "answer", "failure", "ra_deg", "de_deg", "quaternion", "matches",
            "name", "version"]  # fmt: skip
    values = [
        lambda: given.ConsumeUnicode(12),
        lambda: given.PickValueInList(["CLOCK_STEP", "LOST", "REOPENED", "ALIGNED", "CLOSED"]),
        lambda: given.ConsumeIntInRange(-(2**70), 2**70),
        given.ConsumeFloat,
        given.ConsumeBool,
        lambda: None,
        list,
        lambda: [given.ConsumeFloat() for _ in range(4)],
        lambda: {"ra_deg": given.ConsumeFloat(), "de_deg": 0.0, "frame_no": 1},
    ]
    chosen = [key for key in keys if given.ConsumeIntInRange(0, 3)]
    document = {key: given.PickValueInList(values)() for key in chosen}
    return json.dumps(document).encode()


def _replay(path: Path) -> None:
    session = replay_session(path).session
    assessment = judge(session)
    report = summarise(session, assessment)
    json.dumps(report, allow_nan=False)
    shown = [
        *plain_lines(report, "session.mcap", verbose=True, paper=True),
        *(event.text for event in session.events),
        "".join(frames_csv(session.frames.columns)),
    ]
    assert all(is_plain(line) for text in shown for line in text.split("\n"))
    junit_xml(report).encode()


def _export(path: Path) -> None:
    export_csv(path, io.StringIO())
    export_ndjson(path, io.StringIO())
    list(read_capture(path))


def bounded(work: Callable[[bytes], None]) -> Callable[[bytes], None]:
    """The same work, which is a find where it takes too much memory or time."""

    def run(data: bytes) -> None:
        began_s = time.process_time()
        work(data)
        elapsed_s = time.process_time() - began_s
        assert elapsed_s <= CPU_S * max(1.0, len(data) / 1e6), f"{elapsed_s:.1f} s for {len(data)} bytes"
        mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        assert mib <= MOST_MIB, f"{mib:.0f} MiB"

    return run


if __name__ == "__main__":
    if WHOLE:
        sys.argv.remove("--whole")
        PROTOCOLS = [load_protocol(name) for name in ("panorama-v1", "attitude-quaternion", "panorama-slip-xxhash")]
        one_session(b"")  # compiles, and loads catalogue and tables
    atheris.Setup(sys.argv, bounded(one_session if WHOLE else one_file))
    atheris.Fuzz()
