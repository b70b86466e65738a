"""The metrics of ECSS-E-ST-60-20C Rev.2, one entry for each subject, metric and axis. docs/metrics.md defines them."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gse.station.results import Subject
from gse.statistics.axis_statistics import AxisStatistics
from gse.statistics.session_statistics import Statistics
from gse.statistics.smooth_path import ABOUT, SmoothPath
from gse.statistics.spatial_errors import ErrorPart, SpatialErrors
from gse.statistics.subject_statistics import SubjectStatistics, ThermalError
from gse.values.axis import D_ROLL, OF_SENSOR

_DRIFT_NEEDS_S = 3600.0
_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class Metric:
    """A value with the interval that holds the true one with 95 %, NaN where there is none; ``note`` says why."""

    subject: Subject
    name: str
    ecss_term: str
    interpretation: str
    axis: str | None
    unit: str
    value: float = _NAN
    low: float = _NAN
    high: float = _NAN
    note: str = ""


def metrics(stats: Statistics) -> tuple[Metric, ...]:
    """The metrics of all subjects; those of single stars are of the objects that the onboard identifier named."""
    return tuple(metric for subject in stats.subjects.values() for metric in _of_subject(subject, stats))


def _of_subject(subject: SubjectStatistics, stats: Statistics) -> Iterator[Metric]:
    for place, axis in enumerate(axis.key for axis in OF_SENSOR):
        of_axis, which = subject.axes[axis], subject.subject
        yield _bias(which, axis, of_axis)
        if which is Subject.ONBOARD and axis != D_ROLL.key:
            yield from _spatial(axis, stats.spatial[place] if stats.spatial else None)
        yield _nea(which, axis, of_axis) if stats.counted.path is None else _noise(which, axis, stats.counted.path)
        yield _drift(which, axis, of_axis, stats.duration_s)
        yield _thermal(which, axis, subject.thermal[axis])
    yield from _latency(subject)
    yield _first_fix(subject)


def _bias(subject: Subject, axis: str, of_axis: AxisStatistics) -> Metric:
    bounds = of_axis.bias_bounds_arcsec
    return Metric(
        subject,
        "bias",
        "bias",
        "temporal",
        axis,
        "arcsec",
        of_axis.bias_arcsec,
        bounds.low,
        bounds.high,
        of_axis.too_short,
    )


def _spatial(axis: str, errors: SpatialErrors | None) -> Iterator[Metric]:
    for term, part in (("FOV spatial error", "fov"), ("pixel spatial error", "pixel"), ("temporal noise", "temporal")):
        interpretation = "temporal" if part == "temporal" else "ensemble of the stars"
        found: ErrorPart | None = getattr(errors, part) if errors else None
        note = "" if found else "too few stars to tell"
        star = (found.rms_arcsec, found.low_arcsec, found.high_arcsec) if found else (_NAN,) * 3
        boresight = found.boresight_arcsec if found else _NAN
        yield Metric(Subject.ONBOARD, f"{term}, of a star", term, interpretation, axis, "arcsec rms", *star, note=note)
        yield Metric(
            Subject.ONBOARD,
            f"{term}, of the boresight",
            term,
            interpretation,
            axis,
            "arcsec rms",
            boresight,
            note=note,
        )


def _nea(subject: Subject, axis: str, of_axis: AxisStatistics) -> Metric:
    return Metric(
        subject,
        "noise equivalent angle",
        "temporal noise",
        "temporal",
        axis,
        "arcsec (1 σ)",
        of_axis.nea_arcsec,
        of_axis.nea_low_arcsec,
        of_axis.nea_high_arcsec,
    )


def _noise(subject: Subject, axis: str, path: SmoothPath) -> Metric:
    note = f"about a smooth path through {ABOUT} answers: there is no truth, and slower errors are not seen"
    name, value = "noise equivalent angle", path.noise_arcsec(axis)
    return Metric(subject, name, "temporal noise", "temporal", axis, "arcsec (1 σ)", value, note=note)


def is_drift_given(low: float, high: float, duration_s: float) -> bool:
    """Below an hour a slope, with its interval, is extrapolated: then only a significant one is given."""
    return duration_s >= _DRIFT_NEEDS_S or low > 0 or high < 0


def _drift(subject: Subject, axis: str, of_axis: AxisStatistics, duration_s: float) -> Metric:
    low, high = of_axis.drift_low_arcsec_per_h, of_axis.drift_high_arcsec_per_h
    metric = Metric(
        subject, "drift", "bias (its change)", "temporal", axis, "arcsec/h", of_axis.drift_arcsec_per_h, low, high
    )
    if is_drift_given(low, high, duration_s):
        return metric
    return Metric(
        subject,
        metric.name,
        metric.ecss_term,
        metric.interpretation,
        axis,
        metric.unit,
        note="not significant in less than an hour",
    )


def _thermal(subject: Subject, axis: str, found: ThermalError | None) -> Metric:
    values = (found.arcsec_per_k, found.low_arcsec_per_k, found.high_arcsec_per_k) if found else (_NAN,) * 3
    note = f"over {found.range_k:.1f} K" if found else "the temperature did not move enough, or is unknown"
    return Metric(
        subject, "thermo-elastic error", "thermo elastic error", "temporal", axis, "arcsec/K", *values, note=note
    )


def _latency(subject: SubjectStatistics) -> Iterator[Metric]:
    of, frame = subject.arrival_ms, "panorama" if subject.subject is Subject.ONBOARD else "ATTITUDE"
    note = f"from mid-exposure to the arrival of {frame} at the host"
    for name, value in (("latency, median", of.p50), ("latency, 95 % of the frames", of.p95)):
        yield Metric(subject.subject, name, "measurement date error", "temporal", None, "ms", value, note=note)


def _first_fix(subject: SubjectStatistics) -> Metric:
    fixes = np.array([fix for fix in subject.first_fixes_s if not math.isnan(fix)])
    starts = len(subject.first_fixes_s)
    note = f"{starts} {'start' if starts == 1 else 'starts'}"
    if len(fixes) < starts:
        note += f", {starts - len(fixes)} without an answer"
    if len(fixes) > 1:
        note += f"; from {fixes.min():.2f} to {fixes.max():.2f} s"
    value = float(np.median(fixes)) if len(fixes) else _NAN
    name, term = "time to first fix, median", "autonomous attitude determination"
    return Metric(subject.subject, name, term, "ensemble of the starts", None, "s", value, note=note)
