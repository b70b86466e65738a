"""The decision rule: when a figure keeps its limit, when it does not, when that cannot be said.

Guarded acceptance (JCGM 106:2012, section 8.3) on both sides: a figure q with the limit L and the one-sided 95 %
uncertainty U passes where q + U <= L, fails where q - U > L, and is inconclusive between them. So a sensor whose true
figure lies at its limit passes in at most 5 % of the sessions, and fails in at most 5 %. U is the root of the sum of
the squares of the sampling uncertainty (gse.statistics.sampling) and of 1.645 times the standard uncertainty of truth.

With ``simple`` acceptance, q <= L passes whatever U is; each row then states how often a sensor outside its limit would
be seen like this. Where truth is not known at all, there is nothing to accept: such a row is inconclusive.
"""

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc, betaincinv, ndtr, ndtri, stdtrit

from gse.station.results import Subject
from gse.statistics.axis_statistics import MIN_S
from gse.statistics.sampling import MIN_FRAMES, Bounds
from gse.values.limits import Decision
from gse.values.text import count_text, percent

# Guarded acceptance: a limit is kept where the figure and its uncertainty keep it (JCGM 106, 8.3.2).

COVERAGE_FACTOR = 1.645
"""Coverage factor of a one-sided 95 % bound of a normal quantity."""

_ROUNDING = 1e-9
DECIDED = 0.8
"""Probability with which a session is decided after the time that is said."""
PROBABILITY = 0.9
"""Probability of a PASS that a plan is made for, if the sensor performs as expected."""
MOST_LENGTHS = 400.0
"""Longest session that is tried, in lengths of the session that was seen: a night for a minute."""
MOST_OF_EVENTS = 20.0
"""The same where a share rests on events that were seen: their number tells nothing of so many nights more."""

_ONE_SIDED = 0.95
_LENGTHS = np.geomspace(1.0, MOST_LENGTHS, 120)
_FEWEST_VALUES = 1.0
_HALVINGS = 24
_POINTS = 200
_SPREAD = 1.324717957244746
"""The root of x^3 = x + 1."""


def guard(sampling: float, truth_standard: float) -> float:
    """The one-sided 95 % uncertainty of a figure, from what sampling leaves open and the standard uncertainty of truth.

    ``sampling`` is the distance between the figure and its one-sided 95 % bound. Both are independent: the squares add
    (JCGM 100, 5.1.2), each at 95 %. NaN or infinite where ``sampling`` is.
    """
    return math.hypot(sampling, COVERAGE_FACTOR * truth_standard)


def keeps(value: float, upper: float, limit: float, truth_standard: float = 0.0) -> bool:
    """Whether a figure with this one-sided 95 % upper bound is within a limit beyond doubt; False for NaN."""
    return value + guard(upper - value, truth_standard) <= limit


def exceeds(value: float, lower: float, limit: float, truth_standard: float = 0.0) -> bool:
    """Whether a figure with this one-sided 95 % lower bound is beyond a limit beyond doubt; False for NaN."""
    return value - guard(value - lower, truth_standard) > limit


RISK = 0.05
"""How often a sensor at its limit passes, and how often it fails, at most."""

DECISION_TEXT = {
    Decision.GUARDED: (
        "A figure q with the limit L and the one-sided 95 % uncertainty U is PASS where q + U <= L, FAIL where "
        "q - U > L, and INCONCLUSIVE between them: a sensor whose true figure is at its limit passes in some 5 % of "
        "the sessions that last ten times as long as its slowest errors, and fails in as many; slower errors count as "
        "far as the session saw them. U = sqrt(U_sampling^2 + (1.645 u_truth)^2). Shares are decided by "
        "their one-sided 95 % bounds after Clopper and Pearson; an outage is an event of Poisson."
    ),
    Decision.SIMPLE: (
        "A figure q with the limit L is PASS where q <= L, else FAIL. Uncertainty does not count: the risk that a "
        "sensor outside its limit is seen like this is stated beside each row that is PASS. Where truth is not known "
        "a row is INCONCLUSIVE."
    ),
}

_SAYS_NOTHING = 0.5
"""A lower bound below half of its limit tells nothing of it."""
_NO_LENGTH = "a longer session cannot decide"
_NONE_NAMED = "no length can be named that decides"
_TOO_NEAR = "it lies too near the limit for a longer session to decide"
_NAN = float("nan")


