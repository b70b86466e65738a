"""Each metric from its own figure, by numbers that are all different."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gse.station.results import Subject
from gse.statistics.axis_statistics import axis_statistics
from gse.statistics.metrics import is_drift_given, metrics
from gse.statistics.sampling import Bounds, Percentiles
from gse.statistics.spatial_errors import ErrorPart, SpatialErrors

NOTHING = axis_statistics(np.array([], dtype=np.int64), np.array([]))
AXES = ("cross_x", "cross_y", "d_roll")


def axis(first):
    """Ten figures from a number on."""
    return replace(
        NOTHING,
        bias_arcsec=first + 0.0,
        bias_bounds_arcsec=Bounds(first + 1.0, first + 2.0, 0.0, 0.0),
        too_short=f"word {first}",
        nea_arcsec=first + 3.0,
        nea_low_arcsec=first + 4.0,
        nea_high_arcsec=first + 5.0,
        drift_arcsec_per_h=first + 6.0,
        drift_low_arcsec_per_h=first + 7.0,
        drift_high_arcsec_per_h=first + 8.0,
    )


def subject_of(subject=Subject.ONBOARD, **changes):
    given = {
        "subject": subject,
        "axes": {name: axis(100.0 * (place + 1)) for place, name in enumerate(AXES)},
        "thermal": dict.fromkeys(AXES),
        "arrival_ms": Percentiles(9, 5.0, 9.5, 9.9, 10.0),
        "first_fixes_s": (),
    }
    return SimpleNamespace(**given | changes)


def found_of(*subjects, spatial=None, duration_s=3600.0):
    return metrics(
        SimpleNamespace(
            subjects={one.subject: one for one in subjects},
            spatial=spatial,
            duration_s=duration_s,
            counted=SimpleNamespace(path=None),
        )
    )


def one(found, name, axis=None):
    (metric,) = (metric for metric in found if (metric.name, metric.axis) == (name, axis))
    return metric


def values(metric):
    return metric.value, metric.low, metric.high


@pytest.mark.parametrize(("place", "axis"), list(enumerate(AXES, start=1)))
def test_bias_noise_and_drift_of_an_axis_have_their_own_intervals(place, axis):
    found, first = found_of(subject_of()), 100.0 * place
    assert values(one(found, "bias", axis)) == (first, first + 1, first + 2)
    assert one(found, "bias", axis).note == f"word {first}"
    assert values(one(found, "noise equivalent angle", axis)) == (first + 3, first + 4, first + 5)
    assert values(one(found, "drift", axis)) == (first + 6, first + 7, first + 8)
    units = [one(found, name, axis).unit for name in ("bias", "noise equivalent angle", "drift")]
    assert units == ["arcsec", "arcsec (1 σ)", "arcsec/h"]


@pytest.mark.parametrize(
    ("low", "high", "duration_s", "is_given"),
    [
        (-1.0, 1.0, 3600.0, True),
        (-1.0, 1.0, 3599.9, False),
        (-1.0, 1.0, 7200.0, True),
        (0.1, 1.0, 60.0, True),
        (0.0, 1.0, 60.0, False),  # zero itself may be true
        (-1.0, 0.0, 60.0, False),
        (-1.0, -0.1, 60.0, True),
        (math.nan, math.nan, 60.0, False),
    ],
)
def test_below_an_hour_only_a_significant_drift_is_given(low, high, duration_s, is_given):
    assert is_drift_given(low, high, duration_s) is is_given
    drifting = replace(NOTHING, drift_arcsec_per_h=5.0, drift_low_arcsec_per_h=low, drift_high_arcsec_per_h=high)
    metric = one(found_of(subject_of(axes=dict.fromkeys(AXES, drifting)), duration_s=duration_s), "drift", "d_roll")
    assert metric.value == (5.0 if is_given else pytest.approx(math.nan, nan_ok=True))
    assert metric.note == ("" if is_given else "not significant in less than an hour")
    assert (metric.unit, metric.ecss_term, metric.interpretation) == ("arcsec/h", "bias (its change)", "temporal")


def test_errors_of_stars_are_those_of_their_axis_and_part_with_none_about_the_boresight():
    sizes = iter(range(6))
    spatial = tuple(
        SpatialErrors(
            *(ErrorPart(*(10.0 * size + more for more in range(4))) for size in (next(sizes) for _ in "abc")), 40, 9
        )
        for _ in "xy"
    )
    found = found_of(subject_of(), spatial=spatial)
    for row, name in enumerate(AXES[:2]):
        for column, term in enumerate(("FOV spatial error", "pixel spatial error", "temporal noise")):
            part = (spatial[row].fov, spatial[row].pixel, spatial[row].temporal)[column]
            star, boresight = one(found, f"{term}, of a star", name), one(found, f"{term}, of the boresight", name)
            assert values(star) == (part.rms_arcsec, part.low_arcsec, part.high_arcsec)
            assert boresight.value == part.boresight_arcsec
            assert math.isnan(boresight.low)
            assert star.note == boresight.note == ""
            ensemble = "temporal" if term == "temporal noise" else "ensemble of the stars"
            assert star.interpretation == boresight.interpretation == ensemble
    assert not [metric for metric in found if "of a star" in metric.name and metric.axis == "d_roll"]


def test_few_stars_are_told_and_only_those_of_the_onboard_identifier():
    found = found_of(subject_of())
    star = one(found, "pixel spatial error, of a star", "cross_y")
    assert all(map(math.isnan, values(star)))
    assert star.note == one(found, "pixel spatial error, of the boresight", "cross_y").note == "too few stars to tell"
    assert not [metric for metric in found_of(subject_of(Subject.SENSOR)) if "of a star" in metric.name]


def test_a_thermal_error_has_its_range_or_a_word():
    thermal = {"cross_x": SimpleNamespace(arcsec_per_k=1.0, low_arcsec_per_k=0.5, high_arcsec_per_k=1.5, range_k=4.04)}
    found = found_of(subject_of(thermal={**dict.fromkeys(AXES), **thermal}))
    moved, still = (one(found, "thermo-elastic error", axis) for axis in AXES[:2])
    assert (values(moved), moved.note, moved.unit) == ((1.0, 0.5, 1.5), "over 4.0 K", "arcsec/K")
    assert all(map(math.isnan, values(still)))
    assert still.note == "the temperature did not move enough, or is unknown"


@pytest.mark.parametrize(("subject", "frame"), [(Subject.ONBOARD, "panorama"), (Subject.SENSOR, "ATTITUDE")])
def test_a_latency_is_that_of_the_frame_of_its_subject(subject, frame):
    found = found_of(subject_of(subject))
    median, most = one(found, "latency, median"), one(found, "latency, 95 % of the frames")
    assert (median.value, most.value) == (5.0, 9.5)
    assert median.note == most.note == f"from mid-exposure to the arrival of {frame} at the host"
    assert {metric.subject for metric in found} == {subject}


@pytest.mark.parametrize(
    ("fixes", "value", "note"),
    [
        ((), math.nan, "0 starts"),
        ((3.0,), 3.0, "1 start"),
        ((math.nan,), math.nan, "1 start, 1 without an answer"),
        ((3.0, 1.0), 2.0, "2 starts; from 1.00 to 3.00 s"),
        ((3.0, math.nan, math.nan), 3.0, "3 starts, 2 without an answer"),
        ((9.0, 1.0, math.nan, 2.0), 2.0, "4 starts, 1 without an answer; from 1.00 to 9.00 s"),
    ],
)
def test_first_fixes_are_told_by_their_median_and_range(fixes, value, note):
    metric = one(found_of(subject_of(first_fixes_s=fixes)), "time to first fix, median")
    assert metric.value == pytest.approx(value, nan_ok=True)
    assert (metric.note, metric.unit) == (note, "s")


def test_metrics_of_all_subjects_are_given_one_after_the_other():
    both = found_of(subject_of(), subject_of(Subject.SENSOR))
    alone = [len(found_of(subject_of(subject))) for subject in (Subject.ONBOARD, Subject.SENSOR)]
    expected = [Subject.ONBOARD] * alone[0] + [Subject.SENSOR] * alone[1]
    assert [metric.subject for metric in both] == expected
