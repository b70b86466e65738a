"""The decision rule: when a figure keeps its limit, when it does not, when that cannot be said.

Guarded acceptance (JCGM 106:2012, section 8.3) on both sides: a figure q with the limit L and the one-sided 95 %
uncertainty U passes where q + U <= L, fails where q - U > L, and is inconclusive between them. So a sensor whose true
figure lies at its limit passes in at most 5 % of the sessions, and fails in at most 5 %. U is the root of the sum of
the squares of the sampling uncertainty (gse.assessment.sampling) and of 1.645 times the standard uncertainty of truth.

With ``simple`` acceptance, q <= L passes whatever U is; each row then states how often a sensor outside its limit would
be seen like this.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

from scipy.special import betaincinv, ndtr

from gse.assessment.guard_band import COVERAGE_FACTOR, exceeds, further_share, guard, keeps
from gse.assessment.sampling import MIN_FRAMES, Bounds
from gse.limits import Decision
from gse.percent import percent
from gse.station.results import Subject

RISK = 0.05
"""How often a sensor at its limit passes, and how often it fails, at most."""

DECISION_TEXT = {
    Decision.GUARDED: (
        "A figure q with the limit L and the one-sided 95 % uncertainty U is PASS where q + U <= L, FAIL where "
        "q - U > L, and INCONCLUSIVE between them: a sensor whose true figure is at its limit passes in at most 5 % of "
        "the sessions, and fails in at most 5 %. U = sqrt(U_sampling^2 + (1.645 u_truth)^2). Shares are decided by "
        "their one-sided 95 % bounds after Clopper and Pearson."
    ),
    Decision.SIMPLE: (
        "A figure q with the limit L is PASS where q <= L, else FAIL. Uncertainty does not count: the risk that a "
        "sensor outside its limit is seen like this is stated beside each row."
    ),
}

_NO_LENGTH = "a longer session cannot decide"
_BY_DRIFT = "most of it a drift that a longer session tells better"
_NAN = float("nan")


class Outcome(StrEnum):
    """The word on one row."""

    PASS = "PASS"
    FAIL = "FAIL"
    INCONCLUSIVE = "INCONCLUSIVE"
    NOT_TESTED = "not tested"


@dataclass(frozen=True, slots=True)
class Row:
    """One judged figure of one subject.

    ``limit`` is the highest value that passes, for availability the lowest; NaN where none is stated.
    ``uncertainty`` is the one-sided 95 % U of the decision, ``truth_uncertainty`` the standard uncertainty of truth in
    it, ``n_eff`` the effective number of frames; NaN where they have no meaning. ``reason`` says in a line why a row is
    not PASS. A ``relative`` row is against a mount that was fitted on the same sky.
    """

    subject: Subject
    name: str
    value: float
    unit: str
    limit: float
    outcome: Outcome
    reason: str = ""
    uncertainty: float = _NAN
    truth_uncertainty: float = _NAN
    n_eff: float = _NAN
    false_pass_risk: float = RISK
    relative: bool = False

    @property
    def label(self) -> str:
        """Subject and name, as a person reads them."""
        return f"{self.subject} {self.name}"


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure with its sampling bounds, the effective number of frames, and the session's length."""

    value: float
    bounds: Bounds
    n_eff: float
    frames: int
    duration_s: float


def judge_figure(
    subject: Subject,
    name: str,
    figure: Figure,
    *,
    unit: str,
    limit: float,
    truth_uncertainty: float,
    decision: Decision,
    relative: bool = False,
    settles: bool = False,
) -> Row:
    """The row of a figure that must not exceed its limit.

    ``settles`` where most of what truth leaves open is what a longer session tells better.
    """
    above = guard(figure.bounds.upper - figure.value, truth_uncertainty)
    below = guard(figure.value - figure.bounds.lower, truth_uncertainty)
    outcome = _outcome(figure, limit, truth_uncertainty, decision)
    risk = RISK if decision is Decision.GUARDED else _risk(figure.value, above, limit)
    label = f"{subject} {name}"
    if figure.frames == 0 or math.isnan(limit):
        outcome = Outcome.NOT_TESTED
        reason = f"{label}: " + ("no frame has it" if figure.frames == 0 else "no limit is stated")
    elif figure.frames < MIN_FRAMES:
        outcome = Outcome.INCONCLUSIVE
        reason = f"{label}: {figure.frames} frames were compared with truth, {MIN_FRAMES} are needed"
    elif outcome is Outcome.FAIL:
        reason = f"{label} is {amount(figure.value, unit)}, the limit is {amount(limit, unit)}"
        reason += f" (U {amount(below, unit)})" if math.isfinite(below) else ""
    elif outcome is Outcome.INCONCLUSIVE:
        uncertainty = above if figure.value <= limit else below
        left = _BY_DRIFT if settles else _NO_LENGTH
        reason = f"{label}{_why_undecided(figure, uncertainty, unit, limit, truth_uncertainty, left)}"
    else:
        reason = ""
    return Row(
        subject,
        name,
        figure.value,
        unit,
        limit,
        outcome,
        reason,
        uncertainty=below if outcome is Outcome.FAIL else above,
        truth_uncertainty=truth_uncertainty,
        n_eff=figure.n_eff,
        false_pass_risk=risk,
        relative=relative,
    )


