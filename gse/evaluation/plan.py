"""Plans of ``gse evaluate``: the settings of both papers, and their results as rates with intervals."""

import math
import textwrap
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gse.evaluation.frames import Conditions, Optics
from gse.external.answers import Failure
from gse.statistics.sampling import Percentiles
from gse.values.camera import Camera
from gse.values.identifier_options import IdentifierOptions

# CPU times of any number of frames, counted to four digits: memory does not grow with the frames.

_NAN = float("nan")


class CpuTimes:
    """Counts of times in us; one that is unknown is a frame, but no time."""

    def __init__(self) -> None:
        self.frames = 0
        self._counts: Counter[float] = Counter()

    def add(self, cpu_us: float) -> None:
        """Count the time of a frame."""
        self.frames += 1
        if math.isfinite(cpu_us):
            self._counts[float(f"{cpu_us:.4g}")] += 1

    def percentiles(self) -> Percentiles:
        """As numpy's of the rounded times."""
        times = np.array(sorted(self._counts), dtype=np.float64)
        if not len(times):
            return Percentiles(0, _NAN, _NAN, _NAN, _NAN)
        ends = np.cumsum([self._counts[time] for time in times.tolist()])
        ranks = np.array([0.5, 0.95, 0.99]) * (ends[-1] - 1)
        lower, upper = (times[np.searchsorted(ends, rank, side="right")] for rank in (np.floor(ranks), np.ceil(ranks)))
        p50, p95, p99 = (lower + (ranks % 1) * (upper - lower)).tolist()
        return Percentiles(int(ends[-1]), p50, p95, p99, float(times[-1]))


SCHEMA = "gse.evaluation/1"
CONFIDENCE = 0.95


KINDS = ("right", "false", "none", "coarse")


@dataclass(frozen=True, slots=True)
class Cell:
    """One line of the table: an identifier under one set of conditions."""

    identifier: IdentifierOptions
    conditions: Conditions
    sky_limit: float = math.inf
    """Magnitude at which the sky ends, where errors are of angles."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Everything that decides the answers; ``catalog`` is a source as ``load_catalog`` takes it."""

    optics: Optics
    cells: tuple[Cell, ...]
    frames: int
    seed: int
    catalog: str
    angle_noise: bool = False

    @property
    def fewest_stars(self) -> int:
        """Frames with fewer real stars do not count."""
        return 3 if self.angle_noise else 4


@dataclass(frozen=True, slots=True)
class FrameOutcome:
    """Outcome of one frame of one cell; ``failure`` is how an external identifier failed, None where it did not.

    ``step_2`` is how many stars the second step of the pivot paper named, and how many of these are right.
    """

    cell: int
    frame: int
    kind: str
    real_stars: int
    cpu_us: float
    failure: Failure | None = None
    step_2: tuple[int, int] = (0, 0)


@dataclass(frozen=True, slots=True)
class Preset:
    """The conditions of a paper."""

    optics: Optics
    identifiers: tuple[str, ...]
    conditions: tuple[Conditions, ...]
    angle_noise: bool
    note: str


def _square(width_deg: float) -> Camera:
    return Camera(1024, 1024, 512 / math.tan(math.radians(width_deg) / 2), (511.5, 511.5))


_PIVOT_ERRORS = (
    *((arcsec, 0.1) for arcsec in (10.0, 20.0, 30.0, 40.0, 50.0)),
    *((10.0, magnitude) for magnitude in (0.2, 0.3, 0.4, 0.5)),
)
"""Errors of angular distance (arcsec) and magnitude along the axes of the pivot paper, figures 11 to 14; the paper
gives numbers for (10, 0.1), (50, 0.1) and (10, 0.5)."""

PIVOT_PAPER = "pivot-paper"
PRESETS = {
    PIVOT_PAPER: Preset(
        Optics("8 deg circular", _square(8.0), 6.0, field_of_view_deg=8.0),
        ("pivot", "match-group"),
        tuple(Conditions("angles", *errors, whole_pixels=False) for errors in _PIVOT_ERRORS),
        angle_noise=True,
        note="the paper's: 8 deg circular field, V = 6.0, 5 stars of each field, K = 4, noise on each angle between "
        "stars, 0.1 mag; ours, because it states none: tolerance 3 sigma, right = first star named right, stars within "
        "60 arcsec are one, without --catalog BSC5 Gaia to 5.7 mag, a gate of 1 mag for match-group; the paper's "
        "shares are those of a sky that ends where the catalogue does, while from one that goes on, as a real one "
        "does, magnitude noise lets stars appear that the catalogue does not have",
    ),
    "lapan": Preset(
        Optics("14 x 14 deg", _square(14.0), 6.0),
        ("neighbour",),
        tuple(Conditions("lapan", 10.0, 0.3, false_objects=count) for count in (0, 3, 8)),
        angle_noise=False,
        note="the paper's: whole pixels, 30 objects, tolerance 1.5 px, neighbours within the field; ours, because it "
        "states none: 14 x 14 deg, 1024 x 1024 px, 10 arcsec, 0.3 mag, limit 6.0 mag, 0, 3 and 8 false, Fn = Fn2 = 6",
    ),
}

SKY_LIMIT = 7.5
"""Magnitude at which the second sky of the pivot paper's preset ends: noise of 0.5 mag lets no fainter star appear."""

GAIA_LIMIT = 5.7
"""Gaia has as many stars to here as the Bright Star Catalogue of the pivot paper to V = 6.0."""


