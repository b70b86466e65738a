"""frames.csv: one line per panorama, for a spreadsheet."""

import csv
import io
from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gse import instant
from gse.assessment.sensor_answers import SensorAnswers
from gse.station.frame_table import ANSWER_CHECKS, FRAME, ONBOARD_COLUMNS, SKY_CONDITIONS, STATUSES
from gse.station.housekeeping import MODES
from gse.station.results import Subject

_ROWS_AT_ONCE = 1024
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

_SENSOR = tuple(field.name for field in fields(SensorAnswers))


def frames_csv(
    frames: NDArray[np.void], own: SensorAnswers | None = None, subject: Subject = Subject.ONBOARD
) -> Iterator[str]:
    """Rows of FRAME as text, UTC first; cells of unknown values are empty. It comes in parts: a session has 60 MB.

    Columns of answers begin with their ``subject``; those that came beside panoramas with ``sensor_``.
    """
    sensor = _SENSOR if own is not None else ()
    head = [*_COMMON, *(f"{subject}_{name}" for name in ONBOARD_COLUMNS), *(f"sensor_{name}" for name in sensor)]
    yield ",".join(["utc", *head]) + "\n"
    for first in range(0, len(frames), _ROWS_AT_ONCE):
        rows = slice(first, first + _ROWS_AT_ONCE)
        columns = [[instant.to_text(utc_ns) for utc_ns in frames["utc_ns"][rows].tolist()]]
        columns += [_texts(name, frames[name][rows]) for name in (*_COMMON, *ONBOARD_COLUMNS)]
        columns += [_texts(name, getattr(own, name)[rows]) for name in sensor]
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(zip(*columns, strict=True))
        yield text.getvalue()


def _texts(name: str, values: NDArray[Any]) -> list[str]:
    if name == "status":
        return [STATUSES[place].value for place in values.tolist()]
    if name == "answer_check":
        return [ANSWER_CHECKS[place].value for place in values.tolist()]
    if name == "mode":
        return [MODES[place].value for place in values.tolist()]
    if name == "sky_condition":
        return [SKY_CONDITIONS[place].value for place in values.tolist()]
    if values.dtype.kind == "b":
        return [str(int(value)) for value in values.tolist()]
    if values.dtype.kind != "f":
        return [str(value) for value in values.tolist()]
    if name == "false_match_probability":
        return ["" if value != value else f"{value:.3g}" for value in values.tolist()]
    decimals = next(digits for end, digits in _DECIMALS.items() if name.endswith(end))
    return ["" if value != value else f"{value:.{decimals}f}" for value in values.tolist()]
