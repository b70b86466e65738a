"""Fine causes: models of what may be wrong compete for the errors of a session.

Each cause predicts the three error angles over time and the residuals over the field (gse.diagnosis.competing_models).
The one with the best score is named, then the best beside it, as long as each is worth more than its columns cost.
Causes that explain the same nearly as well are its equals.
"""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gse.diagnosis.changes_in_time import STEPS, sinusoids, steps
from gse.diagnosis.competing_models import Columns, Fitted, Observed, by_its_noise, fitted, forget_observed
from gse.diagnosis.field_patterns import FieldOfErrors
from gse.diagnosis.fine_hypotheses import Hypothesis, causes_of_field, constant_causes, drifts
from gse.diagnosis.session_model import SessionModel
from gse.matrices import pinv, product

EQUAL_WITHIN = 9.0
"""Three standard errors."""
_MOST_CAUSES = 3
_EXCLUSIVE = (
    frozenset({"clock offset", "mount", "site"}),
    frozenset({"clock drift", "mount moves"}),
    frozenset({"focal length", "distortion", "refraction"}),
)
_LEAST_WITHOUT_ONE = 0.5
"""Of what a cause must be worth: in a field of few stars one at the edge may tell half of a distortion."""
_AROUND = 5
"""Frames next to one whose median says what it would be if it were no outlier."""
_REFINEMENTS = 6
_REST_SHARE = 0.2
"""Of the size of an earlier change over time."""


@dataclass(frozen=True, slots=True, eq=False)
class Named:
    """A cause that was found: coefficients (P,) in the units of its columns, with standard errors, and its equals."""

    hypothesis: Hypothesis
    coefficients: NDArray[np.float64]
    errors: NDArray[np.float64]
    equals: tuple[Hypothesis, ...]


def fine_causes(model: SessionModel) -> tuple[Named, ...]:
    """The causes that are worth their columns, the best first."""
    observed = model.observed()
    fixed = [*constant_causes(model), *causes_of_field(model), *drifts(model)]
    named: list[Hypothesis] = []
    rivals = list(fixed)
    for _ in range(_MOST_CAUSES):
        base = fitted_to(observed, named)
        done = _beside(named)
        tried = [one for one in fixed if one.cause not in done]
        columns = together(observed, named)
        changes = [*steps(model, observed, base, columns), *sinusoids(model, observed, base, columns)]
        tried += changes
        gains = [(score(observed, [*named, one]) - base.twice_log_likelihood, one) for one in tried]
        seen = [item for item in gains if _is_seen(model, observed, named, item[1])]
        seen.sort(key=lambda item: item[0], reverse=True)
        found = next((item for item in seen if not _is_of_one_frame(model, named, item[1])), None)
        if found is None:
            break
        gain, best = found
        gain -= _of_its_noise(observed, named, best)
        if gain + best.cost < best.is_worth or not _outlasts_stars(model, observed, named, best):
            break
        best = _refined(observed, named, best)
        if _is_rest(observed, named, best):
            break
        named = [*_without_idle(observed, named, best), best]
        rivals += changes
    return tuple(told(model, observed, named, one, rivals) for one in named)


def _of_its_noise(observed: Observed, named: list[Hypothesis], one: Hypothesis) -> float:
    """What slow noise alone gains as an explanation of a change over time, if the change does not make it white."""
    if not one.is_change:
        return 0.0
    left = [
        observed.cosines - product(together(observed, causes).cosines, fitted_to(observed, causes).coefficients)
        for causes in (named, [*named, one])
    ]
    return by_its_noise(*left)


def _is_seen(model: SessionModel, observed: Observed, named: list[Hypothesis], one: Hypothesis) -> bool:
    """Whether what a cause does to the stars is more than their places on the pixels do, and than is stated."""
    if model.field is None or not one.columns.field.any():
        return True
    coefficients = fitted_to(observed, [*named, one]).coefficients[-one.columns.count :]
    if abs(float(coefficients[0])) < one.known:
        return False
    moved_px = product(model.field.moved_px, product(one.columns.field, coefficients))
    return bool((moved_px**2).sum(axis=1).mean() >= model.field.least_px**2)


def _is_of_one_frame(model: SessionModel, named: list[Hypothesis], one: Hypothesis) -> bool:
    """Whether a single frame near an end of the session tells a step: that is an outlier, and nothing that stays."""
    if one.cause not in STEPS:
        return False
    series, first = model.series, int(one.place)
    count = len(series.time_s)
    after = count - first
    side = np.arange(first, count) if after <= first else np.arange(first)
    errors = series.errors_arcsec.copy()
    off = product(errors[side] - np.median(errors, axis=0), model.decorrelate.T)
    row = int(side[(off**2).sum(axis=1).argmax()])
    around = np.argsort(np.abs(np.arange(count) - row), kind="stable")[1 : _AROUND + 1]
    errors[row] = np.median(errors[around], axis=0)
    others = replace(model, series=replace(series, errors_arcsec=errors)).observed()
    gain = fitted(others, together(others, [*named, one])).twice_log_likelihood
    gain -= fitted(others, together(others, named)).twice_log_likelihood
    return gain < _LEAST_WITHOUT_ONE * one.is_worth


def _refined(observed: Observed, named: list[Hypothesis], found: Hypothesis) -> Hypothesis:
    """The same between the places that were tried."""
    if found.moved is None:
        return found
    best, best_score, step = found, score(observed, [*named, found]), found.spacing / 2
    for _ in range(_REFINEMENTS):
        for place in (best.place - step, best.place + step):
            moved = found.moved(place)
            moved_score = score(observed, [*named, moved])
            if moved_score > best_score:
                best, best_score = moved, moved_score
        step /= 2
    return best