class Claim(StrEnum):
    """What a row that is not PASS says of a sensor: what may excuse it goes by that (gse.statistics.excuses)."""

    ACCURACY = "its answers lie too far from truth"
    ABSENCE = "it does not answer"
    FALSEHOOD = "its answers are of other stars"
    SLOWNESS = "its answers take too long"
    CURRENT = "it draws too much current"
    HOUSEKEEPING = "an item of its housekeeping is out of its limits"


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

    @property
    def is_of_few_frames(self) -> bool:
        """Whether it is of fewer frames than bounds can be had of."""
        return self.frames < MIN_FRAMES


@dataclass(frozen=True, slots=True)
class Criterion:
    """What is asked of a figure or share of one subject, and by which rule it is decided."""

    subject: Subject
    name: str
    limit: float
    decision: Decision
    unit: str = ""

    @property
    def label(self) -> str:
        """Subject and name, as a person reads them."""
        return f"{self.subject} {self.name}"


def judge_figure(asked: Criterion, figure: Figure, *, truth_uncertainty: float, relative: bool = False) -> Row:
    """The row of a figure that must not exceed its limit."""
    above = guard(figure.bounds.upper - figure.value, truth_uncertainty)
    below = guard(figure.value - figure.bounds.lower, truth_uncertainty)
    outcome = _outcome(asked, figure, truth_uncertainty)
    reason = ""
    if outcome is Outcome.NOT_TESTED:
        reason = f"{asked.label}: " + ("no frame has it" if figure.frames == 0 else "no limit is stated")
    elif outcome is Outcome.FAIL:
        reason = f"{asked.label} is {amount(figure.value, asked.unit)}, the limit is {amount(asked.limit, asked.unit)}"
        reason += f" (U {amount(below, asked.unit)})" if math.isfinite(below) else ""
    elif outcome is Outcome.INCONCLUSIVE:
        uncertainty = above if figure.value <= asked.limit else below
        reason = f"{asked.label}{_why_undecided(asked, figure, uncertainty, truth_uncertainty)}"
    return Row(
        asked.subject,
        asked.name,
        figure.value,
        asked.unit,
        asked.limit,
        outcome,
        reason,
        uncertainty=below if outcome is Outcome.FAIL else above,
        truth_uncertainty=truth_uncertainty,
        n_eff=figure.n_eff,
        false_pass_risk=RISK if asked.decision is Decision.GUARDED else _risk(figure.value, above, asked.limit),
        relative=relative,
    )


def _outcome(asked: Criterion, figure: Figure, truth_uncertainty: float) -> Outcome:
    if figure.frames == 0 or math.isnan(asked.limit):
        return Outcome.NOT_TESTED
    if figure.is_of_few_frames:
        return Outcome.INCONCLUSIVE
    if asked.decision is Decision.SIMPLE and math.isfinite(figure.value) and math.isfinite(truth_uncertainty):
        return Outcome.PASS if figure.value <= asked.limit else Outcome.FAIL
    if keeps(figure.value, figure.bounds.upper, asked.limit, truth_uncertainty):
        return Outcome.PASS
    is_over = exceeds(figure.value, figure.bounds.lower, asked.limit, truth_uncertainty)
    return Outcome.FAIL if is_over else Outcome.INCONCLUSIVE


def _risk(value: float, above: float, limit: float) -> float:
    """The share of sensors outside the limit among those that are seen so, for a normal uncertainty; NaN: not known."""
    return float(ndtr(-(limit - value) * COVERAGE_FACTOR / above)) if above > 0 else _NAN


def _why_undecided(asked: Criterion, figure: Figure, uncertainty: float, truth_uncertainty: float) -> str:
    """What follows the name of the row."""
    if figure.is_of_few_frames:
        return f": {count_text(figure.frames, 'frame')} compared with truth, {MIN_FRAMES} are needed"
    if math.isnan(figure.bounds.upper):
        if math.isnan(figure.n_eff) and figure.duration_s >= MIN_S:
            return ": every answer has the same error, which tells nothing of its scatter"
        number = f" (n_eff {figure.n_eff:.0f})" if math.isfinite(figure.n_eff) else ""
        return f": the session is too short to tell{number}"
    if math.isinf(truth_uncertainty):
        return " cannot be judged, because the error of truth is not known"
    value, u, most = (amount(size, asked.unit) for size in (figure.value, uncertainty, asked.limit))
    text = f" is {value} with U {u}, the limit is {most}"
    more_min = minutes_more(figure, asked.limit, truth_uncertainty)
    if math.isfinite(more_min):
        return f"{text}: {_minutes(more_min)} would have decided"
    truth = COVERAGE_FACTOR * truth_uncertainty
    if truth < abs(asked.limit - figure.value):
        return f"{text}: {_TOO_NEAR}"
    return f"{text}: truth leaves {amount(truth, asked.unit)}, {_NO_LENGTH}"


