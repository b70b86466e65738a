"""The table of frames: one row per panorama, with time, the subjects' answers, their errors, and the sky.

Its columns are those of the frame table (gse.station.frame_table.FRAME) and of the sensor's own answers; a column that
is added there is a column here.
"""

import typing
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gse.assessment.counted_frames import CountedFrames
from gse.assessment.sensor_answers import SensorAnswers
from gse.station.frame_table import ANSWER_CHECKS, FRAME, ONBOARD_COLUMNS, SKY_CONDITIONS, STATUSES
from gse.tables.records import UTC
from gse.tables.units import field, schema

WORDS = {"status": STATUSES, "answer_check": ANSWER_CHECKS, "sky_condition": SKY_CONDITIONS}
_WORD = pa.dictionary(pa.int8(), pa.string())
_COUNTED = {"expected": "expected", "excluded": "excluded", "onboard_false": "false", "onboard_used": "used"}
"""Columns, and the masks of CountedFrames that they hold."""


def frames_schema() -> pa.Schema:
    """The schema of the table of frames."""
    return schema("frames", [field(name, kind) for name, kind in _kinds()])


def frames_table(frames: NDArray[np.void], counted: CountedFrames, own: SensorAnswers | None, key: str) -> pa.Table:
    """Rows of FRAME as a table; ``own`` are the sensor's answers to the same frames, ``key`` is of the results.

    What is unknown is null.
    """
    arrays = {"key": same_key(key, len(frames)), "frame": pa.array(np.arange(len(frames), dtype=np.uint32))}
    arrays |= {frame_column(name): arrow_column(name, frames[name]) for name in FRAME.names or ()}
    arrays |= {name: pa.array(getattr(counted, mask)) for name, mask in _COUNTED.items()}
    for name, kind in _sensor_kinds():
        values = None if own is None else getattr(own, name.removeprefix("sensor_"))
        arrays[name] = pa.nulls(len(frames), kind) if values is None else pa.array(values, kind, from_pandas=True)
    return pa.table([arrays[name] for name in frames_schema().names], schema=frames_schema())


def frame_column(name: str) -> str:
    """The name in the tables of a column of FRAME: UTC is UTC, and answers under test begin with their subject."""
    if name.endswith("utc_ns"):
        return name.removesuffix("_ns")
    return f"onboard_{name}" if name in ONBOARD_COLUMNS else name


def arrow_column(name: str, values: NDArray[Any]) -> pa.Array:
    """A column of FRAME or MATCH as Arrow keeps it: instants, words from their places, unknown numbers as null."""
    values = np.ascontiguousarray(values)
    if name.endswith("utc_ns"):
        return pa.array(values, pa.int64()).cast(UTC)
    if name in WORDS:
        places = pa.array(values.astype(np.int8))
        return pa.DictionaryArray.from_arrays(places, [word.value for word in WORDS[name]])
    return pa.array(values, from_pandas=True)


def _kinds() -> list[tuple[str, pa.DataType]]:
    of_frame = [(frame_column(name), _kind(name, FRAME[name])) for name in FRAME.names or ()]
    common = [item for item in of_frame if not item[0].startswith("onboard_")]
    onboard = [item for item in of_frame if item[0].startswith("onboard_")]
    counted = [(name, pa.bool_()) for name in _COUNTED]
    return [("key", KEY), ("frame", pa.uint32()), *common, *counted[:2], *onboard, *counted[2:], *_sensor_kinds()]


def _kind(name: str, kind: np.dtype[Any]) -> pa.DataType:
    if name.endswith("utc_ns"):
        return UTC
    return _WORD if name in WORDS else pa.from_numpy_dtype(kind)


def _sensor_kinds() -> list[tuple[str, pa.DataType]]:
    """From the types of the arrays: NDArray[np.bool_], NDArray[np.float64]."""
    hints = typing.get_type_hints(SensorAnswers)
    scalars = {name: typing.get_args(typing.get_args(hint)[1])[0] for name, hint in hints.items()}
    return [(f"sensor_{name}", pa.from_numpy_dtype(np.dtype(scalar))) for name, scalar in scalars.items()]


KEY = pa.dictionary(pa.int32(), pa.string())
"""The key in each row of frames and stars: kept once."""


def same_key(key: str, count: int) -> pa.Array:
    """The column of a key that all rows share."""
    return pa.DictionaryArray.from_arrays(pa.array(np.zeros(count, dtype=np.int32)), [key])
