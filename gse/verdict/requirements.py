"""What a session is asked: the one table of the rows of the verdict, in the order of a report.

An entry says all that is known of its row: whose figure it is and how it is taken, the key of its limit and its unit,
by which rule it is decided, what a FAIL claims of the sensor (which says what may excuse it), how a session is planned
for it, how two sessions are compared by it, and its line of documentation. Whoever needs a row asks its entry: verdict,
forecast, ``gse plan``, ``gse compare``, the decision of a campaign, docs/metrics.md. Report, JUnit and tables show what
rows there are. So one more row is one more entry here, and one more field of gse.values.limits.Limits where its limit
is new.

The rule itself, one for figures and one for shares, is in gse.statistics.decision.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from gse.station.housekeeping import ItemSummary
from gse.station.results import Subject
from gse.statistics.axis_statistics import MIN_S
from gse.statistics.decision import (
    COVERAGE_FACTOR,
    Claim,
    Criterion,
    Figure,
    Outcome,
    Row,
    Share,
    how_long,
    judge_figure,
    judge_share,
    share_of,
    share_times,
)
from gse.statistics.sampling import MIN_FRAMES, NO_BOUNDS, Bounds
from gse.statistics.session_statistics import PowerUse, RateError, Statistics
from gse.statistics.subject_statistics import SubjectStatistics, figure_of
from gse.statistics.truth_budget import TruthUncertaintyBudget
from gse.values.axis import AXES, CROSS_X, CROSS_Y, D_DE, D_RA_COSDE, D_ROLL, ON_SKY, Axis
from gse.values.constants import ARCSEC_PER_RAD, EARTH_RATE_ARCSEC_PER_S
from gse.values.limits import Limits
from gse.values.text import percent
from gse.verdict.compared_rows import (
    Bounded,
    CompareRows,
    SideBySide,
    along,
    bounded_row,
    false_answers,
    good_answers,
    not_compared,
    slow_answers,
)
from gse.verdict.compared_rows import ComparedRow as ComparedRow
from gse.verdict.planning import (
    Expected,
    accuracy_frames,
    availability_frames,
    false_answer_frames,
    figure_times,
)

SLOW_SHARE = 0.01
"""99 % of the frames must keep the limit of time."""


@dataclass(frozen=True, slots=True)
class Case:
    """One subject of a session, with all that its rows are made from.

    ``relative`` where the mount was fitted on the same sky. ``slew`` are the subject's steps of a scene that turned at
    several rates, ``items`` those of the sensor's housekeeping.
    """

    subject: SubjectStatistics
    statistics: Statistics
    budget: TruthUncertaintyBudget
    limits: Limits
    relative: bool
    slew: tuple["SlewStep", ...] = ()
    items: Mapping[str, ItemSummary] = dataclasses.field(default_factory=dict)

    def truth_standard(self, axes: tuple[Axis, ...]) -> float:
        """The standard uncertainty whose 1.645-fold is the one-sided 95 % bound of truth, whatever its distribution."""
        truth = self.budget.own_axes if self.subject.subject is Subject.SENSOR else self.budget.axes
        return math.hypot(*(truth[axis.key].one_sided_arcsec / COVERAGE_FACTOR for axis in axes))


@dataclass(frozen=True, slots=True)
class ByBounds:
    """A figure that must not exceed its limit: decided by its sampling bounds, and by truth's along some axes.

    A figure of answers alone has no ``truth``.
    """

    figure: Callable[[SubjectStatistics, float], Figure]
    truth: tuple[Axis, ...] = ()

    def row(self, asked: Criterion, case: Case) -> Row:
        """The row of one subject."""
        return judge_figure(
            asked,
            self.figure(case.subject, case.statistics.judged_s),
            truth_uncertainty=case.truth_standard(self.truth),
            relative=case.relative,
        )

    def times_left(self, row: Row, subject: SubjectStatistics) -> float:
        """Further lengths of the session after which an undecided row is decided."""
        return figure_times(row)

    def bounded(self, subject: SubjectStatistics) -> Bounded:
        """The value and its bounds."""
        figure = self.figure(subject, math.nan)
        return Bounded(figure.value, figure.bounds.lower, figure.bounds.upper)


@dataclass(frozen=True, slots=True)
class ByShare:
    """A share of frames that must not exceed its limit, or must reach it (``at_least``): decided by its exact bounds.

    ``column`` is the name of the share in the tables of a data set; ``beside`` and ``events`` join the reason.
    """

    share: Callable[[SubjectStatistics], Share]
    column: str
    at_least: bool = False
    beside: Callable[[Case], str] = lambda _: ""
    events: Callable[[Case], str] = lambda _: ""

    def row(self, asked: Criterion, case: Case) -> Row:
        """The row of one subject."""
        words = {"beside": self.beside(case), "events": self.events(case)}
        return judge_share(asked, self.share(case.subject), at_least=self.at_least, **words)

    def times_left(self, row: Row, subject: SubjectStatistics) -> float:
        """Further lengths of the session after which an undecided row is decided."""
        return share_times(self.share(subject), row.limit, at_least=self.at_least)

    def bounded(self, subject: SubjectStatistics) -> Bounded:
        """The value and its bounds."""
        share = self.share(subject)
        return Bounded(share.value, share.lower, share.upper)


@dataclass(frozen=True, slots=True)
class BySlowShare:
    """A time that 99 % of the frames must keep: the share of the slower ones decides, the 99th percentile is shown."""

    def row(self, asked: Criterion, case: Case) -> Row:
        """The row of one subject."""
        subject = case.subject
        row = judge_share(dataclasses.replace(asked, limit=SLOW_SHARE, unit=""), subject.slow, at_least=False)
        reason = row.reason
        undecided = row.outcome is Outcome.INCONCLUSIVE
        if row.outcome is Outcome.FAIL or undecided:
            reason = f"{row.label} is {subject.time_ms.p99:.1f} ms, the limit is {asked.limit:g} ms"
            reason += f" ({subject.slow.count} of {subject.slow.of} frames are slower"
            shows = f", which shows at most {percent(subject.slow.upper, 1)}: "
            shows += f"{how_long(subject.slow, SLOW_SHARE, at_least=False)})"
            reason += shows if undecided else ")"
        return dataclasses.replace(
            row, value=subject.time_ms.p99, unit=asked.unit, limit=asked.limit, reason=reason, uncertainty=math.nan
        )

    def times_left(self, row: Row, subject: SubjectStatistics) -> float:
        """Further lengths of the session after which an undecided row is decided."""
        return share_times(subject.slow, SLOW_SHARE, at_least=False)

    def bounded(self, subject: SubjectStatistics) -> Bounded:
        """The 99th percentile, whose bounds nobody asks for."""
        return Bounded(subject.time_ms.p99, math.nan, math.nan)


RATE_TOLERANCE = 1e-3
"""A rate so little below its limit keeps it: clocks are not exact, and a limit is written with few digits."""


@dataclass(frozen=True, slots=True)
class ByValue:
    """A value that is counted, not estimated, and so is decided without an uncertainty.

    It must not exceed its limit, or must reach it (``at_least``). NaN is not tested, infinity is what never happened.
    """

    value: Callable[[SubjectStatistics], float]
    at_least: bool = False

    def row(self, asked: Criterion, case: Case) -> Row:
        """The row of one subject."""
        value, limit = self.value(case.subject), asked.limit
        row = Row(asked.subject, asked.name, value, asked.unit, limit, Outcome.PASS)
        if math.isnan(value):
            return dataclasses.replace(row, outcome=Outcome.NOT_TESTED, reason=f"{asked.label}: too few frames to tell")
        if value >= limit * (1 - RATE_TOLERANCE) if self.at_least else value <= limit:
            return row
        seen = f"is {value:.4g} {asked.unit}" if math.isfinite(value) else "never came"
        return dataclasses.replace(
            row, outcome=Outcome.FAIL, reason=f"{asked.label} {seen}, the limit is {limit:g} {asked.unit}"
        )

    def times_left(self, row: Row, subject: SubjectStatistics) -> float:
        """Not known: it is decided, and only what excuses a FAIL leaves it open."""
        return math.nan

    def bounded(self, subject: SubjectStatistics) -> Bounded:
        """The value, which has no bounds."""
        return Bounded(self.value(subject), math.nan, math.nan)


@dataclass(frozen=True, slots=True)
class SlewStep:
    """The frames of a subject while the scene turned at one rate: their statistics, and the core rows of these."""

    rate_deg_per_s: float
    frames: int
    subject: SubjectStatistics
    rows: tuple[Row, ...]

    @property
    def outcome(self) -> Outcome:
        """PASS where all of its rows pass; FAIL where one fails."""
        outcomes = {row.outcome for row in self.rows}
        if Outcome.FAIL in outcomes:
            return Outcome.FAIL
        return Outcome.PASS if outcomes == {Outcome.PASS} else Outcome.INCONCLUSIVE


class _OfSession:
    """What belongs to a session and not to one of its subjects: no greater length decides it, nothing is compared."""

    __slots__ = ()

    def times_left(self, row: Row, subject: SubjectStatistics) -> float:
        """Not known."""
        return math.nan

    def bounded(self, subject: SubjectStatistics) -> Bounded:
        """Not known of a subject alone."""
        return Bounded(math.nan, math.nan, math.nan)


@dataclass(frozen=True, slots=True)
class BySlewSteps(_OfSession):
    """The highest rate up to which every step keeps its limits, which must reach a limit."""

    def row(self, asked: Criterion, case: Case) -> Row:
        """The row of one subject."""
        kept, bad = math.nan, None
        for step in case.slew:
            if step.outcome is not Outcome.PASS:
                bad = step
                break
            kept = step.rate_deg_per_s
        row = Row(asked.subject, asked.name, kept, asked.unit, asked.limit, Outcome.PASS)
        if not case.slew:
            tries = f"no scene turned at several rates; test it with: gse run --rates 0,{asked.limit:g}deg/s"
            return dataclasses.replace(row, outcome=Outcome.NOT_TESTED, reason=f"{asked.label}: {tries}")
        if kept >= asked.limit * (1 - RATE_TOLERANCE):
            return row
        if bad is not None and bad.rate_deg_per_s <= asked.limit * (1 + RATE_TOLERANCE):
            why = next(one.reason for one in bad.rows if one.outcome is bad.outcome)
            reason = f"{asked.label}: at {bad.rate_deg_per_s:g} {asked.unit}, {why}"
            return dataclasses.replace(row, outcome=bad.outcome, reason=reason)
        reason = f"{asked.label}: {kept:g} {asked.unit} is shown; add a step at the limit of {asked.limit:g} to --rates"
        return dataclasses.replace(row, outcome=Outcome.INCONCLUSIVE, reason=reason)


@dataclass(frozen=True, slots=True)
class ByCurrent(_OfSession):
    """A current of the supply, which belongs to the session and not to one of its subjects."""

    current: Callable[[PowerUse], float]

    def row(self, asked: Criterion, case: Case) -> Row:
        """The row, the same below each subject."""
        return ByValue(lambda _: self.current(case.statistics.power)).row(asked, case)


@dataclass(frozen=True, slots=True)
class ByRate(_OfSession):
    """The largest figure of the rates about the axes, which belong to the session, decided by its sampling bounds.

    Truth is the Earth's rate: an error of the mount along some axes puts as large a part of it on others. Scatter has
    no ``truth``.
    """

    size: Callable[[RateError], tuple[float, Bounds]]
    truth: tuple[Axis, ...] = ()

    def row(self, asked: Criterion, case: Case) -> Row:
        """The row, the same below each subject but for what is known of its truth."""
        rates = case.statistics.rates
        sizes = [self.size(rate) for rate in rates]
        value = max((size for size, _ in sizes), default=math.nan)
        lower, upper = (max((getattr(of, end) for _, of in sizes), default=math.nan) for end in ("lower", "upper"))
        bounds = NO_BOUNDS if any(math.isnan(of.upper) for _, of in sizes) else Bounds(lower=lower, upper=upper)
        n_eff, values = (min((getattr(rate, of) for rate in rates), default=0) for of in ("n_eff", "values"))
        figure = Figure(value, bounds, n_eff, values, case.statistics.judged_s)
        truth = EARTH_RATE_ARCSEC_PER_S * case.truth_standard(self.truth) / ARCSEC_PER_RAD
        return judge_figure(asked, figure, truth_uncertainty=truth, relative=case.relative)

    def times_left(self, row: Row, subject: SubjectStatistics) -> float:
        """Further lengths of the session after which an undecided row is decided."""
        return figure_times(row)


@dataclass(frozen=True, slots=True)
class ByNames(_OfSession):
    """The share of the sensor's lists of stars in which a name is wrong, decided by its exact bounds."""

    def row(self, asked: Criterion, case: Case) -> Row:
        """The row, the same below each subject."""
        names = case.statistics.names
        share = share_of(names.wrong_lists, names.known_lists) if names else share_of(0, 0)
        return judge_share(asked, share, at_least=False)


