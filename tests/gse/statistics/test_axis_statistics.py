"""Statistics of one axis on series whose answer is known."""

import math
from dataclasses import fields

import numpy as np
import pytest
import scipy.stats

from gse.statistics.axis_statistics import (
    MIN_S,
    WINDOW_S,
    AxisStatistics,
    _running_mean,
    _successive,
    _too_short,
    axis_statistics,
    drift,
    quick_errors,
)
from gse.statistics.sampling import MIN_FRAMES, error_bounds, mean_bounds, root_mean_square_bounds, slope_bounds
from gse.values.instant import NS_PER_S

TOO_FEW = f"too few frames to tell ({MIN_FRAMES - 1}, {MIN_FRAMES} are needed)"


def axis(error, step_s=0.1):
    return axis_statistics(np.arange(len(error)) * round(step_s * NS_PER_S), np.asarray(error, dtype=float))


def test_the_figures_of_four_errors_by_hand():
    figures = axis([1.0, -2.0, 3.0, -6.0], step_s=30.0)
    assert figures.bias_arcsec == -1.0
    assert figures.std_arcsec == pytest.approx(math.sqrt((4 + 1 + 16 + 25) / 3))  # of a sample: by one less than four
    assert figures.three_sigma_arcsec == pytest.approx(3 * math.sqrt(46 / 3))
    assert figures.rms_arcsec == pytest.approx(math.sqrt((1 + 4 + 9 + 36) / 4))
    assert (figures.mean_abs_arcsec, figures.max_abs_arcsec) == (3.0, 6.0)
    assert figures.p95_abs_arcsec == pytest.approx(3 + 3 * 0.85)  # the 2.85th of 0 to 3, between its neighbours


def test_white_noise_is_found_as_the_noise_equivalent_angle_both_ways():
    figures = axis(np.random.default_rng(2).normal(3.0, 5.0, 36_000))
    assert figures.nea_arcsec == pytest.approx(5.0, rel=0.02)
    assert figures.nea_successive_arcsec == pytest.approx(5.0, rel=0.02)
    assert figures.nea_low_arcsec < 5.0 < figures.nea_high_arcsec
    assert abs(figures.bias_arcsec - 3.0) < figures.bias_error_arcsec < 0.2
    assert figures.three_sigma_arcsec == pytest.approx(3 * figures.std_arcsec)
    assert figures.rms_arcsec == pytest.approx(math.hypot(3.0, 5.0), rel=0.02)
    assert figures.p95_abs_arcsec < figures.p99_abs_arcsec < figures.max_abs_arcsec


def test_a_slow_wave_is_low_frequency_error_and_no_noise():
    time_s = np.arange(36_000) * 0.1
    figures = axis(np.random.default_rng(3).normal(0, 2.0, 36_000) + 10 * np.sin(2 * np.pi * time_s / 600))
    assert figures.nea_arcsec == pytest.approx(2.0, rel=0.03)
    assert figures.low_frequency_arcsec == pytest.approx(10 / math.sqrt(2), rel=0.05)
    assert figures.std_arcsec == pytest.approx(math.hypot(2, 10 / math.sqrt(2)), rel=0.03)


@pytest.mark.parametrize(("windows", "is_known"), [(1.5, False), (2.0, False), (2.1, True)])
def test_low_frequency_error_needs_more_than_two_of_its_windows(windows, is_known):
    figures = axis(np.random.default_rng(3).normal(0, 2.0, round(windows * WINDOW_S) + 1), step_s=1.0)
    assert math.isfinite(figures.low_frequency_arcsec) == is_known


def test_a_drift_is_found_among_outliers():
    rng = np.random.default_rng(4)
    error = rng.normal(0, 3.0, 18_000) + 40.0 * np.arange(18_000) * 0.1 / 3600
    error[rng.random(18_000) < 0.01] += 500
    figures = axis(error)
    assert figures.drift_low_arcsec_per_h < 40.0 < figures.drift_high_arcsec_per_h
    assert figures.drift_high_arcsec_per_h - figures.drift_low_arcsec_per_h < 3


