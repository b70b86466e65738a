"""Reads a rerun recording back, by arrow alone."""

from pathlib import Path
from typing import Any

import pyarrow as pa
from rerun.chunk import RrdReader


def rows_of(path: Path) -> dict[str, list[dict[str, Any]]]:
    """The rows of each entity, static ones last, by the names of their columns."""
    rows: dict[str, list[dict[str, Any]]] = {}
    chunks = RrdReader(str(path)).stream().to_chunks()
    for chunk in sorted(chunks, key=lambda chunk: bool(chunk.is_static)):
        found = _with_integer_times(chunk.to_record_batch()).to_pylist()
        rows.setdefault(chunk.entity_path, []).extend({**row, "static": chunk.is_static} for row in found)
    return rows


def moving(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Only the rows that have a time, in its order."""
    return sorted((row for row in rows if not row["static"]), key=lambda row: row["utc"])


def _with_integer_times(batch: pa.RecordBatch) -> pa.RecordBatch:
    """UTC in nanoseconds: Python's datetime would cut them."""
    columns = [column.cast(pa.int64()) if pa.types.is_timestamp(column.type) else column for column in batch.columns]
    return pa.RecordBatch.from_arrays(columns, names=batch.schema.names)