def minutes_more(figure: Figure, limit: float, truth_uncertainty: float) -> float:
    """How many more minutes of the same would decide; infinite where no length does."""
    sampling = figure.bounds.upper - figure.value if figure.value <= limit else figure.value - figure.bounds.lower
    return figure.duration_s / 60 * further_share(limit - figure.value, sampling, truth_uncertainty, figure.n_eff)


# How long until a decision: the true figure, and that of a longer session, are drawn from what the bounds leave open.


def further_share(distance: float, sampling: float, truth_standard: float, n_eff: float = math.inf) -> float:
    """How much longer a session must be so that DECIDED of all sessions like it are decided, as a share of its length.

    ``distance`` lies between figure and limit, ``sampling`` between figure and one-sided 95 % bound, of ``n_eff``
    independent values. 0 where the figure is decided; infinite where no length of up to MOST_LENGTHS decides, since
    truth prevents it or the figure lies too near its limit; NaN where ``sampling`` is.
    """
    if not math.isfinite(sampling):
        return sampling
    times, (true, new) = _LENGTHS[:, None], _points()
    scatter = sampling / COVERAGE_FACTOR
    ahead = scatter * ((1 - 1 / times) * true + np.sqrt(times - 1) / times * new)
    uncertainty = np.hypot(sampling * _narrower(n_eff, times), COVERAGE_FACTOR * truth_standard)
    return _first_length(np.abs(abs(distance) - ahead) >= uncertainty * (1 - _ROUNDING), DECIDED) - 1


def lengths_to_pass(distance: float, sampling: float, truth_standard: float, n_eff: float = math.inf) -> float:
    """How long another session like the judged one must be for a PASS with PROBABILITY, in lengths of the judged one.

    The arguments are those of further_share; ``distance`` is below 0 where the figure is above its limit.
    """
    if not math.isfinite(sampling):
        return sampling
    times = _LENGTHS[:, None] ** 2 / MOST_LENGTHS
    seen = sampling / COVERAGE_FACTOR / np.sqrt(times) * _points()[1]
    uncertainty = np.hypot(sampling * _narrower(n_eff, times), COVERAGE_FACTOR * truth_standard)
    return _first_length(seen + uncertainty <= distance, PROBABILITY) ** 2 / MOST_LENGTHS


