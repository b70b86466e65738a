"""The verdict: figures of a session against the limits of its station.

Judged are mean |dRA*| and mean |dDE|, as in table 4-1 of [S]; that 95 % of the frames have |dRA*| and |dDE| within the
same limit; availability; the 99th percentile of the identification time; and that no answer is false. Roll is reported
and not judged. Truth must be better than a third of a limit to say PASS by it, and FAIL is said only where truth cannot
be the reason. False answers and lost frames are no matter of truth.
"""

import math
from dataclasses import dataclass

from gse.assessment.axis_statistics import AxisStatistics
from gse.assessment.diagnosis import findings
from gse.assessment.statistics import Statistics, statistics
from gse.assessment.truth_budget import TruthUncertaintyBudget, session_facts, truth_budget
from gse.station.results import Verdict
from gse.station.session_data import SessionData

MIN_FRAMES = 30
"""Fewer compared frames than this decide nothing: 95 % of them would be all but one."""

TRUTH_SHARE = 3.0
"""A limit must be this many times what truth leaves open."""


@dataclass(frozen=True, slots=True)
class Measurement:
    """One judged figure; ``limit`` is the highest value that passes (for availability the lowest)."""

    name: str
    value: float
    unit: str
    limit: float
    outcome: Verdict


@dataclass(frozen=True, slots=True)
class Assessment:
    """The verdict, one line per reason where it is not PASS, what it was made from, and what the errors look like."""

    verdict: Verdict
    reasons: tuple[str, ...]
    measurements: tuple[Measurement, ...]
    statistics: Statistics
    budget: TruthUncertaintyBudget
    findings: tuple[str, ...] = ()


def judge(session: SessionData) -> Assessment:
    """Measure a night and judge it."""
    figures = statistics(session)
    drifts = {
        axis: max(abs(found.drift_low_arcsec_per_h), abs(found.drift_high_arcsec_per_h))
        for axis, found in figures.axes.items()
    }
    facts = session_facts(session, clock_error_s=figures.clock.error_bound_s, drift_arcsec_per_h=drifts)
    budget = truth_budget(facts)
    measured = [
        *_accuracy("dRA*", figures.axes["d_ra_cosde"], session.station.limits.d_ra_cosde_arcsec, budget.ra_arcsec),
        *_accuracy("dDE", figures.axes["d_de"], session.station.limits.d_de_arcsec, budget.de_arcsec),
        _availability(figures, session.station.limits.availability),
        _false_answers(figures),
        *_identification_time(figures, session.station.limits.identification_ms),
    ]
    outcomes = [measurement.outcome for measurement, _ in measured]
    worst = (Verdict.FAIL, Verdict.INCONCLUSIVE)
    verdict = next((outcome for outcome in worst if outcome in outcomes), Verdict.PASS)
    reasons = [reason for measurement, reason in measured if reason and measurement.outcome is not Verdict.PASS]
    found = findings(session, figures)
    if verdict is not Verdict.PASS:
        reasons += [*_complaints(session, budget), *found]
    measurements = tuple(measurement for measurement, _ in measured)
    return Assessment(verdict, tuple(dict.fromkeys(reasons)), measurements, figures, budget, found)


def _complaints(session: SessionData, budget: TruthUncertaintyBudget) -> list[str]:
    limits = session.station.limits
    rows = (("dRA*", limits.d_ra_cosde_arcsec), ("dDE", limits.d_de_arcsec))
    return [line for axis, limit in rows if (line := budget.complaint(axis, limit, TRUTH_SHARE))]


_Measured = tuple[Measurement, str]


def _accuracy(axis: str, figures: AxisStatistics, limit: float, truth_arcsec: float) -> list[_Measured]:
    rows = ((f"mean |{axis}|", figures.mean_abs_arcsec), (f"95 % of |{axis}|", figures.p95_abs_arcsec))
    measured = []
    for name, value in rows:
        outcome, reason = _against(value, limit, truth_arcsec), ""
        if figures.n < MIN_FRAMES:
            outcome = Verdict.INCONCLUSIVE
            reason = f"{figures.n} frames were compared with truth, {MIN_FRAMES} are needed"
        elif outcome is Verdict.FAIL:
            reason = f"{name} is {value:.1f} arcsec, the limit is {limit:g}"
        measured.append((Measurement(name, value, "arcsec", limit, outcome), reason))
    return measured


def _against(value: float, limit: float, truth: float) -> Verdict:
    if truth * TRUTH_SHARE <= limit:
        return Verdict.PASS if value <= limit else Verdict.FAIL
    return Verdict.FAIL if value - truth > limit else Verdict.INCONCLUSIVE


def _availability(figures: Statistics, limit: float) -> _Measured:
    share = figures.available
    name = "availability"
    if share.of < MIN_FRAMES:
        reason = f"{share.of} frames were expected, {MIN_FRAMES} are needed"
        return Measurement(name, share.value, "", limit, Verdict.INCONCLUSIVE), reason
    outcome = Verdict.PASS if share.value >= limit else Verdict.FAIL
    reason = f"{share.count} of {share.of} frames were identified ({share.value:.1%}), the limit is {limit:.1%}"
    return Measurement(name, share.value, "", limit, outcome), reason


def _false_answers(figures: Statistics) -> _Measured:
    count = figures.false_answers.count
    outcome = Verdict.FAIL if count else Verdict.PASS
    return Measurement("false answers", count, "", 0, outcome), f"{count} answers were false, none may be"


def _identification_time(figures: Statistics, limit: float) -> list[_Measured]:
    """Nothing where no time was recorded: a session from elsewhere has none, and that says nothing of the sensor."""
    value = figures.identification_ms.p99
    if math.isnan(value):
        return []
    outcome = Verdict.PASS if value <= limit else Verdict.FAIL
    reason = f"identification took {value:.1f} ms in 99 % of the frames, the limit is {limit:g} ms"
    return [(Measurement("identification time, 99 %", value, "ms", limit, outcome), reason)]
