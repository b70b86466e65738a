"""Definitions of a sensor's own answer, and its offset from the answer here by each of them.

Air and aberration part the stars of a field unevenly. A sensor may answer the mean over its stars, as the one here does
from the same panorama, over the whole field, or its boresight alone. What no idea explains is an error of its own.
"""

import numpy as np
from numpy.typing import NDArray

from gse.attitude_convention import from_angles
from gse.station.attitude_error import attitude_errors
from gse.station.own_answers import OwnAnswerTruth, SensorAnswers, field_of, own_truth
from gse.station.session_data import SessionData

_MOST_ROWS = 1 << 14
"""Evenly over the session: medians of so many are known well, and rotations of more are large."""


def by_each_idea(
    session: SessionData, own: SensorAnswers, rows: NDArray[np.int64]
) -> tuple[NDArray[np.int64], list[NDArray[np.float64]]] | None:
    """Some rows (K,) of the frames that both answer, and offsets (K, 2) east and north: by stars, field, boresight.

    None without a truth, and before a star simulator, which has no air.
    """
    truth, frames = own_truth(session), session.frames.columns
    if truth is None or truth.mount.inertial is not None:
        return None
    rows = rows[:: -(-len(rows) // _MOST_ROWS)]
    utc_ns = frames["utc_ns"][rows]
    angles = (frames[name][rows].astype(np.float64) for name in ("ra_deg", "de_deg", "roll_deg"))
    # the answers here are from catalogue places, with the air and the aberration of their stars left in
    simple = OwnAnswerTruth(truth.truth, truth.mount, False, field_of(session.station.sensor.camera()))
    here = attitude_errors(from_angles(*angles), simple.expected(utc_ns))[:, :2]
    of_sensor = np.column_stack([own.d_ra_cosde_arcsec[rows], own.d_de_arcsec[rows]])
    by_field = of_sensor - np.column_stack([frames["d_ra_cosde_arcsec"][rows], frames["d_de_arcsec"][rows]])
    boresight = OwnAnswerTruth(truth.truth, truth.mount, truth.aberration_corrected)
    middle_ns = utc_ns[len(rows) // 2 :][:1]
    of_field = attitude_errors(truth.expected(middle_ns), boresight.expected(middle_ns))[:, :2]
    return rows, [of_sensor - here, by_field, by_field + of_field]
