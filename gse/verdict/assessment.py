"""The verdict: the statistics of a session against the limits of its station, by a stated decision rule.

Each subject on trial has the rows of gse.verdict.requirements; gse.statistics.decision gives the rule.

The run of a procedure is judged by its steps; those that watched the sensor have rows of their own.

FAIL where a row fails. A row that fails for what excuses it is INCONCLUSIVE (gse.statistics.excuses); so is a session
where a row of the accuracy, availability or false answers cannot be decided, or where something stands in the way of
PASS (gse.verdict.obstacles). PASS otherwise, with what was not tested.
"""

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from html import escape

from gse.config.station import Station
from gse.diagnosis.diagnosis import findings
from gse.diagnosis.fine_findings import TAGS_DRIFT
from gse.diagnosis.moved_mount import moved_mount
from gse.diagnosis.screen_findings import screen_findings
from gse.diagnosis.sensor_findings import sensor_findings
from gse.diagnosis.sensor_health import SensorHealth, health_findings, sensor_health
from gse.diagnosis.set_up_mistake import (
    OF_PLACE,
    alignment_finding,
    at_the_right_rate,
    beside_a_change,
    camera_beside_answers,
    camera_mistake,
    driven_mount,
    hidden_mistake,
    lost_station,
    mistake_of,
    place_mistake,
    pushed_mount,
    repointed_mount,
    shared_turn,
    without_turn,
)
from gse.external.identifier import ExternalCounts
from gse.procedure.as_run import (
    KEEPS_ALL,
    PORT_GONE,
    AsRun,
    Start,
    StepOutcome,
    StepRun,
    as_run,
    not_watched,
    starts,
    stretch,
)
from gse.procedure.file import Watch
from gse.station.events import Finding
from gse.station.exclusions import Cause, Exclusion, excluded
from gse.station.housekeeping import parameter_differences
from gse.station.results import Subject, Verdict
from gse.station.session_data import SessionData
from gse.statistics.decision import Claim, Outcome, Row
from gse.statistics.excuses import Evidence, excused
from gse.statistics.session_statistics import Statistics, statistics
from gse.statistics.truth_budget import TruthUncertaintyBudget, session_facts, truth_budget
from gse.values.axis import ON_SKY
from gse.values.instant import LAST_NS, NS_PER_S, to_text
from gse.verdict.obstacles import obstacles
from gse.verdict.requirements import REQUIREMENTS, Case, SlewStep, item_requirements, requirement_of

TRUTH_SHARE = 3.0
"""Truth that is worse than this share of a limit is named where a session does not pass."""

LEFT_OUT = ": neither limit nor data: "
"""Between a subject and the names of its rows that a report leaves out, in a line of ``not_tested``."""

STAR_SIMULATOR = (
    "star simulator: absolute pointing, site and clock; refraction and aberration; the colours of stars, their picture "
    "through the optics, and the faintest of them"
)
"""What no screen shows, in a line of ``not_tested``."""
RELATIVE = "relative to a "
"""The begin of a reason that names what was fitted on the same sky; such a reason does not stand against PASS."""

_REPR_COLUMNS = 110


