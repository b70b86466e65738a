"""Statistics of one subject from a few columns: which frames enter each number, and each number by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gse.station.columns import FRAME
from gse.station.results import Subject
from gse.statistics.axis_statistics import axis_statistics
from gse.statistics.counted_frames import CountedFrames
from gse.statistics.subject_statistics import (
    SubjectAnswers,
    _earth_rate,
    _mean_abs_d_ra_deg,
    _star_fields,
    about_circular_mean,
    figure_of,
    subject_statistics,
    thermal_error,
)
from gse.values.axis import ALL_AXES, OF_SENSOR
from gse.values.instant import NS_PER_S
from gse.values.limits import Limits

HALF_TURN_ARCSEC = 648_000.0
SECONDS = np.array([2.0, 0.0, 1.0, 3.0, 5.0, 6.5, 10.0, 11.0, 12.0, 13.0])
"""The clock stepped back after the first frame."""


def mask(*rows, of=10):
    made = np.zeros(of, dtype=bool)
    made[list(rows)] = True
    return made


def frames(seconds=SECONDS):
    made = np.zeros(len(seconds), dtype=FRAME)
    made["utc_ns"] = 10**18 + np.round(np.asarray(seconds) * NS_PER_S).astype(np.int64)
    made["frame_no"] = np.arange(len(seconds))
    made["de_true_deg"], made["temperature_c"] = 60.0, 20.0
    return made


def answers(count=10, **changes):
    """All frames are expected, timed and answered well, with errors that no two frames and no two axes share."""
    every = np.ones(count, dtype=bool)
    columns = {axis.column: 100.0 * place + np.arange(count) for place, axis in enumerate(ALL_AXES, 1)}
    columns |= {"ra_deg": np.zeros(count), "de_deg": np.zeros(count)}
    times = np.full(count, np.nan)
    never_came = np.zeros(count, dtype=np.int64)
    counted = CountedFrames(every, every, ~every, ~every, every, never_came, 0, every, ())
    masks = {name: changes.pop(name) for name in [*changes] if name in CountedFrames.__slots__}
    usual = SubjectAnswers(columns, replace(counted, **masks), times, times, False)
    return replace(usual, **changes)


def found(given, rows=None, *, limit_ms=100.0, field_rad=0.25, **limits):
    made = frames() if rows is None else rows
    asked = Limits(identification_ms=limit_ms, **limits)
    return subject_statistics(Subject.SENSOR, made, given, asked, field_rad)


def test_errors_are_those_of_the_used_frames_in_the_order_of_time():
    stats = found(answers(used=mask(0, 1, 4, 9)))
    for place, axis in enumerate(ALL_AXES, 1):
        assert stats.axes[axis.key].n == 4
        assert stats.axes[axis.key].bias_arcsec == pytest.approx(100.0 * place + (0 + 1 + 4 + 9) / 4)
        assert stats.axes[axis.key].max_abs_arcsec == 100.0 * place + 9
    assert stats.mean_abs_d_de_deg == pytest.approx(203.5 / 3600)
    assert stats.mean_abs_d_ra_deg == pytest.approx(103.5 / 0.5 / 3600)
    cones = [math.hypot(400.0 + row, 500.0 + row) for row in (0, 1, 4, 9)]
    assert stats.half_cone_95.max_abs_arcsec == pytest.approx(max(cones))
    assert stats.half_cone_95.bias_arcsec == pytest.approx(sum(cones) / 4)
    assert stats.subject is Subject.SENSOR


def test_an_expected_frame_that_was_answered_well_is_available_and_a_lost_one_is_not():
    """Nine are expected, of which two have no answer and one a false one; two never came before one, and two ever."""
    never_came = np.array([0, 0, 2, 0, 0, 0, 0, 9, 0, 0])
    counted = {"expected": ~mask(7), "answered": ~mask(1, 2, 8), "false": mask(3)}
    stats = found(answers(**counted, never_came=never_came, unplaced=2))
    assert (stats.available.count, stats.available.of) == (5, 13)


def test_false_answers_are_of_all_that_are_judged_whether_they_were_expected_or_not():
    stats = found(answers(expected=~mask(5, 6), judged=~mask(8), false=mask(3, 5)))
    assert (stats.false_answers.count, stats.false_answers.of) == (2, 9)


def test_times_are_those_that_are_known_and_slow_is_more_than_the_limit():
    times = np.array([np.nan, 99.0, 100.0, 100.5, 300.0, np.nan, 1.0, 2.0, 3.0, 4.0])
    arrivals = np.where(np.arange(10) < 7, np.nan, 5.0 + np.arange(10))
    stats = found(answers(time_ms=times, arrival_ms=arrivals, time_is_stated=True))
    assert (stats.time_ms.n, stats.time_ms.max) == (8, 300.0)
    assert stats.time_ms.p50 == pytest.approx((4.0 + 99.0) / 2)
    assert (stats.slow.count, stats.slow.of) == (2, 8)
    assert (stats.arrival_ms.n, stats.arrival_ms.p50, stats.arrival_ms.max) == (3, 13.0, 14.0)
    assert stats.time_is_stated
    assert not found(answers()).time_is_stated


def test_outage_and_acquisition_are_of_timed_frames_with_a_good_answer():
    rows = frames(np.arange(10.0) ** 2)
    given = answers(excluded=mask(0, 6), answered=~mask(1, 2, 4), false=mask(3))
    stats = found(given, rows)  # timed from 1 s; good at 25, 49, 64 and 81 s
    assert stats.acquisition_s == 24.0
    assert stats.outage_s == 24.0
    assert stats.first_fixes_s == (24.0,)


def test_one_good_answer_has_no_outage_and_none_no_acquisition():
    one = found(answers(answered=mask(4)))
    assert math.isnan(one.outage_s)
    assert one.acquisition_s == 3.0
    assert math.isnan(found(answers(answered=mask())).acquisition_s)
    assert found(answers(answered=mask(4, 6))).outage_s == 5.0


def test_each_start_of_the_sensor_has_its_first_fix():
    rows = frames(np.arange(10.0))
    rows["frame_no"] = [7, 8, 9, 0, 1, 2, 0, 1, 2, 3]
    stats = found(answers(answered=mask(1, 2, 8, 9)), rows)
    assert stats.first_fixes_s == pytest.approx((1.0, math.nan, 2.0), nan_ok=True)


def test_an_answer_without_roll_counts_for_the_other_angles():
    columns = answers().columns | {"d_roll_arcsec": np.array([np.nan, 4.0] * 5)}
    stats = found(answers(columns=columns))
    assert (stats.axes["d_roll"].n, stats.axes["d_roll"].bias_arcsec) == (5, 4.0)
    assert stats.axes["d_de"].n == 10
    columns["d_roll_arcsec"] = np.full(10, np.nan)
    assert found(answers(columns=columns)).axes["d_roll"].n == 0


def test_only_a_roll_goes_round():
    """About half a turn a roll scatters by little; another error that is as large has its own mean."""
    around = np.resize([HALF_TURN_ARCSEC - 10.0, 10.0 - HALF_TURN_ARCSEC], 10)
    stats = found(answers(columns=answers().columns | {"d_roll_arcsec": around, "d_de_arcsec": around}))
    assert abs(stats.axes["d_roll"].bias_arcsec) == pytest.approx(HALF_TURN_ARCSEC, abs=1e-3)
    assert stats.axes["d_roll"].std_arcsec == pytest.approx(10.0 * math.sqrt(10 / 9), rel=1e-6)
    assert stats.axes["d_de"].bias_arcsec == pytest.approx(0.0, abs=1e-6)
    assert stats.axes["d_de"].std_arcsec > 6e5


def test_the_declination_is_that_of_the_answer_where_there_is_no_truth():
    rows, columns = frames(), answers().columns | {"de_deg": np.full(10, -45.0)}
    rows["de_true_deg"][5:] = np.nan
    stats = found(answers(columns=columns), rows)
    by_hand = sum((100.0 + row) / (0.5 if row < 5 else math.sqrt(0.5)) for row in range(10)) / 10 / 3600
    assert stats.mean_abs_d_ra_deg == pytest.approx(by_hand)


def test_nothing_used_gives_no_number():
    stats = found(answers(used=mask()))
    assert math.isnan(stats.mean_abs_d_ra_deg)
    assert math.isnan(stats.earth_rate.measured_arcsec_per_s)
    assert stats.earth_rate.expected_arcsec_per_s == pytest.approx(15.041067, abs=1e-6)
    assert stats.star_fields == 0
    empty = found(answers(0, unplaced=3), frames([]))
    assert (empty.available.count, empty.available.of) == (0, 3)
    assert empty.first_fixes_s == ()


def test_the_error_per_kelvin_is_of_the_used_frames_with_their_temperature():
    count, used = 200, np.arange(200) % 5 != 0
    rows = frames(np.arange(200.0))
    rows["temperature_c"] = 20.0 + 3.0 * np.sin(np.arange(200) / 20)
    rng = np.random.default_rng(3)
    columns = {axis.column: place * rows["temperature_c"] + rng.normal(0, 0.3, count) for place, axis in
               enumerate(ALL_AXES, 1)} | {"ra_deg": np.zeros(count), "de_deg": np.zeros(count)}  # fmt: skip
    columns["d_roll_arcsec"][7::10] = np.nan
    thermal = found(answers(count, columns=columns, used=used), rows).thermal
    assert list(thermal) == ["cross_x", "cross_y", "d_roll"]
    for axis, slope in (("cross_x", 4.0), ("cross_y", 5.0), ("d_roll", 3.0)):
        known = used & np.isfinite(columns[f"{axis}_arcsec"])
        by_hand = thermal_error(rows["utc_ns"][known], columns[f"{axis}_arcsec"][known], rows["temperature_c"][known])
        assert thermal[axis].arcsec_per_k == pytest.approx(slope, abs=0.1)
        assert thermal[axis].arcsec_per_k == pytest.approx(by_hand.arcsec_per_k)
        assert thermal[axis].range_k == pytest.approx(by_hand.range_k)


def test_an_unknown_convention_leaves_no_error_and_no_false_answer():
    plain = answers(false=mask(3)).counted.uncompared()
    assert not plain.false.any()
    assert not plain.judged.any()
    assert not plain.used.any()
    assert plain.answered.all()


@pytest.mark.parametrize("turns", [0.0, 0.9999, -0.5, 0.25, 0.6])
def test_angles_lie_within_half_a_turn_of_their_mean_wherever_it_is(turns):
    """Two lie 115 deg to either side of a third, one of them stated a turn off: their mean direction is the third's."""
    middle = turns * 2 * HALF_TURN_ARCSEC
    apart = 115 * 3600.0
    about = about_circular_mean(middle + np.array([-apart, 0.0, apart + 2 * HALF_TURN_ARCSEC]))
    assert about - about[1] == pytest.approx([-apart, 0.0, apart], abs=1e-6)
    assert -HALF_TURN_ARCSEC - 1e-6 <= about[1] <= HALF_TURN_ARCSEC + 1e-6
    assert math.remainder(about[1] - middle, 2 * HALF_TURN_ARCSEC) == pytest.approx(0.0, abs=1e-6)


