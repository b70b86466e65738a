"""Results of a sensor that sends its own answers and no panoramas: it is the only subject of its session."""

import math

import numpy as np
from numpy.typing import NDArray

from gse.attitude import Attitude
from gse.attitude_convention import AttitudeConvention
from gse.camera import Camera
from gse.mount import Mount
from gse.panorama import Panorama
from gse.station.attitude_error import attitude_error
from gse.station.attitude_table import AttitudeTable
from gse.station.own_answers import OwnAnswerTruth, field_of, measured_rotations
from gse.station.results import FrameResult, OwnAnswer, Status, Subject
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

    def result(
        self, panorama: Panorama, message: AttitudeMessage, truth: SiderealTruth | None, mount: Mount | None
    ) -> FrameResult:
        """The result of an answer; its identification time is the processing time that the sensor states."""
        table = AttitudeTable()
        table.append(panorama.host_utc_ns, message)
        elapsed_us = None if math.isnan(message.latency_s) else message.latency_s * 1e6
        who = Subject.SENSOR.value
        (is_answer,) = table.columns["acquired"]
        if not is_answer:
            status = Status.SENSOR_FAULT if message.problems else Status.NO_MATCH
            detail = message.problems[0] if message.problems else f"the sensor says {message.state or 'nothing'}"
            return FrameResult(panorama, status, detail, who, elapsed_us=elapsed_us)
        utc_ns = np.array([panorama.utc_ns])
        (measured,) = measured_rotations(table.columns, utc_ns, self._convention)
        geometric = true = None
        if truth is not None:
            (shift,) = self._of(truth, mount or _looking_at(measured, truth, panorama.utc_ns)).shifts(utc_ns)
            geometric = Attitude(shift.T @ measured, _NO_COVARIANCE)
            true = truth.attitude_true(panorama.utc_ns, mount) if mount else None
        return FrameResult(
            panorama,
            Status.IDENTIFIED,
            "",
            who,
            attitude=Attitude(measured, _NO_COVARIANCE),
            elapsed_us=elapsed_us,
            attitude_geometric=geometric,
            attitude_error=attitude_error(geometric, true) if geometric and true else None,
            attitude_true=true,
        )

    def _of(self, truth: SiderealTruth, mount: Mount) -> OwnAnswerTruth:
        """Kept while truth and mount stay: what moves the answers is computed once a minute."""
        if self._truth is None or self._truth.truth is not truth or self._truth.mount != mount:
            corrected = self._convention.aberration == "corrected"
            self._truth = OwnAnswerTruth(truth, mount, corrected, self._field_sensor)
        return self._truth


def _looking_at(measured: NDArray[np.float64], truth: SiderealTruth, utc_ns: int) -> Mount:
    """The mount that the answer itself shows, for refraction while the mount is not fitted yet."""
    return mount_of(measured @ truth.icrs_to_horizon(utc_ns).T)
