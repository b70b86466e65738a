"""The plan of a session, row by row: how long it must be for a PASS, and how much longer one that was begun must run.

The plan of a session asks each requirement (gse.verdict.requirements); what is left of a session is the time
after which each of its rows would be decided if its figures stayed as they are. The live view asks the same as
``gse plan``.
"""

import math
from dataclasses import dataclass

import numpy as np

from gse.station.results import Subject, Verdict
from gse.statistics.decision import Outcome, Row
from gse.values.axis import AXES
from gse.values.limits import Limits
from gse.verdict.assessment import Assessment
from gse.verdict.obstacles import NO_SKY_WORDS
from gse.verdict.planning import NEVER, figure_length
from gse.verdict.requirements import REQUIREMENTS, ExpectedSession, Requirement, RowPlan, requirement_of

_AXIS_OF_LIMIT = {axis.column: axis.label for axis in AXES}
"""By the key of a limit along an axis, which both rows of that axis have."""


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
    share = of_subject.available
    left = [item for item in rows_left(assessment) if item.row.subject is subject]
    lengths = _lengths(left)
    if len(lengths) < len(AXES) or any(map(math.isnan, lengths.values())) or not share.of:
        return None
    seen = {name: None if math.isinf(times) else math.ceil(stats.frames * times) for name, times in lengths.items()}
    return session_plan(
        ExpectedSession((), limits, share.value, frames_per_s, frames_per_answer=share.of / share.n_eff, seen=seen)
    )


def _lengths(left: list["RowLeft"]) -> dict[str, float]:
    """How long another session must be, in lengths of this one: by axis (the longer of its two rows), or by row.

    A row with a plan of its own, other than that of an axis, is left to its plan. A row without one needs no more than
    it had where it is decided.
    """
    lengths: dict[str, float] = {}
    for item in left:
        name = _AXIS_OF_LIMIT.get(item.requirement.limit)
        if name is not None:
            lengths[name] = float(np.maximum(figure_length(item.row), lengths.get(name, 0.0)))  # NaN where one is
        elif item.requirement.plan is None:
            will_pass = item.row.outcome is not Outcome.FAIL and item.requirement.keeps(item.row.value, item.row.limit)
            lengths[item.row.name] = 1 + item.times if will_pass else math.inf
    return lengths


@dataclass(frozen=True, slots=True)
class RowLeft:
    """After how many minutes, and further lengths of the session, a row is decided.

    0 where it is, NEVER, or NaN where that cannot be told yet.
    """

    requirement: Requirement
    row: Row
    times: float
    minutes: float


def minutes_left(assessment: Assessment) -> float:
    """Minutes until a session has its verdict if its figures stay: 0, NEVER, or NaN where that cannot be told yet."""
    if assessment.verdict is not Verdict.INCONCLUSIVE:
        return 0.0
    left = [item.minutes for item in rows_left(assessment)]
    if any(map(math.isnan, left)):
        return math.nan
    # What stands against a verdict beside the rows does not go away by itself; the same sky has as little of it.
    return NEVER if lacks_sky(assessment) else max(left, default=0.0) or NEVER


def lacks_sky(assessment: Assessment) -> str:
    """In how many frames there was no sky, in words, where these are too many for a verdict; else empty."""
    found = (NO_SKY_WORDS.match(reason) for reason in assessment.reasons)
    return next((one[0] for one in found if one), "")


def rows_left(assessment: Assessment) -> tuple[RowLeft, ...]:
    """What is left for each row that was tested."""
    stats = assessment.statistics
    tested = [(requirement_of(row), row) for row in assessment.rows if row.outcome is not Outcome.NOT_TESTED]
    left = [(requirement, row, requirement.times_left(row, stats.subjects[row.subject])) for requirement, row in tested]
    return tuple(RowLeft(requirement, row, times, times * stats.judged_s / 60) for requirement, row, times in left)
