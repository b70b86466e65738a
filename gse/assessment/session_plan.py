"""How long a session must be for a PASS, and how much longer one that was begun.

The plan of a session asks each row of the verdict (gse.assessment.planning); what is left of a session is the time
after which each of its rows would be decided if its figures stayed as they are. The live view asks the same as
``gse plan``.
"""

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from gse.assessment.planning import (
    Expected,
    accuracy_frames,
    availability_frames,
    false_answer_frames,
)
from gse.assessment.verdict import SLOW_SHARE, Assessment
from gse.axis import AXES
from gse.limits import Decision, Limits
from gse.station.results import Subject, Verdict
from gse.statistics.axis_statistics import MIN_S
from gse.statistics.decision import Outcome, Row, Share, share_of, share_outcome
from gse.statistics.guard_band import COVERAGE_FACTOR, further_share
from gse.statistics.subject_statistics import SubjectStatistics

NEVER = math.inf
"""Minutes after which a row is decided that no length of session decides."""

_MOST_TIMES = 1_000_000
_HALVINGS = 50


@dataclass(frozen=True, slots=True)
class AxisQuestion:
    """What is expected of one axis, its limit, and the standard uncertainty of truth."""

    name: str
    expected: Expected
    limit_arcsec: float
    truth_arcsec: float


@dataclass(frozen=True, slots=True)
class RowPlan:
    """Frames after which a row of the verdict passes with 90 %; None where no length of session does."""

    name: str
    limit: float
    unit: str
    frames: int | None


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


def session_plan(
    axes: tuple[AxisQuestion, ...],
    limits: Limits,
    *,
    availability: float,
    frames_per_s: float,
    frames_per_answer: float = 1.0,
) -> SessionPlan:
    """Plan a session without false answers; answers come and fail in runs of ``frames_per_answer`` frames.

    No axis has bounds before MIN_S.
    """
    least = math.ceil(MIN_S * frames_per_s) + 1
    rows = []
    for axis in axes:
        frames = _frames_of(axis.expected, axis.limit_arcsec, axis.truth_arcsec)
        rows.append(RowPlan(axis.name, axis.limit_arcsec, "arcsec", None if frames is None else max(frames, least)))
    answered = availability_frames(availability, limits.availability, frames_per_value=frames_per_answer)
    rows.append(RowPlan("availability", limits.availability, "", answered))
    rows.append(RowPlan("false answers", limits.false_share, "", false_answer_frames(limits.false_share)))
    return SessionPlan(tuple(rows), frames_per_s)


@functools.lru_cache(maxsize=16)
def _frames_of(expected: Expected, limit_arcsec: float, truth_arcsec: float) -> int | None:
    """Both axes on the sky are often asked the same, and it takes seconds."""
    return accuracy_frames(expected, limit_arcsec, truth_arcsec=truth_arcsec)


def plan_like(assessment: Assessment, subject: Subject, limits: Limits) -> SessionPlan | None:
    """The plan of another session like one that was judged.

    None where that one says too little of noise, correlation or answers.
    """
    stats = assessment.statistics
    of_subject = stats.subjects[subject]
    if stats.duration_s <= 0:
        return None
    frames_per_s = (stats.frames - 1) / stats.duration_s
    axes = tuple(_questions(assessment, of_subject, frames_per_s))
    share = of_subject.available
    if len(axes) < len(AXES) or not share.of:
        return None
    return session_plan(
        axes,
        limits,
        availability=share.value,
        frames_per_s=frames_per_s,
        frames_per_answer=share.of / share.n_eff,
    )


def _questions(assessment: Assessment, subject: SubjectStatistics, frames_per_s: float) -> Iterator[AxisQuestion]:
    rows = {row.name: row for row in assessment.rows if row.subject is subject.subject}
    for axis in AXES:
        figures, row = subject.axes[axis.key], rows[f"95 % of |{axis.label}|"]
        values = (figures.bias_arcsec, figures.std_arcsec, figures.tau_s)
        if all(map(math.isfinite, values)) and math.isfinite(row.truth_uncertainty):
            yield AxisQuestion(axis.label, Expected(*values, frames_per_s), row.limit, row.truth_uncertainty)


@dataclass(frozen=True, slots=True)
class RowLeft:
    """Minutes after which a row of a session is decided: 0 where it is, NEVER, or NaN where that cannot be told yet."""

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
    tested = [row for row in assessment.rows if row.outcome is not Outcome.NOT_TESTED]
    return tuple(RowLeft(row, minutes * _times_left(row, stats.subjects[row.subject])) for row in tested)


def _times_left(row: Row, subject: SubjectStatistics) -> float:
    """Further lengths of the session."""
    if row.outcome is not Outcome.INCONCLUSIVE:
        return 0.0
    if row.unit == "arcsec":
        return _figure_times(row)
    if row.name == "availability":
        return _share_times(subject.available, row.limit, at_least=True)
    if row.name == "false answers":
        return _share_times(subject.false_answers, row.limit, at_least=False)
    return _share_times(subject.slow, SLOW_SHARE, at_least=False)


def _figure_times(row: Row) -> float:
    if math.isnan(row.uncertainty):
        return math.nan
    sampling = math.sqrt(max(row.uncertainty**2 - (COVERAGE_FACTOR * row.truth_uncertainty) ** 2, 0.0))
    return further_share(row.limit - row.value, sampling, row.truth_uncertainty, row.n_eff)


def _share_times(share: Share, limit: float, *, at_least: bool) -> float:
    """By bisection: the bounds of a share come closer to it with every frame."""

    def is_decided(times: float) -> bool:
        longer = share_of(share.count * _MOST_TIMES, share.of * _MOST_TIMES, share.n_eff * times)
        outcome = share_outcome(longer, limit, at_least=at_least, decision=Decision.GUARDED)
        return outcome is not Outcome.INCONCLUSIVE

    return _first(is_decided) - 1 if is_decided(_MOST_TIMES) else NEVER


def _first(is_so: Callable[[float], bool]) -> float:
    low, high = 1.0, float(_MOST_TIMES)
    for _ in range(_HALVINGS):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if is_so(middle) else (middle, high)
    return high
