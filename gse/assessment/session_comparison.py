"""Two nights side by side: figures, their differences, and which differences are a regression."""

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from gse.assessment.axis_statistics import block_means
from gse.assessment.counted_frames import false_answers
from gse.assessment.statistics import Statistics, statistics
from gse.instant import NS_PER_S
from gse.station.frame_table import STATUSES
from gse.station.results import Status
from gse.station.session_data import SessionData

PAIRED_SHARE = 0.9
"""Two nights are of the same panoramas when this share of the shorter one's are in both."""
SAME_WITHIN_NS = NS_PER_S
"""The UTC of a panorama differs by less between replays; a sensor that restarts repeats numbers and time tags."""

_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class Row:
    """One figure of both nights.

    ``sigmas`` says how significant the difference is, positive where the second night is worse (NaN: not known);
    ``worse`` is a regression: significant, and larger than what is allowed. A figure without ``gate`` is only shown.
    """

    name: str
    unit: str
    first: float
    second: float
    difference: float
    sigmas: float
    worse: bool
    gate: bool = True


@dataclass(frozen=True, slots=True)
class SessionComparison:
    """All rows; ``paired`` where both nights are of the same panoramas, which makes small differences significant."""

    rows: tuple[Row, ...]
    paired: bool

    @property
    def regressions(self) -> tuple[Row, ...]:
        """The rows in which the second night is worse."""
        return tuple(row for row in self.rows if row.worse)


def session_comparison(
    first: SessionData, second: SessionData, *, sigmas: float = 3.0, allowed_share: float = 0.01
) -> SessionComparison:
    """Compare two nights.

    The second is worse in a figure where the difference is beyond ``sigmas`` and larger than ``allowed_share`` of the
    first station's limit for it.
    """
    limits = first.station.limits
    figures = statistics(first), statistics(second)
    columns = first.frames.columns, second.frames.columns
    pairs = _pairs(*columns)
    measured = []
    for axis, label, limit in (
        ("d_ra_cosde", "dRA*", limits.d_ra_cosde_arcsec),
        ("d_de", "dDE", limits.d_de_arcsec),
    ):
        measured.append((_mean_abs(f"mean |{label}|", axis, columns, figures, pairs), allowed_share * limit))
        measured.append((_noise(f"NEA {label}", axis, figures), allowed_share * limit))
        measured.append((_bias(f"bias {label}", axis, figures), math.inf))
    measured.append((_availability(figures, columns, pairs), allowed_share))
    measured.append((_false(figures, columns, pairs), 0.0))
    if pairs is None:
        measured.append((_time(figures), math.inf))
    rows = tuple(_judged(row, sigmas, allowed) for row, allowed in measured)
    return SessionComparison(rows, pairs is not None)


_Pairs = tuple[NDArray[np.int64], NDArray[np.int64]]
_Columns = tuple[NDArray[np.void], NDArray[np.void]]
_Figures = tuple[Statistics, Statistics]


def _judged(row: Row, sigmas: float, allowed: float) -> Row:
    lower_is_better = row.name != "availability"
    loss = row.difference if lower_is_better else -row.difference
    worse = row.gate and row.sigmas > sigmas and loss > allowed
    return Row(row.name, row.unit, row.first, row.second, row.difference, row.sigmas, worse, row.gate)


def _pairs(first: NDArray[np.void], second: NDArray[np.void]) -> _Pairs | None:
    """Rows of the panoramas that are in both nights, or None where these are few."""
    common, one, two = np.intersect1d(first["time_us"], second["time_us"], return_indices=True)
    same = first["frame_no"][one] == second["frame_no"][two]
    same &= np.abs(first["utc_ns"][one] - second["utc_ns"][two]) < SAME_WITHIN_NS
    if len(common) == 0 or same.sum() < PAIRED_SHARE * min(len(first), len(second)):
        return None
    return one[same], two[same]


def _good(frames: NDArray[np.void]) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(frames["d_de_arcsec"]) & ~false_answers(frames), dtype=bool)