@dataclass(frozen=True, slots=True)
class Tally:
    """One cell's counts; ``excluded`` are those of frames with too few real stars. Times are CPU of all frames.

    ``failures`` are those of an external identifier by kind, in all frames, ``first_failure`` is the first in words;
    each counts as none, too. ``step_2`` is that of the outcomes, over the frames that count.
    """

    frames: int
    counted: dict[str, int]
    excluded: dict[str, int]
    cpu_us: Percentiles
    failures: dict[str, int]
    first_failure: str | None
    step_2: tuple[int, int]

    @property
    def total(self) -> int:
        """The frames that count."""
        return sum(self.counted.values())


class OutcomeCounter:
    """Counts the outcomes of a plan as they come; nothing is kept of a single frame."""

    def __init__(self, plan: Plan) -> None:
        self._fewest_stars = plan.fewest_stars
        self._counted = [dict.fromkeys(KINDS, 0) for _ in plan.cells]
        self._excluded = [dict.fromkeys(KINDS, 0) for _ in plan.cells]
        self._cpu_us = [CpuTimes() for _ in plan.cells]
        self._failures: list[dict[str, int]] = [{} for _ in plan.cells]
        self._first_failure: list[str | None] = [None for _ in plan.cells]
        self._step_2 = [(0, 0) for _ in plan.cells]

    def add(self, done: Sequence[FrameOutcome]) -> int:
        """Count outcomes; returns how many they were."""
        for outcome in done:
            is_counted = outcome.real_stars >= self._fewest_stars
            (self._counted if is_counted else self._excluded)[outcome.cell][outcome.kind] += 1
            if is_counted:
                named, right = self._step_2[outcome.cell]
                self._step_2[outcome.cell] = named + outcome.step_2[0], right + outcome.step_2[1]
            self._cpu_us[outcome.cell].add(outcome.cpu_us)
            if outcome.failure:
                failures, kind = self._failures[outcome.cell], outcome.failure.kind.value
                failures[kind] = failures.get(kind, 0) + 1
                self._first_failure[outcome.cell] = self._first_failure[outcome.cell] or outcome.failure.detail
        return len(done)

    def tallies(self) -> list[Tally]:
        """The counts of every cell so far."""
        counts = zip(self._counted, self._excluded, self._cpu_us, strict=True)
        others = zip(self._failures, self._first_failure, self._step_2, strict=True)
        return [
            Tally(us.frames, dict(counted), dict(excluded), us.percentiles(), dict(kinds), first, step_2)
            for (counted, excluded, us), (kinds, first, step_2) in zip(counts, others, strict=True)
        ]


def failure_lines(rows: Sequence[dict[str, Any]]) -> list[str]:
    """How external identifiers failed, and the first failure of each, of rows with identifier and failures."""
    found: dict[str, dict[str, int]] = {}
    first: dict[str, str] = {}
    for row in rows:
        of_program = found.setdefault(row["identifier"], {})
        for kind, count in row["failures"].items():
            of_program[kind] = of_program.get(kind, 0) + count
            first.setdefault(row["identifier"], row["first_failure"])
    lines = []
    for name, failures in found.items():
        if failures:
            kinds = ", ".join(f"{count} {kind}" for kind, count in sorted(failures.items()))
            lines.append(f"{name} failed: {kinds}; counted as none")
            lines += textwrap.wrap(f"the first: {first[name]}", 80, initial_indent="  ", subsequent_indent="  ")
    return lines


def interval(count: int, total: int) -> tuple[float, float] | None:
    """Clopper-Pearson interval of a share at 95 %; None where nothing was counted."""
    from scipy.stats import binomtest

    if total == 0:
        return None
    bounds = binomtest(count, total).proportion_ci(CONFIDENCE, method="exact")
    return float(bounds.low), float(bounds.high)


def report(plan: Plan, rows: Sequence[Tally], *, interrupted: bool) -> dict[str, Any]:
    """The JSON of schema gse.evaluation/1; all but ``cpu_ms`` is the same in every run of one seed."""
    return {
        "schema": SCHEMA,
        "optics": plan.optics.name,
        "magnitude_limit": plan.optics.magnitude_limit,
        "catalog": plan.catalog,
        "frames": plan.frames,
        "seed": plan.seed,
        "angle_noise": plan.angle_noise,
        "fewest_stars": plan.fewest_stars,
        "confidence": CONFIDENCE,
        "interrupted": interrupted,
        "cells": [_cell(plan, k, row) for k, row in enumerate(rows)],
    }


def _cell(plan: Plan, k: int, row: Tally) -> dict[str, Any]:
    cell, total = plan.cells[k], row.total
    conditions = cell.conditions
    rates = {}
    for kind, count in row.counted.items():
        bounds = interval(count, total)
        share = round(count / total, 6) if total else None
        rates[kind] = {"count": count, "share": share, "interval": bounds and [round(bound, 6) for bound in bounds]}
    times = {"median": row.cpu_us.p50, "p95": row.cpu_us.p95, "max": row.cpu_us.max}
    return {
        "identifier": cell.identifier.label,
        "noise_arcsec": conditions.position_arcsec,
        "magnitude_noise": conditions.magnitude,
        "false_objects": conditions.false_objects,
        "missing_share": conditions.missing_share,
        "whole_pixels": conditions.whole_pixels,
        "sky_limit": cell.sky_limit if plan.angle_noise else None,
        "frames_done": row.frames,
        "frames_counted": total,
        "rates": rates,
        "step_2": {"named": row.step_2[0], "right": row.step_2[1]} if plan.angle_noise else None,
        "excluded": row.excluded,
        "failures": dict(sorted(row.failures.items())),
        "first_failure": row.first_failure,
        "cpu_ms": {name: round(us / 1000, 4) if math.isfinite(us) else None for name, us in times.items()},
    }
