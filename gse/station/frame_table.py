"""Table of results: the frames of a session as columns, 14 h in some 100 MB."""

import copy
import math
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gse.station.frame_columns import ColumnStore, FrameColumns
from gse.station.results import AnswerCheck, SkyCondition, Status

STATUSES = tuple(Status)
ANSWER_CHECKS = tuple(AnswerCheck)
SKY_CONDITIONS = tuple(SkyCondition)
_ROOM_ROWS = 1 << 19
"""14 h at 10 Hz; the capacity doubles when it is full."""
MOST_IN_MEMORY = 1 << 16
"""Frames of a replay: 12 MB, 1.8 h at 10 Hz; those of a longer one lie in a temporary file, 180 bytes each."""
MOST_MATCHES = 250_000
"""In a longer session only every second, fourth, ... frame keeps its matches: 5 MB are enough for maps and fits. And so
for its other objects, which pictures show."""

FRAME = np.dtype(
    [
        ("utc_ns", "i8"),
        ("host_utc_ns", "i8"),
        ("time_us", "u8"),
        ("frame_no", "u4"),
        ("sequence", "u2"),
        ("status", "u1"),
        ("answer_check", "u1"),
        ("objects", "u1"),
        ("matched", "u1"),
        ("hot_pixels", "u1"),
        ("exposure_s", "f4"),
        ("temperature_c", "f4"),
        ("false_match_probability", "f4"),
        ("zero_point_mag", "f4"),
        ("elapsed_us", "f4"),
        ("ra_deg", "f8"),
        ("de_deg", "f8"),
        ("roll_deg", "f8"),
        ("ra_true_deg", "f8"),
        ("de_true_deg", "f8"),
        ("roll_true_deg", "f8"),
        ("d_ra_cosde_arcsec", "f8"),
        ("d_de_arcsec", "f8"),
        ("d_roll_arcsec", "f8"),
        ("cross_x_arcsec", "f8"),
        ("cross_y_arcsec", "f8"),
        ("stars_seen", "u1"),
        ("limiting_mag", "f4"),
        ("sky_condition", "u1"),
        ("transparency", "f4"),
        ("stars_expected", "f4"),
        ("sun_altitude_deg", "f4"),
        ("sun_separation_deg", "f4"),
        ("moon_altitude_deg", "f4"),
        ("moon_separation_deg", "f4"),
        ("false_objects", "u1"),
        ("supply_v", "f4"),
        ("mode", "u1"),
    ]
)
"""One row per panorama; NaN where a value is missing; status, answer_check and sky_condition are places in STATUSES,
ANSWER_CHECKS and SKY_CONDITIONS. ``zero_point_mag`` is the median of catalogue magnitude + 2.5 log10(index value) of
the named stars: the same sensor under clear sky keeps it, and a cloud of one magnitude lowers it by one. ``stars_seen``
are those that were named, by the reference identifier where the one under test has no answer; ``limiting_mag`` is the
magnitude of the faintest of them. The columns behind it are of the sky, the same for the frames of 5 s:
``transparency`` is the share of the starlight of the session's clearest part, ``stars_expected`` the number of
catalogue stars in the field, at most as many as a panorama holds; separations are from the boresight.
``false_objects`` are as bright as stars of the mission catalogue and are neither star, planet nor hot pixel.
``supply_v`` and ``mode`` (a place in MODES of gse.station.housekeeping) are those of the latest STATUS frame."""

ONBOARD_COLUMNS = (
    "status",
    "answer_check",
    "matched",
    "false_match_probability",
    "zero_point_mag",
    "elapsed_us",
    "ra_deg",
    "de_deg",
    "roll_deg",
    "d_ra_cosde_arcsec",
    "d_de_arcsec",
    "d_roll_arcsec",
    "cross_x_arcsec",
    "cross_y_arcsec",
)
"""Columns of FRAME that are of the identifier under test; the others are of the panorama, its sky, or truth."""

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
(gse.station.unnamed_stars). ``compress`` and ``take`` select rows in an eighth of the time of ``[]``."""


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
    """Rows of one dtype in memory that is reserved ahead; unused pages take no physical memory."""

    def __init__(self, room: NDArray[np.void], used: int = 0) -> None:
        self._room = room
        self._used = used

    def extend(self, rows: NDArray[np.void]) -> None:
        self._make_room(len(rows))
        self._room[self._used : self._used + len(rows)] = rows
        self._used += len(rows)

    def _make_room(self, count: int) -> None:
        while self._used + count > len(self._room):
            self._room = np.concatenate([self._room, np.zeros(max(len(self._room), _ROOM_ROWS), self._room.dtype)])

    def __len__(self) -> int:
        return self._used

    def array(self) -> NDArray[np.void]:
        """All rows so far, as a view without a copy."""
        return self._room[: self._used]


class _Thinned:
    """Rows with a ``frame``, of every frame, or where there are too many of every second, fourth, ... one."""

    def __init__(self, dtype: "np.dtype[np.void]") -> None:
        self._rows = _Rows(np.zeros(_ROOM_ROWS, dtype))
        self.stride = 1

    @classmethod
    def of(cls, rows: NDArray[np.void], stride: int) -> Self:
        made = cls.__new__(cls)
        made._rows, made.stride = _Rows(rows, len(rows)), stride
        return made

    def extend(self, rows: NDArray[np.void]) -> None:
        self._rows.extend(rows.compress(rows["frame"] % self.stride == 0))
        if len(self._rows) > MOST_MATCHES:
            self.stride *= 2
            stored = self._rows.array()
            self._rows = _Rows(np.zeros(_ROOM_ROWS, rows.dtype))
            self._rows.extend(stored.compress(stored["frame"] % self.stride == 0))

    def array(self) -> NDArray[np.void]:
        return self._rows.array()

    def snapshot(self) -> "_Thinned":
        taken = copy.copy(self)
        taken._rows = copy.copy(self._rows)
        return taken


class FrameTable:
    """Frames of a session, in order: ``columns`` of FRAME, ``matches`` of MATCH and ``others`` of OTHER."""

    def __init__(self) -> None:
        self._frames = ColumnStore(FRAME, _ROOM_ROWS)
        self._most_in_memory: float = math.inf
        self._matches, self._others = _Thinned(MATCH), _Thinned(OTHER)

    @classmethod
    def of(cls, frames: NDArray[np.void], matches: NDArray[np.void]) -> Self:
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

        ``stride`` is that of ``pictures``.
        """
        table = cls()
        table._frames = ColumnStore(FRAME, 0).with_room(count, on_disk=count > most_in_memory)
        table._frames.used = count
        table._matches, table._others = _Thinned.of(matches, stride), _Thinned.of(others, stride)
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
        taken._matches, taken._others = self._matches.snapshot(), self._others.snapshot()
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
