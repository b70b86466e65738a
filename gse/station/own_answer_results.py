"""Results of a sensor that sends its own answers and no panoramas: it is the only subject of its session."""

import math

import numpy as np
from numpy.typing import NDArray

from gse.attitude import Attitude, Attitudes
from gse.attitude_convention import AttitudeConvention
from gse.camera import Camera
from gse.identifier import Answers
from gse.matrices import product
from gse.mount import Mount
from gse.panorama import Panorama, Panoramas
from gse.station.attitude_error import attitude_errors
from gse.station.attitude_table import AttitudeTable
from gse.station.columns import ANSWER_CHECKS, STATUSES
from gse.station.frame_results import FrameResults
from gse.station.non_stellar import Others
from gse.station.own_answers import OwnAnswerTruth, field_of, measured_rotations
from gse.station.results import ERRORS, AnswerCheck, Matches, OwnAnswer, Starlight, Status, Subject
from gse.truth import SiderealTruth, mount_of
from protocols import AttitudeMessage

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
            Panoramas.of([panorama]),
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
