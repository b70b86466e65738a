"""The row of a session on its way from a worker: the index is made of rows that no file has to be read for."""

import pyarrow as pa

_CODEC = "zstd"
_SIZE_BYTES = 8


def packed(row: pa.Table) -> bytes:
    """A table of few rows in Arrow's IPC format, compressed as a whole: 900 short columns are mostly padding."""
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, row.schema) as writer:
        writer.write_table(row)
    plain = sink.getvalue()
    small: bytes = pa.compress(plain, _CODEC, asbytes=True)
    return len(plain).to_bytes(_SIZE_BYTES, "little") + small


def unpacked(data: bytes) -> pa.Table:
    """The table again."""
    size = int.from_bytes(data[:_SIZE_BYTES], "little")
    return pa.ipc.open_stream(pa.decompress(data[_SIZE_BYTES:], size, _CODEC)).read_all()
