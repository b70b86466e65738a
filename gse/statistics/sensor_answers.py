"""The sensor's own answers (ATTITUDE frames) as a subject: their errors against sidereal truth, frame by frame."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.attitude_convention import AttitudeConvention, state_angles
from gse.axis import ALL_AXES, D_ROLL
from gse.instant import NS_PER_DAY, UNIX_EPOCH_MJD
from gse.station.attitude_error import attitude_errors
from gse.station.attitude_table import ANGLES, QUATERNION
from gse.station.own_answers import OwnAnswerTruth, field_of, measured_rotations
from gse.station.session_data import SessionData
from gse.statistics.middle_instant import middle_instant_ns
from gse.truth import truth_of
from gse.truth.orientation import FIRST_MJD

_FIRST_NS = (FIRST_MJD - UNIX_EPOCH_MJD + 1) * NS_PER_DAY
"""No truth before: a wrong clock may have stamped a frame so."""
_ROWS_AT_ONCE = 1 << 14
"""Rotations of more rows than these are large: those of 8 h at 10 Hz have 20 MB."""

_ANGLES = ("ra_deg", "de_deg", "roll_deg")
ERRORS = tuple(axis.column for axis in ALL_AXES)


@dataclass(frozen=True, slots=True, eq=False)
class SensorAnswers:
    """The sensor's answers by frame: columns (M,) in the order of the frame table, NaN where there is none.

    ``sent`` frames have an ATTITUDE frame, ``acquired`` ones an answer in it. RA, DE and roll are in ICRS, read by the
    convention of the station file; errors are in arcsec, as in AttitudeError. ``latency_ms`` is the processing time
    that the sensor states, ``arrival_ms`` from mid-exposure to the first byte of the ATTITUDE frame at the host,
    ``matched`` how many stars it says it identified.
    """

    sent: NDArray[np.bool_]
    acquired: NDArray[np.bool_]
    ra_deg: NDArray[np.float64]
    de_deg: NDArray[np.float64]
    roll_deg: NDArray[np.float64]
    d_ra_cosde_arcsec: NDArray[np.float64]
    d_de_arcsec: NDArray[np.float64]
    d_roll_arcsec: NDArray[np.float64]
    cross_x_arcsec: NDArray[np.float64]
    cross_y_arcsec: NDArray[np.float64]
    latency_ms: NDArray[np.float64]
    arrival_ms: NDArray[np.float64]
    matched: NDArray[np.uint16]


def sensor_answers(session: SessionData) -> SensorAnswers | None:
    """The sensor's answers to the panoramas of a session; None where it sent none for them."""
    frames = session.frames.columns
    rows, places = paired_answers(session)
    if not len(rows):
        return None
    columns = {name: np.full(len(frames), np.nan) for name in (*_ANGLES, *ERRORS, "latency_ms", "arrival_ms")}
    answers = session.sensor_attitudes.columns  # a copy of its rows of 8 h at 10 Hz is 28 MB
    sent, acquired = np.zeros(len(frames), dtype=bool), np.zeros(len(frames), dtype=bool)
    sent[rows], acquired[rows] = True, answers["acquired"][places]
    columns["latency_ms"][rows] = answers["latency_ms"][places]
    host_utc_ns = answers["host_utc_ns"][places]
    columns["arrival_ms"][rows] = np.where(host_utc_ns > 0, (host_utc_ns - frames["utc_ns"][rows]) / 1e6, np.nan)
    matched = np.zeros(len(frames), dtype=np.uint16)
    matched[rows] = answers["matched"][places]
    good = answers["acquired"][places]
    _measure(session, rows[good], places[good], columns)
    return SensorAnswers(sent, acquired, **columns, matched=matched)


def paired_answers(session: SessionData) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows (K,) of the frame table, and rows (K,) of the answers to them, by time tag and frame number.

    A sensor whose ATTITUDE has no frame number is taken by the tag alone. Of two answers to one panorama the later.
    """
    frames, answers = session.frames.columns, session.sensor_attitudes.columns
    if not len(frames) or not len(answers):
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    order = np.argsort(frames["time_us"], kind="stable")
    place = np.searchsorted(frames["time_us"][order], answers["time_us"], side="right") - 1
    rows = order[np.maximum(place, 0)]
    same = (place >= 0) & (frames["time_us"][rows] == answers["time_us"])
    same &= (frames["frame_no"][rows] == answers["frame_no"]) | (answers["frame_no"] == 0)
    rows, later = np.unique(rows[same][::-1], return_index=True)
    return rows, np.flatnonzero(same)[::-1][later]


def not_compared(session: SessionData) -> int:
    """How many answers are to no panorama, or were followed by one to the same panorama that says otherwise."""
    answers, (_, places) = session.sensor_attitudes.columns, paired_answers(session)
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


def own_truth(session: SessionData) -> OwnAnswerTruth | None:
    """What an errorless sensor answers in a session; None without Earth orientation, or before the mount is fitted."""
    station = session.station
    mount = session.alignment.mount if session.alignment else station.mount
    truth = truth_of(station.site, mount, session.earth_orientation)
    if truth is None or (station.mount.align is not None and session.alignment is None):
        return None
    corrected = station.sensor.attitude.aberration == "corrected"
    return OwnAnswerTruth(truth, mount, corrected, field_of(station.sensor.camera()))


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


def _measure(
    session: SessionData, rows: NDArray[np.int64], places: NDArray[np.int64], columns: dict[str, NDArray[np.float64]]
) -> None:
    """Put angles and errors of the answers into their rows of the columns."""
    answers = session.sensor_attitudes.columns
    truth, utc_ns = own_truth(session), session.frames.columns["utc_ns"][rows]
    compared = _compared(session, utc_ns) if truth else np.zeros(len(rows), dtype=bool)
    for first in range(0, len(rows), _ROWS_AT_ONCE):
        part = slice(first, first + _ROWS_AT_ONCE)
        measured = measured_rotations(answers[places[part]], utc_ns[part], session.station.sensor.attitude)
        for name, values in zip(_ANGLES, state_angles(measured, AttitudeConvention()).T, strict=True):
            columns[name][rows[part]] = values
        with_truth = compared[part]
        if truth is None or not with_truth.any():
            continue
        errors = attitude_errors(measured[with_truth], truth.expected(utc_ns[part][with_truth]))
        for name, values in zip(ERRORS, errors.T, strict=True):
            columns[name][rows[part][with_truth]] = values
    without_roll = rows[np.isnan(answers["roll_deg"][places]) & np.isfinite(answers["ra_deg"][places])]
    columns["roll_deg"][without_roll] = columns[D_ROLL.column][without_roll] = np.nan


def _compared(session: SessionData, utc_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which instants (M,) are compared: those of truth, and not those that the mount was fitted on."""
    mask = utc_ns >= _FIRST_NS
    if session.alignment is not None:
        frames = session.frames.columns
        compared = np.isfinite(frames["ra_true_deg"])
        mask &= utc_ns >= frames["utc_ns"][compared].min() if compared.any() else False
    return np.asarray(mask)
