"""How far the answers of a sensor lie from a smooth path through their neighbours, where there is no truth.

About each answer a robust line is laid through eleven: slopes and heights are medians (Theil and Sen), so that three
false ones of eleven move it little. The line is that of the small turns from the answer that lies most among the
others. A body that turns at a steady rate leaves nothing, RA may wrap and the boresight may cross a pole.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.station.own_answers import measured_rotations, paired
from gse.station.session_data import SessionData
from gse.values.attitude_convention import to_quaternions
from gse.values.axis import CROSS_X, CROSS_Y, D_ROLL
from gse.values.constants import ARCSEC_PER_RAD

ABOUT = 11
FEWEST = 5
"""Answers of a stretch without a pause that show a path."""
_PAUSE = 10.0
"""A pause is longer than this many usual steps: no path leads over it."""
_ROWS_AT_ONCE = 2048
_MOST_SIGMAS = 6.0
_TO_SIGMA = 1.4826
"""From the median of normal deviations to their standard deviation."""


@dataclass(frozen=True, slots=True, eq=False)
class SmoothPath:
    """What a smooth path leaves of the answers, by frame and axis of the sensor (M, 3), in arcsec; NaN of no answer."""

    left_arcsec: NDArray[np.float64]

    @property
    def across_arcsec(self) -> NDArray[np.float64]:
        """How far (M,) the boresights lie from it."""
        return np.asarray(np.hypot(self.left_arcsec[:, 0], self.left_arcsec[:, 1]))

    def noise_arcsec(self, axis: str) -> float:
        """The standard deviation along an axis, without what lies far off; NaN of fewer answers than ABOUT.

        White noise shows 98 % of its size, for each answer takes part in its own line.
        """
        left = self.left_arcsec[:, (CROSS_X.key, CROSS_Y.key, D_ROLL.key).index(axis)]
        left = left[np.isfinite(left)]
        if len(left) < ABOUT:
            return float("nan")
        near = left[np.abs(left) <= _MOST_SIGMAS * _TO_SIGMA * np.median(np.abs(left))]
        return float(np.sqrt((near**2).mean()))


def smooth_path(session: SessionData) -> SmoothPath:
    """The path of a session whose sensor sends answers of its own."""
    frames, answers = session.frames.columns, session.sensor_attitudes.columns
    rows, places = paired(frames, answers)
    good = answers["acquired"][places]
    rows, places = rows[good], places[good]
    left = np.full((len(frames), 3), np.nan)
    utc_ns, first = np.unique(frames["utc_ns"][rows], return_index=True)
    rows, places = rows[first], places[first]
    if len(rows):
        rotations = measured_rotations(answers[places], utc_ns, session.station.sensor.attitude)
        left[rows] = left_of_path(utc_ns, to_quaternions(rotations))
    return SmoothPath(left)


def left_of_path(utc_ns: NDArray[np.int64], quaternions: NDArray[np.float64]) -> NDArray[np.float64]:
    """What the path leaves (M, 3), in arcsec about the sensor's axes, of quaternions (M, 4) at rising instants (M,)."""
    left = np.full((len(utc_ns), 3), np.nan)
    steps = np.diff(utc_ns)
    pauses = np.flatnonzero(steps > _PAUSE * (np.median(steps) if len(steps) else 0)) + 1
    for stretch in np.split(np.arange(len(utc_ns)), pauses):
        if len(stretch) < FEWEST:
            continue
        about = min(ABOUT, len(stretch))
        for first in range(0, len(stretch), _ROWS_AT_ONCE):
            own = stretch[first : first + _ROWS_AT_ONCE]
            begin = np.clip(own - ABOUT // 2, stretch[0], stretch[-1] + 1 - about)
            window = begin[:, None] + np.arange(about)
            time_s = (utc_ns[window] - utc_ns[own][:, None]) / 1e9
            left[own] = _left(time_s, quaternions[window], own - begin)
    return left


def _left(
    time_s: NDArray[np.float64], quaternions: NDArray[np.float64], place: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Of windows (M, K) of quaternions (M, K, 4), what is left (M, 3) of the one at ``place`` (M,) in each."""
    each = np.arange(len(place))
    alike = np.abs(np.einsum("mki,mli->mkl", quaternions, quaternions))
    middle = np.median(alike, axis=2).argmax(axis=1)
    turns = _turns(quaternions, quaternions[each, middle])
    one, other = np.triu_indices(time_s.shape[1], 1)
    apart_s = time_s[:, other] - time_s[:, one]
    slope = np.median((turns[:, other] - turns[:, one]) / apart_s[:, :, None], axis=1)
    height = np.median(turns - slope[:, None] * time_s[:, :, None], axis=1)
    return np.asarray((turns[each, place] - height) * ARCSEC_PER_RAD)


def _turns(quaternions: NDArray[np.float64], reference: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation vectors (M, K, 3) in the sensor frame from references (M, 4) to quaternions (M, K, 4), the short way."""
    vector, scalar = quaternions[..., :3], quaternions[..., 3:]
    of_vector, of_scalar = -reference[:, None, :3], reference[:, None, 3:]
    turn = scalar * of_vector + of_scalar * vector + np.cross(of_vector, vector)
    cosine = scalar * of_scalar - (of_vector * vector).sum(axis=-1, keepdims=True)
    turn, cosine = np.where(cosine < 0, -turn, turn), np.abs(cosine)
    sine = np.linalg.norm(turn, axis=-1, keepdims=True)
    return np.asarray(turn * np.where(sine > 0, 2 * np.arctan2(sine, cosine) / np.where(sine > 0, sine, 1.0), 2.0))