def _bias(rate: RateError) -> tuple[float, Bounds]:
    bias, of = rate.bias_arcsec_per_s, rate.bias_bounds_arcsec_per_s
    return abs(bias), Bounds(lower=max(abs(bias) - (bias - of.lower), 0.0), upper=abs(bias) + (of.upper - bias))


def _noise(rate: RateError) -> tuple[float, Bounds]:
    return rate.noise_arcsec_per_s, rate.noise_bounds_arcsec_per_s


@dataclass(frozen=True, slots=True)
class AxisQuestion:
    """What is expected along one axis, its limit, and the standard uncertainty of truth."""

    axis: Axis
    expected: Expected
    limit_arcsec: float
    truth_arcsec: float


@dataclass(frozen=True, slots=True)
class ExpectedSession:
    """What a session is planned from: answers come and fail in runs of ``frames_per_answer`` frames.

    ``seen`` are the frames after which rows of a session like one that was judged pass, by the name of the row or of
    its axis; None where they never do.
    """

    axes: tuple[AxisQuestion, ...]
    limits: Limits
    availability: float
    frames_per_s: float
    frames_per_answer: float = 1.0
    seen: Mapping[str, int | None] = dataclasses.field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class RowPlan:
    """Frames after which a row of the verdict passes with 90 %; None where no length of session does."""

    name: str
    limit: float
    unit: str
    frames: int | None


