"""Housekeeping of STATUS frames beside the panoramas."""

from collections.abc import Sequence
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

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
    place = latest_status(frames["host_utc_ns"], statuses)
    known = place >= 0
    frames["supply_v"][known] = np.array([message.supply_v for _, message in statuses], dtype=np.float32)[place[known]]
    frames["mode"][known] = np.array([_place(message.mode) for _, message in statuses])[place[known]]


def latest_status(host_utc_ns: NDArray[np.int64], statuses: Sequence[tuple[int, StatusMessage]]) -> NDArray[np.int64]:
    """Place in ``statuses`` of the latest before each time (N,), -1 before the first."""
    begins_ns = np.array([utc_ns for utc_ns, _ in statuses], dtype=np.int64)
    order = np.argsort(begins_ns, kind="stable")
    return np.append(order, -1)[np.searchsorted(begins_ns[order], host_utc_ns, side="right") - 1]


def firmware_text(message: StatusMessage) -> str:
    """The version of the firmware, as 1.2.0; empty where the protocol has none."""
    return ".".join(map(str, message.firmware))


def _place(mode: str) -> int:
    return MODES.index(Mode(mode)) if mode in MODES else 0


def in_words(message: StatusMessage) -> str:
    """The housekeeping of a STATUS frame in a line; what the protocol does not have is left out."""
    parts = [
        message.mode,
        "" if np.isnan(message.supply_v) else f"{message.supply_v:.2f} V",
        "" if np.isnan(message.temperature_c) else f"{message.temperature_c:.1f} degC",
        f"firmware {firmware_text(message)}" if message.firmware else "",
        f"serial {message.serial}" if message.serial else "",
    ]
    return ", ".join(part for part in parts if part)
