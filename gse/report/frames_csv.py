"""frames.csv: one line per panorama, for a spreadsheet."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow.csv import WriteOptions, write_csv

from gse.station.columns import COLUMNS, OWN_COLUMNS, Column
from gse.station.frame_columns import Columns
from gse.station.housekeeping import firmware_text, latest_status
from gse.station.own_answers import SensorAnswers
from gse.station.results import Subject
from protocols import StatusMessage

_ROWS_AT_ONCE = 1 << 12
"""More take more memory, and hardly less time."""
_DIGITS = 20
"""A number with more is of a sensor gone wrong: it is written as Python writes it."""
_INSTANT = "utc_ns"
"""It comes first, in words."""
_COMMON = tuple(column for column in COLUMNS if not column.of_answer and column.name != _INSTANT)
_OF_ANSWER = tuple(column for column in COLUMNS if column.of_answer)
_OF_STATUS = ("firmware", "serial")


def frames_csv(
    frames: Columns,
    own: SensorAnswers | None = None,
    subject: Subject = Subject.ONBOARD,
    statuses: Sequence[tuple[int, StatusMessage]] = (),
) -> Iterator[str]:
    """Rows of FRAME as text, UTC first; cells of unknown values are empty. It comes in parts: a session has 60 MB.

    Columns of answers begin with their ``subject``; those that came beside panoramas with ``sensor_``. Firmware and
    serial number are those of the latest of ``statuses``, each with its host UTC.
    """
    beside = OWN_COLUMNS if own is not None else ()
    answers = [column.name_of(subject) for column in _OF_ANSWER]
    answers += [f"{Subject.SENSOR}_{column.name}" for column in beside]
    yield ",".join(["utc", *(column.name for column in _COMMON), *_OF_STATUS, *answers]) + "\n"
    known = [pa.array([word or None for word in words], pa.string()) for words in _words_of(statuses)]
    latest = latest_status(frames["host_utc_ns"], statuses)
    for first in range(0, len(frames), _ROWS_AT_ONCE):
        rows = slice(first, first + _ROWS_AT_ONCE)
        columns = [_utc(frames[_INSTANT][rows])]
        columns += [_texts(column, frames[column.name][rows]) for column in _COMMON]
        columns += [words.take(pa.array(latest[rows] % len(words))) for words in known]
        columns += [_texts(column, frames[column.name][rows]) for column in _OF_ANSWER]
        columns += [_texts(column, getattr(own, column.name)[rows]) for column in beside]
        yield _lines(columns)


def _words_of(statuses: Sequence[tuple[int, StatusMessage]]) -> tuple[list[str], list[str]]:
    """Firmware and serial number of each, and empty ones last, for -1."""
    messages = [message for _, message in statuses]
    firmware = [*map(firmware_text, messages), ""]
    return firmware, [*(str(message.serial) if message.serial else "" for message in messages), ""]


def _lines(columns: list[pa.Array]) -> str:
    table = pa.table(columns, names=[str(number) for number in range(len(columns))])
    text = pa.BufferOutputStream()
    write_csv(table, text, WriteOptions(include_header=False, quoting_style="none"))
    return str(text.getvalue().to_pybytes(), "utf-8")


def _utc(utc_ns: NDArray[np.int64]) -> pa.Array:
    """RFC 3339, cut to microseconds."""
    return pa.array(np.datetime_as_string((utc_ns // 1000).astype("datetime64[us]"), timezone="UTC"))


def _texts(column: Column, values: NDArray[Any]) -> pa.Array:
    """A column as Arrow writes it: words, whole numbers, numbers with a fixed count of decimals, null where unknown."""
    values = np.ascontiguousarray(values)
    if column.words:
        words = pa.array([word.value for word in column.words])
        return words.take(pa.array(values))
    if values.dtype.kind != "f":
        return pa.array(values.astype(np.uint8) if values.dtype.kind == "b" else values)
    if column.significant:
        distinct, places = np.unique(values, return_inverse=True)  # it follows from a few counts of stars
        words = pa.array([f"{value:.{column.significant}g}" for value in distinct.tolist()])
        return words.take(pa.array(places, mask=np.isnan(values)))
    decimals = column.shown_decimals
    try:
        return pa.array(values.astype(np.float64), from_pandas=True).cast(pa.decimal128(_DIGITS, decimals))
    except pa.ArrowInvalid:
        return pa.array([f"{value:.{decimals}f}" for value in values.tolist()], mask=np.isnan(values))
