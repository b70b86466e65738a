"""The sensor's own answers (ATTITUDE frames) as a subject: their errors against sidereal truth.

They are taken as the station's own uncorrected answers are: RA, DE and roll of the boresight from catalogue places in
ICRS, without corrections for aberration and refraction. So truth is brought to the same: the geometric direction of the
mount, less what aberration and refraction move it by.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.assessment.onboard_equivalence import ACQUIRED
from gse.attitude import Attitude
from gse.constants import ARCSEC_PER_RAD
from gse.instant import NS_PER_DAY, NS_PER_S, UNIX_EPOCH_MJD
from gse.mount import Mount
from gse.station.session_data import SessionData
from gse.truth import SiderealTruth
from gse.truth.orientation import FIRST_MJD
from protocols import AttitudeMessage

_GRID_NS = 60 * NS_PER_S
"""Aberration and refraction of the boresight change by 0.01 arcsec in this time."""

_FIRST_NS = (FIRST_MJD - UNIX_EPOCH_MJD + 1) * NS_PER_DAY
"""No truth before: a wrong clock may have stamped a frame so."""

_NAN = float("nan")


@dataclass(frozen=True, slots=True, eq=False)
class SensorAnswers:
    """The sensor's answers by frame: columns (M,) in the order of the frame table, NaN where there is none.

    ``sent`` frames have an ATTITUDE frame, ``acquired`` ones an answer in it. Errors are in arcsec, as in
    AttitudeError; ``latency_ms`` is the processing time that the sensor states.
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


def sensor_answers(session: SessionData) -> SensorAnswers | None:
    """The sensor's answers to the panoramas of a session; None where it sent none for them."""
    frames = session.frames.columns
    rows, answers = _paired(session)
    if not answers:
        return None
    columns = {name: np.full(len(frames), _NAN) for name in ("ra_deg", "de_deg", "roll_deg", "latency_ms")}
    sent, acquired = np.zeros(len(frames), dtype=bool), np.zeros(len(frames), dtype=bool)
    sent[rows] = True
    acquired[rows] = [answer.state == ACQUIRED for answer in answers]
    for name in ("ra_deg", "de_deg", "roll_deg"):
        columns[name][rows] = [getattr(answer, name) for answer in answers]
        columns[name][~acquired] = _NAN
    columns["latency_ms"][rows] = [answer.latency_s * 1e3 for answer in answers]
    errors = _errors(session, frames, columns, np.flatnonzero(acquired))
    return SensorAnswers(sent, acquired, **columns, **errors)


def _paired(session: SessionData) -> tuple[list[int], list[AttitudeMessage]]:
    """Rows of the frame table and the answers for them, by frame number and time tag."""
    frames = session.frames.columns
    keys = zip(frames["frame_no"].tolist(), frames["time_us"].tolist(), strict=True)
    places = {key: row for row, key in enumerate(keys)}
    found = {
        places[key]: answer
        for _, answer in session.sensor_attitudes
        if (key := (answer.frame_no, answer.time_us)) in places
    }
    return list(found), list(found.values())


def _errors(
    session: SessionData, frames: NDArray[np.void], columns: dict[str, NDArray[np.float64]], rows: NDArray[np.int64]
) -> dict[str, NDArray[np.float64]]:
    names = ("d_ra_cosde_arcsec", "d_de_arcsec", "d_roll_arcsec", "cross_x_arcsec", "cross_y_arcsec")
    errors = {name: np.full(len(frames), _NAN) for name in names}
    mount = session.alignment.mount if session.alignment else session.station.mount
    fitting = session.station.mount.align is not None and session.alignment is None
    if session.earth_orientation is None or fitting or not len(rows):
        return errors
    if session.alignment is not None:  # frames that the mount was fitted on are not compared, as for the other subject
        compared = np.isfinite(frames["ra_true_deg"])
        rows = rows[frames["utc_ns"][rows] >= frames["utc_ns"][compared].min()] if compared.any() else rows[:0]
    rows = rows[frames["utc_ns"][rows] >= _FIRST_NS]
    if not len(rows):
        return errors
    truth = SiderealTruth(session.station.site, session.earth_orientation)
    true = _uncorrected_truth(truth, mount, frames["utc_ns"][rows])
    measured = rotations(*(columns[name][rows] for name in ("ra_deg", "de_deg", "roll_deg")))
    for name, values in zip(names, attitude_errors(measured, true), strict=True):
        errors[name][rows] = values
    return errors