def _mean_abs(name: str, axis: str, columns: _Columns, figures: _Figures, pairs: _Pairs | None) -> Row:
    """Mean absolute error; the scatter of the difference is that of means over 20 s, paired where possible."""
    a, b = (session.onboard.axes[axis].mean_abs_arcsec for session in figures)
    errors = [np.abs(frames[f"{axis}_arcsec"]) for frames in columns]
    if pairs is not None:
        both = _good(columns[0])[pairs[0]] & _good(columns[1])[pairs[1]]
        change = (errors[1][pairs[1]] - errors[0][pairs[0]])[both]
        sigma = _sigma_of_mean(columns[0]["utc_ns"][pairs[0]][both], change)
    else:
        kept = [_good(frames) for frames in columns]
        parts = [
            _sigma_of_mean(frames["utc_ns"][good], error[good])
            for frames, good, error in zip(columns, kept, errors, strict=True)
        ]
        sigma = math.hypot(*parts)
    return Row(name, "arcsec", a, b, b - a, _sigmas(b - a, sigma), worse=False)


def _sigma_of_mean(utc_ns: NDArray[np.int64], values: NDArray[np.float64]) -> float:
    if len(values) < 2:
        return _NAN
    means = block_means((utc_ns - utc_ns[0]) / 1e9, values)
    return float(means.std(ddof=1) / math.sqrt(len(means)))


def _sigmas(difference: float, sigma: float) -> float:
    if sigma > 0:
        return difference / sigma
    return 0.0 if difference == 0 else math.copysign(math.inf, difference) if sigma == 0 else _NAN


def _noise(name: str, axis: str, figures: _Figures) -> Row:
    a, b = (session.onboard.axes[axis] for session in figures)
    sigma = math.hypot(*((one.nea_high_arcsec - one.nea_low_arcsec) / 2 / 1.96 for one in (a, b)))
    difference = b.nea_arcsec - a.nea_arcsec
    return Row(name, "arcsec", a.nea_arcsec, b.nea_arcsec, difference, _sigmas(difference, sigma), worse=False)


def _bias(name: str, axis: str, figures: _Figures) -> Row:
    """Shown, not gated: it may go either way, and mean |error| has it."""
    a, b = (session.onboard.axes[axis] for session in figures)
    sigma = math.hypot(a.bias_error_arcsec, b.bias_error_arcsec) / 1.96
    difference = b.bias_arcsec - a.bias_arcsec
    sigmas = _sigmas(difference, sigma)
    return Row(name, "arcsec", a.bias_arcsec, b.bias_arcsec, difference, sigmas, worse=False, gate=False)


def _availability(figures: _Figures, columns: _Columns, pairs: _Pairs | None) -> Row:
    a, b = (session.onboard.available for session in figures)
    missed = [~_answered_well(frames) for frames in columns]
    sigmas = _more_often(missed, pairs, (a.of - a.count, a.of), (b.of - b.count, b.of))
    return Row("availability", "", a.value, b.value, b.value - a.value, sigmas, worse=False)


def _false(figures: _Figures, columns: _Columns, pairs: _Pairs | None) -> Row:
    a, b = (session.onboard.false_answers for session in figures)
    false = [false_answers(frames) for frames in columns]
    sigmas = _more_often(false, pairs, (a.count, a.of), (b.count, b.of))
    return Row("false answers", "", a.count, b.count, b.count - a.count, sigmas, worse=False)


def _answered_well(frames: NDArray[np.void]) -> NDArray[np.bool_]:
    answered = frames["status"] == STATUSES.index(Status.IDENTIFIED)
    return np.asarray(answered & ~false_answers(frames), dtype=bool)


def _more_often(
    happened: list[NDArray[np.bool_]], pairs: _Pairs | None, first: tuple[int, int], second: tuple[int, int]
) -> float:
    """Whether something happens more often in the second night, in sigmas, negative for less often.

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


def _time(figures: _Figures) -> Row:
    """Shown, not gated: recorded times belong to a host. Panoramas that are in both nights have the same."""
    a, b = (session.onboard.time_ms.p99 for session in figures)
    return Row("identification time, 99 %", "ms", a, b, b - a, _NAN, worse=False, gate=False)
