"""frames.csv: one line per panorama, for a spreadsheet."""

from collections.abc import Iterator, Sequence
from dataclasses import fields
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow.csv import WriteOptions, write_csv

from gse.station.frame_columns import Columns
from gse.station.frame_table import ANSWER_CHECKS, FRAME, ONBOARD_COLUMNS, SKY_CONDITIONS, STATUSES
from gse.station.housekeeping import MODES, firmware_text, latest_status
from gse.station.results import Subject
from gse.statistics.sensor_answers import SensorAnswers
from protocols import StatusMessage

_ROWS_AT_ONCE = 1 << 12
"""More take more memory, and hardly less time."""
_DIGITS = 20
"""A number with more is of a sensor gone wrong: it is written as Python writes it."""
_DECIMALS = {
    "_altitude_deg": 2,
    "_separation_deg": 2,
    "_deg": 7,
    "_arcsec": 3,
    "_us": 1,
    "_s": 6,
    "_ms": 3,
    "_c": 2,
    "_mag": 3,
    "transparency": 3,
    "_expected": 0,
    "_v": 3,
}
"""By the end of a column's name; the first that fits counts."""
_COMMON = tuple(name for name in FRAME.names or () if name not in (*ONBOARD_COLUMNS, "utc_ns"))
"""Columns of the panorama itself, its sky and truth."""

_WORDS = {"status": STATUSES, "answer_check": ANSWER_CHECKS, "sky_condition": SKY_CONDITIONS, "mode": MODES}
_SENSOR = tuple(field.name for field in fields(SensorAnswers))
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
    sensor = _SENSOR if own is not None else ()
    answers = [*(f"{subject}_{name}" for name in ONBOARD_COLUMNS), *(f"sensor_{name}" for name in sensor)]
    yield ",".join(["utc", *_COMMON, *_OF_STATUS, *answers]) + "\n"
    known = [pa.array([word or None for word in words], pa.string()) for words in _words_of(statuses)]
    latest = latest_status(frames["host_utc_ns"], statuses)
    for first in range(0, len(frames), _ROWS_AT_ONCE):
        rows = slice(first, first + _ROWS_AT_ONCE)
        columns = [_utc(frames["utc_ns"][rows])]
        columns += [_texts(name, frames[name][rows]) for name in _COMMON]
        columns += [words.take(pa.array(latest[rows] % len(words))) for words in known]
        columns += [_texts(name, frames[name][rows]) for name in ONBOARD_COLUMNS]
        columns += [_texts(name, getattr(own, name)[rows]) for name in sensor]
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


def _texts(name: str, values: NDArray[Any]) -> pa.Array:
    """A column as Arrow writes it: words, whole numbers, numbers with a fixed count of decimals, null where unknown."""
    values = np.ascontiguousarray(values)
    if name in _WORDS:
        words = pa.array([word.value for word in _WORDS[name]])
        return words.take(pa.array(values))
    if values.dtype.kind != "f":
        return pa.array(values.astype(np.uint8) if values.dtype.kind == "b" else values)
    if name == "false_match_probability":
        distinct, places = np.unique(values, return_inverse=True)  # it follows from a few counts of stars
        words = pa.array([f"{value:.3g}" for value in distinct.tolist()])
        return words.take(pa.array(places, mask=np.isnan(values)))
    decimals = next(digits for end, digits in _DECIMALS.items() if name.endswith(end))
    try:
        return pa.array(values.astype(np.float64), from_pandas=True).cast(pa.decimal128(_DIGITS, decimals))
    except pa.ArrowInvalid:
        return pa.array([f"{value:.{decimals}f}" for value in values.tolist()], mask=np.isnan(values))
