"""Errors of the sensor's own answers (ATTITUDE frames) while a session runs, for the live views.

``take`` belongs to the thread of the loop and only copies; ``errors`` pairs the answers with their panoramas and
compares them with truth, on the thread of the view. The report judges all answers again, at the end of the session.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.config.station import Station
from gse.mount import Mount
from gse.station.attitude_error import attitude_errors
from gse.station.attitude_table import OWN_ANSWER
from gse.station.frame_results import FrameResult
from gse.station.own_answers import OwnAnswerTruth, field_of, measured_rotations
from gse.station.results import Subject
from gse.station.session_data import SessionData
from gse.truth import EarthOrientation, truth_of

OWN_ERROR = np.dtype(
    [
        ("utc_ns", "i8"),
        ("d_ra_cosde_arcsec", "f8"),
        ("d_de_arcsec", "f8"),
        ("d_roll_arcsec", "f8"),
        ("latency_ms", "f8"),
    ]
)
"""One row per answer, at the mid-exposure of its panorama. NaN where the sensor has no answer, or there is no truth."""

MOST_WAITING = 1000
"""Panoramas without their answer, and answers without their panorama: more than a minute at 10 Hz."""
QUEUED = 4000
_UNKNOWN = -(1 << 63)
_ERRORS = ("d_ra_cosde_arcsec", "d_de_arcsec", "d_roll_arcsec")


@dataclass(frozen=True, slots=True)
class _Came:
    """A panorama, the answers that came since the one before, and what truth follows from."""

    time_us: int
    frame_no: int
    utc_ns: int
    answers: NDArray[np.void]
    orientation: EarthOrientation | None
    mount: Mount | None


class OwnAnswerErrors:
    """Pairs answers with panoramas as both come; answers from before the mount is fitted are left out."""

    def __init__(self, station: Station) -> None:
        self._station = station
        self._taken = 0
        self._queue: deque[_Came] = deque(maxlen=QUEUED)
        self._panoramas: dict[int, tuple[int, int]] = {}
        self._answers = np.empty(0, OWN_ANSWER)
        self._from: tuple[EarthOrientation | None, Mount | None] = None, None
        self._truth: OwnAnswerTruth | None = None

    def take(self, result: FrameResult, session: SessionData) -> None:
        """Take a panorama and the answers that are new in the session; nothing where the answers are its frames."""
        if session.subject is Subject.SENSOR:
            return
        new = session.sensor_attitudes.columns[self._taken :].copy()
        self._taken += len(new)
        stated, panorama = session.station.mount, result.panorama
        mount = session.alignment.mount if session.alignment else stated if stated.align is None else None
        came = _Came(panorama.time_us, panorama.frame_no, panorama.utc_ns, new, session.earth_orientation, mount)
        self._queue.append(came)

    def errors(self) -> NDArray[np.void]:
        """Rows of OWN_ERROR of the answers that found their panoramas since the last call, in their order."""
        parts = [np.empty(0, OWN_ERROR)]
        while self._queue:
            came = [self._queue.popleft()]
            source = came[0].orientation, came[0].mount
            while self._queue and (self._queue[0].orientation, self._queue[0].mount) == source:
                came.append(self._queue.popleft())
            if source != self._from:
                self._from, self._truth = source, self._truth_of(*source)
            parts.append(self._measured(*self._paired(came)))
        return np.concatenate(parts)

    def _truth_of(self, orientation: EarthOrientation | None, mount: Mount | None) -> OwnAnswerTruth | None:
        truth = truth_of(self._station.site, mount, orientation) if mount else None
        if truth is None or mount is None:
            return None
        sensor = self._station.sensor
        return OwnAnswerTruth(truth, mount, sensor.attitude.aberration == "corrected", field_of(sensor.camera()))

    def _paired(self, came: Sequence[_Came]) -> tuple[NDArray[np.void], NDArray[np.int64]]:
        """Answers (K,) whose panoramas are known, and the UTC (K,) of these; the others wait."""
        if self._truth is not None:
            self._panoramas |= {one.time_us: (one.frame_no, one.utc_ns) for one in came}
        waiting = np.concatenate([self._answers, *(one.answers for one in came)])
        utc_ns = np.array([self._utc_of(row) for row in waiting[["time_us", "frame_no"]].tolist()], dtype=np.int64)
        self._answers = waiting[utc_ns == _UNKNOWN][-MOST_WAITING:]
        for oldest in list(self._panoramas)[: max(0, len(self._panoramas) - MOST_WAITING)]:
            del self._panoramas[oldest]
        return waiting[utc_ns != _UNKNOWN], utc_ns[utc_ns != _UNKNOWN]

    def _utc_of(self, answer: tuple[int, int]) -> int:
        time_us, frame_no = answer
        its_frame_no, utc_ns = self._panoramas.get(time_us, (-1, _UNKNOWN))
        return utc_ns if frame_no in (0, its_frame_no) else _UNKNOWN

    def _measured(self, answers: NDArray[np.void], utc_ns: NDArray[np.int64]) -> NDArray[np.void]:
        rows = np.zeros(len(answers), dtype=OWN_ERROR)
        rows["utc_ns"], rows["latency_ms"] = utc_ns, answers["latency_ms"]
        for name in _ERRORS:
            rows[name] = np.nan
        good = np.flatnonzero(answers["acquired"])
        if len(good) and self._truth is not None:
            measured = measured_rotations(answers[good], utc_ns[good], self._station.sensor.attitude)
            errors = attitude_errors(measured, self._truth.expected(utc_ns[good]))
            for name, values in zip(_ERRORS, errors.T, strict=False):
                rows[name][good] = values
            without_roll = np.isnan(answers["roll_deg"]) & np.isfinite(answers["ra_deg"])
            rows["d_roll_arcsec"][without_roll] = np.nan
        return rows[np.argsort(rows["utc_ns"], kind="stable")]
