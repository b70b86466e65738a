"""The sensor's own answers beside panoramas: how many are compared with none, and what their stars leave open."""

import math

import numpy as np

from gse.station.attitude_table import ANGLES, QUATERNION
from gse.station.own_answers import own_truth, paired
from gse.station.session_data import SessionData, middle_instant_ns


def not_compared(session: SessionData) -> int:
    """How many answers are to no panorama, or were followed by one to the same panorama that says otherwise."""
    answers = session.sensor_attitudes.columns
    _, places = paired(session.frames.columns, answers)
    if not len(places):
        return int(answers["acquired"].sum())
    left = answers["acquired"].copy()
    left[places] = False
    others = np.flatnonzero(left)
    compared = places[np.argsort(answers["time_us"][places], kind="stable")]
    at = np.searchsorted(answers["time_us"][compared], answers["time_us"][others])
    said, then = answers[others], answers[compared[np.minimum(at, len(compared) - 1)]]
    copies = np.ones(len(others), dtype=bool)
    for name in ("time_us", "frame_no", *ANGLES, *QUATERNION):
        copies &= (said[name] == then[name]) | (np.isnan(said[name]) & np.isnan(then[name]))
    return int((~copies).sum())


def by_other_stars_arcsec(session: SessionData) -> float:
    """What another choice of as many stars makes of the sensor's boresight (standard deviation, along each axis).

    Air and aberration part the stars of a field unevenly; which of them a sensor took, it does not say.
    """
    truth, utc_ns = own_truth(session), middle_instant_ns(session)
    if truth is None or truth.mount.inertial is not None or utc_ns is None:
        return 0.0
    return truth.uneven_arcsec(utc_ns) / math.sqrt(_stars_of_a_fix(session))


def _stars_of_a_fix(session: SessionData) -> float:
    """As the sensor says, or as the station identifies where it says nothing."""
    answers = session.sensor_attitudes.columns
    for matched in (answers["matched"][answers["acquired"]], session.frames.columns["matched"]):
        if (matched > 0).any():
            return float(np.median(matched[matched > 0]))
    return 1.0