@dataclass(frozen=True, slots=True)
class Assessment:
    """The verdict, a line per reason, the rows it was made from, and what the errors look like.

    ``relative`` where the mount was fitted on the same sky: then absolute pointing, site and clock were not tested.
    ``damaged`` where a part of the session file is missing: what that part showed is unknown. ``growing`` where it is
    still being recorded. ``not_tested`` are lines on what the verdict says nothing of. A ``simulated`` session proves
    nothing of a sensor. ``slew`` has the steps of each subject before a screen that turned at several rates. Of a
    ``procedure`` the verdict is that of its steps; the rows are the worst of the stretches that it watched.
    """

    verdict: Verdict
    reasons: tuple[str, ...]
    rows: tuple[Row, ...]
    statistics: Statistics
    budget: TruthUncertaintyBudget
    findings: tuple[Finding, ...]
    not_tested: tuple[str, ...]
    relative: bool
    simulated: bool
    damaged: bool
    health: SensorHealth
    growing: bool = False
    slew: Mapping[Subject, tuple[SlewStep, ...]] = field(default_factory=dict)
    procedure: "ProcedureRun | None" = None

    def __repr__(self) -> str:
        """Five lines at most: a notebook shows it after each ``gse.judge``."""
        outcomes = Counter(row.outcome.value for row in self.rows)
        lines = [
            f"<gse verdict: {self.word}{' (SIMULATED)' if self.simulated else ''}, {self.statistics.frames} frames",
            *(f" {reason}" for reason in self.reasons[:2]),
            f" rows: {', '.join(f'{count} {outcome}' for outcome, count in outcomes.items())}",
            " .rows .reasons .findings .statistics .budget .not_tested>",
        ]
        return "\n".join(line if len(line) <= _REPR_COLUMNS else f"{line[: _REPR_COLUMNS - 4]} ..." for line in lines)

    def _repr_html_(self) -> str:
        """The verdict and its rows, as Jupyter shows them."""
        head = f"{self.word}{' (SIMULATED)' if self.simulated else ''}"
        reasons = "".join(f"<li>{escape(reason)}</li>" for reason in self.reasons)
        rows = "".join(
            f"<tr><td>{row.subject}</td><td>{escape(row.name)}</td><td>{row.value:.4g}</td><td>{row.uncertainty:.3g}</td>"
            f"<td>{row.limit:g} {row.unit}</td><td>{row.outcome}</td></tr>"
            for row in self.rows
        )
        names = "".join(f"<th>{name}</th>" for name in ("subject", "row", "value", "U 95 %", "limit", "outcome"))
        return f"<b>{escape(head)}</b><ul>{reasons}</ul><table><tr>{names}</tr>{rows}</table>"

    @property
    def word(self) -> str:
        """The verdict as it is printed: a PASS with what it does not cover; ``so far`` while the session runs."""
        so_far = ["so far"] * self.growing
        if self.verdict is not Verdict.PASS:
            return ", ".join([self.verdict.value, *so_far])
        return ", ".join(["PASS", *["relative"] * self.relative, *["damaged session"] * self.damaged, *so_far])


@dataclass(frozen=True, slots=True)
class ProcedureRun:
    """A run: its ``log``, the assessment of each stretch that a step ``watched``, by its number, and its ``starts``."""

    log: AsRun
    watched: Mapping[str, Assessment]
    starts: tuple[Start, ...]


def judge(session: SessionData) -> Assessment:
    """Measure a session and judge it: by its steps where it is the run of a procedure."""
    log = as_run(session.events)
    return _judge(session) if log is None else _judge_procedure(session, log)


def judge_watch(session: SessionData, step: StepRun, watch: Watch) -> Assessment:
    """Judge a stretch of a session as a session of its own, under the limits of a step that watched it."""
    return _judge(stretch(session, step, watch))


def _judge_procedure(session: SessionData, log: AsRun) -> Assessment:
    """What no step watched is left out of the statistics; the whole session decides on what a step watched."""
    watches = [
        (step, watch) for step in log.steps if (watch := step.watch) and step.outcome is not StepOutcome.NOT_DONE
    ]
    watched = {step.number: judge_watch(session, step, watch) for step, watch in watches}
    log = replace(log, steps=tuple(_as_judged(step, watched.get(step.number)) for step in log.steps))
    whole = _judge(replace(session, excluded=(*session.excluded, *not_watched(session, log))))
    verdict = log.verdict
    parameters = list(parameter_differences(session.housekeeping, session.station.test))
    if verdict is Verdict.PASS and (session.truncated or parameters):
        verdict = Verdict.INCONCLUSIVE
    lines = [*log.reasons(), *parameters, *(line for one in watched.values() for line in one.reasons)]
    return replace(
        whole,
        verdict=verdict,
        reasons=tuple(dict.fromkeys(lines)),
        rows=_worst_rows(watched.values()),
        findings=tuple(dict.fromkeys(found for one in watched.values() for found in one.findings)),
        not_tested=tuple(dict.fromkeys(line for one in watched.values() for line in one.not_tested)),
        procedure=ProcedureRun(log, watched, starts(session)),
    )


def _as_judged(step: StepRun, assessment: Assessment | None) -> StepRun:
    """A step with verdict and reason of its stretch, which the whole session, or what is stated later, shows better."""
    if assessment is None:
        return step
    frames, _, said = step.seen.partition(": ")
    reason = next(iter(assessment.reasons), KEEPS_ALL)
    words = f"{frames}: {reason}{PORT_GONE if said.endswith(PORT_GONE) else ''}"
    if assessment.verdict.value != step.outcome.value:
        words += f"; {step.outcome} when it ended, {assessment.verdict} by the whole session"
    return replace(step, outcome=StepOutcome(assessment.verdict.value), seen=words)


