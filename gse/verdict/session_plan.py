"""How long a session must be for a PASS, and how much longer one that was begun.

The plan of a session asks each requirement (gse.verdict.requirements); what is left of a session is the time
after which each of its rows would be decided if its figures stayed as they are. The live view asks the same as
``gse plan``.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from gse.station.results import Subject, Verdict
from gse.statistics.decision import Outcome, Row
from gse.statistics.session_statistics import Statistics
from gse.statistics.subject_statistics import SubjectStatistics
from gse.values.axis import AXES
from gse.values.limits import Limits
from gse.verdict.assessment import Assessment
from gse.verdict.planning import NEVER, Expected
from gse.verdict.requirements import (
    REQUIREMENTS,
    AxisQuestion,
    Case,
    ExpectedSession,
    Requirement,
    RowPlan,
    requirement_of,
)


@dataclass(frozen=True, slots=True)
class SessionPlan:
    """The plan of a session, by rows."""

    rows: tuple[RowPlan, ...]
    frames_per_s: float

    @property
    def frames(self) -> int | None:
        """Frames of the session; None where a row cannot pass."""
        counts = [row.frames for row in self.rows]
        known = [count for count in counts if count is not None]
        return max(known) if len(known) == len(counts) and known else None

    def minutes(self, frames: int | None) -> float | None:
        """How long so many frames take."""
        return None if frames is None else frames / self.frames_per_s / 60


def session_plan(expected: ExpectedSession) -> SessionPlan:
    """Plan a session without false answers."""
    rows = dict.fromkeys(row for requirement in REQUIREMENTS if (row := requirement.planned(expected)))
    return SessionPlan(tuple(rows), expected.frames_per_s)


def plan_like(assessment: Assessment, subject: Subject, limits: Limits) -> SessionPlan | None:
    """The plan of another session like one that was judged.

    None where that one says too little of noise, correlation or answers.
    """
    stats = assessment.statistics
    of_subject = stats.subjects[subject]
    if stats.duration_s <= 0:
        return None
    frames_per_s = (stats.frames - 1) / stats.duration_s
    axes = tuple(_questions(assessment, of_subject, limits, frames_per_s))
    share = of_subject.available
    if len(axes) < len(AXES) or not share.of:
        return None
    left = [item for item in rows_left(assessment) if item.row.subject is subject and item.requirement.plan is None]
    if any(math.isnan(item.minutes) for item in left):
        return None
    seen = {item.row.name: _frames_for(item, stats) for item in left}
    return session_plan(
        ExpectedSession(axes, limits, share.value, frames_per_s, frames_per_answer=share.of / share.n_eff, seen=seen)
    )


def _frames_for(item: "RowLeft", stats: Statistics) -> int | None:
    """Frames after which a row like that passes, which are no more than it had where it does."""
    will_pass = item.row.outcome is not Outcome.FAIL and item.requirement.keeps(item.row.value, item.row.limit)
    if not will_pass or item.minutes == NEVER:
        return None
    return math.ceil(stats.frames * (1 + item.minutes * 60 / stats.duration_s))


def _questions(
    assessment: Assessment, subject: SubjectStatistics, limits: Limits, frames_per_s: float
) -> Iterator[AxisQuestion]:
    case = Case(subject, assessment.statistics, assessment.budget, limits, relative=False)
    for axis in AXES:
        figures, truth_arcsec = subject.axes[axis.key], case.truth_standard((axis,))
        values = (figures.bias_arcsec, figures.std_arcsec, figures.tau_s)
        if all(map(math.isfinite, values)) and math.isfinite(truth_arcsec):
            yield AxisQuestion(axis, Expected(*values, frames_per_s), limits.of(axis), truth_arcsec)


@dataclass(frozen=True, slots=True)
class RowLeft:
    """Minutes after which a row of a session is decided: 0 where it is, NEVER, or NaN where that cannot be told yet."""

    requirement: Requirement
    row: Row
    minutes: float


def minutes_left(assessment: Assessment) -> float:
    """Minutes until a session has its verdict if its figures stay: 0, NEVER, or NaN where that cannot be told yet."""
    if assessment.verdict is not Verdict.INCONCLUSIVE:
        return 0.0
    left = [item.minutes for item in rows_left(assessment)]
    if any(map(math.isnan, left)):
        return math.nan
    # What stands against a verdict beside the rows does not go away by itself.
    return max(left, default=0.0) or NEVER


def rows_left(assessment: Assessment) -> tuple[RowLeft, ...]:
    """What is left for each row that was tested."""
    stats = assessment.statistics
    minutes = stats.duration_s / 60
    tested = [(requirement_of(row), row) for row in assessment.rows if row.outcome is not Outcome.NOT_TESTED]
    return tuple(
        RowLeft(requirement, row, minutes * requirement.times_left(row, stats.subjects[row.subject]))
        for requirement, row in tested
    )