def _is_rest(observed: Observed, named: list[Hypothesis], one: Hypothesis) -> bool:
    """Whether a change over time is small against an earlier one: no swing is quite a sinusoid."""
    earlier = [other for other in named if other.is_change]
    if not one.is_change or not earlier:
        return False
    causes = [*named, one]
    ends = np.cumsum([other.columns.count for other in causes])[:-1]
    sizes = {
        id(cause): float(np.square(product(cause.columns.cosines, part)).sum())
        for cause, part in zip(causes, np.split(fitted_to(observed, causes).coefficients, ends), strict=True)
    }
    return sizes[id(one)] < _REST_SHARE**2 * max(sizes[id(other)] for other in earlier)


def fitted_to(observed: Observed, causes: Sequence[Hypothesis]) -> Fitted:
    """The fit of causes together; most are asked for twice, to compete and as equals of the best."""
    return _fitted_to(observed, tuple(causes))


@functools.lru_cache(maxsize=256)
def _fitted_to(observed: Observed, causes: tuple[Hypothesis, ...]) -> Fitted:
    return fitted(observed, together(observed, causes))


def forget_fits() -> None:
    """Drop the fits of a session: with its errors and hypotheses some 8 MB."""
    _fitted_to.cache_clear()
    forget_observed()


def together(observed: Observed, causes: Sequence[Hypothesis]) -> Columns:
    columns = Columns(np.zeros((3, 0)), np.zeros((len(observed.cosines), 3, 0)), np.zeros((len(observed.right), 0)))
    for one in causes:
        columns = columns + one.columns
    return columns


def score(observed: Observed, causes: Sequence[Hypothesis]) -> float:
    """Twice the log likelihood less what the last cause costs; hopeless outside of what nature allows."""
    fit = fitted_to(observed, causes)
    if not causes:
        return fit.twice_log_likelihood
    last = causes[-1]
    place = -last.columns.count
    slack = 3 * math.sqrt(max(float(fit.covariance[place, place]), 0.0))
    low, high = last.bounds
    inside = low - slack <= float(fit.coefficients[place]) <= high + slack
    return fit.twice_log_likelihood - last.cost if inside else -math.inf


def _explains(observed: Observed, causes: Sequence[Hypothesis]) -> float:
    """The score at the place that was found, whatever the search for it cost."""
    return score(observed, causes) + 2 * math.log(causes[-1].searched)


def _beside(named: Sequence[Hypothesis]) -> frozenset[str]:
    """Causes that are not tried any more: a constant error has one cause, and so has a change over time."""
    found = {one.cause for one in named}
    return frozenset().union(*(group for group in _EXCLUSIVE if found & group))


def _without_idle(observed: Observed, named: list[Hypothesis], best: Hypothesis) -> list[Hypothesis]:
    """The earlier causes that are still worth their columns beside the new one."""
    kept = list(named)
    for one in named:
        others = [other for other in kept if other is not one]
        with_it, without = (fitted_to(observed, [*some, best]).twice_log_likelihood for some in (kept, others))
        gain = with_it - without
        if gain < one.is_worth:
            kept = others
    return kept


def _outlasts_stars(model: SessionModel, observed: Observed, named: list[Hypothesis], best: Hypothesis) -> bool:
    """Whether a cause is more than single stars make: a change over time by those that keep their errors.

    What moves stars over the field must be seen without the one that tells most of it.
    """
    if not best.is_change:
        return model.field is None or _without_one(model.field, observed, named, best)
    size, by_frames, by_stars = _change(model, observed, [*named, best])
    inverse = pinv(by_frames + by_stars)
    of_stars = float(np.trace(product(inverse, by_stars))) / len(size)
    freedom = 1 / ((1 - of_stars) ** 2 / observed.cosines.size + of_stars**2 / model.stars_freedom)
    return float(product(size, inverse, size)) > best.is_sure(freedom)


def _without_one(field: FieldOfErrors, observed: Observed, named: list[Hypothesis], best: Hypothesis) -> bool:
    parts = np.flatnonzero(best.columns.field.any(axis=1))
    if not len(parts):
        return True
    star = field.most_told_by(parts)
    normal, right = field.normal - field.by_star[star], field.right - field.right_by_star[star]
    others = replace(observed, normal=normal, right=right)
    gain = fitted_to(others, [*named, best]).twice_log_likelihood - fitted_to(others, named).twice_log_likelihood
    return gain >= _LEAST_WITHOUT_ONE * best.is_worth


def _change(
    model: SessionModel, observed: Observed, causes: Sequence[Hypothesis]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """The last cause, a change over time: coefficients (P,), covariances (P, P) by frames and by what stars keep."""
    fit, count = fitted_to(observed, causes), causes[-1].columns.count
    by_stars = model.left_open(together(observed, causes), fit, count)
    return fit.coefficients[-count:], fit.covariance[-count:, -count:], by_stars


def told(
    model: SessionModel, observed: Observed, named: list[Hypothesis], one: Hypothesis, rivals: Sequence[Hypothesis]
) -> Named:
    others = [other for other in named if other is not one]
    fit = fitted_to(observed, [*others, one])
    count = one.columns.count
    covariance = fit.covariance[-count:, -count:]
    if one.is_change:
        covariance = covariance + model.left_open(together(observed, [*others, one]), fit, count)
    least = score(observed, [*others, one]) - EQUAL_WITHIN  # a place that was searched for is better by chance alone
    equals = [rival for rival in rivals if rival.cause != one.cause and _explains(observed, [*others, rival]) > least]
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return Named(one, fit.coefficients[-count:], errors, tuple(equals))