def _worst_rows(assessments: Iterable[Assessment]) -> tuple[Row, ...]:
    """Of each subject and name the row that is worst, in the order of the first."""
    worst: dict[tuple[Subject, str], Row] = {}
    for one in assessments:
        for row in one.rows:
            before = worst.setdefault((row.subject, row.name), row)
            if _WORST_FIRST.index(row.outcome) < _WORST_FIRST.index(before.outcome):
                worst[row.subject, row.name] = row
    return tuple(worst.values())


_WORST_FIRST = (Outcome.FAIL, Outcome.INCONCLUSIVE, Outcome.PASS, Outcome.NOT_TESTED)


def _judge(session: SessionData) -> Assessment:
    stats = statistics(session)
    budget = _budget(session, stats)
    relative = _is_relative(session.station)
    slew = slew_steps(session, relative=relative)
    rows = _rows(session, stats, budget, slew)
    found = _causes(session, stats)
    mistakes, kept = [lost_station(session)], frozenset[tuple[Subject, str]]()
    if not any(mistakes) and Outcome.FAIL in {row.outcome for row in rows}:
        mistakes = [camera_mistake(session, stats.counted, found)]
        if not any(mistakes):
            hidden = hidden_mistake(session, found)
            place, kept, found = _turned(session, stats, budget, rows, found)
            mistakes = [place, hidden]
    made = tuple(mistake for mistake in mistakes if mistake)
    available = {subject: of.available for subject, of in stats.subjects.items()}
    evidence = Evidence(session, available, tuple(mistake_of(one, is_turn=bool(kept)) for one in made), kept)
    rows = tuple(excused(row, requirement_of(row).claim, evidence) for row in rows)
    in_the_way = tuple(obstacles(session, stats, rows))
    in_the_way = (*(f"set-up: {mistake}" for mistake in made), *in_the_way)
    verdict = _verdict(rows, in_the_way)
    compared = None if any(finding.is_gross for finding in found) else stats.own
    found += sensor_findings(session, compared, stats.convention, stats.equivalence, named=found)
    health = sensor_health(session)
    found += tuple(health_findings(session, health))
    # What decides comes first: screens with one line show the first reason.
    reasons = [row.reason for outcome in (Outcome.FAIL, Outcome.INCONCLUSIVE) for row in rows if row.outcome is outcome]
    # A mistake of the set-up explains the figures that follow it.
    explains = made and (verdict is not Verdict.FAIL or made[0].cause != "obstruction")
    reasons = [*in_the_way[:1], *reasons, *in_the_way[1:]] if explains else [*reasons, *in_the_way]
    if verdict is not Verdict.PASS:
        first = [str(finding) for finding in found if finding.is_gross]
        others = [str(finding) for finding in found if finding not in made]
        reasons = [*(() if made else first), *reasons, *_complaints(session, budget), *others]
    if relative:
        reasons.append(_relative_to(session))
    return Assessment(
        verdict,
        tuple(dict.fromkeys(reasons)),
        rows,
        stats,
        budget,
        found,
        (
            *_not_tested(stats, rows, session.station, relative, len(session.sensor_attitudes)),
            *_unknown_stars(session.external_counts),
        ),
        relative,
        session.is_simulated,
        session.truncated,
        health,
        session.growing,
        slew,
    )


def _rows(
    session: SessionData,
    stats: Statistics,
    budget: TruthUncertaintyBudget,
    slew: Mapping[Subject, tuple[SlewStep, ...]] | None = None,
) -> tuple[Row, ...]:
    relative, limits, items = _is_relative(session.station), session.station.limits, session.housekeeping
    cases = {
        name: Case(subject, stats, budget, limits, relative, (slew or {}).get(name, ()), items.summaries)
        for name, subject in stats.subjects.items()
    }
    rows = [
        requirement.row(case)
        for case in cases.values()
        for requirement in REQUIREMENTS
        if requirement.is_there(case.subject, limits)
    ]
    sensor = cases.get(Subject.SENSOR) or next(iter(cases.values()), None)
    units = {item.name: item.unit for item in items.items}
    if sensor is not None:
        rows += [requirement.row(sensor) for requirement in item_requirements(limits, units)]
    return tuple(rows)


