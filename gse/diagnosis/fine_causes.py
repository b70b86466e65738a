"""Fine causes: models of what may be wrong compete for the errors of a session.

Each cause is a hypothesis that predicts the three error angles over time and the residuals of the stars over the field
(gse.diagnosis.competing_models). The one with the best score is named, then the best beside it, as long as each is
worth more than its columns cost. Causes that explain the same nearly as well are its equals.
"""

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv, chdtri

from gse.diagnosis.competing_models import (
    PENALTY,
    Fitted,
    Observed,
    Predictions,
    by_its_noise,
    fitted,
    forget_observed,
    white_precision,
)
from gse.diagnosis.field_patterns import PARAMETERS, FieldOfErrors
from gse.diagnosis.session_model import SessionModel
from gse.diagnosis.turns import EAST, all_turns, pole
from gse.statistics.budget_terms import AIR_MODEL
from gse.values.constants import EARTH_RATE_ARCSEC_PER_S
from gse.values.matrices import pinv, product
from gse.values.site import Site

FALSE_ALARM = 2e-3
"""Chance that a session in which nothing is wrong has a finding by noise."""
_HYPOTHESES = 25
"""Number of hypotheses that compete. Each has an equal share of the prior, split equally over the places where it is
searched."""
MOST_HPA, _COLDEST_K = 1085.0, 180.0
"""The highest pressure and the lowest temperature on record: air that is colder than stated bends light as denser."""
ZERO_C_K = 273.15
TANGENTIAL = "tangential"
_ORIGINS_PX = (-1.0, -0.5, 0.5, 1.0)
"""Pixels that are counted from 1, or from the corner of the first one."""
_ORIGIN_ERROR_PX = 0.1
"""What is known worse is near to one of these by chance."""
_MOST_FOCAL = 0.25
"""As a share: more is another lens."""
_MOST_PPM = (-9e6, 9e5)
"""Of the time that it shows: a clock between ten times too slow and ten times too fast. Time tags in 1/1024 s that are
read as ms run 2.4 % fast."""
_MOST_STEP_S, MOST_SLIP_ARCSEC, _MOST_ARCSEC_PER_H = 3600.0, 36_000.0, 65_000.0
"""An hour, ten degrees, and a little more than the sky turns: beyond them a step of the errors is of another kind."""
MOST_SWING_ARCSEC = 600.0
"""No heater and no fan swings or shakes a mount by more than ten arcminutes."""


@dataclass(frozen=True, slots=True, eq=False)
class FineHypothesis:
    """A cause with its columns; ``searched`` places were tried for ``at_s``, an instant or a period.

    ``is_change`` over time; ``bounds`` are what nature allows the first coefficient, and ``known`` is how well it is
    stated (95 %): what is smaller is not a mistake.
    ``moved`` gives it at another ``place`` than those that were tried, ``spacing`` apart. A coefficient that can be
    ``only`` some values is that of a mistake without a size of its own.
    """

    cause: str
    kind: str
    columns: Predictions
    is_change: bool = False
    searched: int = 1
    at_s: float = math.nan
    bounds: tuple[float, float] = (-math.inf, math.inf)
    known: float = 0.0
    place: float = math.nan
    spacing: float = 0.0
    moved: "Callable[[float], FineHypothesis] | None" = None
    only: tuple[float, ...] = ()

    def allows(self, coefficient: float, error: float) -> bool:
        """Whether nature allows a first coefficient that is known so well: within bounds, or one of some values."""
        low, high = self.bounds
        slack = 3 * error
        if self.only:
            off = min(abs(coefficient - value) for value in self.only)
            return error <= _ORIGIN_ERROR_PX and off <= max(slack, _ORIGIN_ERROR_PX)
        return low - slack <= coefficient <= high + slack

    @property
    def cost(self) -> float:
        """What it must be better by than a rival without columns."""
        return PENALTY * self.columns.count + 2 * math.log(self.searched)

    @property
    def is_worth(self) -> float:
        """By how much twice the log likelihood must grow: what noise does with so small a chance."""
        return float(chdtri(self.columns.count, self._chance))

    def is_sure(self, freedom: float) -> float:
        """What the size squared, in its own covariance, must reach, where that is known with so much ``freedom``."""
        count = self.columns.count
        rest = float(betaincinv(freedom / 2, count / 2, self._chance))
        return freedom * (1 - rest) / rest

    @property
    def _chance(self) -> float:
        return FALSE_ALARM / _HYPOTHESES / self.searched


