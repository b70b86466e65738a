"""The frame table of a session from its tables of frames and stars, exactly as it was."""

from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gse.catalog.stars import Designation, ListedStars
from gse.report.parquet import ParquetColumns
from gse.station.columns import COLUMNS, Column
from gse.station.frame_table import MATCH, MOST_IN_MEMORY, FrameTable
from gse.station.results import Subject


def restored_frames(
    frames: ParquetColumns, stars: ParquetColumns, subject: Subject, others: NDArray[np.void], stride: int
) -> FrameTable:
    """The frame table that the tables were made of; ``subject`` is whose answers it holds.

    ``others`` and ``stride`` are the table's own rows of OTHER and its ``picture_stride``.
    """
    matches = np.zeros(stars.num_rows, dtype=MATCH)
    for name in MATCH.names or ():
        matches[name] = _numbers(stars["star_row" if name == "star" else name])
    table = FrameTable.with_rows(frames.num_rows, matches, others, stride=stride, most_in_memory=MOST_IN_MEMORY)
    for column in COLUMNS:
        values = frames[column.name_of(subject)]
        table.columns[column.name] = _places(column, values) if column.words else _numbers(values)
    return table


def restored_stars(stars: ParquetColumns, designation: Designation) -> ListedStars:
    """The stars of the catalogue as far as the matches name them; the others have the number 0."""
    rows = _numbers(stars["star_row"])
    count = int(rows.max()) + 1 if len(rows) else 0
    ids, magnitude = np.zeros(count, dtype=np.int64), np.full(count, np.nan)
    ids[rows], magnitude[rows] = _numbers(stars["star_id"]), _numbers(stars["magnitude_mag"])
    return ListedStars(designation, ids, magnitude)


def _places(column: Column, values: pa.ChunkedArray) -> NDArray[Any]:
    words = pa.array([word.value for word in column.words])
    return np.asarray(pc.index_in(values.cast(pa.string()), words).to_numpy(zero_copy_only=False))


def _numbers(column: pa.ChunkedArray) -> NDArray[Any]:
    """Numbers, with NaN for null; instants as nanoseconds."""
    if pa.types.is_timestamp(column.type):
        column = column.cast(pa.int64())
    if pa.types.is_floating(column.type):
        column = column.fill_null(float("nan"))
    return np.asarray(column.to_numpy())