Plan = Callable[[ExpectedSession], RowPlan | None]


def both_rows_of(axis: Axis) -> Plan:
    """Mean and 95 % of one axis, which one simulated session must pass together; no axis has bounds before MIN_S."""

    def plan(session: ExpectedSession) -> RowPlan | None:
        asked = next((one for one in session.axes if one.axis == axis), None)
        if asked is not None:
            frames = _frames_of(asked.expected, asked.limit_arcsec, asked.truth_arcsec)
        elif axis.label in session.seen:
            frames = session.seen[axis.label]
        else:
            return None
        limit = session.limits.of(axis) if asked is None else asked.limit_arcsec
        least = max(math.ceil(MIN_S * session.frames_per_s) + 1, MIN_FRAMES)
        return RowPlan(axis.label, limit, axis.unit, None if frames is None else max(frames, least))

    return plan


@functools.lru_cache(maxsize=16)
def _frames_of(expected: Expected, limit_arcsec: float, truth_arcsec: float) -> int | None:
    """Both axes on the sky are often asked the same, and it takes seconds."""
    return accuracy_frames(expected, limit_arcsec, truth_arcsec=truth_arcsec)


def _answered(session: ExpectedSession) -> RowPlan:
    limit = session.limits.availability
    frames = availability_frames(session.availability, limit, frames_per_value=session.frames_per_answer)
    return RowPlan(AVAILABILITY.name, limit, AVAILABILITY.unit, frames)