def test_gaps_do_not_enter_the_successive_differences():
    utc_ns = np.concatenate([np.arange(500), 10_000 + np.arange(500)]) * 100_000_000
    error = np.random.default_rng(5).normal(0, 1.0, 1000)
    error[500:] += 1000
    assert axis_statistics(utc_ns, error).nea_successive_arcsec == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_very_few_frames_give_no_figure_instead_of_a_wrong_one(count):
    figures = axis([1.0] * count)
    assert figures.n == count
    assert math.isnan(figures.drift_arcsec_per_h)


@pytest.mark.parametrize(
    ("count", "seconds", "words"),
    [
        (MIN_FRAMES - 1, 60, TOO_FEW),
        (MIN_FRAMES, 60, ""),
        (MIN_FRAMES, MIN_S - 0.1, f"too short to tell ({MIN_S - 0.1:.1f} s"),
        (MIN_FRAMES, MIN_S, ""),
    ],
)
def test_a_session_says_what_it_lacks(count, seconds, words):
    utc_ns = np.linspace(0, seconds * 1e9, count).astype(np.int64)
    found = axis_statistics(utc_ns, np.random.default_rng(2).normal(0, 1, count)).too_short
    assert found.startswith(words)
    assert bool(found) == bool(words)


# Every figure, by its definition


@pytest.fixture(scope="module")
def irregular():
    """Seventy errors at irregular instants of 200 s that drift, one of them more than ten seconds from the others."""
    rng = np.random.default_rng(6)
    time_s = np.sort(np.concatenate([rng.uniform(0, 180, 68), [0.0, 200.0]]))
    return time_s, rng.normal(2.0, 3.0, 70) + 0.02 * time_s + 4 * np.sin(time_s / 15)


@pytest.fixture(scope="module")
def figures(irregular):
    time_s, error = irregular
    return axis_statistics(1_000_000_000_000 + np.round(time_s * 1e9).astype(np.int64), error)


def windows(time_s):
    """Which frames (columns) are within ten seconds of each (rows), both ends included."""
    return np.abs(time_s[:, None] - time_s) <= 10.0


def test_plain_figures_are_numpys(irregular, figures):
    _, error = irregular
    absolute = np.abs(error)
    found = (figures.bias_arcsec, figures.std_arcsec, figures.rms_arcsec, figures.mean_abs_arcsec)
    assert found == pytest.approx((error.mean(), np.std(error, ddof=1), np.sqrt(np.mean(error**2)), absolute.mean()))
    percentiles = (figures.p95_abs_arcsec, figures.p99_abs_arcsec, figures.max_abs_arcsec)
    assert percentiles == pytest.approx((np.percentile(absolute, 95), np.percentile(absolute, 99), absolute.max()))
    assert figures.three_sigma_arcsec == pytest.approx(3 * figures.std_arcsec)
    assert figures.n == 70


def test_bounds_are_those_of_the_series(irregular, figures):
    time_s, error = irregular
    bounds = error_bounds(error, np.round(time_s * 1e9) / 1e9)
    assert figures.n_eff == bounds.n_eff
    assert figures.tau_s == pytest.approx(70 / bounds.n_eff * float(np.median(np.diff(time_s))))
    assert figures.bias_bounds_arcsec == bounds.bias
    assert figures.bias_error_arcsec == pytest.approx(bounds.bias.high - error.mean())
    assert figures.mean_abs_bounds_arcsec == bounds.mean_abs
    assert figures.p95_abs_bounds_arcsec == bounds.p95_abs
    assert figures.std_bounds_arcsec == root_mean_square_bounds(error - error.mean())


def test_noise_is_what_the_mean_of_twenty_seconds_leaves(irregular, figures):
    """A frame that is one of m has lost 1 / m of its variance to their mean; one alone tells nothing."""
    time_s, error = irregular
    near = windows(time_s)
    count = near.sum(axis=1)
    left = (error - near @ error / count)[count > 1]
    share = 1 - 1 / count[count > 1]
    assert (count == 1).sum() == 1
    assert figures.nea_arcsec == pytest.approx(math.sqrt((left**2).sum() / share.sum()))
    bounds = root_mean_square_bounds(left / np.sqrt(share))
    assert (figures.nea_low_arcsec, figures.nea_high_arcsec) == pytest.approx((bounds.low, bounds.high))


