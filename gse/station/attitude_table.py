"""Table of the sensor's own answers: the ATTITUDE messages of a session as columns, 8 h at 10 Hz in 26 MB."""

import math
from typing import Self

import numpy as np
from numpy.typing import NDArray

from protocols import AttitudeMessage

ACQUIRED = "acquired"
_WITHOUT_STATE = ""
_ROOM_ROWS = 1024
"""The capacity doubles when it is full."""

OWN_ANSWER = np.dtype(
    [
        ("host_utc_ns", "i8"),
        ("time_us", "u8"),
        ("frame_no", "u4"),
        ("matched", "u2"),
        ("acquired", "?"),
        ("latency_ms", "f4"),
        ("ra_deg", "f8"),
        ("de_deg", "f8"),
        ("roll_deg", "f8"),
        ("q1", "f8"),
        ("q2", "f8"),
        ("q3", "f8"),
        ("q4", "f8"),
    ]
)
"""One row per ATTITUDE message, as it came; NaN where a value is missing. ``host_utc_ns`` is the host's time of the
first byte. ``acquired`` rows hold an answer: the sensor says so, or has no such word, and its numbers are in order."""

QUATERNION = ("q1", "q2", "q3", "q4")
ANGLES = ("ra_deg", "de_deg", "roll_deg")
_LARGEST_FRAME_NO, _LARGEST_MATCHED = 2**32 - 1, 2**16 - 1


class AttitudeTable:
    """The sensor's own answers, in order; ``columns`` is a structured array of OWN_ANSWER."""

    def __init__(self) -> None:
        self._room = np.zeros(_ROOM_ROWS, dtype=OWN_ANSWER)
        self._used = 0

    @classmethod
    def from_rows(cls, rows: NDArray[np.void]) -> Self:
        """A table with these rows of OWN_ANSWER."""
        table = cls()
        if len(rows):
            table._room, table._used = rows, len(rows)
        return table

    def __len__(self) -> int:
        return self._used

    def append(self, host_utc_ns: int, message: AttitudeMessage) -> None:
        """Add a message whose first byte was read at ``host_utc_ns``."""
        if self._used == len(self._room):
            # The kernel gives memory to the zeros only once they are written, so that half the room costs nothing.
            room = np.zeros(2 * len(self._room), dtype=OWN_ANSWER)
            room[: self._used] = self._room[: self._used]
            self._room = room
        self._room[self._used] = (
            host_utc_ns,
            message.time_us,
            min(max(message.frame_no, 0), _LARGEST_FRAME_NO),
            min(max(message.matched, 0), _LARGEST_MATCHED),
            has_answer(message),
            message.latency_s * 1e3,
            message.ra_deg,
            message.de_deg,
            message.roll_deg,
            message.q1,
            message.q2,
            message.q3,
            message.q4,
        )
        self._used += 1

    @property
    def columns(self) -> NDArray[np.void]:
        """One row per message, dtype OWN_ANSWER; a view without a copy."""
        return self._room[: self._used]


def has_answer(message: AttitudeMessage) -> bool:
    """Whether a message holds an attitude: RA and DE, or a quaternion that has a length."""
    if message.state not in (ACQUIRED, _WITHOUT_STATE) or message.problems:
        return False
    length = math.hypot(message.q1, message.q2, message.q3, message.q4)
    return (math.isfinite(message.ra_deg) and math.isfinite(message.de_deg)) or 0 < length < math.inf
