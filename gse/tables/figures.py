"""Figures of a session as columns: statistics of each subject, and the truth uncertainty."""

from collections.abc import Iterator

from gse.axis import ALL_AXES, AXES, CROSS_X, CROSS_Y
from gse.budget.truth_budget import TruthUncertaintyBudget
from gse.budget.uncertainty import AxisUncertainty, Term
from gse.station.frame_table import ANSWER_CHECKS, STATUSES
from gse.station.results import Subject
from gse.statistics.axis_statistics import AxisStatistics
from gse.statistics.session_statistics import Statistics
from gse.statistics.spatial_errors import SpatialErrors
from gse.statistics.subject_statistics import SubjectStatistics
from gse.statistics.thermal import ThermalError
from gse.tables.records import COUNT, Column, column, columns_of, records

_BY_KEY = ("statuses", "answer_checks", "subjects", "spatial", "exclusions", "counted", "own", "arrival_ms")
"""Fields of Statistics that are not plain values: they have columns of their own."""


def figures(stats: Statistics | None) -> Iterator[Column]:
    """The columns of all statistics; null without any."""
    yield from columns_of(Statistics, stats, without=_BY_KEY)
    for stem, words, counts in (
        ("status", STATUSES, stats.statuses if stats else {}),
        ("answer_check", ANSWER_CHECKS, stats.answer_checks if stats else {}),
    ):
        for word in words:
            yield column(f"{stem}_{word.value.lower()}", COUNT, counts.get(word.value))
    for subject in Subject:
        yield from _of_subject(subject, stats.subjects.get(subject) if stats else None)
    for place, axis in enumerate((CROSS_X, CROSS_Y)):
        of_axis = stats.spatial[place] if stats and stats.spatial else None
        yield from columns_of(SpatialErrors, of_axis, f"onboard_{axis.key}_star")


def _of_subject(subject: Subject, stats: SubjectStatistics | None) -> Iterator[Column]:
    yield from columns_of(
        SubjectStatistics, stats, subject.value, without=("subject", "axes", "thermal", "time_is_stated")
    )
    for axis in ALL_AXES:
        stem = f"{subject.value}_{axis.key}"
        yield from columns_of(AxisStatistics, stats.axes[axis.key] if stats else None, stem)
        yield from columns_of(ThermalError, stats.thermal.get(axis.key) if stats else None, f"{stem}_thermal")


def truth_figures(budget: TruthUncertaintyBudget | None) -> Iterator[Column]:
    """The columns of the truth uncertainty budget."""
    for axis in AXES:
        of_axis = budget.axes[axis.key] if budget else None
        # k is expanded / standard; a column that ends in _k is in kelvin.
        yield from columns_of(AxisUncertainty, of_axis, f"truth_{axis.key}", without=("k",))
    yield records(Term, budget.terms if budget else None, "truth_terms")