def _turned(
    session: SessionData,
    stats: Statistics,
    budget: TruthUncertaintyBudget,
    rows: tuple[Row, ...],
    found: tuple[Finding, ...],
) -> tuple[Finding | None, frozenset[tuple[Subject, str]], tuple[Finding, ...]]:
    """The mistake of place, if there is one, the rows that keep their limit without its turn, and what was found.

    One turn is looked for in the whole session, then one on either side of a slip, under a drive, in each of several
    pointings, or at another rate of time tags, where that leaves fewer rows.
    """
    shared = shared_turn(session, stats, budget)
    kept = _kept(rows, without_turn(session, shared.fit)) if shared is not None else frozenset()
    if shared is not None and shared.turn_arcsec <= session.station.limits.false_beyond_arcsec:
        # so small a turn makes no answer false
        false = {(row.subject, row.name) for row in rows if requirement_of(row).claim is Claim.FALSEHOOD}
        kept = frozenset(kept - false)
    failing = {
        (row.subject, row.name)
        for row in rows
        if row.outcome is Outcome.FAIL and requirement_of(row).claim is not Claim.ABSENCE
    }
    named = None
    for changed in (_moved, _driven, _repointed, _mistimed):
        if failing - kept and (change := changed(session, stats, rows, found)) and len(change[1]) > len(kept):
            named, kept = change
    if named is not None:
        return named, kept, (named, *beside_a_change(found, named))
    if shared is None or not kept:
        return None, kept, found
    if explained := place_mistake(session, stats.counted, found, shared):
        return explained[0], kept, explained
    if _own_answers_pass(session, rows):
        of_camera = camera_beside_answers(session, found, shared)
        beside = (one for one in found if one.cause not in (*OF_PLACE, of_camera.cause))
        return of_camera, kept, (of_camera, *beside)
    beside = (one for one in found if not one.is_gross and one.cause not in OF_PLACE)
    return None, kept, (alignment_finding(shared), *beside)


def _own_answers_pass(session: SessionData, rows: tuple[Row, ...]) -> bool:
    """Whether truth confirms the sensor's own answers: the rows of their accuracy pass, and false ones are few."""
    own = [row for row in rows if row.subject is Subject.SENSOR]
    accurate = {row.outcome for row in own if requirement_of(row).claim is Claim.ACCURACY} - {Outcome.NOT_TESTED}
    false = {row.outcome for row in own if requirement_of(row).claim is Claim.FALSEHOOD}
    return accurate == {Outcome.PASS} and Outcome.FAIL not in false and not _is_relative(session.station)


def _moved(
    session: SessionData, stats: Statistics, rows: tuple[Row, ...], found: tuple[Finding, ...]
) -> tuple[Finding, frozenset[tuple[Subject, str]]] | None:
    """That the mount was moved once, and the failing rows that keep their limit both here and there."""
    how = moved_mount(session, stats.counted)
    if how is None or not how.is_proven:
        return None
    turns, kept = [], {(row.subject, row.name) for row in rows}
    for part in how.parts_of(session):
        of_part = statistics(part)
        shared = shared_turn(part, of_part, _budget(part, of_part))
        if shared is None:  # too few frames to tell where it looked
            continue
        if not shared.is_free:
            return None
        turns.append(shared)
        kept &= _kept(rows, without_turn(part, shared.fit))
    return (pushed_mount(found, how.changes_ns[0], tuple(turns)), frozenset(kept)) if turns else None


def _driven(
    session: SessionData, stats: Statistics, rows: tuple[Row, ...], found: tuple[Finding, ...]
) -> tuple[Finding, frozenset[tuple[Subject, str]]] | None:
    """That a drive turned the mount with the sky, and the failing rows that keep their limit on a mount so turned."""
    driven = driven_mount(session, stats, _budget(session, stats), found)
    return (driven[0], _all_kept(rows, driven[1])) if driven else None


def _repointed(
    session: SessionData, stats: Statistics, rows: tuple[Row, ...], found: tuple[Finding, ...]
) -> tuple[Finding, frozenset[tuple[Subject, str]]] | None:
    """That the mount was turned repeatedly, and the failing rows that keep their limit where it stood each time."""
    repointed = repointed_mount(session, stats, _budget(session, stats))
    return (repointed[0], _all_kept(rows, repointed[1])) if repointed else None


