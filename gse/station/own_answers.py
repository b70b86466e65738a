"""The sensor's own answers (ATTITUDE frames): the panoramas that they are to, and how far they are off the truth.

A sensor answers from the catalogue places of the stars that it sees: it knows no air, and a simple one no aberration.
So truth is brought to the same: the geometric direction of the mount, less what refraction, and aberration where it is
left in, move it by. Air bends what is lower by more, and a fit of stars over the field takes the mean of that: over 14
deg at an altitude of 22 deg it lies 12 arcsec from the bend at the boresight.
"""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gse.identifier import Answers
from gse.station.columns import ANSWER_CHECKS, STATUSES
from gse.station.frame_columns import Columns
from gse.station.frame_results import FrameResults
from gse.station.non_stellar import Others
from gse.station.results import ERRORS, AnswerCheck, Matches, OwnAnswer, Starlight, Status, Subject, attitude_errors
from gse.station.session_data import SessionData, middle_instant_ns
from gse.station.session_tables import ANGLES, QUATERNION, AttitudeTable
from gse.truth import Alignment, EarthOrientation, SiderealTruth, horizon_to_sensor, mount_of, truth_of
from gse.truth.frames import icrs_to_frame
from gse.truth.orientation import FIRST_MJD
from gse.values.attitude import Attitude, Attitudes, solve_attitude
from gse.values.attitude_convention import AttitudeConvention, read_angles, read_quaternions, state_angles
from gse.values.axis import D_ROLL
from gse.values.camera import Camera
from gse.values.constants import ARCSEC_PER_RAD
from gse.values.instant import NS_PER_DAY, NS_PER_S, UNIX_EPOCH_MJD
from gse.values.matrices import length, product
from gse.values.mount import Mount
from gse.values.panorama import Panorama, Panoramas
from protocols import AttitudeMessage

_CELL_NS = 60 * NS_PER_S
"""Aberration and refraction of the boresight change by 0.01 arcsec in this time."""
_CELLS_KEPT = 4096
_NEAR = np.array([[0.0, 0.0, 1.0], [1e-3, 0.0, 1.0], [0.0, 1e-3, 1.0]]) / np.sqrt([[1.0], [1.000001], [1.000001]])
_LOWEST = 0.05
"""Sine of 3 deg: stars below are seen by no sensor."""
_GRID = 9

_FIRST_NS = (FIRST_MJD - UNIX_EPOCH_MJD + 1) * NS_PER_DAY
"""No truth before: a wrong clock may have stamped a frame so."""
_ROWS_AT_ONCE = 1 << 14
"""Rotations of more rows than these are large: those of 8 h at 10 Hz have 20 MB."""

OWN_ERROR = np.dtype([("utc_ns", "i8"), *((name, "f8") for name in (*ERRORS[:3], "latency_ms"))])
"""One row per answer, at the mid-exposure of its panorama. NaN where the sensor has no answer, or there is no truth."""
NO_OWN_ERRORS = np.empty(0, OWN_ERROR)

MOST_WAITING = 8192
"""Answers without their panorama: a replay is so far ahead with answers that are only kept."""
MOST_BEHIND = 1000
"""Panoramas whose answers may still come: more than a minute at 10 Hz."""


def measured_rotations(
    answers: NDArray[np.void], utc_ns: NDArray[np.int64], convention: AttitudeConvention
) -> NDArray[np.float64]:
    """Rotations (M, 3, 3) from ICRS to the sensor that rows of OWN_ANSWER state for instants (M,).

    Angles count where a row has RA and DE, else its quaternion.
    """
    angles = np.column_stack([answers[name] for name in ANGLES])
    by_angle = np.isfinite(angles[:, :2]).all(axis=1)
    read = np.empty((len(answers), 3, 3))
    if by_angle.any():
        read[by_angle] = read_angles(angles[by_angle], convention)
    if not by_angle.all():
        quaternions = np.column_stack([answers[name][~by_angle] for name in QUATERNION])
        read[~by_angle] = read_quaternions(quaternions, convention)
    return np.asarray(product(read, icrs_to_frame(convention.frame, utc_ns)), dtype=np.float64)


