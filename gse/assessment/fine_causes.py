"""Fine causes: models of what may be wrong compete for the errors of a session.

Each cause predicts the three error angles over time and the residuals over the field (gse.assessment.competing_models).
The one with the best score is named, then the best beside it, as long as each is worth more than its columns cost.
Causes that explain the same nearly as well are its equals.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from gse.assessment.competing_models import PENALTY, Columns, Fitted, Observed, fitted, white_precision
from gse.assessment.error_series import ErrorSeries
from gse.assessment.field_patterns import PARAMETERS, FieldOfErrors
from gse.assessment.turns import EAST, VERTICAL, all_turns, level_axis, pole
from gse.constants import EARTH_RATE_ARCSEC_PER_S
from gse.mount import Mount
from gse.site import Site
from gse.star_influence import boresight_shifts
from gse.truth import horizon_to_sensor

FALSE_ALARM = 3e-5
"""Chance that noise explains a cause as well, for each place that was searched; of some twenty causes that compete."""
EQUAL_WITHIN = 9.0
"""Three standard errors."""
_MOST_CAUSES = 3
_EXCLUSIVE = (
    frozenset({"clock offset", "mount", "site"}),
    frozenset({"clock drift", "mount moves"}),
    frozenset({"focal length", "distortion", "refraction"}),
)
_LEAST_SIGMAS = 4.5
_STEPS = 96
_FEWEST_CYCLES, _CYCLE_STEP = 1.0, 0.25
_SINUSOID_MOST_SHARE = 0.25
"""Of the ordinates: shorter periods are vibration, or pixels that stars cross."""
_SINUSOID_LEAST_S = 60.0
_FLOOR_ARCSEC = np.array([0.3, 0.3, 1.0])
"""What the models of air and stars leave open, along columns, rows and about the boresight."""
_MOST_HPA = 1085.0
"""The highest pressure on record, at sea level."""
_PIXELS_LAST_S = 60.0
"""Whole pixels err alike for as long as a star takes over several of them."""
_UNTESTED_ARCSEC2 = 1e12


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """A cause with its columns; ``searched`` places were tried for ``at_s``, an instant or a period.

    ``weights`` (M,) give the size of a change over time; ``bounds`` are what nature allows the first coefficient.
    """

    cause: str
    kind: str
    columns: Columns
    weights: NDArray[np.float64] | None = None
    searched: int = 1
    at_s: float = math.nan
    bounds: tuple[float, float] = (-math.inf, math.inf)

    @property
    def cost(self) -> float:
        """What it must be better by than a rival without columns."""
        return PENALTY * self.columns.count + 2 * math.log(self.searched)

    @property
    def is_worth(self) -> float:
        """By how much twice the log likelihood must grow: what noise does with the chance of FALSE_ALARM."""
        return float(chdtri(self.columns.count, FALSE_ALARM / self.searched))


@dataclass(frozen=True, slots=True, eq=False)
class Named:
    """A cause that was found: coefficients (P,) in the units of its columns, with standard errors, and its equals."""

    hypothesis: Hypothesis
    coefficients: NDArray[np.float64]
    errors: NDArray[np.float64]
    equals: tuple[Hypothesis, ...]


@dataclass(frozen=True, slots=True, eq=False)
class SessionModel:
    """Errors and field of a session with the geometry that the causes need.

    ``mount`` is the one in force; ``is_fitted`` where it was fitted on the same sky, so that constant errors tell
    nothing.
    """

    series: ErrorSeries
    field: FieldOfErrors | None
    site: Site
    mount: Mount
    is_fitted: bool
    decorrelate: NDArray[np.float64]

    @classmethod
    def of(
        cls, series: ErrorSeries, field: FieldOfErrors | None, site: Site, mount: Mount, *, is_fitted: bool
    ) -> "SessionModel":
        """With the coordinates in which the upper half of the ordinates is independent and of variance one."""
        cosines = series.cosines(series.errors_arcsec)
        upper = cosines[len(cosines) // 2 :]
        covariance = upper.T @ upper / len(upper)
        covariance += np.diag(1e-6 + 1e-6 * np.diag(covariance))
        return cls(series, field, site, mount, is_fitted, np.linalg.inv(np.linalg.cholesky(covariance)))

    def observed(self) -> Observed:
        """What the models compete for."""
        errors = self.series.errors_arcsec @ self.decorrelate.T
        lasting = np.diag(_FLOOR_ARCSEC**2)
        if self.field is not None:
            lasting = lasting + self.lasting_arcsec2(np.full(len(errors), 1 / len(errors)))
        if self.is_fitted:
            lasting = np.eye(3) * _UNTESTED_ARCSEC2
        field = self.field
        return Observed(
            len(errors),
            errors.mean(axis=0),
            self.decorrelate @ lasting @ self.decorrelate.T,
            self.series.cosines(errors),
            field.normal if field else np.eye(len(PARAMETERS)),
            field.right if field else np.zeros(len(PARAMETERS)),
            field.freedom if field else 0.0,
        )

    def lasting_arcsec2(self, weights: NDArray[np.float64]) -> NDArray[np.float64]:
        """Covariance (3, 3) of the weighted (M,) sum of the errors, by what single stars keep; zero without stars."""
        if self.field is None:
            return np.zeros((3, 3))
        of_pixels = self.field.stars.of_whole_pixels_arcsec2() / (1 + self.series.duration_s / _PIXELS_LAST_S)
        return self.field.stars.lasting_arcsec2(self._of_frames(weights)) + of_pixels

    def _of_frames(self, weights: NDArray[np.float64]) -> NDArray[np.float64]:
        """Weights of the series as those of the rows of the field's stars, with the same sum over frames."""
        assert self.field is not None
        stars = self.field.stars
        at = np.interp(stars.frames, self.series.rows, weights)
        return at * (len(self.series.rows) / len(np.unique(stars.frames)))

    def columns(self, *series_arcsec: NDArray[np.float64], field: NDArray[np.float64] | None = None) -> Columns:
        """Columns of errors (M, 3) each, with the parameters (F, P) of the field."""
        stacked = np.stack(series_arcsec, axis=2)
        turned = np.einsum("ij,mjp->mip", self.decorrelate, stacked)
        none = np.zeros((len(PARAMETERS), len(series_arcsec)))
        return Columns(turned.mean(axis=0), self.series.cosines(turned), none if field is None else field)

    def shift(self, axis_horizon: NDArray[np.float64]) -> NDArray[np.float64]:
        """Shifts (3,) of the error where the measured mount is turned by 1 about an axis of the horizon frame."""
        return np.asarray(boresight_shifts((horizon_to_sensor(self.mount) @ axis_horizon)[None])[0])

    def along(self, axis_horizon: NDArray[np.float64], over_time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Errors (M, 3) of turns (M,) about an axis."""
        return over_time[:, None] * self.shift(axis_horizon)

    def axes(self) -> dict[str, NDArray[np.float64]]:
        """The axes of the horizon frame about which the three angles of the mount grow."""
        boresight = horizon_to_sensor(self.mount)[2]
        return {"azimuth": VERTICAL, "altitude": -level_axis(self.mount), "roll": boresight}


def fine_causes(model: SessionModel) -> tuple[Named, ...]:
    """The causes that are worth their columns, the best first."""
    observed = model.observed()
    fixed = [*_constant(model), *_of_field(model), *_drifts(model)]
    named: list[Hypothesis] = []
    for _ in range(_MOST_CAUSES):
        base = _fit(observed, named)
        done = _beside(named)
        tried = [one for one in fixed if one.cause not in done]
        tried += [*_steps(model, observed, base, named), *_sinusoids(model, observed, base, named)]
        gains = [(_score(observed, [*named, one]) - base.twice_log_likelihood, one) for one in tried]
        seen = [item for item in gains if _is_seen(model, observed, named, item[1])]
        if not seen:
            break
        gain, best = max(seen, key=lambda item: item[0])
        if gain + best.cost < best.is_worth or not _outlasts_stars(model, observed, named, best):
            break
        named = [*_without_idle(observed, named, best), best]
    return tuple(_named(observed, named, one, fixed) for one in named)


def _is_seen(model: SessionModel, observed: Observed, named: list[Hypothesis], one: Hypothesis) -> bool:
    """Whether what a cause does to the stars is more than their places on the pixels do."""
    if model.field is None or not one.columns.field.any():
        return True
    coefficients = _fit(observed, [*named, one]).coefficients[-one.columns.count :]
    moved_px = model.field.moved_px @ (one.columns.field @ coefficients)
    return bool((moved_px**2).sum(axis=1).mean() >= model.field.least_px**2)


def _fit(observed: Observed, causes: Sequence[Hypothesis]) -> Fitted:
    return fitted(observed, _together(observed, causes))


def _together(observed: Observed, causes: Sequence[Hypothesis]) -> Columns:
    columns = Columns(np.zeros((3, 0)), np.zeros((len(observed.cosines), 3, 0)), np.zeros((len(observed.right), 0)))
    for one in causes:
        columns = columns + one.columns
    return columns


def _score(observed: Observed, causes: Sequence[Hypothesis]) -> float:
    """Twice the log likelihood less what the last cause costs; hopeless outside of what nature allows."""
    fit = _fit(observed, causes)
    if not causes:
        return fit.twice_log_likelihood
    last = causes[-1]
    place = -last.columns.count
    slack = 3 * math.sqrt(max(float(fit.covariance[place, place]), 0.0))
    low, high = last.bounds
    inside = low - slack <= float(fit.coefficients[place]) <= high + slack
    return fit.twice_log_likelihood - last.cost if inside else -math.inf


def _beside(named: Sequence[Hypothesis]) -> frozenset[str]:
    """Causes that are not tried any more: a constant error has one cause, and so has a change over time."""
    found = {one.cause for one in named}
    return frozenset().union(*(group for group in _EXCLUSIVE if found & group))


def _without_idle(observed: Observed, named: list[Hypothesis], best: Hypothesis) -> list[Hypothesis]:
    """The earlier causes that are still worth their columns beside the new one."""
    kept = list(named)
    for one in named:
        others = [other for other in kept if other is not one]
        gain = _fit(observed, [*kept, best]).twice_log_likelihood - _fit(observed, [*others, best]).twice_log_likelihood
        if gain < one.is_worth:
            kept = others
    return kept


def _outlasts_stars(model: SessionModel, observed: Observed, named: list[Hypothesis], best: Hypothesis) -> bool:
    """Whether a change over time is more than stars make that keep their errors while they cross their pixels."""
    if best.weights is None:
        return True
    fit = _fit(observed, [*named, best])
    count = best.columns.count
    size = model.series.errors_arcsec.T @ best.weights
    covariance = model.lasting_arcsec2(best.weights) + np.diag(_FLOOR_ARCSEC**2) * 0.01
    own = float(
        fit.coefficients[-count:] @ np.linalg.pinv(fit.covariance[-count:, -count:]) @ fit.coefficients[-count:]
    )
    by_stars = float(size @ np.linalg.inv(covariance) @ size)
    return own * by_stars / max(own + by_stars, 1e-300) > _LEAST_SIGMAS**2


def _named(observed: Observed, named: list[Hypothesis], one: Hypothesis, rivals: list[Hypothesis]) -> Named:
    others = [other for other in named if other is not one]
    fit = _fit(observed, [*others, one])
    count = one.columns.count
    best = _score(observed, [*others, one])
    equals = [
        rival for rival in rivals if rival.kind != one.kind and _score(observed, [*others, rival]) > best - EQUAL_WITHIN
    ]
    errors = np.sqrt(np.maximum(np.diag(fit.covariance)[-count:], 0.0))
    return Named(one, fit.coefficients[-count:], errors, tuple(equals))


def _constant(model: SessionModel) -> Iterator[Hypothesis]:
    if model.is_fitted:
        return
    ones = np.ones(len(model.series.time_s))
    north = pole(model.site)
    axes = model.axes()
    yield Hypothesis("clock offset", "clock", model.columns(model.along(north, EARTH_RATE_ARCSEC_PER_S * ones)))
    for name, axis in axes.items():
        yield Hypothesis("mount", name, model.columns(model.along(axis, ones)))
    yield Hypothesis("site", "latitude", model.columns(model.along(EAST, ones)))
    yield Hypothesis("mount", "mount", model.columns(*(model.along(axis, ones) for axis in all_turns(model.mount))))


def _of_field(model: SessionModel) -> Iterator[Hypothesis]:
    if model.field is None:
        return
    shifts = np.stack(
        [
            [np.interp(model.series.rows, model.field.rows, model.field.shifts[:, axis, part]) for axis in range(3)]
            for part in range(len(PARAMETERS))
        ]
    )

    def of(cause: str, *names: str) -> Hypothesis:
        parts = [PARAMETERS.index(name) for name in names]
        field = np.zeros((len(PARAMETERS), len(parts)))
        field[parts, range(len(parts))] = 1.0
        return Hypothesis(cause, cause, model.columns(*(shifts[part].T for part in parts), field=field))

    yield of("focal length", "focal length")
    yield of("distortion", "k1")
    yield replace(of("distortion", "k1", "k2"), kind="k1 and k2")
    yield of("principal point", "principal point x", "principal point y")
    if not model.is_fitted:
        stated_hpa = model.site.air_pressure_hpa
        yield replace(of("refraction", "pressure"), bounds=(-stated_hpa, _MOST_HPA - stated_hpa))


def _drifts(model: SessionModel) -> Iterator[Hypothesis]:
    """From the first frame, or to the last: when it was right is not known."""
    time_s = model.series.time_s
    for since_s in (0.0, model.series.duration_s / 2, model.series.duration_s):
        ramp = time_s - since_s
        weights = _weights(ramp)
        about_pole = model.columns(model.along(pole(model.site), EARTH_RATE_ARCSEC_PER_S * 1e-6 * ramp))
        yield Hypothesis("clock drift", "clock drift", about_pole, weights)
        for name, axis in model.axes().items():
            yield Hypothesis("mount moves", name, model.columns(model.along(axis, ramp / 3600)), weights)
        each = (model.along(axis, ramp / 3600) for axis in all_turns(model.mount))
        yield Hypothesis("mount moves", "mount moves", model.columns(*each), weights)


def _weights(over_time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of the least-squares coefficient of a course (M,) beside a mean, times its standard deviation."""
    off = over_time - over_time.mean()
    scale = float(off.std()) * len(off)
    return np.asarray(off / scale if scale > 0 else off)


def _steps(model: SessionModel, observed: Observed, base: Fitted, named: list[Hypothesis]) -> Iterator[Hypothesis]:
    """A step at the best place of many, of the clock, of one angle of the mount, or of all."""
    count = len(model.series.time_s)
    places = np.unique(np.linspace(0, count, _STEPS + 2)[1:-1].astype(np.int64))
    places = places[places > 0]
    if not len(places):
        return
    each = [model.series.cosines((np.arange(count) >= place).astype(np.float64)) for place in places]
    left = observed.cosines - _together(observed, named).cosines @ base.coefficients
    gains = _gains(np.column_stack(each), left, base.precision)
    for first in {int(places[gain.argmax()]) for gain in gains}:
        after = (np.arange(count) >= first).astype(np.float64)
        at_s = float(model.series.time_s[first])
        for course in (after, after - 1):
            yield from _about_axes(model, course, _weights(after), len(places), at_s)


def _about_axes(
    model: SessionModel, course: NDArray[np.float64], weights: NDArray[np.float64], searched: int, at_s: float
) -> Iterator[Hypothesis]:
    clock = model.columns(model.along(pole(model.site), EARTH_RATE_ARCSEC_PER_S * course))
    yield Hypothesis("clock step", "clock step", clock, weights, searched, at_s)
    for name, axis in model.axes().items():
        yield Hypothesis("slip of the mount", name, model.columns(model.along(axis, course)), weights, searched, at_s)
    each = (model.along(axis, course) for axis in all_turns(model.mount))
    yield Hypothesis("slip of the mount", "slip", model.columns(*each), weights, searched, at_s)


def _sinusoids(model: SessionModel, observed: Observed, base: Fitted, named: list[Hypothesis]) -> Iterator[Hypothesis]:
    """A sinusoid of the best period of many."""
    duration_s, time_s = model.series.duration_s, model.series.time_s
    most = min(_SINUSOID_MOST_SHARE * len(observed.cosines), duration_s / _SINUSOID_LEAST_S)
    cycles = np.arange(_FEWEST_CYCLES, most + 1e-9, _CYCLE_STEP)
    if not len(cycles):
        return
    left = observed.cosines - _together(observed, named).cosines @ base.coefficients
    gains = np.zeros((2, len(cycles)))
    for row, cycle in enumerate(cycles.tolist()):
        wave = np.exp(2j * math.pi * cycle / duration_s * time_s)
        orthogonal, _ = np.linalg.qr(model.series.cosines(np.column_stack([wave.real, wave.imag])))
        gains[:, row] = _gains(orthogonal, left, base.precision).sum(axis=1)
    for cycle in {float(cycles[gain.argmax()]) for gain in gains}:
        yield from _waves(model, duration_s / cycle, len(cycles))


def _waves(model: SessionModel, period_s: float, searched: int) -> Iterator[Hypothesis]:
    phase = 2 * math.pi * model.series.time_s / period_s
    waves = np.sin(phase), np.cos(phase)
    weights = _weights(_course(model, waves))
    for kind, axes in (("sinusoid", (0, 1)), ("columns", (0,)), ("rows", (1,))):
        each = [np.outer(wave, np.eye(3)[axis]) for axis in axes for wave in waves]
        yield Hypothesis("thermal sinusoid", kind, model.columns(*each), weights, searched, period_s)


def _course(model: SessionModel, waves: tuple[NDArray[np.float64], NDArray[np.float64]]) -> NDArray[np.float64]:
    """The wave with the phase of the axis that swings most."""
    errors = model.series.errors_arcsec @ model.decorrelate.T
    amplitude = np.array([errors.T @ (wave - wave.mean()) for wave in waves])
    most = amplitude[:, int((amplitude**2).sum(axis=0).argmax())]
    return np.asarray(most[0] * waves[0] + most[1] * waves[1])


def _gains(
    courses: NDArray[np.float64], left: NDArray[np.float64], precision: NDArray[np.float64]
) -> NDArray[np.float64]:
    """By how much each course (K, S), of any size on each axis, explains what is left (K, 3): (2, S).

    In the first row with the noise that was found without it, which took a step for slow noise, in the second with
    white noise.
    """
    gains = []
    for weight in (precision, white_precision(left)):
        top = courses.T @ (weight * left)
        gains.append((top**2 / np.maximum((courses**2).T @ weight, 1e-300)).sum(axis=1))
    return np.array(gains)
