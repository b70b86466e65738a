"""frames.csv: one line per panorama, for a spreadsheet."""

import csv
import io
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from gse import instant
from gse.station.frame_table import ANSWER_CHECKS, FRAME, STATUSES

_ROWS_AT_ONCE = 1024
_DECIMALS = {"_deg": 7, "_arcsec": 3, "_us": 1, "_s": 6, "_c": 2, "_mag": 3}


def frames_csv(frames: NDArray[np.void]) -> Iterator[str]:
    """The columns of FRAME as text, UTC first; empty where there is nothing. It comes in parts: a night has 60 MB."""
    names = [name for name in FRAME.names or () if name != "utc_ns"]
    yield ",".join(["utc", *names]) + "\n"
    for first in range(0, len(frames), _ROWS_AT_ONCE):
        part = frames[first : first + _ROWS_AT_ONCE]
        columns = [[instant.to_text(utc_ns) for utc_ns in part["utc_ns"].tolist()]]
        columns += [_texts(name, part[name]) for name in names]
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(zip(*columns, strict=True))
        yield text.getvalue()


def _texts(name: str, values: NDArray[np.void]) -> list[str]:
    if name == "status":
        return [STATUSES[place].value for place in values.tolist()]
    if name == "answer_check":
        return [ANSWER_CHECKS[place].value for place in values.tolist()]
    if values.dtype.kind != "f":
        return [str(value) for value in values.tolist()]
    if name == "false_match_probability":
        return ["" if value != value else f"{value:.3g}" for value in values.tolist()]
    decimals = next(digits for end, digits in _DECIMALS.items() if name.endswith(end))
    return ["" if value != value else f"{value:.{decimals}f}" for value in values.tolist()]
