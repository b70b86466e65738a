"""Housekeeping of STATUS frames beside the panoramas."""

from enum import StrEnum

import numpy as np

from gse.station.frame_columns import Columns
from protocols import StatusMessage


class Mode(StrEnum):
    """Mode of the sensor, in the words of the protocols; unknown before the first STATUS."""

    UNKNOWN = "unknown"
    STANDBY = "standby"
    STREAMING = "streaming"


MODES = tuple(Mode)


def fill_housekeeping(frames: Columns, statuses: list[tuple[int, StatusMessage]]) -> None:
    """Give each row of FRAME supply voltage and mode of the latest STATUS before it; none before the first."""
    if not statuses:
        return
    begins_ns = np.array([utc_ns for utc_ns, _ in statuses])
    order = np.argsort(begins_ns, kind="stable")
    supply_v = np.array([statuses[row][1].supply_v for row in order], dtype=np.float32)
    mode = np.array([_place(statuses[row][1].mode) for row in order])
    place = np.searchsorted(begins_ns[order], frames["host_utc_ns"], side="right") - 1
    known = place >= 0
    frames["supply_v"][known] = supply_v[place[known]]
    frames["mode"][known] = mode[place[known]]


def _place(mode: str) -> int:
    return MODES.index(Mode(mode)) if mode in MODES else 0


def in_words(message: StatusMessage) -> str:
    """The housekeeping of a STATUS frame in a line; what the protocol does not have is left out."""
    parts = [
        message.mode,
        "" if np.isnan(message.supply_v) else f"{message.supply_v:.2f} V",
        "" if np.isnan(message.temperature_c) else f"{message.temperature_c:.1f} degC",
        f"firmware {'.'.join(map(str, message.firmware))}" if message.firmware else "",
        f"serial {message.serial}" if message.serial else "",
    ]
    return ", ".join(part for part in parts if part)