def _none_false(session: ExpectedSession) -> RowPlan:
    limit = session.limits.false_share
    return RowPlan(FALSE_ANSWERS.name, limit, FALSE_ANSWERS.unit, false_answer_frames(limit))


def not_planned(_: ExpectedSession) -> None:
    """The plan of a row that needs no more frames than the others do."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Requirement:
    """One row of the verdict.

    ``limit`` is the key of its limit in Limits. Without a limit it is not tested; an ``only_asked`` row is not there
    then, nor is a row of a subject to which it does not apply (``applies``). ``claim`` is what a FAIL says of the
    sensor. PASS needs the ``core`` rows of one subject. Without a ``plan`` of its own it is planned from a session that
    was judged; without ``compared`` two sessions are compared by its bounds. ``says`` is the line of its documentation.
    """

    name: str
    limit: str
    unit: str = ""
    claim: Claim
    decided: "ByBounds | ByShare | BySlowShare | ByValue | BySlewSteps | ByCurrent | ByRate | ByNames | ByItem"
    says: str
    applies: Callable[[SubjectStatistics], bool] = lambda _: True
    core: bool = False
    only_asked: bool = False
    plan: Plan | None = None
    compared: CompareRows | None = None

    def limit_of(self, limits: Limits) -> float:
        """The limit; NaN where none is stated."""
        value = getattr(limits, self.limit)
        return math.nan if value is None else float(value)

    def is_there(self, subject: SubjectStatistics, limits: Limits) -> bool:
        """Whether a subject has this row."""
        return self.applies(subject) and not (self.only_asked and math.isnan(self.limit_of(limits)))

    def keeps(self, value: float, limit: float) -> bool:
        """Whether a value is on the right side of a limit, its uncertainty aside."""
        return value >= limit if self.at_least else value <= limit

    def row(self, case: Case) -> Row:
        """The row of one subject of a session."""
        limits = case.limits
        return self.decided.row(
            Criterion(case.subject.subject, self.name, self.limit_of(limits), limits.decision, self.unit), case
        )

    def times_left(self, row: Row, subject: SubjectStatistics) -> float:
        """Further lengths of the session after which its row is decided; 0 where it is."""
        return self.decided.times_left(row, subject) if row.outcome is Outcome.INCONCLUSIVE else 0.0

    def planned(self, session: ExpectedSession) -> RowPlan | None:
        """How long a session must be for it; None where that is no question, or cannot be told."""
        if self.plan is not None:
            return self.plan(session)
        if self.name not in session.seen:
            return None
        return RowPlan(self.name, self.limit_of(session.limits), self.unit, session.seen[self.name])

    def compare(self, both: SideBySide) -> Iterator[ComparedRow]:
        """Its rows of a comparison of two sessions."""
        if self.compared is not None:
            yield from self.compared(both)
            return
        limit = self.limit_of(both.limits)
        if not math.isnan(limit):
            one, two = (self.decided.bounded(subject.statistics) for subject in both.subjects)
            row = bounded_row(self.name, self.unit, one, two, both=both, allowed=both.allowed_share * limit)
            yield dataclasses.replace(row, at_least=self.at_least)

    @property
    def at_least(self) -> bool:
        """Whether the limit is the lowest value that passes; else it is the highest."""
        if isinstance(self.decided, BySlewSteps):
            return True
        return isinstance(self.decided, (ByShare, ByValue)) and self.decided.at_least

    @property
    def is_error(self) -> bool:
        """Whether its figure is an error of the answers against truth, which has no value where none was compared."""
        return isinstance(self.decided, ByBounds) and bool(self.decided.truth)

    @property
    def share_column(self) -> str | None:
        """The name of its share in the tables of a data set; None of a figure."""
        return self.decided.column if isinstance(self.decided, ByShare) else None


def _of_axis(
    axis: Axis, *, core: bool = False, compared: CompareRows = not_compared
) -> tuple["Requirement", "Requirement"]:
    """Mean and 95 % along an axis, against one limit. A comparison of the first speaks for both."""

    def entry(name: str, which: str, says: str, compared: CompareRows) -> Requirement:
        return Requirement(
            name=name,
            limit=axis.column,
            unit=axis.unit,
            claim=Claim.ACCURACY,
            decided=ByBounds(lambda subject, s: figure_of(subject.axes[axis.key], which, s), truth=(axis,)),
            says=says,
            core=core,
            plan=both_rows_of(axis),
            compared=compared,
        )

    label = axis.label
    return (
        entry(f"mean |{label}|", "mean_abs", f"mean of the absolute error in {label}", compared),
        entry(f"95 % of |{label}|", "p95_abs", f"absolute error in {label} that 95 % of the frames keep", not_compared),
    )


_NO_FIGURE = Figure(math.nan, NO_BOUNDS, math.nan, 0, math.nan)
"""What a session has whose own station file states no limit along the sensor's axes."""


