"""Parquet files of the tables: their columns, one way to write them, and a bounded way to read them.

A column's name says the unit, its metadata say unit and subject. Frozen dataclasses become columns.
"""

import contextlib
import functools
import math
import types
import typing
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any, BinaryIO

import pyarrow as pa
import pyarrow.parquet as pq

from gse.station.columns import UNITS, unit_of
from gse.station.results import Subject

SCHEMA_VERSION = 1
"""Version of all tables. It grows where a column goes or changes its name, type or meaning, not for a new
column."""

_UTC = "UTC"
_PURE_NUMBERS = ("n", "n_eff", "count", "of", "k", "known", "stars")
"""Parts of a figure that have no unit, whatever the figure has."""


def joined(stem: str, part: str) -> str:
    """The name of a part of a figure, its unit last: time_ms and p50 make time_p50_ms.

    The part called ``value`` has the name of the figure itself.
    """
    body, end = _split(stem)
    has_unit = part in _PURE_NUMBERS or bool(unit_of(f"_{part}"))
    words = (body.removesuffix("_bounds"), "" if part == "value" else part, "" if has_unit else end)
    return "_".join(word for word in words if word)


def _split(name: str) -> tuple[str, str]:
    """A name without its unit, and the unit as the name writes it."""
    end = next((end for end in UNITS if name.endswith(f"_{end}")), "")
    return (name.removesuffix(f"_{end}"), end) if end else (name, "")


def field(name: str, kind: pa.DataType) -> pa.Field:
    """A field with its unit, and the subject where its name begins with one, as metadata."""
    unit = _UTC if pa.types.is_timestamp(kind) else unit_of(name)
    subject = next((subject.value for subject in Subject if name.startswith(f"{subject.value}_")), "")
    return pa.field(name, kind, metadata={"unit": unit, "subject": subject})


def schema(table: str, fields: list[pa.Field]) -> pa.Schema:
    """The schema of a table, named in its metadata: gse.frames/1."""
    return pa.schema(fields, metadata={"schema": f"gse.{table}/{SCHEMA_VERSION}"})


FLAG, COUNT, NUMBER, TEXT = pa.bool_(), pa.int64(), pa.float64(), pa.string()
WORDS = pa.list_(TEXT)
UTC = pa.timestamp("ns", tz="UTC")
_PLAIN = {bool: FLAG, int: COUNT, float: NUMBER, str: TEXT}


@dataclass(frozen=True, slots=True)
class TableCell:
    """A field and its value in one row; None is null."""

    field: pa.Field
    value: Any


def column(name: str, kind: pa.DataType, value: Any) -> TableCell:
    """A column with the metadata that its name states."""
    return TableCell(field(name, kind), value)


def columns_of(kind: Any, value: Any, stem: str = "", *, without: Iterable[str] = ()) -> Iterator[TableCell]:
    """The columns of a record of type ``kind``, their names beginning with ``stem``; all null where ``value`` is None.

    ``without`` names fields that are not taken, for example those that are not plain values.
    """
    hints = _hints(kind)
    for item in fields(kind):
        if item.name in without:
            continue
        name = joined(stem, item.name)
        of_field, inner = None if value is None else getattr(value, item.name), _inner(hints[item.name])
        if is_dataclass(inner):
            yield from columns_of(inner, of_field, name)
        else:
            yield _plain_column(name, arrow_type(inner), plain(of_field))


def _plain_column(name: str, kind: pa.DataType, value: Any) -> TableCell:
    return column(name, kind, str(value) if kind == TEXT and value is not None else value)


def records(kind: Any, values: Iterable[Any] | None, name: str) -> TableCell:
    """One column with a list of records of type ``kind``, each a struct."""
    listed = None if values is None else [plain(value) for value in values]
    return column(name, pa.list_(arrow_type(kind)), listed)


def arrow_type(hint: Any) -> pa.DataType:
    """The Arrow type of a plain value, a tuple of them, or a record; ValueError of anything else."""
    hint = _inner(hint)
    if is_dataclass(hint):
        hints = _hints(hint)
        return pa.struct([field(item.name, arrow_type(hints[item.name])) for item in fields(hint)])
    if typing.get_origin(hint) is tuple:
        return pa.list_(arrow_type(typing.get_args(hint)[0]))
    if typing.get_origin(hint) in (typing.Union, types.UnionType, typing.Literal):
        return TEXT  # a word, or a number or a word: "auto", 5000
    if isinstance(hint, type):
        for plain_type, kind in _PLAIN.items():
            if issubclass(hint, plain_type):
                return kind
    raise ValueError(f"{hint} has no column; expected a plain value, a tuple or a dataclass")


def plain(value: Any) -> Any:
    """A value as Arrow takes it; what is unknown or infinite becomes null, as in report.json."""
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    if is_dataclass(value) and not isinstance(value, type):
        return {item.name: plain(getattr(value, item.name)) for item in fields(value)}
    return value


_hints: Callable[[Any], dict[str, Any]] = functools.cache(typing.get_type_hints)


def _inner(hint: Any) -> Any:
    """The type without the None that it may be."""
    if typing.get_origin(hint) not in (typing.Union, types.UnionType):
        return hint
    others = [arg for arg in typing.get_args(hint) if arg is not type(None)]
    return others[0] if len(others) == 1 else hint


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
