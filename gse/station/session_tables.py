"""Tables of a session as columns: frames, 14 h in some 100 MB; the sensor's own answers, 8 h at 10 Hz in 26 MB."""

import copy
import math
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gse.station.columns import FRAME
from gse.station.frame_columns import ColumnStore, FrameColumns
from protocols import AttitudeMessage

_ROOM_ROWS = 1 << 19
"""14 h at 10 Hz; the capacity doubles when it is full."""
MOST_IN_MEMORY = 1 << 16
"""Frames of a replay: 13 MB, 1.8 h at 10 Hz; those of a longer one lie in a temporary file, 195 bytes each."""
MOST_MATCHES = 250_000
"""In a longer session only every second, fourth, ... frame keeps its matches: 5 MB are enough for maps and fits. And so
for its other objects, which pictures show."""

MATCH = np.dtype(
    [
        ("frame", "u4"),
        ("star", "i4"),
        ("x_px", "f4"),
        ("y_px", "f4"),
        ("residual_x_arcsec", "f4"),
        ("residual_y_arcsec", "f4"),
        ("brightness", "f4"),
        ("named", "?"),
    ]
)
"""One row per star of the frames that keep theirs; ``frame`` is the row of its panorama, ``star`` that of its star in
the mission catalogue, ``brightness`` its index value. The answer has ``named`` it, or has left it out
(gse.station.shown_stars). ``compress`` and ``take`` select rows in an eighth of the time of ``[]``."""


OTHER = np.dtype(
    [
        ("frame", "u4"),
        ("x_px", "f4"),
        ("y_px", "f4"),
        ("brightness", "f4"),
        ("kind", "u1"),
    ]
)
"""One row per object that no answer names, brightest first, of the frames that keep theirs; columns as of MATCH.
``kind`` is a place in KINDS of gse.station.non_stellar."""
NO_OTHERS = np.zeros(0, OTHER)