def test_no_angles_have_no_mean():
    assert len(about_circular_mean(np.zeros(0))) == 0


def test_a_figure_to_decide_on_has_the_bounds_of_its_own_axis():
    rng = np.random.default_rng(1)
    axis = axis_statistics(np.arange(100) * NS_PER_S, rng.normal(0, 3, 100))
    mean, most = figure_of(axis, "mean_abs", 99.0), figure_of(axis, "p95_abs", 99.0)
    assert (mean.value, mean.bounds) == (axis.mean_abs_arcsec, axis.mean_abs_bounds_arcsec)
    assert (most.value, most.bounds) == (axis.p95_abs_arcsec, axis.p95_abs_bounds_arcsec)
    assert (mean.n_eff, mean.frames, mean.duration_s) == (axis.n_eff, 100, 99.0)


@pytest.mark.parametrize(("de_deg", "is_known"), [(89.9, True), (-89.9, True), (89.91, False)])
def test_right_ascension_has_an_error_to_a_tenth_of_a_degree_from_the_pole(de_deg, is_known):
    error_deg = _mean_abs_d_ra_deg(np.array([-3.6, 3.6]), np.array([0.0, de_deg]))
    assert math.isfinite(error_deg) == is_known
    assert not is_known or error_deg == pytest.approx((1 + 1 / math.cos(math.radians(de_deg))) / 2000)
    rate = _earth_rate(np.array([de_deg, 0.0]), axis_statistics(np.arange(40) * NS_PER_S, np.zeros(40)))
    assert math.isfinite(rate.expected_arcsec_per_s)
    assert math.isfinite(rate.measured_arcsec_per_s) == is_known


