"""The three error angles of a session over time, and their cosine transform.

An error is the small rotation between measured and true attitude, as shifts of the boresight along columns and rows and
as roll, in arcsec. The transform's ordinates are independent whatever the correlation of the errors
(gse.assessment.autocorrelation): slow causes show in the lowest, where slow noise shows too.
"""

import functools
import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gse.camera import Camera
from gse.constants import ARCSEC_PER_RAD
from gse.star_influence import attitude_operators, boresight_shifts

MOST_ORDINATES = 128
"""A step is known to a 250th of the session, a sinusoid of up to 60 cycles is seen."""
FEWEST_FRAMES = 20
_BLOCKS = 1024
_OUTLIER = 5.0


@dataclass(frozen=True, slots=True, eq=False)
class ErrorSeries:
    """Errors (M, 3) along columns, rows and about the boresight, in arcsec, at instants (M,) in s from the first."""

    rows: NDArray[np.int64]
    time_s: NDArray[np.float64]
    errors_arcsec: NDArray[np.float64]

    @property
    def duration_s(self) -> float:
        """From the first to the last."""
        return float(self.time_s[-1])

    @property
    def ordinates(self) -> int:
        """How many of the transform are used."""
        return min(MOST_ORDINATES, len(self.time_s) // 2)

    def cosines(self, columns: NDArray[np.float64]) -> NDArray[np.float64]:
        """The lowest ordinates (K, ...) of columns (M, ...), without the mean; white noise keeps its variance."""
        edges, basis = _basis(len(self.time_s), self.ordinates)
        return np.asarray(math.sqrt(2 / len(self.time_s)) * np.tensordot(basis, np.add.reduceat(columns, edges), 1))


def error_series(frames: NDArray[np.void], used: NDArray[np.bool_]) -> ErrorSeries | None:
    """Of the used (M,) rows of FRAME that have a roll, in the order of time; None of too few."""
    rows = np.flatnonzero(used & np.isfinite(frames["d_roll_arcsec"]))
    rows = rows[np.argsort(frames["utc_ns"][rows], kind="stable")]
    if len(rows) < FEWEST_FRAMES:
        return None
    utc_ns = frames["utc_ns"][rows]
    x, y, roll = (frames[f"{name}_arcsec"][rows] / ARCSEC_PER_RAD for name in ("cross_x", "cross_y", "d_roll"))
    turns = _rotation_vectors(x, y, roll) * ARCSEC_PER_RAD
    return ErrorSeries(rows, (utc_ns - utc_ns[0]) / 1e9, boresight_shifts(turns))


def with_left_out(series: ErrorSeries, matches: NDArray[np.void], camera: Camera) -> ErrorSeries:
    """The errors as they are with the stars (rows of MATCH) that answers left out; between frames without rows linear.

    Those that an identifier names are chosen by their distances, which biases them (gse.station.left_out_stars).
    """
    matches = matches[np.isin(matches["frame"], series.rows)]
    residuals = np.column_stack([matches["residual_x_arcsec"], matches["residual_y_arcsec"]]).astype(np.float64)
    length = np.hypot(*residuals.T)
    sound = matches["named"] | (length <= _OUTLIER * np.median(length)) if len(matches) else matches["named"]
    if sound.sum() == (matches["named"] & sound).sum():
        return series
    matches, residuals = matches[sound], residuals[sound]
    xy_px = np.column_stack([matches["x_px"], matches["y_px"]]).astype(np.float64)
    operators = attitude_operators(camera.directions(xy_px), matches["frame"])
    numbers, place = np.unique(matches["frame"], return_inverse=True)
    turns = np.zeros((len(numbers), 3))
    np.add.at(turns, place, np.einsum("nij,nj->ni", operators, residuals))
    shifts = boresight_shifts(turns)
    more = np.column_stack([np.interp(series.rows, numbers, shift) for shift in shifts.T])
    return replace(series, errors_arcsec=series.errors_arcsec + more)


def _rotation_vectors(x: NDArray[np.float64], y: NDArray[np.float64], roll: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rotations (M, 3) that gse.station.attitude_error describes: first the boresight, then about it."""
    across = Rotation.from_rotvec(np.column_stack([y, -x, np.zeros_like(x)]))
    about = Rotation.from_rotvec(np.column_stack([np.zeros_like(x), np.zeros_like(x), roll]))
    vectors: NDArray[np.float64] = (about * across).as_rotvec()
    return vectors


@functools.lru_cache(maxsize=4)
def _basis(n: int, ordinates: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """First rows (B,) of blocks, and cosines (K, B) at their middles."""
    edges = np.linspace(0, n, min(n, _BLOCKS) + 1).astype(np.int64)
    middle = (edges[:-1] + edges[1:]) / (2 * n)
    return edges[:-1], np.cos(math.pi * np.arange(1, ordinates + 1)[:, None] * middle)
