"""The table of housekeeping: one row per value of an item that the sensor sent, with its colour."""

from collections.abc import Iterator

import numpy as np
import pyarrow as pa

from gse.report.frames_table import KEY, instants, numbers, same_key, table_of
from gse.report.parquet import ROWS_AT_ONCE
from gse.report.table_columns import UTC, field, schema
from gse.station.session_data import SessionData
from protocols import COLOURS

_WORD = pa.dictionary(pa.int32(), pa.string())


def housekeeping_schema() -> pa.Schema:
    """The schema of the table of housekeeping."""
    kinds = [("key", KEY), ("utc", UTC), ("item", _WORD), ("value", pa.float64()), ("word", _WORD), ("unit", _WORD)]
    return schema("housekeeping", [field(name, kind) for name, kind in [*kinds, ("colour", _WORD)]])


def housekeeping_table(session: SessionData, key: str) -> pa.Table:
    """All values; ``value`` is in the ``unit`` of the item, of words and bits it is the number on the wire."""
    return pa.concat_tables(housekeeping_parts(session, key), promote_options="none").unify_dictionaries()


def housekeeping_parts(session: SessionData, key: str) -> Iterator[pa.Table]:
    """The same table in parts, at least one."""
    rows, items = session.housekeeping.rows, session.housekeeping.items
    names = pa.array([item.name for item in items], pa.string())
    units = pa.array([item.unit for item in items], pa.string())
    without_unit = np.array([not item.unit for item in items], dtype=np.bool_)
    for first in range(0, max(len(rows), 1), ROWS_AT_ONCE):
        part = rows[first : first + ROWS_AT_ONCE]
        item, value = np.asarray(part["item"]).astype(np.int32), np.array(part["value"])
        colour = np.asarray(part["colour"]).astype(np.int32)
        words: list[str | None] = [None] * len(value)
        for number in np.unique(item).tolist():
            if items[number].words or items[number].are_bits:
                for at in np.flatnonzero(item == number).tolist():
                    words[at] = str(items[number].value(float(value[at])))
        arrays = {
            "key": same_key(key, len(value)),
            "utc": instants(np.array(part["utc_ns"])),
            "item": pa.DictionaryArray.from_arrays(pa.array(item), names),
            "value": numbers(value),
            "word": pa.array(words, pa.string()).dictionary_encode(),
            "unit": pa.DictionaryArray.from_arrays(pa.array(item, mask=without_unit[item]), units),
            "colour": pa.DictionaryArray.from_arrays(pa.array(colour, mask=colour == 0), pa.array(COLOURS)),
        }
        yield table_of(arrays, housekeeping_schema(), len(value))