def field_of(camera: Camera) -> NDArray[np.float64]:
    """Directions (N, 3) evenly over the detector of a camera."""
    x, y = ((np.arange(_GRID) + 0.5) * size / _GRID - 0.5 for size in (camera.columns, camera.rows))
    return camera.directions(np.stack(np.meshgrid(x, y), axis=-1))


@dataclass(slots=True)
class OwnAnswerTruth:
    """What a sensor on a mount answers that makes no error; ``aberration_corrected`` as its convention says.

    ``field_sensor`` (N, 3) are directions over its field; without them it is taken as small.
    """

    truth: SiderealTruth
    mount: Mount
    aberration_corrected: bool = False
    field_sensor: NDArray[np.float64] | None = None
    _shifts: dict[int, NDArray[np.float64]] = field(default_factory=dict)

    def expected(self, utc_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Rotations (M, 3, 3) from ICRS to the sensor at instants (M,)."""
        geometric = product(horizon_to_sensor(self.mount), self.truth.icrs_to_horizon_at(utc_ns))
        return np.asarray(product(self.shifts(utc_ns), geometric))

    def shifts(self, utc_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Rotations (M, 3, 3) in the sensor frame from the geometric attitude to the one that the sensor answers."""
        cells, of_cell = np.unique(utc_ns // _CELL_NS, return_inverse=True)
        return np.array([self._shift(cell) for cell in cells.tolist()]).reshape(-1, 3, 3)[of_cell]

    def uneven_arcsec(self, utc_ns: int) -> float:
        """How far (rms) air and aberration part the stars of the field, so that a few of them have another mean."""
        if self.field_sensor is None:
            return 0.0
        seen, stars = self._stars(utc_ns)
        left = seen - product(stars, _fitted(seen, stars).T)
        return math.sqrt(float((left**2).sum(axis=1).mean())) * ARCSEC_PER_RAD

    def _shift(self, cell: int) -> NDArray[np.float64]:
        shift = self._shifts.get(cell)
        if shift is None:
            if len(self._shifts) >= _CELLS_KEPT:
                self._shifts.clear()
            shift = self._shifts[cell] = self._computed(cell * _CELL_NS + _CELL_NS // 2)
        return shift

    def _computed(self, utc_ns: int) -> NDArray[np.float64]:
        seen, stars = self._stars(utc_ns)
        # of a small field the boresight by its star, the turn about it by the stars beside it
        return product(_triad(seen), _triad(stars).T) if seen is _NEAR else _fitted(seen, stars)

    def _stars(self, utc_ns: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Directions (N, 3) of the field, and where the mount has the stars seen there, in the sensor frame."""
        geometric = self.truth.attitude_true(utc_ns, self.mount).icrs_to_sensor
        zenith_sensor = product(geometric, self.truth.icrs_to_horizon(utc_ns)[2])
        seen = _NEAR if self.field_sensor is None else self.field_sensor
        up = product(seen, zenith_sensor) > _LOWEST
        if not up.all():
            seen = seen[up] if up.sum() >= len(_NEAR) else _NEAR
        stars = product(self.truth.unrefracted(seen, zenith_sensor), geometric)
        if not self.aberration_corrected:
            stars = self._catalogue_places(stars, utc_ns)
        return seen, product(stars, geometric.T)

    def _catalogue_places(self, apparent: NDArray[np.float64], utc_ns: int) -> NDArray[np.float64]:
        stars = apparent.copy()
        for _ in range(3):
            stars -= self.truth.apparent(stars, utc_ns) - apparent
            stars /= np.linalg.norm(stars, axis=1)[:, None]
        return stars


def _fitted(seen: NDArray[np.float64], true: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rotation (3, 3) that turns true directions (N, 3) into those that are seen, by Wahba's least squares."""
    return solve_attitude(seen, true, 1.0).icrs_to_sensor


def _triad(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Axes in columns: z along the first direction (3,), x by the mean of what two beside it, along x and y, show.

    Refraction shears the field: by either of the two alone the turn would be some arcsec off, one way or the other.
    """
    z = vectors[0] / length(vectors[0])
    beside = vectors[1:] - product(vectors[1:], z)[:, None] * z
    along_x, along_y = beside / np.linalg.norm(beside, axis=1)[:, None]
    x = along_x + np.cross(along_y, z)
    x /= length(x)
    return np.column_stack([x, np.cross(z, x), z])


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
    answers = session.sensor_attitudes.columns  # a copy of its rows of 8 h at 10 Hz is 28 MB
    rows, places = paired(frames, answers)
    if not len(rows):
        return None
    columns = {name: np.full(len(frames), np.nan) for name in (*ANGLES, *ERRORS, "latency_ms", "arrival_ms")}
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


def paired(frames: Columns, answers: NDArray[np.void]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows (K,) of FRAME, and rows (K,) of OWN_ANSWER that answer them; of two answers to one panorama the later."""
    row_of = panoramas_of(frames, answers)
    places = np.flatnonzero(row_of >= 0)[::-1]
    rows, later = np.unique(row_of[places], return_index=True)
    return rows, places[later]


def panoramas_of(frames: Columns, answers: NDArray[np.void]) -> NDArray[np.int64]:
    """The row of FRAME that each of some answers (M,) is to, by time tag and frame number; -1 where there is none.

    A sensor that starts anew may repeat both: then the panorama that the host read at the nearest time is meant. A
    sensor whose ATTITUDE has no frame number is taken by the tag alone.
    """
    rows = np.full(len(answers), -1)
    if not len(frames):
        return rows
    numbered = answers["frame_no"] > 0
    for some, numbers in ((numbered, True), (~numbered, False)):
        asked = np.flatnonzero(some)
        if not len(asked):
            continue
        keys = _ranks(frames["time_us"], answers["time_us"][asked])
        if numbers:
            number = frames["frame_no"].astype(np.int64), answers["frame_no"][asked].astype(np.int64)
            keys = _ranks(keys[0] << 32 | number[0], keys[1] << 32 | number[1])
        rows[asked] = _nearest(*keys, frames["host_utc_ns"], answers["host_utc_ns"][asked])
    return rows


def _ranks(one: NDArray[Any], other: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The places of values (N,) and (M,) among all different ones of both."""
    ranks = np.unique(np.concatenate([one, other]), return_inverse=True)[1].astype(np.int64)
    return ranks[: len(one)], ranks[len(one) :]


def _nearest(
    of_frames: NDArray[np.int64],
    of_answers: NDArray[np.int64],
    frames_ns: NDArray[np.int64],
    answers_ns: NDArray[np.int64],
) -> NDArray[np.int64]:
    """For each key (M,) the row of the equal key (N,) that is nearest in time; -1 where none is equal.

    Where the host's times are not known, those that came first belong together.
    """
    if not frames_ns.any():
        frames_ns, answers_ns = _occurrence(of_frames), _occurrence(of_answers)
    frame_rank, answer_rank = _ranks(frames_ns, answers_ns)
    many = 1 + max(int(frame_rank.max()), int(answer_rank.max()))
    keys = of_frames * many + frame_rank
    order = np.argsort(keys, kind="stable")
    after = np.searchsorted(keys, of_answers * many + answer_rank, sorter=order)
    best, best_ns = np.full(len(of_answers), -1), np.full(len(of_answers), np.iinfo(np.int64).max)
    for place in (after - 1, after):
        row = order[np.clip(place, 0, len(order) - 1)]
        apart_ns = np.abs(frames_ns[row] - answers_ns)
        is_nearer = (place >= 0) & (place < len(order)) & (of_frames[row] == of_answers) & (apart_ns < best_ns)
        best[is_nearer], best_ns[is_nearer] = row[is_nearer], apart_ns[is_nearer]
    return best


def _occurrence(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """How many equal keys (N,) came before each."""
    order = np.argsort(keys, kind="stable")
    first = np.flatnonzero(np.diff(keys[order], prepend=-1))
    found = np.empty(len(keys), dtype=np.int64)
    found[order] = np.arange(len(keys)) - np.repeat(first, np.diff(np.append(first, len(keys))))
    return found


def own_truth(session: SessionData) -> OwnAnswerTruth | None:
    """What an errorless sensor answers in a session; None without Earth orientation, or before the mount is fitted."""
    station = session.station
    mount = session.alignment.mount if session.alignment else station.mount
    truth = truth_of(station.site, mount, session.earth_orientation, session.shown)
    if truth is None or (station.mount.align is not None and session.alignment is None):
        return None
    corrected = station.sensor.attitude.aberration == "corrected"
    return OwnAnswerTruth(truth, mount, corrected, field_of(station.sensor.camera()))


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
        for name, values in zip(ANGLES, state_angles(measured, AttitudeConvention()).T, strict=True):
            columns[name][rows[part]] = values
        with_truth = compared[part]
        if truth is None or not with_truth.any():
            continue
        expected = truth.expected(utc_ns[part][with_truth])
        if session.mount_turns is not None:
            expected = product(session.mount_turns[rows[part][with_truth]], expected)
        errors = attitude_errors(measured[with_truth], expected)
        for name, values in zip(ERRORS, errors.T, strict=True):
            columns[name][rows[part][with_truth]] = values
    without_roll = rows[_lacks_roll(answers["ra_deg"][places], answers["roll_deg"][places])]
    columns["roll_deg"][without_roll] = columns[D_ROLL.column][without_roll] = np.nan


def _compared(session: SessionData, utc_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which instants (M,) are compared: those of truth, and not those that the mount was fitted on."""
    mask = utc_ns >= _FIRST_NS
    if session.station.mount.align is not None and session.alignment is not None:
        frames = session.frames.columns
        compared = np.isfinite(frames["ra_true_deg"])
        mask &= utc_ns >= frames["utc_ns"][compared].min() if compared.any() else False
    return np.asarray(mask)


def _lacks_roll(ra_deg: NDArray[np.float64], roll_deg: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which answers (M,) are angles without a roll."""
    return np.asarray(np.isnan(roll_deg) & np.isfinite(ra_deg))


class NewOwnErrors:
    """Errors of the sensor's own answers as they come, for the live displays; ``sensor_answers`` judges all at the end.

    Answers to panoramas from before there was a truth, as while the mount is fitted, are left out.
    """

    def __init__(self) -> None:
        self._truth: OwnAnswerTruth | None = None
        self._truth_is_of: tuple[EarthOrientation | None, Alignment | None] | None = None
        self._waiting = np.empty(0, dtype=np.int64)
        self._taken = self._seen = self._compared_from = 0

    def take(self, session: SessionData) -> NDArray[np.void]:
        """Rows of OWN_ERROR of the answers that found their panoramas since the last call, in the order of time."""
        frames, answers = session.frames.columns, session.sensor_attitudes.columns
        if session.subject is Subject.SENSOR or not self._has_truth(session):
            self._seen = self._compared_from = len(frames)
            return NO_OWN_ERRORS
        waiting = np.append(self._waiting, np.arange(self._taken, len(answers)))
        recent = frames[max(self._seen - MOST_BEHIND, self._compared_from) :]
        self._taken, self._seen = len(answers), len(frames)
        if not len(waiting):
            return NO_OWN_ERRORS
        rows = panoramas_of(recent, answers[waiting])
        found = rows >= 0
        self._waiting = waiting[~found][-MOST_WAITING:]
        return self._errors(session, answers[waiting[found]], recent["utc_ns"][rows[found]])

    def _has_truth(self, session: SessionData) -> bool:
        orientation, alignment = session.earth_orientation, session.alignment
        known = self._truth_is_of
        if known is None or known[0] is not orientation or known[1] is not alignment:
            self._truth_is_of, self._truth = (orientation, alignment), own_truth(session)
        return self._truth is not None

    def _errors(self, session: SessionData, answers: NDArray[np.void], utc_ns: NDArray[np.int64]) -> NDArray[np.void]:
        rows = np.zeros(len(answers), dtype=OWN_ERROR)
        rows["utc_ns"], rows["latency_ms"] = utc_ns, answers["latency_ms"]
        good = np.flatnonzero(answers["acquired"])
        errors = np.full((len(answers), len(ERRORS)), np.nan)
        if len(good) and self._truth is not None:
            measured = measured_rotations(answers[good], utc_ns[good], session.station.sensor.attitude)
            errors[good] = attitude_errors(measured, self._truth.expected(utc_ns[good]))
        for name, values in zip(ERRORS[:3], errors.T, strict=False):
            rows[name] = values
        rows["d_roll_arcsec"][_lacks_roll(answers["ra_deg"], answers["roll_deg"])] = np.nan
        return rows[np.argsort(utc_ns, kind="stable")]


# Results of a sensor that sends its own answers and no panoramas: it is the only subject of its session.

_NO_COVARIANCE = np.zeros((3, 3))


class OwnAnswerProcessor:
    """Makes results of answers, read by the sensor's convention."""

    def __init__(self, convention: AttitudeConvention, camera: Camera) -> None:
        self._convention = convention
        self._field_sensor = field_of(camera)
        self._truth: OwnAnswerTruth | None = None

    @staticmethod
    def panorama(answer: OwnAnswer) -> Panorama:
        """The exposure behind an answer: its time and number, without objects."""
        message = answer.message
        return Panorama(
            utc_ns=answer.utc_ns or 0,
            xy_px=np.empty((0, 2)),
            brightness=np.empty(0),
            frame_no=message.frame_no,
            exposure_s=math.nan,
            time_us=message.time_us,
            host_utc_ns=answer.host_utc_ns,
            sequence=answer.sequence,
            problems=message.problems,
        )

    def results(
        self, panorama: Panorama, message: AttitudeMessage, truth: SiderealTruth | None, mount: Mount | None
    ) -> FrameResults:
        """The result of an answer, alone; its identification time is the processing time that the sensor states."""
        table = AttitudeTable()
        table.append(panorama.host_utc_ns, message)
        status, detail = Status.IDENTIFIED, ""
        measured, geometric, true = (Attitudes.none(1) for _ in range(3))
        errors_arcsec = np.full((1, len(ERRORS)), np.nan)
        utc_ns = np.array([panorama.utc_ns])
        if not table.columns["acquired"][0]:
            status = Status.SENSOR_FAULT if message.problems else Status.NO_MATCH
            detail = message.problems[0] if message.problems else f"the sensor says {message.state or 'nothing'}"
        else:
            (seen,) = measured_rotations(table.columns, utc_ns, self._convention)
            measured[0] = Attitude(seen, _NO_COVARIANCE)
            if truth is not None:
                (shift,) = self._of(truth, mount or _looking_at(seen, truth, panorama.utc_ns)).shifts(utc_ns)
                geometric[0] = Attitude(product(shift.T, seen), _NO_COVARIANCE)
            if truth is not None and mount is not None:
                true[0] = truth.attitude_true(panorama.utc_ns, mount)
                errors_arcsec = attitude_errors(geometric.icrs_to_sensor, true.icrs_to_sensor)
        return FrameResults(
            Panoramas.from_panoramas([panorama]),
            Subject.SENSOR.value,
            str,
            np.array([STATUSES.index(status)], dtype=np.uint8),
            {0: detail} if detail else {},
            Answers.none(1),
            np.zeros((0, 2)),
            np.array([message.latency_s * 1e6]),
            measured,
            geometric,
            true,
            errors_arcsec,
            np.array([True]),
            np.array([ANSWER_CHECKS.index(AnswerCheck.UNKNOWN)], dtype=np.uint8),
            np.full((1, 3), np.nan),
            Others.none(1),
            Starlight.none(1),
            Matches.none(1),
        )

    def _of(self, truth: SiderealTruth, mount: Mount) -> OwnAnswerTruth:
        """Kept while truth and mount stay: what moves the answers is computed once a minute."""
        if self._truth is None or self._truth.truth is not truth or self._truth.mount != mount:
            corrected = self._convention.aberration == "corrected"
            self._truth = OwnAnswerTruth(truth, mount, corrected, self._field_sensor)
        return self._truth


def _looking_at(measured: NDArray[np.float64], truth: SiderealTruth, utc_ns: int) -> Mount:
    """The mount that the answer itself shows, for refraction while the mount is not fitted yet."""
    return mount_of(product(measured, truth.icrs_to_horizon(utc_ns).T))


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
