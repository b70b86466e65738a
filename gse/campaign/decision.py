"""The decision of a campaign: the rows of the verdict over nights.

Nights are the sample. A row's figure is the mean of its nightly values; its one-sided 95 % bounds are those of
Student's t with one degree of freedom less than nights, from the scatter between nights, in which the scatter within
them is contained. The uncertainty of truth is common to all nights of a roof: it is added once, undiminished, the
greatest of the nights. Then the rule of a session decides (gse.statistics.decision). A share (availability, false
answers) is that of all frames, with exact bounds on the effective number of frames that its scatter between nights
leaves.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from gse.campaign.nights import Session, weighted
from gse.station.results import Verdict
from gse.statistics.decision import Outcome, Share, exceeds, further_share, guard, keeps, share_of, share_outcome
from gse.values.limits import Decision
from gse.values.text import count_text, percent
from gse.verdict.requirements import Requirement, requirement_named

ONE_SIDED = 0.95
_AGAINST = (Outcome.FAIL, Outcome.INCONCLUSIVE)
ONE_NIGHT = "figures of one night say nothing of how nights differ; 2 nights are needed"
"""The reason of each row that is not a share."""
_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class CampaignRow:
    """One requirement over the nights of a sensor.

    ``within`` is the typical one-sided uncertainty of one night, ``between`` the standard deviation of the nights;
    ``passed``, ``failed`` and ``undecided`` count the nights by their own outcome. NaN where a figure has no meaning.
    """

    subject: str
    name: str
    unit: str
    value: float
    uncertainty: float
    limit: float
    outcome: Outcome
    reason: str
    nights: int
    within: float
    between: float
    worst: float
    worst_night: str
    passed: int
    failed: int
    undecided: int


def campaign_rows(nights: dict[str, list[Session]]) -> list[CampaignRow]:
    """The rows of one sensor, in the order of a session's report."""
    names: dict[tuple[str, str], None] = {}
    for sessions in nights.values():
        for session in sessions:
            for item in session.row["measurements"] or ():
                names.setdefault((item["subject"], item["name"]))
    return [_row(nights, subject, name) for subject, name in names]


def reasons_of(rows: Iterable[CampaignRow]) -> list[str]:
    """Why it is not PASS: what fails first, each reason once."""
    by_weight = sorted(
        (row for row in rows if row.outcome in _AGAINST),
        key=lambda row: (_AGAINST.index(row.outcome), row.reason == ONE_NIGHT),
    )
    return list(dict.fromkeys(f"{row.outcome.value}: {row.reason}" for row in by_weight))


def verdict_of(rows: Iterable[CampaignRow]) -> Verdict:
    """FAIL where a row fails, PASS where some pass and none is undecided."""
    outcomes = [row.outcome for row in rows]
    if Outcome.FAIL in outcomes:
        return Verdict.FAIL
    if Outcome.INCONCLUSIVE in outcomes or Outcome.PASS not in outcomes:
        return Verdict.INCONCLUSIVE
    return Verdict.PASS


@dataclass(frozen=True, slots=True)
class _Nightly:
    """One row's items, night by night, each with its frames."""

    items: dict[str, list[tuple[dict[str, Any], float]]]

    def values(self) -> dict[str, float]:
        known = {
            night: [(item["value"], frames) for item, frames in items if item["value"] is not None]
            for night, items in self.items.items()
        }
        return {night: weighted(values) for night, values in known.items() if values}

    def all(self, key: str) -> list[Any]:
        return [item[key] for items in self.items.values() for item, _ in items if item[key] is not None]

    def outcomes(self) -> list[set[str]]:
        return [{item["outcome"] for item, _ in items} for items in self.items.values()]


def _row(nights: dict[str, list[Session]], subject: str, name: str) -> CampaignRow:
    of = _Nightly(
        {
            night: [
                (item, float(session.row["frames"] or 0))
                for session in sessions
                for item in session.row["measurements"] or ()
                if (item["subject"], item["name"]) == (subject, name)
            ]
            for night, sessions in nights.items()
        }
    )
    values, limits = of.values(), sorted(set(of.all("limit")))
    decisions = {session.row["limit_decision"] for sessions in nights.values() for session in sessions}
    decision = Decision.SIMPLE if decisions == {Decision.SIMPLE.value} else Decision.GUARDED
    limit = limits[0] if len(limits) == 1 else _NAN
    label, requirement = f"{subject} {name}", requirement_named(name)
    if not values or not limits:
        why = "no limit is stated" if values else "no night has it"
        outcome, value, above, reason = Outcome.NOT_TESTED, _mean(values), _NAN, f"{label}: {why}"
    elif len(limits) > 1:
        outcome, value, above = Outcome.INCONCLUSIVE, _mean(values), _NAN
        reason = f"{label}: the sessions have {len(limits)} different limits; judge them with one --station"
    elif requirement is not None and requirement.share_column is not None:
        outcome, value, above, reason = _share(nights, subject, requirement, limit, decision)
    else:
        truth = max(of.all("truth_uncertainty"), default=0.0)
        outcome, value, above, reason = _figure(label, list(values.values()), limit, truth, of.all("unit")[0], decision)
    at_least = requirement is not None and requirement.at_least
    worst_night = (min if at_least else max)(values, key=values.__getitem__, default="")
    single = of.outcomes()
    failed = sum(Outcome.FAIL in one for one in single)
    undecided = sum(Outcome.INCONCLUSIVE in one and Outcome.FAIL not in one for one in single)
    return CampaignRow(
        subject,
        name,
        next(iter(of.all("unit")), ""),
        value,
        above,
        limit,
        outcome,
        reason,
        len(values),
        float(np.median(of.all("uncertainty"))) if of.all("uncertainty") else _NAN,
        float(np.std(list(values.values()), ddof=1)) if len(values) > 1 else _NAN,
        values.get(worst_night, _NAN),
        worst_night,
        sum(one == {Outcome.PASS.value} for one in single),
        failed,
        undecided,
    )