@pytest.mark.parametrize("drift_arcsec_per_h", [36.0, -36.0])
def test_the_earth_turns_faster_where_right_ascension_runs_ahead(drift_arcsec_per_h):
    """36 arcsec an hour at a mean declination of 60 deg are 0.02 arcsec a second about the pole."""
    axis = axis_statistics(np.arange(20) * NS_PER_S, np.arange(20) * drift_arcsec_per_h / 3600)
    bounded = replace(
        axis, drift_low_arcsec_per_h=drift_arcsec_per_h - 9.0, drift_high_arcsec_per_h=drift_arcsec_per_h + 9.0
    )
    rate = _earth_rate(np.array([50.0, 70.0]), bounded)
    assert rate.measured_arcsec_per_s - 15.0410669 == pytest.approx(drift_arcsec_per_h / 1800, abs=1e-6)
    assert rate.error_arcsec_per_s == pytest.approx(0.005)


@pytest.mark.parametrize("field_rad", [0.05, 0.11])
def test_narrow_fields_are_cells_of_their_own_width_on_the_sphere(field_rad):
    """Cells by hand, three numbers each; whole numbers of them do not fit the sphere."""
    rng = np.random.default_rng(9)
    ra, de = rng.uniform(0, 360, 3000), np.degrees(np.arcsin(rng.uniform(-1, 1, 3000)))
    vectors = np.column_stack([np.cos(np.radians(de)) * np.cos(np.radians(ra)),
                               np.cos(np.radians(de)) * np.sin(np.radians(ra)), np.sin(np.radians(de))])  # fmt: skip
    assert _star_fields(ra, de, field_rad) == len({tuple(cell) for cell in np.floor(vectors / field_rad).tolist()})


def test_the_output_rate_is_that_of_the_answers_without_what_is_missing():
    seconds = np.array([0.0, 0.1, 0.2, 0.3, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0])
    assert found(answers(), frames(seconds)).output_rate_hz == pytest.approx(10.0)
    assert found(answers(answered=mask(0, 2, 4, 6, 8)), frames(np.arange(10) / 10)).output_rate_hz == pytest.approx(5.0)
    assert math.isnan(found(answers(1), frames([0.0])).output_rate_hz)


def test_the_error_at_a_confidence_is_along_each_axis_of_the_sensor_where_one_is_asked():
    assert found(answers()).at_confidence == {}
    figures = found(answers(), x_arcsec=1.0, confidence=0.5).at_confidence
    columns = answers().columns
    for axis in OF_SENSOR:
        assert (figures[axis.key].value, figures[axis.key].frames) == (np.median(columns[axis.column]), 10)
