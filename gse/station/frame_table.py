"""Table of results: the frames of a session as columns, 14 h in some 100 MB."""

import copy
from collections.abc import Iterator, Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gse.attitude import Attitude, angles_deg
from gse.panorama import Panorama
from gse.station.results import AnswerCheck, FrameResult, Matches, SkyCondition, Status

STATUSES = tuple(Status)
ANSWER_CHECKS = tuple(AnswerCheck)
SKY_CONDITIONS = tuple(SkyCondition)
_NAN = float("nan")
_ROOM_ROWS = 1 << 19
"""14 h at 10 Hz; the capacity doubles when it is full."""
_FRAMES_AT_ONCE = 64
"""Frames whose matches become columns together: one by one takes eight times as long."""
MOST_MATCHES = 250_000
"""In a longer session only every second, fourth, ... frame keeps its matches: 5 MB are enough for maps and fits."""

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
(gse.station.left_out_stars)."""


class _Rows:
    """Rows of one dtype in memory that is reserved ahead; unused pages take no physical memory."""

    def __init__(self, dtype: np.dtype[np.void]) -> None:
        self._room = np.zeros(_ROOM_ROWS, dtype=dtype)
        self._used = 0

    def extend(self, rows: NDArray[np.void] | list[tuple[float, ...]]) -> None:
        self._make_room(len(rows))
        self._room[self._used : self._used + len(rows)] = rows
        self._used += len(rows)

    def copied(self) -> "_Rows":
        taken = copy.copy(self)
        taken._room = self.array().copy()
        return taken

    def _make_room(self, count: int) -> None:
        while self._used + count > len(self._room):
            self._room = np.concatenate([self._room, np.zeros_like(self._room)])

    def __len__(self) -> int:
        return self._used

    def array(self) -> NDArray[np.void]:
        """All rows so far, as a view without a copy."""
        return self._room[: self._used]


class FrameTable:
    """Frames of a session, in order; ``columns`` and ``matches`` are structured arrays of FRAME and MATCH."""

    def __init__(self) -> None:
        self._frames = _Rows(FRAME)
        self._matches = _Rows(MATCH)
        self._match_stride = 1
        self._waiting: list[tuple[int, Panorama, Matches, bool]] = []

    @classmethod
    def of(cls, frames: NDArray[np.void], matches: NDArray[np.void]) -> Self:
        """A table with these rows of FRAME and MATCH."""
        table = cls()
        table._frames.extend(frames)
        table._matches.extend(matches)
        return table

    def __len__(self) -> int:
        return len(self._frames)

    def append(self, result: FrameResult) -> None:
        """Add one frame."""
        self.extend([result])

    def extend(self, results: Sequence[FrameResult]) -> None:
        """Add frames."""
        first = len(self._frames)
        answered = _angles([result.attitude for result in results])
        true = _angles([result.attitude_true for result in results])
        self._frames.extend([_row(*columns) for columns in zip(results, answered, true, strict=True)])
        for row, result in enumerate(results, first):
            if row % self._match_stride == 0 and len(result.matches):
                self._waiting += [(row, result.panorama, result.matches, True)]
                if len(result.left_out):
                    self._waiting += [(row, result.panorama, result.left_out, False)]
                if len(self._waiting) >= _FRAMES_AT_ONCE:
                    self._take_in_matches()

    def _take_in_matches(self) -> None:
        """Make columns of the waiting matches; drop every second frame's matches when there are too many."""
        if not self._waiting:
            return
        frames, panoramas, matches, named = zip(*self._waiting, strict=True)
        self._waiting = []
        counts = [len(of_frame) for of_frame in matches]
        rows = np.empty(sum(counts), dtype=MATCH)
        rows["frame"], rows["named"] = np.repeat(frames, counts), np.repeat(named, counts)
        rows["star"] = np.concatenate([of_frame.stars for of_frame in matches])
        seen = list(zip(panoramas, matches, strict=True))
        rows["x_px"], rows["y_px"] = np.concatenate([one.xy_px.take(stars.objects, axis=0) for one, stars in seen]).T
        rows["brightness"] = np.concatenate([one.brightness.take(stars.objects) for one, stars in seen])
        residuals_arcsec = np.concatenate([of_frame.residuals_arcsec for of_frame in matches])
        rows["residual_x_arcsec"], rows["residual_y_arcsec"] = residuals_arcsec.T
        self._matches.extend(rows)
        if len(self._matches) > MOST_MATCHES:
            self._match_stride *= 2
            stored = self._matches.array()
            self._matches = _Rows(MATCH)
            self._matches.extend(stored[stored["frame"] % self._match_stride == 0])

    def snapshot(self) -> "FrameTable":
        """A table of the rows so far, for another thread: columns are copied, matches, which never change, shared."""
        self._take_in_matches()
        taken = copy.copy(self)
        taken._frames, taken._matches = self._frames.copied(), copy.copy(self._matches)
        taken._waiting = []
        return taken

    @property
    def columns(self) -> NDArray[np.void]:
        """One row per panorama, dtype FRAME."""
        return self._frames.array()

    @property
    def matches(self) -> NDArray[np.void]:
        """One row per star, dtype MATCH; in a long session not from every frame."""
        self._take_in_matches()
        return self._matches.array()


_Angles = tuple[float, float, float]
_NO_ANGLES = _NAN, _NAN, _NAN


def _false_objects(result: FrameResult) -> int:
    """Unknown objects that are brighter than every star that the mission catalogue lacks."""
    brightness, least = result.panorama.brightness, result.light.faintest_index
    return sum(kind == "unknown" and float(brightness[row]) > least for row, kind in result.others)


def _row(result: FrameResult, angles_deg: _Angles, angles_true_deg: _Angles) -> tuple[float, ...]:
    """The row of FRAME."""
    panorama, error = result.panorama, result.attitude_error
    return (
        panorama.utc_ns,
        panorama.host_utc_ns,
        panorama.time_us,
        panorama.frame_no,
        panorama.sequence,
        STATUSES.index(result.status),
        ANSWER_CHECKS.index(result.answer_check),
        min(len(panorama.brightness), 255),
        min(len(result.matches), 255),
        [kind for _, kind in result.others].count("hot pixel"),
        panorama.exposure_s,
        panorama.temperature_c,
        result.identification.false_match_probability if result.identification else _NAN,
        result.light.zero_point_mag,
        _NAN if result.elapsed_us is None else result.elapsed_us,
        *angles_deg[:2],
        angles_deg[2] if result.has_roll else _NAN,
        *angles_true_deg,
        *(
            (
                error.d_ra_cosde_arcsec,
                error.d_de_arcsec,
                error.d_roll_arcsec,
                error.cross_x_arcsec,
                error.cross_y_arcsec,
            )
            if error
            else (_NAN,) * 5
        ),
        min(result.light.stars, 255),
        result.light.limiting_mag,
        0,
        *(_NAN,) * 6,
        _false_objects(result),
        _NAN,
        0,
    )


def _angles(attitudes: list[Attitude | None]) -> Iterator[_Angles]:
    """RA, DE and roll of each."""
    angles = iter(angles_deg([attitude for attitude in attitudes if attitude is not None]).tolist())
    return (_NO_ANGLES if attitude is None else next(angles) for attitude in attitudes)
