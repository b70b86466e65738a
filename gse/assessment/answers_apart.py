"""How far the sensor's own answers lie from those to the same panoramas here: in the sensor frame, without truth."""

import numpy as np
from numpy.typing import NDArray

from gse.assessment.sensor_answers import SensorAnswers
from gse.attitude_convention import from_angles
from gse.constants import ARCSEC_PER_RAD

_ROWS_AT_ONCE = 1 << 14
"""Rotations of more rows than these are large."""


def answers_apart(own: SensorAnswers, frames: NDArray[np.void]) -> NDArray[np.float64]:
    """The sensor's boresight (M, 2) along columns and rows from the one here, in arcsec; NaN where one is missing.

    Another body frame makes all of them alike, a wrong clock, site or mount none.
    """
    here = np.column_stack([frames[name] for name in ("ra_deg", "de_deg", "roll_deg")]).astype(np.float64)
    ra, de = np.radians(own.ra_deg), np.radians(own.de_deg)
    sensor = np.column_stack([np.cos(de) * np.cos(ra), np.cos(de) * np.sin(ra), np.sin(de)])
    apart = np.full((len(frames), 2), np.nan)
    rows = np.flatnonzero(np.isfinite(here).all(axis=1) & np.isfinite(sensor).all(axis=1))
    for first in range(0, len(rows), _ROWS_AT_ONCE):
        part = rows[first : first + _ROWS_AT_ONCE]
        seen = np.einsum("mij,mj->mi", from_angles(*here[part].T), sensor[part])
        # beyond 90 deg the sine falls again: what lies behind is as far as can be
        behind = seen[:, 2] < 0
        seen[behind, :2] = 1.0
        apart[part] = seen[:, :2] * ARCSEC_PER_RAD
    return apart