def _at_confidence(axis: Axis, name: str, limit: str, *, truth: tuple[Axis, ...], along: str) -> Requirement:
    """The error along an axis of the sensor that a stated share of the frames keeps."""

    def figure(subject: SubjectStatistics, duration_s: float) -> Figure:
        return dataclasses.replace(subject.at_confidence.get(axis.key, _NO_FIGURE), duration_s=duration_s)

    return Requirement(
        name=name,
        limit=limit,
        unit=axis.unit,
        claim=Claim.ACCURACY,
        decided=ByBounds(figure, truth=truth),
        says=f"absolute error {along} that the share `limits.confidence` of the frames keeps, by order statistics",
        only_asked=True,
    )


def _slowest_fix_s(subject: SubjectStatistics) -> float:
    """The longest of all starts; infinite where a start had none."""
    fixes = subject.first_fixes_s
    return max(math.inf if math.isnan(one) else one for one in fixes) if fixes else math.nan


def _lost(case: Case) -> str:
    lost = case.statistics.frames_expected - int(case.statistics.counted.expected.sum())
    return f", {lost} of which never came" if lost else ""


def _outages(case: Case) -> str:
    """The outages where they make most of what is missing."""
    outages, available = case.subject.outages, case.subject.available
    return str(outages) if 2 * outages.frames > available.of - available.count else ""


