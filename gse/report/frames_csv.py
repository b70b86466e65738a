"""frames.csv: one line per panorama, for a spreadsheet."""

import csv
import io

import numpy as np
from numpy.typing import NDArray

from gse import instant
from gse.frame_table import FRAME, JUDGES, STATUSES

_DECIMALS = {"_deg": 7, "_arcsec": 3, "_us": 1, "_s": 6, "_c": 2}


def frames_csv(frames: NDArray[np.void]) -> str:
    """The columns of FRAME as text, UTC first; empty where there is nothing."""
    names = [name for name in FRAME.names or () if name != "utc_ns"]
    columns = [[instant.to_text(utc_ns) for utc_ns in frames["utc_ns"].tolist()]]
    columns += [_texts(name, frames[name]) for name in names]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["utc", *names])
    writer.writerows(zip(*columns, strict=True))
    return text.getvalue()


def _texts(name: str, values: NDArray[np.void]) -> list[str]:
    if name == "status":
        return [STATUSES[place].value for place in values.tolist()]
    if name == "judge":
        return [JUDGES[place].value for place in values.tolist()]
    if values.dtype.kind != "f":
        return [str(value) for value in values.tolist()]
    if name == "chance":
        return ["" if value != value else f"{value:.3g}" for value in values.tolist()]
    decimals = next(digits for end, digits in _DECIMALS.items() if name.endswith(end))
    return ["" if value != value else f"{value:.{decimals}f}" for value in values.tolist()]
