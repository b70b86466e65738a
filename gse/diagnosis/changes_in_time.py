"""Searches for the instant of a step and the period of a sinusoid."""

import functools
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from gse.constants import EARTH_RATE_ARCSEC_PER_S
from gse.diagnosis.competing_models import Columns, Fitted, Observed, white_precision
from gse.diagnosis.fine_hypotheses import Hypothesis
from gse.diagnosis.session_model import SessionModel
from gse.diagnosis.turns import all_turns, pole
from gse.matrices import product

STEPS = ("clock step", "slip of the mount")
_STEPS = 96
_FEWEST_CYCLES, _CYCLE_STEP = 1.0, 0.25
_SINUSOID_MOST_SHARE = 0.25
"""Of the ordinates: shorter periods are vibration, or pixels that stars cross."""
_SINUSOID_LEAST_S = 60.0
_SWINGS = {"sinusoid": (0, 1), "columns": (0,), "rows": (1,)}


def steps(model: SessionModel, observed: Observed, base: Fitted, named: Columns) -> Iterator[Hypothesis]:
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


def _step(model: SessionModel, searched: int, cause: str, kind: str, is_before: bool, place: float) -> Hypothesis:
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
    return Hypothesis(
        cause,
        kind,
        model.columns(*each),
        True,
        searched,
        float(time_s[first]),
        place=first,
        spacing=len(time_s) / (_STEPS + 1),
        moved=functools.partial(_step, model, searched, cause, kind, is_before),
    )


def sinusoids(model: SessionModel, observed: Observed, base: Fitted, named: Columns) -> Iterator[Hypothesis]:
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


def _wave(model: SessionModel, searched: int, kind: str, cycles: float) -> Hypothesis:
    """A sinusoid of so many cycles in the session."""
    period_s = model.series.duration_s / cycles
    phase = 2 * math.pi * model.series.time_s / period_s
    waves = np.sin(phase), np.cos(phase)
    each = [np.outer(wave, np.eye(3)[axis]) for axis in _SWINGS[kind] for wave in waves]
    return Hypothesis(
        "thermal sinusoid",
        kind,
        model.columns(*each),
        True,
        searched,
        period_s,
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
