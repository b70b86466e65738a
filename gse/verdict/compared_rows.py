"""The rows of a comparison, by what is compared: an axis, how often something happens, a figure with its bounds.

Along an axis two sessions stand side by side by bias, mean and noise, each with how well it is known.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from gse.diagnosis.field_content import FieldContent, field_content
from gse.station.columns import STATUSES
from gse.station.own_answers import SensorAnswers
from gse.station.results import ERRORS, Status, Subject
from gse.station.session_data import SessionData
from gse.statistics.axis_statistics import AxisStatistics, quick_errors
from gse.statistics.decision import COVERAGE_FACTOR
from gse.statistics.error_model import error_model
from gse.statistics.sampling import MIN_FRAMES
from gse.statistics.session_statistics import Statistics, statistics
from gse.statistics.subject_statistics import SubjectStatistics
from gse.values.axis import Axis
from gse.values.limits import Limits

# One subject of one session as a comparison takes it: its statistics, and which of its answers were good.

Pairs = tuple[NDArray[np.int64], NDArray[np.int64]]
"""Rows of the panoramas that are in both sessions."""


@dataclass(frozen=True, slots=True, eq=False)
class ComparedSubject:
    """Masks are over the rows (M,) of the frame table, and so are its ``errors``, in arcsec, by name.

    ``good`` answers were compared with truth and are not false; ``missed`` panoramas have no answer or a false one;
    ``slow`` ones took longer than the limit. ``fields`` is what the stars make of an axis.
    """

    statistics: SubjectStatistics
    utc_ns: NDArray[np.int64]
    errors: dict[str, NDArray[np.float64]]
    good: NDArray[np.bool_]
    missed: NDArray[np.bool_]
    false: NDArray[np.bool_]
    slow: NDArray[np.bool_]
    fields: dict[str, FieldContent]


@dataclass(frozen=True, slots=True, eq=False)
class ComparedSession:
    """The subject of the frame table, and the sensor's own answers beside panoramas; None where it sent none."""

    statistics: Statistics
    table: ComparedSubject
    sensor: ComparedSubject | None

    @classmethod
    def from_session(cls, session: SessionData) -> "ComparedSession":
        stats = statistics(session)
        fields = field_content(session, stats.counted.false)
        return cls(stats, _of_table(session, stats, fields), _of_sensor(session, stats, fields))

    def sensor_said_the_same(self, other: "ComparedSession", pairs: Pairs) -> bool:
        """Whether the sensor's own answers to panoramas that are in both, and their errors, are the same ones."""
        one, two = self.statistics.own, other.statistics.own
        return one is not None and two is not None and all(_same(one, two, name, pairs) for name in _SAID)


_SAID = ("acquired", "latency_ms", *ERRORS)


def _same(one: SensorAnswers, two: SensorAnswers, name: str, pairs: Pairs) -> bool:
    first, second = getattr(one, name)[pairs[0]], getattr(two, name)[pairs[1]]
    return np.array_equal(first.astype(np.float64), second.astype(np.float64), equal_nan=True)


def _of_table(session: SessionData, stats: Statistics, fields: dict[str, FieldContent]) -> ComparedSubject:
    frames = session.frames.columns
    false = stats.counted.false
    answered = frames["status"] == STATUSES.index(Status.IDENTIFIED)
    return ComparedSubject(
        stats.onboard,
        frames["utc_ns"],
        {name: frames[name] for name in ERRORS},
        np.asarray(np.isfinite(frames["d_de_arcsec"]) & ~false, dtype=bool),
        np.asarray(~(answered & ~false), dtype=bool),
        false,
        np.asarray(frames["elapsed_us"] / 1e3 > session.station.limits.identification_ms, dtype=bool),
        fields,
    )


def _of_sensor(session: SessionData, stats: Statistics, fields: dict[str, FieldContent]) -> ComparedSubject | None:
    own, frames = stats.own, session.frames.columns
    if own is None or stats.own_counted is None:
        return None
    false, good = stats.own_counted.false, stats.own_counted.used
    return ComparedSubject(
        stats.subjects[Subject.SENSOR],
        frames["utc_ns"],
        {name: getattr(own, name) for name in ERRORS},
        good,
        np.asarray(~(own.acquired & ~false), dtype=bool),
        false,
        np.asarray(own.latency_ms > session.station.limits.identification_ms, dtype=bool),
        fields,
    )


_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class ComparedRow:
    """One value of both sessions.

    ``alike`` is the second session's value as it would be over the fields of the first; ``difference`` is that less
    the first. ``sigmas`` says how significant the difference is, positive where the second session is worse (NaN: not
    known); ``worse`` is a regression: significant, and larger than ``allowed``. A value without ``gate`` is only shown.
    The second is worse with a larger value, ``at_least`` with a smaller one, ``either_way`` with any other one.
    """

    name: str
    unit: str
    first: float
    second: float
    alike: float
    difference: float
    sigmas: float
    allowed: float
    worse: bool = False
    gate: bool = True
    at_least: bool = False
    either_way: bool = False