def constant_causes(model: SessionModel) -> Iterator[FineHypothesis]:
    if model.is_fitted:
        return
    ones = np.ones(len(model.series.time_s))
    north = pole(model.site)
    axes = model.axes()
    yield FineHypothesis("clock offset", "clock", model.columns(model.along(north, EARTH_RATE_ARCSEC_PER_S * ones)))
    for name, axis in axes.items():
        yield FineHypothesis("mount", name, model.columns(model.along(axis, ones)))
    yield FineHypothesis("site", "latitude", model.columns(model.along(EAST, ones)))
    if any(model.pixel_arcsec):
        shifted = np.outer(ones, [*model.pixel_arcsec, 0.0])
        yield FineHypothesis("pixel origin", "pixel origin", model.columns(shifted), only=_ORIGINS_PX)
    yield FineHypothesis("mount", "mount", model.columns(*(model.along(axis, ones) for axis in all_turns(model.mount))))


def causes_of_field(model: SessionModel) -> Iterator[FineHypothesis]:
    if model.field is None:
        return
    shifts = np.stack(
        [
            [np.interp(model.series.rows, model.field.rows, model.field.shifts[:, axis, part]) for axis in range(3)]
            for part in range(len(PARAMETERS))
        ]
    )

    def of(cause: str, *names: str) -> FineHypothesis:
        parts = [PARAMETERS.index(name) for name in names]
        field = np.zeros((len(PARAMETERS), len(parts)))
        field[parts, range(len(parts))] = 1.0
        return FineHypothesis(cause, cause, model.columns(*(shifts[part].T for part in parts), field=field))

    yield replace(of("focal length", "focal length"), bounds=(-_MOST_FOCAL, _MOST_FOCAL))
    yield of("distortion", "k1")
    yield replace(of("distortion", "k1", "k2"), kind="k1 and k2")
    yield replace(of("distortion", "p1", "p2"), kind=TANGENTIAL)
    yield of("principal point", "principal point x", "principal point y")
    for kind, way in (("columns", 1.0), ("rows", -1.0)):  # one of the two scales alone: half of it is a focal length's
        pitch = np.zeros((len(PARAMETERS), 1))
        pitch[PARAMETERS.index("focal length")], pitch[PARAMETERS.index("pixel pitch")] = -0.5, way
        moved = -0.5 * shifts[PARAMETERS.index("focal length")] + way * shifts[PARAMETERS.index("pixel pitch")]
        yield FineHypothesis(
            "pixel pitch", kind, model.columns(moved.T, field=pitch), bounds=(-_MOST_FOCAL, _MOST_FOCAL)
        )
    if not model.is_fitted:
        stated_hpa = model.site.air_pressure_hpa
        densest_hpa = MOST_HPA * (model.site.air_temperature_c + ZERO_C_K) / _COLDEST_K
        yield replace(
            of("refraction", "pressure"), bounds=(-stated_hpa, densest_hpa - stated_hpa), known=_known_hpa(model.site)
        )


def _known_hpa(site: Site) -> float:
    """How well the site states its air (95 %): pressure, temperature as a pressure, and the colour of the stars."""
    by_temperature = site.temperature_uncertainty_c / (site.air_temperature_c + ZERO_C_K)
    return math.hypot(site.pressure_uncertainty_hpa, site.air_pressure_hpa * math.hypot(by_temperature, AIR_MODEL))


def most_of_step(cause: str) -> tuple[float, float]:
    """What nature allows the step of a clock, in s, or the slip of a mount, in arcsec."""
    most = _MOST_STEP_S if cause == "clock step" else MOST_SLIP_ARCSEC
    return -most, most