def _uncorrected_truth(truth: SiderealTruth, mount: Mount, utc_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Rotations (M, 3, 3) from ICRS to the sensor that an errorless sensor without corrections answers."""
    cells, of_cell = np.unique(utc_ns // _GRID_NS, return_inverse=True)
    shifts = np.array([_shift_sensor(truth, mount, cell * _GRID_NS + _GRID_NS // 2) for cell in cells.tolist()])
    geometric = np.array([truth.attitude_true(ns, mount).icrs_to_sensor for ns in utc_ns.tolist()])
    return np.asarray(shifts[of_cell] @ geometric)


def _shift_sensor(truth: SiderealTruth, mount: Mount, utc_ns: int) -> NDArray[np.float64]:
    """The rotation in the sensor frame from the geometric attitude to the one of catalogue places."""
    geometric = truth.attitude_true(utc_ns, mount).icrs_to_sensor
    seen = np.array([[0.0, 0.0, 1.0], [1e-3, 0.0, 1.0], [0.0, 1e-3, 1.0]])
    seen /= np.linalg.norm(seen, axis=1)[:, None]
    zenith = geometric @ truth.icrs_to_horizon(utc_ns)[2]
    apparent = truth.unrefracted(seen, zenith) @ geometric
    stars = apparent.copy()
    for _ in range(3):
        stars -= truth.apparent(stars, utc_ns) - apparent
        stars /= np.linalg.norm(stars, axis=1)[:, None]
    # the boresight by its star, the turn about it by the stars beside it
    return _triad(seen) @ _triad(stars @ geometric.T).T


def _triad(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Axes in columns: z along the first direction (3,), x by the mean of what two beside it, along x and y, show.

    Refraction shears the field: by either of the two alone the turn would be some arcsec off, one way or the other.
    """
    z = vectors[0] / np.linalg.norm(vectors[0])
    beside = vectors[1:] - (vectors[1:] @ z)[:, None] * z
    along_x, along_y = beside / np.linalg.norm(beside, axis=1)[:, None]
    x = along_x + np.cross(along_y, z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def rotations(
    ra_deg: NDArray[np.float64], de_deg: NDArray[np.float64], roll_deg: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Rotations (M, 3, 3) from ICRS to the sensor, of angles (M,) in degrees."""
    angles = zip(ra_deg.tolist(), de_deg.tolist(), roll_deg.tolist(), strict=True)
    return np.array([Attitude.from_angles(*one).icrs_to_sensor for one in angles]).reshape(-1, 3, 3)


def attitude_errors(measured: NDArray[np.float64], true: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """dRA*, dDE, roll and cross-boresight x, y (M,) in arcsec of rotations (M, 3, 3), as ``compare`` gives one."""
    error = measured @ true.transpose(0, 2, 1)
    x, y, z = error[:, 2].T
    across = np.hypot(x, y)
    arc = np.where(across > 0, np.arctan2(across, z) / np.where(across > 0, across, 1.0), 1.0)
    boresight = true[:, 2]
    level = np.hypot(boresight[:, 0], boresight[:, 1])
    safe = np.where(level > 0, level, 1.0)
    cos_ra = np.where(level > 0, boresight[:, 0] / safe, 1.0)
    sin_ra = np.where(level > 0, boresight[:, 1] / safe, 0.0)
    off = x[:, None] * true[:, 0] + y[:, None] * true[:, 1]
    east = cos_ra * off[:, 1] - sin_ra * off[:, 0]
    north = level * off[:, 2] - boresight[:, 2] * (cos_ra * off[:, 0] + sin_ra * off[:, 1])
    roll = np.arctan2(error[:, 1, 0] - error[:, 0, 1], error[:, 0, 0] + error[:, 1, 1])
    return tuple(values * ARCSEC_PER_RAD for values in (east * arc, north * arc, roll, x * arc, y * arc))