def _mistimed(
    session: SessionData, stats: Statistics, rows: tuple[Row, ...], found: tuple[Finding, ...]
) -> tuple[Finding, frozenset[tuple[Subject, str]]] | None:
    """That the time tags of a raw capture run wrong, and the failing rows that keep their limit at the right rate.

    Nobody vouches for that rate: --clock-error is a bound of the start alone.
    """
    named = next((finding for finding in found if finding.cause == TAGS_DRIFT), None)
    if named is None:
        return None
    timed = at_the_right_rate(session, stats.counted)
    of_timed = statistics(timed)
    shared = shared_turn(timed, of_timed, _budget(timed, of_timed))
    if shared is None or not shared.is_free:
        return None
    return named, _kept(rows, without_turn(timed, shared.fit))


def _kept(rows: tuple[Row, ...], without: SessionData) -> frozenset[tuple[Subject, str]]:
    """Rows that fail, and keep their limits in the session without the turn that panoramas and stars share."""
    return _kept_by(rows, _rows_of(without))


def _all_kept(rows: tuple[Row, ...], without: SessionData) -> frozenset[tuple[Subject, str]]:
    """The same; none where another row fails there: turns that differ may have hidden which answers are false."""
    left = _rows_of(without)
    failing = ({(row.subject, row.name) for row in some if row.outcome is Outcome.FAIL} for some in (left, rows))
    return _kept_by(rows, left) if next(failing) <= next(failing) else frozenset()


def _rows_of(session: SessionData) -> tuple[Row, ...]:
    stats = statistics(session)
    return _rows(session, stats, _budget(session, stats))


def _kept_by(rows: tuple[Row, ...], left: tuple[Row, ...]) -> frozenset[tuple[Subject, str]]:
    failing = {(row.subject, row.name) for row in rows if row.outcome is Outcome.FAIL}
    return frozenset(failing & {(row.subject, row.name) for row in left if _keeps_its_limit(row)})


def _keeps_its_limit(row: Row) -> bool:
    """Whether the figure itself does, though its uncertainty may not."""
    keeps = row.value >= row.limit if requirement_of(row).at_least else row.value <= row.limit
    return row.outcome is Outcome.PASS or (row.outcome is Outcome.INCONCLUSIVE and keeps)


def _causes(session: SessionData, stats: Statistics) -> tuple[Finding, ...]:
    """The causes of what panoramas show under the sky; before a star simulator only those of a screen can be."""
    if Subject.ONBOARD not in stats.subjects:
        return ()
    if session.station.mount.inertial is not None:
        return tuple(screen_findings(session))
    return findings(session, stats)


def _budget(session: SessionData, stats: Statistics) -> TruthUncertaintyBudget:
    clock = stats.clock
    return truth_budget(session_facts(session, clock_error_s=clock.error_bound_s, clock_by=clock.vouched_by))


def _verdict(rows: tuple[Row, ...], in_the_way: tuple[str, ...]) -> Verdict:
    outcomes = {row.outcome for row in rows}
    if Outcome.FAIL in outcomes:
        return Verdict.FAIL
    if Outcome.INCONCLUSIVE in outcomes or in_the_way:
        return Verdict.INCONCLUSIVE
    return Verdict.PASS


def _is_relative(station: Station) -> bool:
    """Whether the mount, the screen or the frame of the answers was fitted on what the sensor saw."""
    rotation, screen = station.sensor.attitude.rotation, station.screen
    is_fitted = (rotation is not None and rotation.fitted) or (screen is not None and screen.to_sensor.fitted)
    return station.mount.align is not None or is_fitted


def _relative_to(session: SessionData) -> str:
    if session.station.mount.align is None and session.station.screen is None:
        return f"{RELATIVE}fitted frame of the answers: their constant error is not tested"
    if session.station.mount.align is None:
        return f"{RELATIVE}fitted screen: absolute pointing not tested"
    align_s, alignment, frames = session.station.mount.align_s or 0.0, session.alignment, session.frames.columns
    which = f"the first {align_s:g} s"
    if alignment is not None and alignment.from_ns - int(frames["utc_ns"].min()) > align_s * NS_PER_S:
        taken_s = (alignment.until_ns - alignment.from_ns) / NS_PER_S
        which = f"{taken_s:.0f} s from {to_text(alignment.from_ns, 0)}, the first of a sky that shows its stars"
    return f"{RELATIVE}mount fitted on {which}: absolute pointing, site and clock not tested"


def is_left_out(row: Row, station: Station) -> bool:
    """Whether a report only names a row: it has no limit and no value, and no requirement of the station file names it.

    So a new row that nobody asks for changes no report of a session that does not show it.
    """
    return math.isnan(row.limit) and math.isnan(row.value) and row.name not in station.test.requirements