def drifts(model: SessionModel) -> Iterator[FineHypothesis]:
    """From the first frame, or to the last: when it was right is not known."""
    time_s = model.series.time_s
    for since_s in (0.0, model.series.duration_s / 2, model.series.duration_s):
        ramp = time_s - since_s
        about_pole = model.columns(model.along(pole(model.site), EARTH_RATE_ARCSEC_PER_S * 1e-6 * ramp))
        yield FineHypothesis("clock drift", "clock drift", about_pole, is_change=True, bounds=_MOST_PPM)
        most = (-_MOST_ARCSEC_PER_H, _MOST_ARCSEC_PER_H)
        for name, axis in model.axes().items():
            column = model.columns(model.along(axis, ramp / 3600))
            yield FineHypothesis("mount moves", name, column, is_change=True, bounds=most)
        each = (model.along(axis, ramp / 3600) for axis in all_turns(model.mount))
        yield FineHypothesis("mount moves", "mount moves", model.columns(*each), is_change=True, bounds=most)


# Searches for the instant of a step and the period of a sinusoid.

STEPS = ("clock step", "slip of the mount")
_STEPS = 96
_FEWEST_CYCLES, _CYCLE_STEP = 1.0, 0.25
_SINUSOID_MOST_SHARE = 0.25
"""Largest share of the ordinates; shorter periods are vibration, or pixels that stars cross."""
_SINUSOID_LEAST_S = 60.0
_SWINGS = {"sinusoid": (0, 1), "columns": (0,), "rows": (1,)}


def steps(model: SessionModel, observed: Observed, base: Fitted, named: Predictions) -> Iterator[FineHypothesis]:
    """A step at the best place of many, of the clock, of one angle of the mount, or of all."""
    count = len(model.series.time_s)
    places = np.unique(np.linspace(0, count, _STEPS + 2)[:-1].astype(np.int64))[1:]
    if not len(places):
        return
    courses = model.series.cosines((np.arange(count)[:, None] >= places).astype(np.float64))
    left = observed.cosines - product(named.cosines, base.coefficients)
    gains = _gains(courses, left, base.precision)
    of_place = functools.partial(_step, model, len(places))
    for first in {int(places[gain.argmax()]) for gain in gains}:
        for is_before in (False, True):
            yield of_place("clock step", "clock step", is_before, first)
            for kind in (*model.axes(), "slip"):
                yield of_place("slip of the mount", kind, is_before, first)


def _step(model: SessionModel, searched: int, cause: str, kind: str, is_before: bool, place: float) -> FineHypothesis:
    """The step at a row: an error from then on, or ``is_before`` it."""
    time_s = model.series.time_s
    first = min(max(round(place), 1), len(time_s) - 1)
    after = (np.arange(len(time_s)) >= first).astype(np.float64)
    course = after - is_before
    if cause == "clock step":
        each = [model.along(pole(model.site), EARTH_RATE_ARCSEC_PER_S * course)]
    else:
        axes = model.axes()
        each = [model.along(axis, course) for axis in ([axes[kind]] if kind in axes else all_turns(model.mount))]
    return FineHypothesis(
        cause,
        kind,
        model.columns(*each),
        True,
        searched,
        float(time_s[first]),
        bounds=most_of_step(cause),
        place=first,
        spacing=len(time_s) / (_STEPS + 1),
        moved=functools.partial(_step, model, searched, cause, kind, is_before),
    )


def sinusoids(model: SessionModel, observed: Observed, base: Fitted, named: Predictions) -> Iterator[FineHypothesis]:
    """A sinusoid of the best period of many."""
    duration_s, time_s = model.series.duration_s, model.series.time_s
    most = min(_SINUSOID_MOST_SHARE * len(observed.cosines), duration_s / _SINUSOID_LEAST_S)
    cycles = np.arange(_FEWEST_CYCLES, most + 1e-9, _CYCLE_STEP)
    if not len(cycles):
        return
    left = observed.cosines - product(named.cosines, base.coefficients)
    phases = np.outer(time_s, 2 * math.pi / duration_s * cycles)
    one, other = (model.series.cosines(of(phases)) for of in (np.cos, np.sin))
    one /= np.linalg.norm(one, axis=0)
    other -= one * (one * other).sum(axis=0)
    other /= np.linalg.norm(other, axis=0)
    courses = np.stack([one, other], axis=2).reshape(len(left), -1)
    gains = _gains(courses, left, base.precision).reshape(2, -1, 2).sum(axis=2)
    for cycle in {float(cycles[gain.argmax()]) for gain in gains}:
        for kind in _SWINGS:
            yield _wave(model, len(cycles), kind, cycle)


