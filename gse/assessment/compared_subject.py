"""One subject of one session as a comparison takes it: its statistics, and which of its answers were good."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.diagnosis.field_content import FieldContent, field_content
from gse.station.frame_table import STATUSES
from gse.station.own_answers import ERRORS, SensorAnswers
from gse.station.results import Status, Subject
from gse.station.session_data import SessionData
from gse.statistics.counted_frames import false_answers
from gse.statistics.sensor_convention import is_wrong
from gse.statistics.session_statistics import Statistics, sensor_masks, statistics
from gse.statistics.subject_statistics import SubjectStatistics

Pairs = tuple[NDArray[np.int64], NDArray[np.int64]]
"""Rows of the panoramas that are in both sessions."""


@dataclass(frozen=True, slots=True, eq=False)
class ComparedSubject:
    """Masks are over the rows (M,) of the frame table, and so are its ``errors``, in arcsec, by name.

    ``good`` answers were compared with truth and are not false; ``missed`` panoramas have no answer or a false one;
    ``slow`` ones took longer than the limit. ``fields`` is what the stars make of an axis.
    """

    statistics: SubjectStatistics
    utc_ns: NDArray[np.int64]
    errors: dict[str, NDArray[np.float64]]
    good: NDArray[np.bool_]
    missed: NDArray[np.bool_]
    false: NDArray[np.bool_]
    slow: NDArray[np.bool_]
    fields: dict[str, FieldContent]


@dataclass(frozen=True, slots=True, eq=False)
class ComparedSession:
    """The subject of the frame table, and the sensor's own answers beside panoramas; None where it sent none."""

    statistics: Statistics
    table: ComparedSubject
    sensor: ComparedSubject | None

    @classmethod
    def of(cls, session: SessionData) -> "ComparedSession":
        stats, fields = statistics(session), field_content(session)
        return cls(stats, _of_table(session, stats, fields), _of_sensor(session, stats, fields))

    def sensor_said_the_same(self, other: "ComparedSession", pairs: Pairs) -> bool:
        """Whether the sensor's own answers to panoramas that are in both, and their errors, are the same ones."""
        one, two = self.statistics.own, other.statistics.own
        return one is not None and two is not None and all(_same(one, two, name, pairs) for name in _SAID)


_SAID = ("acquired", "latency_ms", *ERRORS)


def _same(one: SensorAnswers, two: SensorAnswers, name: str, pairs: Pairs) -> bool:
    first, second = getattr(one, name)[pairs[0]], getattr(two, name)[pairs[1]]
    return np.array_equal(first.astype(np.float64), second.astype(np.float64), equal_nan=True)


def _of_table(session: SessionData, stats: Statistics, fields: dict[str, FieldContent]) -> ComparedSubject:
    frames = session.frames.columns
    false = false_answers(frames)
    answered = frames["status"] == STATUSES.index(Status.IDENTIFIED)
    return ComparedSubject(
        stats.onboard,
        frames["utc_ns"],
        {name: frames[name] for name in ERRORS},
        np.asarray(np.isfinite(frames["d_de_arcsec"]) & ~false, dtype=bool),
        np.asarray(~(answered & ~false), dtype=bool),
        false,
        np.asarray(frames["elapsed_us"] / 1e3 > session.station.limits.identification_ms, dtype=bool),
        fields,
    )


def _of_sensor(session: SessionData, stats: Statistics, fields: dict[str, FieldContent]) -> ComparedSubject | None:
    own, frames = stats.own, session.frames.columns
    if own is None:
        return None
    false, good = sensor_masks(own, frames, stats.counted)
    if is_wrong(stats.convention, session.station.sensor.attitude):
        false = good = np.zeros(len(frames), dtype=bool)
    return ComparedSubject(
        stats.subjects[Subject.SENSOR],
        frames["utc_ns"],
        {name: getattr(own, name) for name in ERRORS},
        good,
        np.asarray(~(own.acquired & ~false), dtype=bool),
        false,
        np.asarray(own.latency_ms > session.station.limits.identification_ms, dtype=bool),
        fields,
    )
