"""Parquet files of the tables: one way to write them, and a bounded way to read them."""

import contextlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO

import pyarrow as pa
import pyarrow.parquet as pq

ROWS_AT_ONCE = 1 << 13
"""Rows of a row group; a longer table is written in parts, since a writer holds ten times the bytes of each."""
MOST_ROWS = 1 << 24
"""Two weeks of frames at 10 Hz."""
MOST_BYTES_PER_ROW = 4096
"""Unpacked; a frame has 400 bytes, and one dictionary of words serves all rows."""
MOST_BYTES_BESIDE = 1 << 22
"""Most bytes of dictionaries and heads in a file with few rows."""
_MOST_FOOTER = 1 << 24
FOOTER_LIMITS = {"thrift_string_size_limit": _MOST_FOOTER, "thrift_container_size_limit": _MOST_FOOTER}
"""Options of a reader."""
_COMPRESSION = "zstd"


def write_parquet(parts: Iterable[pa.Table], to: Path | BinaryIO) -> None:
    """Write the parts of one table, each of ROWS_AT_ONCE at most, to a new file; OSError where it cannot be written.

    The same rows give the same bytes. A single row, of 800 columns, needs neither statistics nor dictionaries: they
    would be most of its file. Measured numbers hardly repeat: dictionaries of them cost more room than they save.
    """
    rest = iter(parts)
    first = next(rest)
    many = len(first) > 1
    repeating = [column.name for column in first.schema if not pa.types.is_floating(column.type)] if many else False
    with pq.ParquetWriter(
        to, first.schema, compression=_COMPRESSION, write_statistics=many, use_dictionary=repeating
    ) as writer:
        writer.write_table(first)
        for part in rest:
            writer.write_table(part)


class ParquetColumns:
    """The columns of an open file by name, each read when it is asked for: a whole table takes 400 bytes a row."""

    def __init__(self, file: pq.ParquetFile) -> None:
        self._file = file
        self.num_rows: int = file.metadata.num_rows

    def __getitem__(self, name: str) -> pa.ChunkedArray:
        return self._file.read(columns=[name])[name]


@contextlib.contextmanager
def read_parquet(path: Path, schema: pa.Schema) -> Iterator[ParquetColumns]:
    """The columns of a file that may come from anybody.

    ValueError where it does not have those of the schema, or is far too large for its rows; ArrowException where it is
    damaged.
    """
    with pq.ParquetFile(path, **FOOTER_LIMITS) as file:
        if not file.schema_arrow.equals(schema):
            raise ValueError(f"{path.name} has other columns than a table of this gse")
        check_size(path.name, file.metadata)
        yield ParquetColumns(file)


def check_size(
    name: str, metadata: pq.FileMetaData, *, most_rows: int = MOST_ROWS, most_bytes_per_row: int = MOST_BYTES_PER_ROW
) -> None:
    """ValueError where a file has more rows than it may, or unpacks to too much."""
    rows = metadata.num_rows
    size = sum(metadata.row_group(number).total_byte_size for number in range(metadata.num_row_groups))
    if rows > most_rows or size > rows * most_bytes_per_row + MOST_BYTES_BESIDE:
        raise ValueError(f"{name} says it has {rows} rows and {size} bytes, which is too much")
