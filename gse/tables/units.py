"""Columns of the tables: a name says the unit, metadata say unit and subject."""

import pyarrow as pa

from gse.station.columns import UNITS, unit_of
from gse.station.results import Subject

SCHEMA_VERSION = 1
"""Of the three tables: one more where a column goes, or changes its name, type or meaning; not for a new column."""

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