def _wave(model: SessionModel, searched: int, kind: str, cycles: float) -> FineHypothesis:
    """A sinusoid of so many cycles in the session."""
    period_s = model.series.duration_s / cycles
    phase = 2 * math.pi * model.series.time_s / period_s
    waves = np.sin(phase), np.cos(phase)
    each = [np.outer(wave, np.eye(3)[axis]) for axis in _SWINGS[kind] for wave in waves]
    return FineHypothesis(
        "thermal sinusoid",
        kind,
        model.columns(*each),
        True,
        searched,
        period_s,
        bounds=(-MOST_SWING_ARCSEC, MOST_SWING_ARCSEC),
        place=cycles,
        spacing=_CYCLE_STEP,
        moved=functools.partial(_wave, model, searched, kind),
    )


def _gains(
    courses: NDArray[np.float64], left: NDArray[np.float64], precision: NDArray[np.float64]
) -> NDArray[np.float64]:
    """By how much each course (K, S), of any size on each axis, explains what is left (K, 3): (2, S).

    In the first row with the noise that was found without it, which took a step for slow noise, in the second with
    white noise.
    """
    gains = []
    for weight in (precision, white_precision(left)):
        top = product(courses.T, weight * left)
        gains.append((top**2 / np.maximum(product((courses**2).T, weight), 1e-300)).sum(axis=1))
    return np.array(gains)


EQUAL_WITHIN = 9.0
"""Three standard errors."""
_MOST_CAUSES = 3
_EXCLUSIVE = (
    frozenset({"clock offset", "mount", "site", "pixel origin"}),
    frozenset({"clock drift", "mount moves"}),
    frozenset({"focal length", "distortion", "refraction", "pixel pitch"}),
)
_LEAST_WITHOUT_ONE = 0.5
"""Share of its worth that a cause keeps without any one star; in a field of few stars one at the edge may tell half of
a distortion."""
_AROUND = 5
"""Frames next to one whose median says what it would be if it were no outlier."""
_REFINEMENTS = 6
_REST_SHARE = 0.2
"""A change over time that is smaller than this share of an earlier one is taken for what that one left."""


@dataclass(frozen=True, slots=True, eq=False)
class Named:
    """A cause that was found: coefficients (P,) in the units of its columns, with standard errors, and its equals."""

    hypothesis: FineHypothesis
    coefficients: NDArray[np.float64]
    errors: NDArray[np.float64]
    equals: tuple[FineHypothesis, ...]


def fine_causes(model: SessionModel) -> tuple[Named, ...]:
    """The causes that are worth their columns, the best first."""
    observed = model.observed()
    fixed = [*constant_causes(model), *causes_of_field(model), *drifts(model)]
    named: list[FineHypothesis] = []
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


def _of_its_noise(observed: Observed, named: list[FineHypothesis], one: FineHypothesis) -> float:
    """What slow noise alone gains as an explanation of a change over time, if the change does not make it white."""
    if not one.is_change:
        return 0.0
    left = [
        observed.cosines - product(together(observed, causes).cosines, fitted_to(observed, causes).coefficients)
        for causes in (named, [*named, one])
    ]
    return by_its_noise(*left)


def _is_seen(model: SessionModel, observed: Observed, named: list[FineHypothesis], one: FineHypothesis) -> bool:
    """Whether what a cause does to the stars is more than their places on the pixels do, and than is stated."""
    if model.field is None or not one.columns.field.any():
        return True
    coefficients = fitted_to(observed, [*named, one]).coefficients[-one.columns.count :]
    if abs(float(coefficients[0])) < one.known:
        return False
    moved_px = product(model.field.moved_px, product(one.columns.field, coefficients))
    return bool((moved_px**2).sum(axis=1).mean() >= model.field.least_px**2)