def test_low_frequency_error_is_what_the_mean_of_twenty_seconds_scatters_beyond_drift_and_noise(irregular, figures):
    """Noise leaves 1 / m of its variance in a mean of m; bias and drift that are taken out take 1 / n each."""
    time_s, error = irregular
    near = windows(time_s)
    count = near.sum(axis=1)
    smooth = near @ error / count
    line = figures.drift_arcsec_per_h / 3600 * (time_s - time_s.mean()) + smooth.mean()
    variances = (smooth - line) ** 2 - figures.nea_arcsec**2 * (1 / count - 1 / 70 - 1 / 70)
    bounds = mean_bounds(variances)
    assert figures.low_frequency_arcsec == pytest.approx(math.sqrt(variances.mean()))
    assert figures.low_frequency_low_arcsec == pytest.approx(math.sqrt(max(bounds.low, 0.0)))
    assert figures.low_frequency_high_arcsec == pytest.approx(math.sqrt(bounds.high))


def test_a_drift_has_the_bounds_of_a_slope_over_hours(irregular, figures):
    time_s, error = irregular
    slope = scipy.stats.theilslopes(error, time_s / 3600).slope
    bounds = slope_bounds(slope, time_s / 3600, error)
    assert figures.drift_arcsec_per_h == pytest.approx(slope, rel=1e-6)
    found = (figures.drift_low_arcsec_per_h, figures.drift_high_arcsec_per_h)
    assert found == pytest.approx((bounds.low, bounds.high), rel=1e-5)


def test_no_error_is_low_frequency_where_noise_explains_it_all():
    """Errors in turn: their means scatter by less than noise."""
    figures = axis(np.resize([5.0, -5.0], 100), step_s=1.0)
    assert figures.low_frequency_arcsec == 0.0
    assert figures.low_frequency_low_arcsec == 0.0


@pytest.mark.parametrize("count", [21, 40, 16_384, 20_001])
def test_a_running_mean_has_all_frames_within_ten_seconds(count):
    """At 1 Hz it has 21, those ten seconds off included, and at both ends 11; of a straight line it is the middle."""
    time_s = np.arange(float(count))
    means, counts = _running_mean(time_s, 3.0 * time_s)
    first, last = np.maximum(time_s - 10, 0), np.minimum(time_s + 10, count - 1)
    assert counts.tolist() == (last - first + 1).tolist()
    assert means == pytest.approx(1.5 * (first + last))


def test_quick_errors_are_what_the_running_mean_leaves(irregular):
    time_s, error = irregular
    near = windows(time_s)
    utc_ns = 1_000_000_000_000 + np.round(time_s * 1e9).astype(np.int64)
    assert quick_errors(utc_ns, error) == pytest.approx(error - near @ error / near.sum(axis=1))
    assert len(quick_errors(utc_ns[:0], error[:0])) == 0


@pytest.mark.parametrize(("count", "rows"), [(3, 1), (399, 1), (400, 2), (401, 2), (1003, 5)])
def test_a_drift_is_the_slope_of_medians_of_as_many_frames_as_make_two_hundred(count, rows):
    rng = np.random.default_rng(count)
    time_s = np.sort(rng.uniform(0, 900, count))
    error = rng.normal(0, 1, count) + 0.01 * time_s
    kept = count - count % rows
    parts = range(0, kept, rows)
    medians = np.array([np.median(error[part : part + rows]) for part in parts])
    hours = np.array([time_s[part : part + rows].mean() for part in parts]) / 3600
    slope, bounds = drift(time_s, error)
    assert slope == pytest.approx(scipy.stats.theilslopes(medians, hours).slope)
    assert math.isnan(bounds.low) if count < 30 else bounds == slope_bounds(slope, hours, medians)


@pytest.mark.parametrize(
    "time_s",
    [[0.0, 7.0], [5.0] * 40, [0.0] * 400 + [1.0]],
    ids=["two frames", "one instant", "one instant but the last"],
)
def test_frames_of_one_instant_tell_no_drift(time_s):
    slope, bounds = drift(np.array(time_s), np.arange(float(len(time_s))))
    assert math.isnan(slope)
    assert math.isnan(bounds.low)


