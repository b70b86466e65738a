"""Columns of the tables: a name says the unit, metadata say unit and subject; frozen dataclasses become columns."""

import functools
import math
import types
import typing
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from typing import Any

import pyarrow as pa

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