def thinned(matches: NDArray[np.void], most: int) -> NDArray[np.void]:
    """Rows of MATCH, by frame; of more than ``most`` those of every second, third, ... frame that has any."""
    frames = matches["frame"]
    number = np.cumsum(np.diff(frames, prepend=frames[:1]) != 0)
    return matches.compress(number % max(-(-len(matches) // most), 1) == 0)


def xy_px_of(matches: NDArray[np.void]) -> NDArray[np.float64]:
    """Where the stars (N, 2) of rows of MATCH are seen."""
    return np.stack([matches["x_px"], matches["y_px"]], axis=1, dtype=np.float64)


def residuals_of(matches: NDArray[np.void]) -> NDArray[np.float64]:
    """The residuals (N, 2) of rows of MATCH, in arcsec."""
    return np.stack([matches["residual_x_arcsec"], matches["residual_y_arcsec"]], axis=1, dtype=np.float64)


class _Rows:
    """Rows of one dtype, in order, in memory that is reserved ahead: the kernel gives zeros their memory when they are
    written. A ``copy.copy`` keeps the rows so far: later ones lie behind them, or elsewhere.
    """

    def __init__(self, room: NDArray[np.void], used: int = 0) -> None:
        self._room = room
        self._used = used

    def __len__(self) -> int:
        return self._used

    def extend(self, rows: NDArray[np.void]) -> None:
        """Add rows; the capacity doubles when it is full."""
        used = self._used + len(rows)
        if used > len(self._room):
            room = np.zeros(max(2 * len(self._room), used), self._room.dtype)
            room[: self._used] = self.array()
            self._room = room
        self._room[self._used : used] = rows
        self._used = used

    def array(self) -> NDArray[np.void]:
        """All rows so far, as a view without a copy."""
        return self._room[: self._used]


class _Thinned(_Rows):
    """Rows with a ``frame``, of every frame, or where there are too many of every second, fourth, ... one."""

    def __init__(self, room: NDArray[np.void], used: int = 0, stride: int = 1) -> None:
        super().__init__(room, used)
        self.stride = stride

    def extend(self, rows: NDArray[np.void]) -> None:
        """Add those of the frames that keep theirs."""
        super().extend(rows.compress(rows["frame"] % self.stride == 0))
        if len(self) > MOST_MATCHES:
            self.stride *= 2
            stored = self.array()
            self._room, self._used = np.zeros(_ROOM_ROWS, rows.dtype), 0
            super().extend(stored.compress(stored["frame"] % self.stride == 0))


class FrameTable:
    """Frames of a session, in order: ``columns`` of FRAME, ``matches`` of MATCH and ``others`` of OTHER."""

    def __init__(self) -> None:
        self._frames = ColumnStore(FRAME, _ROOM_ROWS)
        self._most_in_memory: float = math.inf
        self._matches, self._others = (_Thinned(np.zeros(_ROOM_ROWS, dtype)) for dtype in (MATCH, OTHER))

    @classmethod
    def from_rows(cls, frames: NDArray[np.void], matches: NDArray[np.void]) -> Self:
        """The table whose rows of FRAME and MATCH these are; matches are not copied."""
        table = cls.with_rows(len(frames), matches)
        for name in FRAME.names or ():
            table.columns[name] = frames[name]
        return table

    @classmethod
    def with_rows(
        cls,
        count: int,
        matches: NDArray[np.void],
        others: NDArray[np.void] = NO_OTHERS,
        *,
        stride: int = 1,
        most_in_memory: float = math.inf,
    ) -> Self:
        """A table with so many rows of zeros, to be filled by column; of more than ``most_in_memory`` on the disk.

        ``stride`` becomes the ``picture_stride``.
        """
        table = cls()
        table._frames = ColumnStore(FRAME, 0).with_room(count, on_disk=count > most_in_memory)
        table._frames.used = count
        table._matches, table._others = (_Thinned(rows, len(rows), stride) for rows in (matches, others))
        return table

    def __len__(self) -> int:
        return self._frames.used

    def extend(self, frames: NDArray[np.void], matches: NDArray[np.void], others: NDArray[np.void] = NO_OTHERS) -> None:
        """Add rows of FRAME, and of MATCH and OTHER, whose ``frame`` counts from the first of these.

        Drops every second frame's matches when there are too many, and so its others.
        """
        matches["frame"] += len(self)
        others["frame"] += len(self)
        self._make_room(len(frames))
        self._frames.extend(frames)
        self._matches.extend(matches)
        self._others.extend(others)

    def use_disk(self, most_in_memory: int = MOST_IN_MEMORY) -> None:
        """From so many rows on, keep the frames in a temporary file.

        Only where no sensor waits: a disk that stands still stops whoever writes to such a file.
        """
        self._most_in_memory = most_in_memory
        self._make_room(0)

    def _make_room(self, count: int) -> None:
        needed, store = len(self) + count, self._frames
        on_disk = needed > self._most_in_memory
        if needed > store.rows or (on_disk and not store.is_on_disk):
            self._frames = store.with_room(2 * needed, on_disk=on_disk)
            if on_disk and not self._frames.is_on_disk:
                self._most_in_memory = math.inf  # the disk has no room: it is asked once

    def snapshot(self) -> "FrameTable":
        """A table of the rows so far, for another thread: columns are copied, matches, which never change, shared."""
        taken = copy.copy(self)
        taken._frames = self._frames.copied()
        taken._matches, taken._others = copy.copy(self._matches), copy.copy(self._others)
        return taken

    @property
    def columns(self) -> FrameColumns:
        """One row per panorama, columns of FRAME."""
        return FrameColumns(self._frames, 0, self._frames.used)

    @property
    def matches(self) -> NDArray[np.void]:
        """One row per star, dtype MATCH; in a long session not from every frame."""
        return self._matches.array()

    @property
    def others(self) -> NDArray[np.void]:
        """One row per object that no answer names, dtype OTHER; in a long session not from every frame."""
        return self._others.array()

    @property
    def picture_stride(self) -> int:
        """Every so manieth frame keeps all of its objects."""
        return max(self._matches.stride, self._others.stride)


ACQUIRED = "acquired"
_WITHOUT_STATE = ""
_ROOM_ANSWERS = 1024
"""Answers that there is room for at first."""

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


class AttitudeTable(_Rows):
    """The sensor's own answers, in order; ``columns`` is a structured array of OWN_ANSWER."""

    def __init__(self) -> None:
        super().__init__(np.zeros(_ROOM_ANSWERS, dtype=OWN_ANSWER))

    @classmethod
    def from_rows(cls, rows: NDArray[np.void]) -> Self:
        """A table with these rows of OWN_ANSWER."""
        table = cls()
        if len(rows):
            table._room, table._used = rows, len(rows)
        return table

    def append(self, host_utc_ns: int, message: AttitudeMessage) -> None:
        """Add a message whose first byte was read at ``host_utc_ns``."""
        row = (
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
        self.extend(np.array([row], dtype=OWN_ANSWER))

    @property
    def columns(self) -> NDArray[np.void]:
        """One row per message, dtype OWN_ANSWER; a view without a copy."""
        return self.array()


def has_answer(message: AttitudeMessage) -> bool:
    """Whether a message holds an attitude: RA and DE, or a quaternion that has a length."""
    if message.state not in (ACQUIRED, _WITHOUT_STATE) or message.problems:
        return False
    length = math.hypot(message.q1, message.q2, message.q3, message.q4)
    return (math.isfinite(message.ra_deg) and math.isfinite(message.de_deg)) or 0 < length < math.inf