def _narrower(n_eff: float, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """What is left of the sampling part of U in a session that is so much longer.

    It falls with the root of the length, and as Student's t does with the independent values: a session that has few
    does not know its own scatter.
    """
    values = np.maximum(max(n_eff, _FEWEST_VALUES) * np.append(1.0, times), _FEWEST_VALUES)
    quantiles = stdtrit(values, _ONE_SIDED)
    return np.asarray((quantiles[1:] / quantiles[0])[:, None] / np.sqrt(times))


def _first_length(happens: NDArray[np.bool_], share: float) -> float:
    """The first of the lengths (L, 1) at which it happens in that share of the points (L, P)."""
    lengths = np.flatnonzero(happens.mean(axis=1) >= share)
    return float(_LENGTHS[lengths[0]]) if len(lengths) else math.inf


@functools.cache
def _points() -> NDArray[np.float64]:
    """Pairs of independent normal quantities (2, P), evenly spread (gse.statistics.error_model)."""
    return np.asarray(ndtri((0.5 + np.arange(1, _POINTS + 1) * (_SPREAD ** -np.arange(1.0, 3.0))[:, None]) % 1))


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


def judge_share(asked: Criterion, share: Share, *, at_least: bool, beside: str = "", events: str = "") -> Row:
    """The row of a share that must keep below its limit, or reach it (``at_least``).

    ``beside`` joins the reason; ``events`` are those that make most of the share, where they are few.
    """
    uncertainty = share.value - share.lower if at_least else share.upper - share.value
    outcome = share_outcome(share, asked.limit, at_least=at_least, decision=asked.decision)
    limit = percent(asked.limit, 2)
    seen = f"{asked.label}: {share.count} of {count_text(share.of, 'frame')}{beside} ({percent(share.value, 2)})"
    reason = ""
    if outcome is Outcome.NOT_TESTED:
        reason = f"{asked.label}: no frame has it"
    elif outcome is Outcome.FAIL:
        reason = f"{seen}, the limit is {limit}"
    elif outcome is Outcome.INCONCLUSIVE:
        bound = f"at least {percent(share.lower, 2)}" if at_least else f"at most {percent(share.upper, 2)}"
        shows = f" show {bound} with 95 % confidence"
        if at_least and share.lower < _SAYS_NOTHING * asked.limit:
            shows = ""
            events = events or ("the answers that are missing came together" if share.count < share.of - 1 else "")
        why = how_long(share, asked.limit, at_least=at_least, events=events)
        reason = f"{seen}{shows}, the limit is {limit}: {why}"
    return Row(
        asked.subject,
        asked.name,
        share.value,
        asked.unit,
        asked.limit,
        outcome,
        reason,
        uncertainty,
        n_eff=share.n_eff,
        false_pass_risk=RISK if asked.decision is Decision.GUARDED else _share_risk(share, asked.limit, at_least),
    )


def _share_risk(share: Share, limit: float, at_least: bool) -> float:
    """As _risk for a share, all true shares being as likely beforehand; NaN of nothing."""
    happened = share.n_eff * share.value
    below = float(betainc(happened + 1, share.n_eff - happened + 1, limit))
    return below if at_least else 1 - below


def share_outcome(share: Share, limit: float, *, at_least: bool, decision: Decision) -> Outcome:
    """Whether a share keeps its limit by its bounds, or under ``simple`` by its value."""
    if share.of == 0:
        return Outcome.NOT_TESTED
    lower, upper = (share.value, share.value) if decision is Decision.SIMPLE else (share.lower, share.upper)
    if lower >= limit if at_least else upper <= limit:
        return Outcome.PASS
    is_broken = upper < limit if at_least else lower > limit
    return Outcome.FAIL if is_broken else Outcome.INCONCLUSIVE


def share_times(share: Share, limit: float, *, at_least: bool) -> float:
    """Further lengths of the session after which DECIDED of all sessions like it pass, or as many fail.

    The true share of what is wrong is drawn from Clopper and Pearson's distribution of it: for a PASS from the upper
    one, for a FAIL from the lower; the share of what is still to come is drawn from that. No prior is neutral to a few
    events, and these two take the true share as near to the limit as the session allows. What never happened, or always
    did, is taken to go on so. 0 where the share is decided; infinite where no length of up to MOST_OF_EVENTS decides,
    or of up to MOST_LENGTHS where there were no events.
    """
    wrong, most = (1 - share.value, 1 - limit) if at_least else (share.value, limit)
    seen, others = share.n_eff * wrong, share.n_eff * (1 - wrong)
    chances, scatter = ndtr(_points()[0]), _points()[1]
    upper, lower = np.full((2, 1), wrong)
    longest = MOST_LENGTHS
    if seen > 0 and others > 0:
        longest = MOST_OF_EVENTS
        upper, lower = betaincinv(seen + 1, others, chances), betaincinv(seen, others + 1, chances)

    def further(true: NDArray[np.float64], more: float) -> NDArray[np.float64]:
        return np.asarray(np.clip(more * true + np.sqrt(more * true * (1 - true)) * scatter, 0, more))

    def is_decided(times: float) -> bool:
        more = share.n_eff * (times - 1)
        new = further(upper, more)
        passes = betainc(seen + new + 1, others + more - new, most) >= 1 - RISK
        new = further(lower, more)
        fails = betainc(seen + new, others + more - new + 1, most) < RISK
        return bool(max(passes.mean(), fails.mean()) >= DECIDED)

    return _first(is_decided, longest) - 1 if is_decided(longest) else math.inf


def how_long(share: Share, limit: float, *, at_least: bool, events: str = "") -> str:
    """Which session would have decided a share that is undecided, in words; ``events`` as for judge_share."""
    times = 1 + share_times(share, limit, at_least=at_least)
    if math.isinf(times):
        return f"{events}, too few events to tell" if events else _NONE_NAMED
    times = max(times, 1.1, 1 + 1 / share.of)  # one frame more at least
    decides = f"a session {times:.{0 if times >= 10 else 1}f} times as long decides"
    return f"{events}; {decides}" if events else decides


def _first(is_so: Callable[[float], bool], longest: float) -> float:
    low, high = 1.0, longest
    for _ in range(_HALVINGS):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if is_so(middle) else (middle, high)
    return high
