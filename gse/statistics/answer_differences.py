"""Differences between the sensor's own answers and the station's to the same panoramas, in the sensor frame."""

import numpy as np
from numpy.typing import NDArray

from gse.attitude_convention import from_angles
from gse.constants import ARCSEC_PER_RAD
from gse.station.frame_columns import Columns
from gse.station.own_answers import SensorAnswers

_ROWS_AT_ONCE = 1 << 14
"""Rotations of more rows than these are large."""


def answer_differences(own: SensorAnswers, frames: Columns) -> NDArray[np.float64]:
    """The sensor's boresight (M, 2) along columns and rows from the one here, in arcsec; NaN where one is missing.

    Another body frame makes all of them alike, a wrong clock, site or mount none.
    """
    apart = np.full((len(frames), 2), np.nan)
    for first in range(0, len(frames), _ROWS_AT_ONCE):
        rows = slice(first, first + _ROWS_AT_ONCE)
        here = np.column_stack([frames[name][rows] for name in ("ra_deg", "de_deg", "roll_deg")]).astype(np.float64)
        apart[rows] = _apart(here, np.radians(own.ra_deg[rows]), np.radians(own.de_deg[rows]))
    return apart


def _apart(here_deg: NDArray[np.float64], ra: NDArray[np.float64], de: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of answers here, RA, DE and roll (M, 3), to RA and DE (M,) in radians."""
    apart = np.full((len(here_deg), 2), np.nan)
    sensor = np.column_stack([np.cos(de) * np.cos(ra), np.cos(de) * np.sin(ra), np.sin(de)])
    known = np.isfinite(here_deg).all(axis=1) & np.isfinite(sensor).all(axis=1)
    seen = np.einsum("mij,mj->mi", from_angles(*here_deg[known].T), sensor[known])
    # beyond 90 deg the sine falls again: what lies behind is as far as can be
    seen[seen[:, 2] < 0, :2] = 1.0
    apart[known] = seen[:, :2] * ARCSEC_PER_RAD
    return apart