def _star_fields(case: Case) -> str:
    count = case.subject.star_fields
    return f" in {count} star field{'' if count == 1 else 's'}" if count else ""


AVAILABILITY = Requirement(
    name="availability",
    limit="availability",
    claim=Claim.ABSENCE,
    decided=ByShare(lambda subject: subject.available, "available", at_least=True, beside=_lost, events=_outages),
    says="share of the expected frames with an answer that is not false, at least",
    core=True,
    plan=_answered,
    compared=good_answers,
)
FALSE_ANSWERS = Requirement(
    name="false answers",
    limit="false_share",
    claim=Claim.FALSEHOOD,
    decided=ByShare(lambda subject: subject.false_answers, "false_answers", beside=_star_fields),
    says="share of the answers that name other stars than the reference identifier, or lie more than "
    "`limits.false_arcsec` from where it looks (from truth, where it has no answer)",
    core=True,
    plan=_none_false,
    compared=false_answers,
)
STATED_TIME = Requirement(
    name="processing time as it states, 99 %",
    limit="identification_ms",
    unit="ms",
    claim=Claim.SLOWNESS,
    decided=BySlowShare(),
    says="processing time that the sensor, or an external identifier, states by its own clock, of 99 % of the frames",
    applies=lambda subject: subject.time_is_stated,
    plan=not_planned,
    compared=slow_answers,
)
HOST_TIME = Requirement(
    name="identification time on this host, 99 %",
    limit="identification_ms",
    unit="ms",
    claim=Claim.SLOWNESS,
    decided=BySlowShare(),
    says="the same of an identifier that runs here, by this computer's clock: it says as much of the computer",
    applies=lambda subject: not subject.time_is_stated,
    plan=not_planned,
    compared=not_compared,
)

