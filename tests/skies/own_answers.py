"""Own answers (ATTITUDE) put beside the panoramas of a night, as sensors of several ideas give them."""

import copy

import numpy as np

from gse.station.own_answers import OwnAnswerTruth, field_of
from gse.station.session_tables import AttitudeTable
from gse.truth import truth_of
from gse.values.attitude import solve_attitude
from gse.values.attitude_convention import AttitudeConvention, state_angles
from protocols import AttitudeMessage


def by_stars(session, catalog, *, most=30, delay=0):
    """RA, DE and roll (M, 3) by the brightest named stars of each panorama, or of that so many before; their number.

    From catalogue places, as a sensor knows them; NaN where there is no panorama before.
    """
    matches, camera = session.frames.matches, session.station.sensor.camera()
    first = np.searchsorted(matches["frame"], np.arange(len(session.frames.columns) + 1))
    angles, counts = np.full((len(first) - 1, 3), np.nan), np.zeros(len(first) - 1, dtype=int)
    for frame in range(delay, len(angles)):
        rows = np.arange(first[frame - delay], first[frame - delay + 1])[:most]
        rows = rows[matches["named"][rows]]
        seen = camera.directions(np.column_stack([matches["x_px"][rows], matches["y_px"][rows]]).astype(float))
        found = solve_attitude(seen, catalog.icrs[matches["star"][rows]], 1e-4)
        angles[frame], counts[frame] = (found.ra_deg, found.de_deg, found.roll_deg), len(rows)
    return angles, counts


def without_error(session, *, whole_field):
    """RA, DE and roll (M, 3) of a sensor that answers the mean over its field, or its boresight alone."""
    station = session.station
    truth = truth_of(station.site, station.mount, session.earth_orientation)
    field_sensor = field_of(station.sensor.camera()) if whole_field else None
    true = OwnAnswerTruth(truth, station.mount, field_sensor=field_sensor).expected(session.frames.columns["utc_ns"])
    return state_angles(true, AttitudeConvention())


def with_answers(session, angles, counts):
    """The session with these as the sensor's own; rows of NaN are not sent."""
    made = copy.copy(session)
    made.sensor_attitudes = AttitudeTable()
    for row, of_one, count in zip(session.frames.columns.rows(), angles.tolist(), counts.tolist(), strict=True):
        if np.isfinite(of_one).all():
            message = AttitudeMessage(int(row["time_us"]), *of_one, int(row["frame_no"]), count, "acquired", 0.08)
            made.sensor_attitudes.append(int(row["utc_ns"]), message)
    return made
