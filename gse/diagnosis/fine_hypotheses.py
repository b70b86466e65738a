"""Hypotheses of fine causes: what each predicts of the error angles over time and of the stars over the field."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import betaincinv, chdtri

from gse.diagnosis.competing_models import PENALTY, Predictions
from gse.diagnosis.field_patterns import PARAMETERS
from gse.diagnosis.session_model import SessionModel
from gse.diagnosis.turns import EAST, all_turns, pole
from gse.statistics.budget_terms import AIR_MODEL
from gse.values.constants import EARTH_RATE_ARCSEC_PER_S
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
