"""Where the columns of a table lie."""

from typing import Any

import numpy as np

from gse.station.frame_columns import FrameColumns


def lies_on_disk(columns: FrameColumns) -> bool:
    """Whether columns lie in a file that is mapped, or in memory of their own."""
    base: Any = columns[columns.dtype.names[0]]
    while isinstance(base, np.ndarray):
        base = base.base
    return base is not None
