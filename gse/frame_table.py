"""The frames of a session as columns: a whole night in some 100 MB."""

import numpy as np
from numpy.typing import NDArray

from gse.attitude import Attitude
from gse.results import FrameResult, Judge, Status

STATUSES = tuple(Status)
JUDGES = tuple(Judge)
_NAN = float("nan")
_BLOCK_ROWS = 4096
_FRAMES_AT_ONCE = 64
"""Frames whose matches become columns together: one by one takes eight times as long."""
MOST_MATCHES = 1_000_000
"""Of a longer night every second, fourth, ... frame keeps its matches: 20 MB, and enough for maps and fits."""

FRAME = np.dtype(
    [
        ("utc_ns", "i8"),
        ("host_utc_ns", "i8"),
        ("time_us", "u8"),
        ("frame_no", "u4"),
        ("sequence", "u2"),
        ("status", "u1"),
        ("judge", "u1"),
        ("objects", "u1"),
        ("matched", "u1"),
        ("hot_pixels", "u1"),
        ("exposure_s", "f4"),
        ("temperature_c", "f4"),
        ("chance", "f4"),
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
    ]
)
"""One row per panorama; NaN where there is nothing; status and judge are places in STATUSES and JUDGES."""

MATCH = np.dtype(
    [("frame", "u4"), ("x_px", "f4"), ("y_px", "f4"), ("residual_x_arcsec", "f4"), ("residual_y_arcsec", "f4")]
)
"""One row per identified object of the frames that keep theirs; ``frame`` is the row of its panorama."""


class _Rows:
    """Rows of one dtype that grow in blocks."""

    def __init__(self, dtype: np.dtype[np.void]) -> None:
        self._blocks: list[NDArray[np.void]] = []
        self._dtype = dtype
        self._used = _BLOCK_ROWS

    def append(self, row: tuple[float, ...]) -> None:
        self._make_room()
        self._blocks[-1][self._used] = row
        self._used += 1

    def extend(self, rows: NDArray[np.void]) -> None:
        while len(rows):
            self._make_room()
            fitting = rows[: _BLOCK_ROWS - self._used]
            self._blocks[-1][self._used : self._used + len(fitting)] = fitting
            self._used += len(fitting)
            rows = rows[len(fitting) :]

    def _make_room(self) -> None:
        if self._used == _BLOCK_ROWS:
            self._blocks.append(np.zeros(_BLOCK_ROWS, dtype=self._dtype))
            self._used = 0

    def __len__(self) -> int:
        return len(self._blocks) * _BLOCK_ROWS - (_BLOCK_ROWS - self._used if self._blocks else 0)

    def array(self) -> NDArray[np.void]:
        """All rows in one array; the blocks become views of it, so that nothing is held twice."""
        if not self._blocks:
            return np.zeros(0, dtype=self._dtype)
        count = len(self)
        whole = np.concatenate(self._blocks)
        self._blocks = [whole[i : i + _BLOCK_ROWS] for i in range(0, len(whole), _BLOCK_ROWS)]
        return whole[:count]


class FrameTable:
    """Frames of a session, in order; ``columns`` and ``matches`` are structured arrays of FRAME and MATCH."""

    def __init__(self) -> None:
        self._frames = _Rows(FRAME)
        self._matches = _Rows(MATCH)
        self._match_stride = 1
        self._waiting: list[tuple[int, NDArray[np.float64], NDArray[np.float64]]] = []

    def __len__(self) -> int:
        return len(self._frames)

    def append(self, result: FrameResult) -> None:
        """Add one frame."""
        row = len(self._frames)
        panorama, error = result.panorama, result.discrepancy
        self._frames.append(
            (
                panorama.utc_ns,
                panorama.host_utc_ns,
                panorama.time_us,
                panorama.frame_no,
                panorama.sequence,
                STATUSES.index(result.status),
                JUDGES.index(result.judge),
                min(len(panorama.index), 255),
                min(len(result.matches), 255),
                [kind for _, kind in result.others].count("hot pixel"),
                panorama.exposure_s,
                panorama.temperature_c,
                result.identification.chance if result.identification else _NAN,
                _NAN if result.elapsed_us is None else result.elapsed_us,
                *_angles(result.attitude),
                *_angles(result.attitude_true),
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
            )
        )
        if row % self._match_stride == 0 and len(result.matches):
            matches = result.matches
            self._waiting.append((row, panorama.xy_px[matches.objects], matches.residuals_arcsec))
            if len(self._waiting) == _FRAMES_AT_ONCE:
                self._take_in_matches()

    def _take_in_matches(self) -> None:
        """Make columns of the matches that wait, and thin all of them out where they have become too many."""
        if not self._waiting:
            return
        frames, xy_px, residuals_arcsec = zip(*self._waiting, strict=True)
        self._waiting = []
        rows = np.empty(sum(map(len, xy_px)), dtype=MATCH)
        rows["frame"] = np.repeat(frames, [len(of_frame) for of_frame in xy_px])
        rows["x_px"], rows["y_px"] = np.concatenate(xy_px).T
        rows["residual_x_arcsec"], rows["residual_y_arcsec"] = np.concatenate(residuals_arcsec).T
        self._matches.extend(rows)
        if len(self._matches) > MOST_MATCHES:
            self._match_stride *= 2
            kept = self._matches.array()
            self._matches = _Rows(MATCH)
            self._matches.extend(kept[kept["frame"] % self._match_stride == 0])

    @property
    def columns(self) -> NDArray[np.void]:
        """One row per panorama, dtype FRAME."""
        return self._frames.array()

    @property
    def matches(self) -> NDArray[np.void]:
        """One row per identified object, dtype MATCH; of a long night not those of every frame."""
        self._take_in_matches()
        return self._matches.array()


def _angles(attitude: Attitude | None) -> tuple[float, float, float]:
    if attitude is None:
        return _NAN, _NAN, _NAN
    return attitude.ra_deg, attitude.de_deg, attitude.roll_deg