_only_asked = functools.partial(Requirement, only_asked=True, plan=not_planned, compared=not_compared)
"""A row that is there only where its limit is stated, and for which no length of a session can be planned."""

REQUIREMENTS = (
    *_of_axis(D_RA_COSDE, core=True, compared=along(D_RA_COSDE)),
    *_of_axis(D_DE, core=True, compared=along(D_DE)),
    *_of_axis(D_ROLL),
    Requirement(
        name="half-cone of 95 % of the boresights",
        limit="boresight_arcsec",
        unit="arcsec",
        claim=Claim.ACCURACY,
        decided=ByBounds(lambda subject, s: figure_of(subject.half_cone_95, "p95_abs", s), truth=ON_SKY),
        says="angle about the true boresight that holds 95 % of the measured ones",
    ),
    # However the sensor is rolled, truth is known along its x and y at least as well as by both axes of the sky.
    _at_confidence(CROSS_X, "|x| at its confidence", "x_arcsec", truth=ON_SKY, along="along the sensor's columns"),
    _at_confidence(CROSS_Y, "|y| at its confidence", "y_arcsec", truth=ON_SKY, along="along the sensor's rows"),
    _at_confidence(
        D_ROLL, "|about| at its confidence", "about_arcsec", truth=(D_ROLL,), along="about the sensor's boresight"
    ),
    AVAILABILITY,
    FALSE_ANSWERS,
    STATED_TIME,
    HOST_TIME,
    _only_asked(
        name="output rate",
        limit="output_rate_hz",
        unit="Hz",
        claim=Claim.SLOWNESS,
        decided=ByValue(lambda subject: subject.output_rate_hz, at_least=True),
        says="frames of the sensor in a second, by their exposures and without gaps, at least (to 0.1 %)",
    ),
    _only_asked(
        name="first fix",
        limit="first_fix_s",
        unit="s",
        claim=Claim.ABSENCE,
        decided=ByValue(_slowest_fix_s),
        says="from the first frame of a start of the sensor to its first answer that is not false: the longest of all",
    ),
    _only_asked(
        name="slew rate",
        limit="slew_deg_per_s",
        unit="deg/s",
        claim=Claim.ACCURACY,
        decided=BySlewSteps(),
        says="the highest rate of turn up to which errors, availability and false answers keep their limits, at least",
    ),
    _only_asked(
        name="mean current",
        limit="mean_current_a",
        unit="A",
        claim=Claim.CURRENT,
        decided=ByCurrent(lambda use: use.mean_a),
        says="mean current of the supply while the sensor is on, without `power.settle_s` after it is switched on",
    ),
    _only_asked(
        name="inrush current",
        limit="inrush_current_a",
        unit="A",
        claim=Claim.CURRENT,
        decided=ByCurrent(lambda use: use.inrush_a),
        says="greatest current of the supply within `power.settle_s` after it is switched on, as often as it is read",
    ),
    _only_asked(
        name="rate bias",
        limit="rate_bias_arcsec_per_s",
        unit="arcsec/s",
        claim=Claim.ACCURACY,
        decided=ByRate(_bias, truth=AXES),
        says="mean error of the rate that the sensor states about an axis, against the Earth's: the largest of all",
    ),
    _only_asked(
        name="rate noise",
        limit="rate_noise_arcsec_per_s",
        unit="arcsec/s",
        claim=Claim.ACCURACY,
        decided=ByRate(_noise),
        says="standard deviation of the rate that the sensor states about an axis: the largest of all",
    ),
    _only_asked(
        name="wrong star names",
        limit="wrong_names_share",
        claim=Claim.FALSEHOOD,
        decided=ByNames(),
        says="the frames whose STARS message gives an object the name of another star than its panorama shows",
    ),
)