def test_frames_that_begin_at_one_instant_tell_a_drift():
    assert drift(np.array([0.0, 0.0, 3600.0]), np.array([1.0, 1.0, 3.0]))[0] == pytest.approx(2.0)
    assert drift(np.array([0.0, 3600.0, 3600.0]), np.array([1.0, 3.0, 3.0]))[0] == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("time_s", "errors", "expected"),
    [
        ([0.0, 2.0, 4.0, 7.0, 11.0], [0.0, 1.0, 3.0, 6.0, 90.0], math.sqrt((1 + 4 + 9) / 3 / 2)),  # 3 s of 2.5 at most
        ([0.0, 2.0, 4.0, 7.1], [0.0, 1.0, 3.0, 90.0], math.sqrt((1 + 4) / 2 / 2)),
        ([0.0, 2.0, 4.0, 7.0], [0.0, 1.0, 3.0, 6.0], math.sqrt((1 + 4 + 9) / 3 / 2)),  # half as long again, exactly
        ([0.0], [5.0], math.nan),
    ],
)
def test_successive_errors_are_those_at_most_half_a_frame_farther_apart(time_s, errors, expected):
    assert _successive(np.array(time_s), np.array(errors)) == pytest.approx(expected, nan_ok=True)


@pytest.mark.parametrize(
    ("n", "duration_s", "n_eff", "words"),
    [
        (MIN_FRAMES - 1, 5.0, math.nan, TOO_FEW),
        (MIN_FRAMES, MIN_S - 0.04, math.nan, f"too short to tell ({MIN_S:.1f} s, {MIN_S:g} s are needed)"),
        (MIN_FRAMES, MIN_S, math.nan, "every value is the same: nothing tells its scatter"),
        (MIN_FRAMES, MIN_S, 0.99, "too short to tell (n_eff below 1)"),
        (MIN_FRAMES, MIN_S, 1.0, "too short to tell (n_eff 1)"),
        (MIN_FRAMES, MIN_S, 1.74, "too short to tell (n_eff 1.7)"),
        (MIN_FRAMES, MIN_S, 9.94, "too short to tell (n_eff 9.9)"),
        (MIN_FRAMES, MIN_S, 10.0, ""),
    ],
)
def test_what_a_session_lacks_is_said_in_order(n, duration_s, n_eff, words):
    assert _too_short(n, duration_s, n_eff) == words


def test_in_too_short_a_time_there_are_bounds_of_scatter_alone():
    short, long = (
        axis(np.random.default_rng(2).normal(0, 1, 100), step_s) for step_s in (MIN_S / 100, MIN_S / 99 + 1e-8)
    )
    assert math.isnan(short.n_eff)
    assert math.isnan(short.bias_error_arcsec)
    assert math.isnan(short.p95_abs_bounds_arcsec.upper)
    assert short.std_bounds_arcsec.low < 1.0 < short.std_bounds_arcsec.high
    assert short.nea_low_arcsec < 1.0 < short.nea_high_arcsec
    assert math.isfinite(long.p95_abs_bounds_arcsec.upper)


def test_a_frame_that_has_no_neighbour_tells_no_noise():
    figures = axis([1.0, -1.0, 2.0], step_s=30.0)
    assert math.isnan(figures.nea_arcsec)
    assert math.isnan(figures.low_frequency_arcsec)


def test_of_no_frame_nothing_is_known():
    figures = axis([])
    assert figures.n == 0
    plain = [field.name for field in fields(AxisStatistics) if field.name not in ("n", "too_short")]
    values = [getattr(figures, name) for name in plain]
    assert all(math.isnan(value if isinstance(value, float) else value.upper) for value in values)


def test_one_frame_has_a_bias_and_no_scatter():
    figures = axis([-3.0])
    assert (figures.bias_arcsec, figures.rms_arcsec, figures.mean_abs_arcsec) == (-3.0, 3.0, 3.0)
    assert math.isnan(figures.std_arcsec)
    assert math.isnan(figures.tau_s)
    assert axis([1.0, 3.0]).std_arcsec == pytest.approx(math.sqrt(2))


def test_frames_of_the_same_instant_are_in_order():
    assert axis_statistics(np.zeros(3, dtype=np.int64), np.array([1.0, 2.0, 3.0])).bias_arcsec == 2.0
    with pytest.raises(ValueError, match="the instants of the errors are not in order; sort them first"):
        axis_statistics(np.array([0, 1, 0]), np.zeros(3))