def _outcome(figure: Figure, limit: float, truth_uncertainty: float, decision: Decision) -> Outcome:
    if decision is Decision.SIMPLE and math.isfinite(figure.value):
        return Outcome.PASS if figure.value <= limit else Outcome.FAIL
    if keeps(figure.value, figure.bounds.upper, limit, truth_uncertainty):
        return Outcome.PASS
    is_over = exceeds(figure.value, figure.bounds.lower, limit, truth_uncertainty)
    return Outcome.FAIL if is_over else Outcome.INCONCLUSIVE


def _risk(value: float, above: float, limit: float) -> float:
    """The share of sensors outside the limit among those that are seen so, for a normal uncertainty; NaN: not known."""
    return float(ndtr(-(limit - value) * COVERAGE_FACTOR / above)) if above > 0 else _NAN


def _why_undecided(
    figure: Figure, uncertainty: float, unit: str, limit: float, truth_uncertainty: float, left: str
) -> str:
    """What follows the name of the row; ``left`` says what a longer session does to what truth leaves open."""
    if math.isnan(figure.bounds.upper):
        number = f" (n_eff {figure.n_eff:.0f})" if math.isfinite(figure.n_eff) else ""
        return f": the session is too short to tell{number}"
    if math.isinf(truth_uncertainty):
        return ": truth is not known well enough to compare with"
    value, u, most = (amount(size, unit) for size in (figure.value, uncertainty, limit))
    text = f" is {value} with U {u}, the limit is {most}"
    more_min = minutes_more(figure, limit, truth_uncertainty)
    if math.isfinite(more_min):
        return f"{text}: {_minutes(more_min)} would have decided"
    return f"{text}: truth leaves {amount(COVERAGE_FACTOR * truth_uncertainty, unit)}, {left}"


def minutes_more(figure: Figure, limit: float, truth_uncertainty: float) -> float:
    """How many more minutes of the same would decide; infinite where truth is the reason."""
    sampling = figure.bounds.upper - figure.value if figure.value <= limit else figure.value - figure.bounds.lower
    return figure.duration_s / 60 * further_share(limit - figure.value, sampling, truth_uncertainty, figure.n_eff)


def _minutes(minutes: float) -> str:
    if minutes > 24 * 60:
        return "more than a day more"
    return f"{max(math.ceil(minutes), 1)} more minute{'s' if minutes > 1 else ''}"


def amount(value: float, unit: str) -> str:
    """A value with its unit as a reason prints it; degrees where arcseconds make no sense."""
    if unit == "arcsec" and abs(value) >= 3600:
        return f"{value / 3600:.2f} deg"
    digits = f"{value:.1f}" if abs(value) < 1000 else f"{value:.0f}"
    return f"{digits} {unit}".rstrip()


@dataclass(frozen=True, slots=True)
class Share:
    """A share of frames with its one-sided 95 % bounds (Clopper & Pearson 1934) on an effective number of them."""

    count: int
    of: int
    value: float
    n_eff: float
    lower: float
    upper: float


def share_of(count: int, of: int, n_eff: float | None = None) -> Share:
    """The share with its bounds; NaN of nothing."""
    if of == 0:
        return Share(0, 0, _NAN, 0.0, _NAN, _NAN)
    number = float(of) if n_eff is None else min(n_eff, float(of))
    happened = number * count / of
    lower = float(betaincinv(happened, number - happened + 1, RISK)) if count else 0.0
    upper = float(betaincinv(happened + 1, number - happened, 1 - RISK)) if count < of else 1.0
    return Share(count, of, count / of, number, lower, upper)


def judge_share(
    subject: Subject, name: str, share: Share, *, limit: float, at_least: bool, decision: Decision, beside: str = ""
) -> Row:
    """The row of a share that must keep below its limit, or reach it (``at_least``); ``beside`` joins the reason."""
    label = f"{subject} {name}"
    uncertainty = share.value - share.lower if at_least else share.upper - share.value
    outcome = _share_outcome(share, limit, at_least=at_least, decision=decision)
    seen = f"{label}: {share.count} of {share.of} frames{beside} ({percent(share.value, 2)})"
    if share.of == 0:
        outcome, reason = Outcome.NOT_TESTED, f"{label}: no frame has it"
    elif outcome is Outcome.FAIL:
        reason = f"{seen}, the limit is {percent(limit, 2)}"
    elif outcome is Outcome.INCONCLUSIVE:
        bound = f"at least {percent(share.lower, 2)}" if at_least else f"at most {percent(share.upper, 2)}"
        reason = f"{seen} show {bound} with 95 % confidence, the limit is {percent(limit, 2)}: a longer session decides"
    else:
        reason = ""
    return Row(subject, name, share.value, "", limit, outcome, reason, uncertainty, n_eff=share.n_eff)


def _share_outcome(share: Share, limit: float, *, at_least: bool, decision: Decision) -> Outcome:
    good, bad = (share.lower >= limit, share.upper < limit) if at_least else (share.upper <= limit, share.lower > limit)
    if decision is Decision.SIMPLE:
        return Outcome.PASS if (share.value >= limit if at_least else share.value <= limit) else Outcome.FAIL
    return Outcome.PASS if good else Outcome.FAIL if bad else Outcome.INCONCLUSIVE