_BY_NAME = {requirement.name: requirement for requirement in REQUIREMENTS}


# Rows of the sensor's housekeeping: two of each item with limits, which no table can name beforehand.

_LOWEST, _HIGHEST = ", lowest", ", highest"


@dataclass(frozen=True, slots=True)
class ByItem(_OfSession):
    """The lowest value of an item must reach its limit (``at_least``), or the highest must not exceed it."""

    item: str
    at_least: bool

    def row(self, asked: Criterion, case: Case) -> Row:
        """The row, of values that are the sensor's own: whether they are right is not asked."""
        summary = case.items.get(self.item)
        row = Row(asked.subject, asked.name, math.nan, asked.unit, asked.limit, Outcome.PASS)
        if summary is None:
            return dataclasses.replace(row, outcome=Outcome.INCONCLUSIVE, reason=f"{self.item}: no value of it came")
        value = summary.least if self.at_least else summary.largest
        row = dataclasses.replace(row, value=value)
        if value >= asked.limit if self.at_least else value <= asked.limit:
            return row
        word = "lowest" if self.at_least else "highest"
        reason = f"{self.item} is {value:.6g} {asked.unit}, its {word} value, the limit is {asked.limit:g} {asked.unit}"
        return dataclasses.replace(row, outcome=Outcome.FAIL, reason=reason)


@dataclass(frozen=True, slots=True, kw_only=True)
class ItemRequirement(Requirement):
    """One end of the limits of an item, whose name is ``limit``."""

    def limit_of(self, limits: Limits) -> float:
        """The low or the high end; NaN where it is open."""
        end = limits.items.get(self.limit, (None, None))[0 if self.at_least else 1]
        return math.nan if end is None else end

    @property
    def at_least(self) -> bool:
        """Whether it is the low end."""
        return self.name.endswith(_LOWEST)


def item_requirement(name: str, unit: str) -> ItemRequirement | None:
    """The entry of a row of this name; None where it is of no item."""
    ending = next((ending for ending in (_LOWEST, _HIGHEST) if name.endswith(ending)), None)
    if ending is None:
        return None
    item = name.removesuffix(ending)
    return ItemRequirement(
        name=name,
        limit=item,
        unit=unit,
        claim=Claim.HOUSEKEEPING,
        decided=ByItem(item, at_least=ending == _LOWEST),
        says="value of an item of the sensor's housekeeping",
        plan=not_planned,
        compared=not_compared,
    )


def item_requirements(limits: Limits, units: Mapping[str, str]) -> Iterator[ItemRequirement]:
    """The entries of all items with limits; ``units`` are those of the items."""
    for item, ends in limits.items.items():
        for end, ending in zip(ends, (_LOWEST, _HIGHEST), strict=True):
            found = item_requirement(f"{item}{ending}", units.get(item, "")) if end is not None else None
            if found is not None:
                yield found


def requirement_named(name: str) -> Requirement | None:
    """The entry of a row that was kept by its name; None of a row of another version."""
    return _BY_NAME.get(name) or item_requirement(name, "")


def requirement_of(row: Row) -> Requirement:
    """The entry that a row was made from."""
    return _BY_NAME.get(row.name) or item_requirement(row.name, row.unit) or _BY_NAME[row.name]