def _not_tested(
    stats: Statistics, rows: tuple[Row, ...], station: Station, relative: bool, own_answers: int
) -> Iterator[str]:
    untested = [row for row in rows if row.outcome is Outcome.NOT_TESTED]
    yield from (row.reason for row in untested if not is_left_out(row, station))
    for subject in stats.subjects:
        names = [row.name for row in untested if row.subject == subject and is_left_out(row, station)]
        if names:
            yield f"{subject}{LEFT_OUT}{'; '.join(names)}"
    if Subject.SENSOR not in stats.subjects:
        yield _without_sensor(own_answers)
    if Subject.ONBOARD not in stats.subjects:
        yield "onboard: no panoramas came, so there was nothing to identify and nothing to check the answers by"
    if station.mount.inertial is not None:
        yield STAR_SIMULATOR
    elif relative:
        yield "absolute pointing, site and clock: the mount was fitted on the same sky"


def _unknown_stars(counts: ExternalCounts) -> Iterator[str]:
    if counts.stars_unknown:
        yield (
            f"onboard: {counts.stars_unknown} of the {counts.stars_named} star numbers of its answers are in no "
            "catalogue and name no star; send them as whole numbers (a double holds 15 digits, a Gaia number has 19)"
        )


def _without_sensor(own_answers: int) -> str:
    if not own_answers:
        return "sensor: it sent no answers of its own (no ATTITUDE frames)"
    return (
        f"sensor: {own_answers} answers of its own came, and no panorama that they are of; if it sends none, leave "
        "PANORAMA out of the protocol description, and they are judged alone"
    )


def _complaints(session: SessionData, budget: TruthUncertaintyBudget) -> list[str]:
    limits = session.station.limits
    if session.station.subject is not None:
        return []
    lines = [line for axis in ON_SKY if (line := budget.complaint(axis, limits.of(axis), TRUTH_SHARE))]
    if lines or not len(session.sensor_attitudes):
        return lines
    return [line for axis in ON_SKY if (line := budget.complaint(axis, limits.of(axis), TRUTH_SHARE, own=True))]


def slew_steps(session: SessionData, *, relative: bool) -> dict[Subject, tuple[SlewStep, ...]]:
    """The steps of each subject, from slow to fast, each judged by the frames of its own rate; nothing of one rate."""
    rates = sorted({item.rate_deg_per_s for item in session.shown.shown})
    steps: dict[Subject, list[SlewStep]] = defaultdict(list)
    for rate in rates if len(rates) > 1 else ():
        for subject, step in _slew_step(session, rate, relative=relative):
            steps[subject].append(step)
    return {subject: tuple(found) for subject, found in steps.items()}


def _slew_step(session: SessionData, rate_deg_per_s: float, *, relative: bool) -> Iterator[tuple[Subject, SlewStep]]:
    """The step of each subject at one rate."""
    others = tuple(_at_other_rates(session, rate_deg_per_s))
    # Each step is judged, also one that is faster than the limit.
    limits = replace(session.station.limits, slew_deg_per_s=None)
    station = session.station.model_copy(update={"limits": limits})
    part = replace(session, station=station, excluded=(*session.excluded, *others))
    stats = statistics(part)
    facts = session_facts(part, clock_error_s=stats.clock.error_bound_s, clock_by=stats.clock.vouched_by)
    budget = truth_budget(replace(facts, shown=part.shown.only(lambda item: item.rate_deg_per_s == rate_deg_per_s)))
    frames = int((~excluded(part.frames.columns["utc_ns"], others)).sum())
    evidence = Evidence(part, {name: subject.available for name, subject in stats.subjects.items()})
    for name, subject in stats.subjects.items():
        case = Case(subject, stats, budget, limits, relative)
        rows = (excused(one.row(case), one.claim, evidence) for one in REQUIREMENTS if one.core)
        yield name, SlewStep(rate_deg_per_s, frames, subject, tuple(rows))


def _at_other_rates(session: SessionData, rate_deg_per_s: float) -> Iterator[Exclusion]:
    shown = session.shown.shown
    begins = [0, *(item.from_ns for item in shown[1:]), LAST_NS]
    for item, from_ns, until_ns in zip(shown, begins, begins[1:], strict=False):
        if item.rate_deg_per_s != rate_deg_per_s:
            yield Exclusion(from_ns, until_ns, "the scene turned at another rate", Cause.MOUNT)
