"""The rows of a comparison, by what is compared: an axis, how often something happens, a figure with its bounds."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from gse.statistics.decision import COVERAGE_FACTOR
from gse.values.axis import Axis
from gse.values.limits import Limits
from gse.verdict.compared_axis import (
    Change,
    ComparedAxis,
    ComparedRow,
    ComparedSubject,
    Pairs,
    axis_rows,
    error_of_mean,
    sigmas_of,
)

_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class SideBySide:
    """One subject of two sessions side by side, and what a difference may be without being a regression.

    ``pairs`` are the panoramas that are in both, or None of different ones. Which stars the sensor took for its own
    answers is not known: then ``stars_are_known`` is False.
    """

    subjects: tuple[ComparedSubject, ComparedSubject]
    pairs: Pairs | None
    limits: Limits
    allowed_share: float
    bias_is_regression: bool
    stars_are_known: bool = True


CompareRows = Callable[[SideBySide], Iterator[ComparedRow]]


def along(axis: Axis) -> CompareRows:
    """Mean absolute error, noise and bias along an axis."""

    def rows(both: SideBySide) -> Iterator[ComparedRow]:
        one, two = (ComparedAxis.from_subject(subject, axis) for subject in both.subjects)
        # The same panoramas have the same fields: fewer stars identified in them is a loss of the second.
        growth = 1.0 if both.pairs is not None else one.growth(two)
        if not both.stars_are_known:  # a poorer field only excuses the noise of the second
            growth = min(growth, 1.0)
        yield from axis_rows(
            axis.label,
            one,
            two,
            paired=_paired_change(axis, both),
            allowed=both.allowed_share * both.limits.of(axis),
            growth=growth,
            bias_is_regression=both.bias_is_regression,
        )

    return rows


def not_compared(_: SideBySide) -> Iterator[ComparedRow]:
    """Of a row that others stand for, or that says more of a host than of a sensor."""
    return iter(())


def good_answers(both: SideBySide) -> Iterator[ComparedRow]:
    """The share of the expected frames with a good answer."""
    a, b = (subject.statistics.available for subject in both.subjects)
    missed = [subject.missed for subject in both.subjects]
    sigmas = _more_often(missed, both.pairs, (a.of - a.count, a.of), (b.of - b.count, b.of))
    difference = b.value - a.value
    yield ComparedRow(
        "availability", "", a.value, b.value, b.value, difference, sigmas, both.allowed_share, at_least=True
    )


def false_answers(both: SideBySide) -> Iterator[ComparedRow]:
    """False answers: each one more counts."""
    a, b = (subject.statistics.false_answers for subject in both.subjects)
    false = [subject.false for subject in both.subjects]
    sigmas = _more_often(false, both.pairs, (a.count, a.of), (b.count, b.of))
    yield ComparedRow("false answers", "", a.count, b.count, b.count, b.count - a.count, sigmas, 0.0)


def slow_answers(both: SideBySide) -> Iterator[ComparedRow]:
    """Answers that took longer than the limit by the clock of who gave them: by this host's they say nothing."""
    if not all(subject.statistics.time_is_stated for subject in both.subjects):
        return
    a, b = (subject.statistics.slow for subject in both.subjects)
    slow = [subject.slow for subject in both.subjects]
    sigmas = _more_often(slow, both.pairs, (a.count, a.of), (b.count, b.of))
    yield ComparedRow("slow answers", "", a.count, b.count, b.count, b.count - a.count, sigmas, 0.0)


@dataclass(frozen=True, slots=True)
class Bounded:
    """A value with its one-sided 95 % bounds."""

    value: float
    lower: float
    upper: float

    @property
    def standard(self) -> float:
        """The standard error that the bounds stand for."""
        return (self.upper - self.lower) / 2 / COVERAGE_FACTOR


def bounded_row(name: str, unit: str, one: Bounded, two: Bounded, *, both: SideBySide, allowed: float) -> ComparedRow:
    """Any value that has bounds; those of the same panoramas are not independent, so that nothing follows from them."""
    error = math.hypot(one.standard, two.standard) if both.pairs is None else _NAN
    difference = two.value - one.value
    return ComparedRow(name, unit, one.value, two.value, two.value, difference, sigmas_of(difference, error), allowed)


def _paired_change(axis: Axis, both: SideBySide) -> Change | None:
    """None of different panoramas, or where none of them was answered well in both sessions."""
    if both.pairs is None:
        return None
    errors = [np.abs(subject.errors[axis.column]) for subject in both.subjects]
    good = both.subjects[0].good[both.pairs[0]] & both.subjects[1].good[both.pairs[1]]
    change = (errors[1][both.pairs[1]] - errors[0][both.pairs[0]])[good]
    return Change(float(change.mean()), error_of_mean(change)) if len(change) else None


def _more_often(
    happened: list[NDArray[np.bool_]], pairs: Pairs | None, first: tuple[int, int], second: tuple[int, int]
) -> float:
    """Whether something happens more often in the second session, in sigmas, negative for less often.

    McNemar's exact test where every frame has its pair, else Fisher's; 0 where neither direction is likelier.
    """
    if pairs is not None and len(pairs[0]) == len(happened[0]) == len(happened[1]):
        one, two = happened[0][pairs[0]], happened[1][pairs[1]]
        only_one, only_two = int((one & ~two).sum()), int((two & ~one).sum())
        if only_one + only_two == 0:
            return 0.0
        both = only_one + only_two
        p = [float(scipy.stats.binomtest(count, both, alternative="greater").pvalue) for count in (only_two, only_one)]
    elif min(first[1], second[1]) == 0:
        return _NAN
    else:
        table = np.array([[second[0], second[1] - second[0]], [first[0], first[1] - first[0]]])
        p = [float(scipy.stats.fisher_exact(rows, alternative="greater").pvalue) for rows in (table, table[::-1])]
    more, less = (float(scipy.stats.norm.isf(min(max(value, 1e-300), 0.5))) for value in p)
    return more if more >= less else -less