class ComparedAxis(NamedTuple):
    """One axis of one session: its statistics, its stars, and standard errors by the order of its frames.

    ``noise_time_share`` is that of the noise equivalent angle, as a share of it.
    """

    statistics: AxisStatistics
    field: FieldContent
    time_error_arcsec: float
    time_error_abs_arcsec: float
    noise_time_share: float

    @classmethod
    def from_subject(cls, subject: ComparedSubject, axis: Axis) -> "ComparedAxis":
        errors = subject.errors[axis.column][subject.good]
        square = quick_errors(subject.utc_ns[subject.good], errors) ** 2
        noise_share = error_of_mean(square) / 2 / max(float(square.mean()), 1e-300) if len(square) else _NAN
        by_time = error_of_mean(errors), error_of_mean(np.abs(errors)), noise_share
        return cls(subject.statistics.axes[axis.key], subject.fields.get(axis.key, _NO_FIELD), *by_time)

    def growth(self, other: "ComparedAxis") -> float:
        """What takes the noise of another session to the fields of this one; 1 where they do not tell."""
        growth = self.field.geometry / other.field.geometry
        return growth if math.isfinite(growth) else 1.0

    @property
    def bias_error_arcsec(self) -> float:
        """Standard error of the bias: what frames show, and what stars keep."""
        return math.hypot(self.time_error_arcsec, self.field.bias_error_arcsec)

    @property
    def noise_error_arcsec(self) -> float:
        """Standard error of the noise equivalent angle: what frames show, or stars that differ."""
        return max(self.noise_time_share, self.field.noise_error_share) * self.statistics.nea_arcsec

    @property
    def mean_abs_error_arcsec(self) -> float:
        """Standard error of the mean absolute error: what frames show, or by bias and spread as of normal errors."""
        share = self.statistics.bias_arcsec / max(self.statistics.std_arcsec, 1e-9)
        by_bias = math.erf(share / math.sqrt(2)) * self.bias_error_arcsec
        spread_error = self.field.spread_error_share * self.statistics.std_arcsec
        by_stars = math.hypot(by_bias, math.sqrt(2 / math.pi) * math.exp(-(share**2) / 2) * spread_error)
        return max(by_stars, self.time_error_abs_arcsec)


_NO_FIELD = FieldContent(_NAN, 0.0, 0.0, 0.0)


class Change(NamedTuple):
    """Mean change of the absolute error of the panoramas that are in both sessions, and its standard error."""

    mean: float
    error: float


def axis_rows(
    label: str,
    one: ComparedAxis,
    two: ComparedAxis,
    *,
    paired: "Change | None",
    allowed: float,
    growth: float,
    bias_is_regression: bool = False,
) -> tuple[ComparedRow, ComparedRow, ComparedRow]:
    """Mean absolute error, noise equivalent angle and bias of both.

    ``growth`` takes the noise of the second to the fields of the first; ``allowed`` is a difference without meaning.
    """
    return (
        _mean_abs(f"mean |{label}|", one, two, growth, paired, allowed),
        _noise(f"NEA {label}", one, two, growth, allowed),
        _bias(f"bias {label}", one, two, allowed, gate=bias_is_regression),
    )


def _mean_abs(
    name: str, one: ComparedAxis, two: ComparedAxis, growth: float, change: "Change | None", allowed: float
) -> ComparedRow:
    """Mean absolute error; that of the second over the fields of the first by a normal distribution of its errors."""
    a, b = one.statistics.mean_abs_arcsec, two.statistics.mean_abs_arcsec
    if change is not None:
        return ComparedRow(
            name, "arcsec", a, b, a + change.mean, change.mean, sigmas_of(change.mean, change.error), allowed
        )
    bias, spread = two.statistics.bias_arcsec, two.statistics.std_arcsec
    alike = b + _folded_mean(bias, spread * growth) - _folded_mean(bias, spread)
    error = math.hypot(one.mean_abs_error_arcsec, growth * two.mean_abs_error_arcsec)
    return ComparedRow(name, "arcsec", a, b, alike, alike - a, sigmas_of(alike - a, error), allowed)


def _folded_mean(bias: float, spread: float) -> float:
    """Mean absolute value of a normal distribution."""
    share = bias / max(spread, 1e-9)
    return spread * math.sqrt(2 / math.pi) * math.exp(-(share**2) / 2) + bias * math.erf(share / math.sqrt(2))


def error_of_mean(values: NDArray[np.float64]) -> float:
    """Standard error of the mean of values (M,) in their order; of few, or of equal ones, as of independent values."""
    if len(values) < 2:
        return _NAN
    if len(values) < MIN_FRAMES or float(np.ptp(values)) == 0:
        return float(values.std(ddof=1) / math.sqrt(len(values)))
    return error_model(values).mean_error().standard


def sigmas_of(difference: float, sigma: float) -> float:
    """A difference in units of its standard error; infinite where that is zero, NaN where it is not known."""
    if sigma > 0:
        return difference / sigma
    return 0.0 if difference == 0 else math.copysign(math.inf, difference) if sigma == 0 else _NAN


def _noise(name: str, one: ComparedAxis, two: ComparedAxis, growth: float, allowed: float) -> ComparedRow:
    """Noise equivalent angle; that of the second over the fields of the first by their geometry."""
    a, b = one.statistics.nea_arcsec, two.statistics.nea_arcsec
    error = math.hypot(one.noise_error_arcsec, growth * two.noise_error_arcsec)
    difference = growth * b - a
    return ComparedRow(name, "arcsec", a, b, growth * b, difference, sigmas_of(difference, error), allowed)


def _bias(name: str, one: ComparedAxis, two: ComparedAxis, allowed: float, *, gate: bool) -> ComparedRow:
    """It may go either way; mean |error| has a large one."""
    a, b = one.statistics.bias_arcsec, two.statistics.bias_arcsec
    error = math.hypot(one.bias_error_arcsec, two.bias_error_arcsec)
    return ComparedRow(name, "arcsec", a, b, b, b - a, sigmas_of(b - a, error), allowed, gate=gate, either_way=True)


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
