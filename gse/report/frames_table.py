"""The table of frames: one row per panorama, with time, the subjects' answers, their errors, and the sky.

Its columns are those of gse.station.columns; one that is added there is a column here. Answers begin with their
subject. A sensor that sends no panoramas is the subject of the frame table itself: then those of ``onboard`` are null.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gse.report.parquet import ROWS_AT_ONCE
from gse.report.table_columns import UTC, field, schema
from gse.station.columns import COLUMNS, OWN_COLUMNS, STATUSES, Column
from gse.station.frame_columns import Columns
from gse.station.own_answers import SensorAnswers
from gse.station.results import Status, Subject
from gse.station.session_data import SessionData
from gse.statistics.session_statistics import Statistics

KEY = pa.dictionary(pa.int32(), pa.string())
"""The key in each row of frames and stars: stored once."""

_WORD = pa.dictionary(pa.int8(), pa.string())
_COMMON = tuple(column for column in COLUMNS if not column.of_answer)
_OF_ANSWER = tuple(column for column in COLUMNS if column.of_answer)
_COUNTED = ("expected", "excluded")
_COUNTED_OF_SUBJECT = ("false", "used")
"""Masks of CountedFrames that are of the whole frame, and of the answers in the frame table."""


def frames_schema() -> pa.Schema:
    """The schema of the table of frames."""
    kinds = {"key": KEY, "frame": pa.uint32()}
    kinds |= {column.name_of(Subject.ONBOARD): _kind(column) for column in _COMMON}
    kinds |= dict.fromkeys(_COUNTED, pa.bool_())
    for subject in Subject:
        kinds |= {column.name_of(subject): _kind(column) for column in _OF_ANSWER}
        kinds |= {f"{subject}_{name}": pa.bool_() for name in _COUNTED_OF_SUBJECT}
    kinds |= {f"{Subject.SENSOR}_{column.name}": _kind(column) for column in OWN_COLUMNS}
    return schema("frames", [field(name, kind) for name, kind in kinds.items()])


def frames_table(session: SessionData, stats: Statistics, key: str) -> pa.Table:
    """The frames of a session as a table; ``key`` is of the results. What is unknown is null."""
    return _part(session, stats, key, slice(0, len(session.frames.columns)))


def frames_parts(
    session: SessionData, stats: Statistics, key: str, *, rows_at_once: int = ROWS_AT_ONCE
) -> Iterator[pa.Table]:
    """The same table in parts, at least one: that of 8 h at 10 Hz takes 90 MB."""
    count = len(session.frames.columns)
    for first in range(0, max(count, 1), rows_at_once):
        yield _part(session, stats, key, slice(first, min(first + rows_at_once, count)))


def _part(session: SessionData, stats: Statistics, key: str, rows: slice) -> pa.Table:
    frames, counted = session.frames.columns[rows], stats.counted
    numbered = np.arange(rows.start, rows.stop, dtype=np.uint32)
    arrays = {"key": same_key(key, len(frames)), "frame": pa.array(numbered)}
    arrays |= {column.name_of(session.subject): arrow_column(column, frames[column.name]) for column in COLUMNS}
    arrays |= {name: pa.array(getattr(counted, name)[rows]) for name in _COUNTED}
    arrays |= {f"{session.subject}_{name}": pa.array(getattr(counted, name)[rows]) for name in _COUNTED_OF_SUBJECT}
    of_sensor = _own(frames) if session.subject is Subject.SENSOR else _beside_panoramas(stats.own, rows)
    arrays |= {f"{Subject.SENSOR}_{name}": numbers(values) for name, values in of_sensor.items()}
    return table_of(arrays, frames_schema(), len(frames))


def table_of(arrays: dict[str, pa.Array], like: pa.Schema, count: int) -> pa.Table:
    """The arrays as a table of ``count`` rows; a column of the schema that is not among them is null."""
    columns = [arrays[of.name].cast(of.type) if of.name in arrays else pa.nulls(count, of.type) for of in like]
    return pa.table(columns, schema=like)


def arrow_column(column: Column, values: NDArray[Any]) -> pa.Array:
    """Values of a column in Arrow: instants, words for their places, null for unknown numbers."""
    values = np.ascontiguousarray(values)
    if column.is_instant:
        return instants(values)
    if column.words:
        return pa.DictionaryArray.from_arrays(pa.array(values.astype(np.int8)), [word.value for word in column.words])
    return numbers(values)


def instants(utc_ns: NDArray[np.int64]) -> pa.Array:
    """UTC in nanoseconds as instants."""
    return pa.array(utc_ns, pa.int64()).cast(UTC)


def numbers(values: NDArray[Any]) -> pa.Array:
    """An array with null where a number is unknown."""
    return pa.array(values, mask=np.isnan(values)) if values.dtype.kind == "f" else pa.array(values)


def same_key(key: str, count: int) -> pa.Array:
    """The column of a key that all rows share."""
    return pa.DictionaryArray.from_arrays(pa.array(np.zeros(count, dtype=np.int32)), [key])


def _own(frames: Columns) -> dict[str, NDArray[Any]]:
    """What SensorAnswers says beside panoramas, of a frame table that holds the sensor's answers themselves."""
    arrival_ms = (frames["host_utc_ns"] - frames["utc_ns"]) / 1e6
    return {
        "sent": np.ones(len(frames), dtype=bool),
        "acquired": frames["status"] == STATUSES.index(Status.IDENTIFIED),
        "latency_ms": frames["elapsed_us"] / 1e3,
        "arrival_ms": np.where(frames["host_utc_ns"] > 0, arrival_ms, np.nan),
    }


def _beside_panoramas(own: SensorAnswers | None, rows: slice) -> dict[str, NDArray[Any]]:
    return {} if own is None else {column.name: getattr(own, column.name)[rows] for column in OWN_COLUMNS}


def _kind(column: Column) -> pa.DataType:
    if column.is_instant:
        return UTC
    return _WORD if column.words else pa.from_numpy_dtype(np.dtype(column.dtype))
