"""Slew rate: the frames of each rate at which a scene on a screen turned, judged by themselves."""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace

from gse.station.exclusions import Cause, Exclusion, excluded
from gse.station.results import Subject
from gse.station.session_data import SessionData
from gse.statistics.excuses import Evidence, excused
from gse.statistics.session_statistics import statistics
from gse.statistics.truth_budget import session_facts, truth_budget
from gse.values.instant import LAST_NS
from gse.verdict.requirements import REQUIREMENTS, Case, SlewStep


def slew_steps(session: SessionData, *, relative: bool) -> dict[Subject, tuple[SlewStep, ...]]:
    """The steps of each subject, from slow to fast; nothing where the scene had less than two rates."""
    rates = sorted({item.rate_deg_per_s for item in session.shown.shown})
    steps: dict[Subject, list[SlewStep]] = defaultdict(list)
    for rate in rates if len(rates) > 1 else ():
        for subject, step in _step(session, rate, relative=relative):
            steps[subject].append(step)
    return {subject: tuple(found) for subject, found in steps.items()}


def _step(session: SessionData, rate_deg_per_s: float, *, relative: bool) -> Iterator[tuple[Subject, SlewStep]]:
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
