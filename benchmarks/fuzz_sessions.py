"""Coverage-guided fuzzing of the session reader with atheris (pip install atheris).

    python benchmarks/fuzz_sessions.py -max_total_time=3600 -max_len=4096

Each input is read as a session file, as what follows a true head, and behind right checksums as an attachment and as
the inside of a chunk, plain and compressed. Anything but CaptureError is a find, and so are bytes out of nothing.
"""

import contextlib
import sys
import zlib

import atheris  # type: ignore[import-not-found]

with atheris.instrument_imports(include=["drivers", "mcap"]):
    import zstandard
    from mcap.data_stream import RecordBuilder
    from mcap.opcode import Opcode
    from mcap.records import Chunk as McapChunk

    from drivers.errors import CaptureError
    from drivers.session_file.file_window import BlockWindow
    from drivers.session_file.record_scanner import MAGIC, RecordScanner
    from drivers.session_file.records import Damage, Message, Record

HEAD = MAGIC + bytes.fromhex("01220000000000000b000000") + b"\0" * 4


def read(data: bytes) -> list[Record]:
    """All records, damage included; the damage lies within the bytes."""
    walk = RecordScanner(BlockWindow(data), "fuzz")
    with contextlib.suppress(CaptureError):
        walk.check_ours()
    records = list(walk.records())
    for record in records:
        if isinstance(record, Damage) and record.file == "fuzz":
            assert 0 <= record.offset < record.offset + record.size <= len(data)
        elif isinstance(record, Message):
            record.event()
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


def one_input(data: bytes) -> None:
    """One input of the fuzzer."""
    read(data)
    read(HEAD + data)
    read(MAGIC + record(Opcode.ATTACHMENT, data + zlib.crc32(data).to_bytes(4, "little")))
    read(MAGIC + chunk(data, "") + data)
    read(MAGIC + chunk(data, "zstd"))
    read(MAGIC + record(Opcode.CHUNK, data))


if __name__ == "__main__":
    atheris.Setup(sys.argv, one_input)
    atheris.Fuzz()