_Decided = tuple[Outcome, float, float, str]


def _figure(label: str, values: list[float], limit: float, truth: float, unit: str, decision: Decision) -> _Decided:
    """Outcome, mean, one-sided uncertainty and reason of a figure that must not exceed its limit."""
    n, mean = len(values), float(np.mean(values))
    if decision is Decision.SIMPLE:
        kept = mean <= limit
        reason = "" if kept else f"{label} is {mean:.4g} {unit} over {n} nights, the limit is {limit:g} {unit}"
        return (Outcome.PASS if kept else Outcome.FAIL), mean, _NAN, reason
    if n < 2:
        return Outcome.INCONCLUSIVE, mean, _NAN, ONE_NIGHT
    half = float(stdtrit(n - 1, ONE_SIDED)) * float(np.std(values, ddof=1)) / math.sqrt(n)
    above = guard(half, truth)
    text = f"{label} is {mean:.4g} {unit} over {n} nights with U {above:.3g}, the limit is {limit:g} {unit}"
    if keeps(mean, mean + half, limit, truth):
        return Outcome.PASS, mean, above, ""
    if exceeds(mean, mean - half, limit, truth):
        return Outcome.FAIL, mean, above, text
    more = n * further_share(limit - mean, half, truth, n - 1)
    ask = (
        f"about {math.ceil(more)} more nights would decide" if math.isfinite(more) else "truth is not known well enough"
    )
    return Outcome.INCONCLUSIVE, mean, above, f"{text}: {ask}"


def length_text(hours: float) -> str:
    """A length of time for a person: 12.5 h, 4.0 min."""
    return f"{hours:.1f} h" if hours >= 1 else f"{hours * 60:.1f} min"


def _share(
    nights: dict[str, list[Session]], subject: str, requirement: Requirement, limit: float, decision: Decision
) -> _Decided:
    share, at_least = campaign_share(nights, subject, requirement), requirement.at_least
    towards_limit = share.value - share.lower if share.value >= limit else share.upper - share.value
    outcome = share_outcome(share, limit, at_least=at_least, decision=decision)
    seen = f"{percent(share.value, 3)} of {share.of} frames in {count_text(len(nights), 'night')}"
    text = f"{subject} {requirement.name}: {seen}"
    reason = ""
    if outcome is Outcome.FAIL:
        reason = f"{text}, the limit is {percent(limit, 2)}"
    elif outcome is Outcome.INCONCLUSIVE:
        bound = f"at least {percent(share.lower, 2)}" if at_least else f"at most {percent(share.upper, 2)}"
        reason = f"{text} show {bound} (95 %), the limit is {percent(limit, 2)}: more nights decide"
    return outcome, share.value, towards_limit, reason


def campaign_share(nights: dict[str, list[Session]], subject: str, requirement: Requirement) -> Share:
    """The share of all frames, with the effective number that its scatter between nights leaves (Korn & Graubard)."""
    stem = f"{subject}_{requirement.share_column}"
    counts = [
        [sum(float(session.row[f"{stem}_{part}"] or 0) for session in sessions) for part in ("count", "of", "n_eff")]
        for sessions in nights.values()
    ]
    count, of, n_eff = (np.array(column) for column in zip(*counts, strict=True))
    return share_over_nights(count, of, n_eff)


def share_over_nights(count: NDArray[np.float64], of: NDArray[np.float64], n_eff: NDArray[np.float64]) -> Share:
    """The share of frames that nights (N,) have, each with its own effective number of them."""
    total = float(of.sum())
    if total == 0 or len(of) < 2:
        return share_of(int(count.sum()), int(total), float(n_eff.sum()))
    share = float(count.sum()) / total
    n = len(of)
    variance = n / (n - 1) * float(((count - share * of) ** 2).sum()) / total**2
    widened = variance * (float(stdtrit(n - 1, ONE_SIDED)) / 1.645) ** 2
    effective = share * (1 - share) / widened if widened > 0 else total
    # Equal nights are not evidence of independent frames: never more than what the nights say of themselves.
    return share_of(int(count.sum()), int(total), max(min(effective, float(n_eff.sum())), 1.0))


def _mean(values: dict[str, float]) -> float:
    return float(np.mean(list(values.values()))) if values else _NAN
