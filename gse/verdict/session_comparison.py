"""Two sessions side by side: values, their differences, and which differences are a regression."""

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from gse.station.frame_columns import Columns
from gse.station.results import Subject
from gse.station.session_data import SessionData
from gse.statistics.metrics import Metric, metrics
from gse.statistics.session_statistics import Statistics
from gse.values.axis import OF_SENSOR
from gse.values.instant import NS_PER_S
from gse.verdict.compared_rows import ComparedRow, ComparedSession, ComparedSubject, Pairs, SideBySide, sigmas_of
from gse.verdict.requirements import REQUIREMENTS

PAIRED_SHARE = 0.9
"""Two sessions are of the same panoramas when this share of the shorter one's are in both."""
SAME_WITHIN_NS = NS_PER_S
"""The UTC of a panorama differs by less between replays; a sensor that restarts repeats numbers and time tags."""

_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class SessionComparison:
    """All rows; ``paired`` where both sessions are of the same panoramas, which makes small differences significant.

    ``metrics`` are the metrics of ECSS-E-ST-60-20C that both sessions have, none of them judged.
    """

    rows: tuple[ComparedRow, ...]
    paired: bool
    metrics: tuple[ComparedRow, ...]

    @property
    def regressions(self) -> tuple[ComparedRow, ...]:
        """The rows in which the second session is worse."""
        return tuple(row for row in self.rows if row.worse)

    @property
    def is_open(self) -> bool:
        """Whether none of the judged rows could be compared: then nothing says that the second is not worse."""
        return all(math.isnan(row.sigmas) for row in self.rows if row.gate)


def session_comparison(
    first: SessionData,
    second: SessionData,
    *,
    sigmas: float = 3.0,
    allowed_share: float = 0.01,
    bias_is_regression: bool = False,
) -> SessionComparison:
    """Compare two sessions.

    The answers of the frame table; and the sensor's own beside panoramas, where both have some that are not the same.
    The second is worse in a value where the difference is beyond ``sigmas`` and larger than ``allowed_share`` of the
    first station's limit for it. With ``bias_is_regression`` a bias that changed either way is one.
    """
    with ThreadPoolExecutor(1) as beside:  # most of it is numpy's work, which lets the other one go on
        of_second = beside.submit(ComparedSession.from_session, second)
        one = ComparedSession.from_session(first)
    two = of_second.result()
    pairs = _pairs(first.frames.columns, second.frames.columns)

    def judged(subjects: _Both, *, stars_are_known: bool = True) -> Iterator[ComparedRow]:
        both = SideBySide(subjects, pairs, first.station.limits, allowed_share, bias_is_regression, stars_are_known)
        for requirement in REQUIREMENTS:
            yield from requirement.compare(both)

    rows = [_judged(row, sigmas) for row in judged((one.table, two.table))]
    if pairs is None:
        rows.append(_time((one.table, two.table)))
    if one.sensor is not None and two.sensor is not None and not (pairs and one.sensor_said_the_same(two, pairs)):
        own = one.sensor, two.sensor
        of_sensor = [_judged(row, sigmas) for row in judged(own, stars_are_known=False)]
        rows += [replace(row, name=f"{Subject.SENSOR} {row.name}") for row in of_sensor]
    shown = tuple(_metric_rows(one.statistics, two.statistics, independent=pairs is None))
    return SessionComparison(tuple(rows), pairs is not None, shown)


_AXIS_NAMES = {axis.key: f", {axis.label}" for axis in OF_SENSOR} | {None: ""}


def _metric_rows(first: Statistics, second: Statistics, *, independent: bool) -> Iterator[ComparedRow]:
    """Metrics of both; sigmas where both have an interval, and are of different panoramas."""
    others = {(metric.subject, metric.name, metric.axis): metric for metric in metrics(second)}
    for one in metrics(first):
        two = others.get((one.subject, one.name, one.axis))
        if two is None or math.isnan(one.value) or math.isnan(two.value):
            continue
        difference = two.value - one.value
        error = math.hypot(_standard(one), _standard(two)) if independent else _NAN
        name = f"{one.subject} {one.name}{_AXIS_NAMES[one.axis]}"
        sigmas = sigmas_of(difference, error)
        yield ComparedRow(name, one.unit, one.value, two.value, two.value, difference, sigmas, math.inf, gate=False)


def _standard(metric: Metric) -> float:
    return (metric.high - metric.low) / 2 / 1.96


_Both = tuple[ComparedSubject, ComparedSubject]


def _judged(row: ComparedRow, sigmas: float) -> ComparedRow:
    if row.either_way:
        worse = abs(row.sigmas) > sigmas and abs(row.difference) > row.allowed
    else:
        loss = -row.difference if row.at_least else row.difference
        worse = row.sigmas > sigmas and loss > row.allowed
    return replace(row, worse=row.gate and worse)


def _pairs(first: Columns, second: Columns) -> Pairs | None:
    """Rows of the panoramas that are in both sessions, or None where these are few."""
    common, one, two = np.intersect1d(first["time_us"], second["time_us"], return_indices=True)
    same = first["frame_no"][one] == second["frame_no"][two]
    same &= np.abs(first["utc_ns"][one] - second["utc_ns"][two]) < SAME_WITHIN_NS
    if len(common) == 0 or same.sum() < PAIRED_SHARE * min(len(first), len(second)):
        return None
    return one[same], two[same]


def _time(subjects: _Both) -> ComparedRow:
    """Shown, not gated: recorded times belong to a host. Panoramas that are in both sessions have the same."""
    a, b = (subject.statistics.time_ms.p99 for subject in subjects)
    return ComparedRow("identification time, 99 %", "ms", a, b, b, b - a, _NAN, math.inf, gate=False)