def _is_of_one_frame(model: SessionModel, named: list[FineHypothesis], one: FineHypothesis) -> bool:
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


def _refined(observed: Observed, named: list[FineHypothesis], found: FineHypothesis) -> FineHypothesis:
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


def _is_rest(observed: Observed, named: list[FineHypothesis], one: FineHypothesis) -> bool:
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


def fitted_to(observed: Observed, causes: Sequence[FineHypothesis]) -> Fitted:
    """The fit of causes together; most are asked for twice, to compete and as equals of the best."""
    return _fitted_to(observed, tuple(causes))


@functools.lru_cache(maxsize=256)
def _fitted_to(observed: Observed, causes: tuple[FineHypothesis, ...]) -> Fitted:
    return fitted(observed, together(observed, causes))


def forget_fits() -> None:
    """Drop the fits of a session: with its errors and hypotheses some 8 MB."""
    _fitted_to.cache_clear()
    forget_observed()


def together(observed: Observed, causes: Sequence[FineHypothesis]) -> Predictions:
    columns = Predictions(np.zeros((3, 0)), np.zeros((len(observed.cosines), 3, 0)), np.zeros((len(observed.right), 0)))
    for one in causes:
        columns = columns + one.columns
    return columns


def score(observed: Observed, causes: Sequence[FineHypothesis]) -> float:
    """Twice the log likelihood less what the last cause costs; hopeless outside of what nature allows."""
    fit = fitted_to(observed, causes)
    if not causes:
        return fit.twice_log_likelihood
    last = causes[-1]
    place = -last.columns.count
    error = math.sqrt(max(float(fit.covariance[place, place]), 0.0))
    is_allowed = last.allows(float(fit.coefficients[place]), error)
    return fit.twice_log_likelihood - last.cost if is_allowed else -math.inf


def _explains(observed: Observed, causes: Sequence[FineHypothesis]) -> float:
    """The score at the place that was found, whatever the search for it cost."""
    return score(observed, causes) + 2 * math.log(causes[-1].searched)


def _beside(named: Sequence[FineHypothesis]) -> frozenset[str]:
    """Causes that are not tried any more: a constant error has one cause, and so has a change over time."""
    found = {one.cause for one in named}
    return frozenset().union(*(group for group in _EXCLUSIVE if found & group))


def _without_idle(observed: Observed, named: list[FineHypothesis], best: FineHypothesis) -> list[FineHypothesis]:
    """The earlier causes that are still worth their columns beside the new one."""
    kept = list(named)
    for one in named:
        others = [other for other in kept if other is not one]
        with_it, without = (fitted_to(observed, [*some, best]).twice_log_likelihood for some in (kept, others))
        gain = with_it - without
        if gain < one.is_worth:
            kept = others
    return kept


def _outlasts_stars(model: SessionModel, observed: Observed, named: list[FineHypothesis], best: FineHypothesis) -> bool:
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


def _without_one(field: FieldOfErrors, observed: Observed, named: list[FineHypothesis], best: FineHypothesis) -> bool:
    parts = np.flatnonzero(best.columns.field.any(axis=1))
    if not len(parts):
        return True
    star = field.most_told_by(parts)
    normal, right = field.normal - field.by_star[star], field.right - field.right_by_star[star]
    others = replace(observed, normal=normal, right=right)
    gain = fitted_to(others, [*named, best]).twice_log_likelihood - fitted_to(others, named).twice_log_likelihood
    return gain >= _LEAST_WITHOUT_ONE * best.is_worth


def _change(
    model: SessionModel, observed: Observed, causes: Sequence[FineHypothesis]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """The last cause, a change over time: coefficients (P,), covariances (P, P) by frames and by what stars keep."""
    fit, count = fitted_to(observed, causes), causes[-1].columns.count
    by_stars = model.left_open(together(observed, causes), fit, count)
    return fit.coefficients[-count:], fit.covariance[-count:, -count:], by_stars


def told(
    model: SessionModel,
    observed: Observed,
    named: list[FineHypothesis],
    one: FineHypothesis,
    rivals: Sequence[FineHypothesis],
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
