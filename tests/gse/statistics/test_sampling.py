"""Sampling bounds against closed forms and scipy.stats, on series whose answer is known."""

import math

import numpy as np
import pytest
import scipy.stats
from hypothesis import given, settings
from hypothesis import strategies as st

from gse.statistics.axis_statistics import axis_statistics, drift
from gse.statistics.decision import exceeds, guard, keeps
from gse.statistics.error_model import MixedStudent, error_model
from gse.statistics.sampling import (
    MIN_FRAMES,
    effective_number,
    error_bounds,
    mean_bounds,
    quantile_bounds,
    root_mean_square_bounds,
    slope_bounds,
)
from gse.values.instant import NS_PER_S
from gse.verdict.planning import Expected, accuracy_frames, availability_frames, false_answer_frames, simulated_errors


def axis(error, step_s=1.0):
    return axis_statistics(np.arange(len(error)) * round(step_s * NS_PER_S), np.asarray(error, dtype=float))


def white(n, seed=1, scale=1.0):
    return np.random.default_rng(seed).normal(0, scale, n)


def correlated(n, tau_s, sessions=1, seed=1):
    return simulated_errors(Expected(0.0, 1.0, tau_s, 1.0), n, sessions, np.random.default_rng(seed))


# The mixture


@pytest.mark.parametrize("probability", [0.95, 0.975])
def test_one_shape_alone_is_students_t(probability):
    error = MixedStudent(np.array([1.0]), np.array([3.0]), 32)
    assert error.half_width(probability) == pytest.approx(3 * scipy.stats.t.ppf(probability, 32), rel=1e-5)


def test_the_quantile_of_a_mixture_is_that_of_its_distribution():
    error = MixedStudent(np.array([0.7, 0.2, 0.1]), np.array([1.0, 5.0, 100.0]), 20)
    reached = error.weights @ scipy.stats.t.cdf(error.half_width(0.975) / error.scales, 20)
    assert reached == pytest.approx(0.975, abs=1e-6)


@pytest.mark.parametrize("freedom", [2, 3, 15, 16, 31, 32])
@pytest.mark.parametrize("probability", [0.6, 0.95, 0.9999])
def test_the_distribution_is_students_with_any_freedom(freedom, probability):
    error = MixedStudent(np.array([0.5, 0.5]), np.array([0.1, 20.0]), freedom)
    reached = error.weights @ scipy.stats.t.cdf(error.half_width(probability) / error.scales, freedom)
    assert reached == pytest.approx(probability, abs=1e-7)


def test_white_noise_has_an_interval_close_to_students():
    ratios = []
    for seed in range(40):
        values = white(400, seed)
        half = scipy.stats.t.ppf(0.975, 399) * values.std(ddof=1) / math.sqrt(400)
        ratios.append(error_model(values).mean_error().half_width(0.975) / half)
    assert 1.0 < np.median(ratios) < 1.4


# Correlation


@pytest.mark.parametrize("tau_s", [10.0, 40.0])
def test_the_effective_number_is_that_of_an_autoregressive_process(tau_s):
    found = [error_bounds(values).n_eff for values in correlated(8000, tau_s, 15)]
    assert np.median(found) == pytest.approx(8000 / tau_s, rel=0.3)


def test_bounds_of_correlated_errors_hold_the_truth():
    held = []
    for values in correlated(900, 30.0, 80):
        bounds = error_bounds(values)
        p95 = scipy.stats.norm.ppf(0.975)
        held.append(
            [
                bounds.bias.low < 0 < bounds.bias.high,
                bounds.mean_abs.low < math.sqrt(2 / math.pi) < bounds.mean_abs.high,
                bounds.p95_abs.low < p95 < bounds.p95_abs.high,
            ]
        )
    assert (np.mean(held, axis=0) >= 0.91).all()


def test_a_session_shorter_than_its_correlation_gets_no_narrow_interval():
    narrow, said = 0, 0
    for values in correlated(600, 600.0, 40):
        found = axis(values)
        narrow += found.bias_bounds_arcsec.low > 0 or found.bias_bounds_arcsec.high < 0
        said += found.too_short.startswith("too short to tell (n_eff ")
    assert narrow <= 5
    assert said >= 36


def test_what_lies_far_beyond_its_limit_fails_however_slowly_it_changes():
    errors = 78_000 + 10 * np.arange(600.0)
    assert exceeds(float(np.percentile(errors, 95)), error_bounds(errors).p95_abs.lower, 60.0)


@pytest.mark.parametrize("cycles", [1, 1.4, 2])
def test_the_drift_of_a_sinusoid_of_few_cycles_lies_between_its_bounds(cycles):
    time_s, held, noise = np.arange(3600.0), [], np.random.default_rng(1)
    for phase in np.linspace(0, 2 * np.pi, 16, endpoint=False):
        wave = 10 * np.sin(2 * np.pi * cycles * time_s / 3600 + phase) + noise.normal(0, 3, 3600)
        bounds = drift(time_s, wave)[1]
        held.append(bounds.low < 0 < bounds.high)
    assert np.mean(held) >= 0.85


# What a decision takes


def passes(errors, limit):
    bounds, absolute = error_bounds(errors), np.abs(errors)
    return keeps(float(absolute.mean()), bounds.mean_abs.upper, limit[0]) and keeps(
        float(np.percentile(absolute, 95)), bounds.p95_abs.upper, limit[1]
    )


@pytest.mark.parametrize(("bias", "figures"), [(0.0, (0.79788, 1.95996)), (2.0, (2.01698, 3.64522))])
def test_a_sensor_at_its_limit_seldom_passes_and_one_at_its_half_does(bias, figures):
    """Ten correlation times, of which no session knows its scatter."""
    sessions = correlated(600, 120.0, 120, seed=3) + bias
    at_limit = np.mean([keeps(0.0, error_bounds(errors).p95_abs.upper, figures[1]) for errors in sessions])
    at_half = np.mean([passes(errors, 2 * np.array(figures)) for errors in sessions])
    assert at_limit <= 0.12
    assert at_half >= 0.5


def u_sampling(errors, time_s=None):
    """Of mean and 95th percentile."""
    bounds, absolute = error_bounds(errors, time_s), np.abs(errors)
    return bounds.mean_abs.upper - absolute.mean(), bounds.p95_abs.upper - np.percentile(absolute, 95)


@pytest.mark.parametrize("tau_s", [0.0, 20.0])
def test_u_falls_with_the_root_of_the_length_of_a_stationary_session(tau_s):
    short, long = (
        np.median([u_sampling(errors) for errors in correlated(n, tau_s, 15, seed=4)], axis=0) for n in (1000, 16_000)
    )
    assert (short / long > 3.0).all()
    assert (short / long < 7.0).all()


def test_six_hours_of_white_noise_leave_a_hundredth_of_it():
    assert max(u_sampling(white(43_200, 2, 5.0))) < 0.15


@pytest.mark.parametrize("frames", [100, 3000])
def test_a_gap_cuts_a_series_and_does_not_shorten_it(frames):
    """A minute or an hour is missing, twice; the errors before, between and after it are as many as ever."""
    sessions, time_s = correlated(frames, 10.0, 15), np.arange(float(frames))
    later = (time_s > frames / 3).astype(float) + (time_s > frames / 2)
    whole, *cut = (
        np.median([u_sampling(errors, time_s + gap_s * later) for errors in sessions], axis=0)
        for gap_s in (0.0, 60.0, 3600.0)
    )
    for one in cut:
        assert one == pytest.approx(whole, rel=0.25)


HOURS = np.arange(10_800) / 7200
NATURAL = {
    "a mount that sinks by 20 arcsec/h": 20 * HOURS - 15,
    "a slip of 15 arcsec": 15.0 * (HOURS > 0.75),
    "a slip near the end": 15.0 * (HOURS > 1.3),
    "two slips": 10.0 * (HOURS > 0.5) - 8 * (HOURS > 1),
    "a swing of 8 arcsec while it sinks": 3 * HOURS + 8 * np.sin(2 * np.pi * HOURS / 0.67),
}


@pytest.mark.parametrize("name", NATURAL)
def test_a_change_of_the_session_is_in_u_once(name):
    """By its size or less, at two frames/s for an hour and a half."""
    errors = NATURAL[name] + white(10_800, 1, 4.0)
    for u in u_sampling(errors):
        assert u < np.ptp(NATURAL[name])


@settings(max_examples=30)
@given(
    st.integers(MIN_FRAMES, 400),
    st.floats(0, 1),
    st.sampled_from([0.0, 1.0, 30.0, 1e4]),
    st.integers(0, 10**6),
)
def test_u_is_never_larger_than_twice_the_spread_of_the_errors_seen(n, walk, bias, seed):
    generator = np.random.default_rng(seed)
    errors = bias + walk * np.cumsum(generator.normal(size=n)) + generator.standard_t(3, n)
    spread = float(np.percentile(np.abs(errors - errors.mean()), 99))
    assert max(u_sampling(errors)) <= 2 * spread * (1 + 1e-9)


def test_every_bound_is_outside_its_one_sided_bound():
    for found in (error_bounds(white(60, scale=3.0)), error_bounds(correlated(3000, 20.0)[0])):
        for bounds in (found.bias, found.mean_abs, found.p95_abs):
            assert bounds.low < bounds.lower < bounds.upper < bounds.high


def test_the_95th_percentile_of_white_noise_is_bounded_like_order_statistics():
    """The exact ranks that hold it with 95 %, from the binomial distribution."""
    values = white(2000, 3)
    ascending = np.sort(np.abs(values))
    low, high = (ascending[int(scipy.stats.binom.ppf(p, 2000, 0.95))] for p in (0.025, 0.975))
    bounds = error_bounds(values).p95_abs
    assert bounds.high - bounds.low == pytest.approx(1.3 * (high - low), rel=0.35)
    assert bounds.low < ascending[1900] < bounds.high


def test_a_standard_deviation_is_bounded_like_chi_square():
    values = white(1000, 4)
    bounds = root_mean_square_bounds(values)
    low, high = (math.sqrt((values**2).sum() / scipy.stats.chi2.ppf(p, 1000)) for p in (0.975, 0.025))
    assert bounds.low < low * 1.01
    assert bounds.high > high * 0.99
    assert bounds.high - bounds.low < 2 * (high - low)


# What tells nothing


@pytest.mark.parametrize("count", [0, 1, 2, MIN_FRAMES - 1])
def test_few_frames_get_a_word_and_no_bounds(count):
    found = axis(white(count))
    assert found.too_short == f"too few frames to tell ({count}, {MIN_FRAMES} are needed)"
    assert math.isnan(found.bias_bounds_arcsec.low)
    assert math.isnan(found.p95_abs_bounds_arcsec.upper)


@pytest.mark.parametrize("value", [0.0, 5.0, -1e9])
def test_the_same_number_every_time_is_no_evidence_of_anything(value):
    found = axis([value] * 600)
    assert found.too_short == "every value is the same: nothing tells its scatter"
    assert not keeps(found.mean_abs_arcsec, found.mean_abs_bounds_arcsec.upper, 60.0)
    assert not exceeds(found.mean_abs_arcsec, found.mean_abs_bounds_arcsec.lower, 60.0)


def test_a_pattern_that_cancels_gives_numbers():
    found = axis(np.resize([1.0, -1.0], 4096))
    assert math.isfinite(found.bias_error_arcsec)
    assert math.isnan(found.mean_abs_bounds_arcsec.upper)


@pytest.mark.parametrize("n", [MIN_FRAMES, MIN_FRAMES + 1, 60, 1000])
def test_nothing_is_unknown_where_there_are_enough_frames(n):
    found = axis(white(n, scale=10.0), step_s=5.0)
    for bounds in (found.bias_bounds_arcsec, found.std_bounds_arcsec, found.p95_abs_bounds_arcsec):
        assert all(math.isfinite(value) for value in (bounds.low, bounds.high, bounds.lower, bounds.upper))
    numbers = (found.n_eff, found.tau_s, found.drift_low_arcsec_per_h, found.low_frequency_high_arcsec)
    assert all(math.isfinite(value) for value in (*numbers, found.nea_low_arcsec, found.nea_high_arcsec))


def test_instants_out_of_order_are_refused():
    with pytest.raises(ValueError, match="not in order"):
        axis_statistics(np.array([2, 1, 3]), np.zeros(3))


def test_the_same_errors_have_the_same_bounds_and_a_gap_changes_the_bias_of_white_noise_little():
    errors, utc_ns = white(600), np.arange(600) * NS_PER_S
    assert axis_statistics(utc_ns, errors) == axis_statistics(utc_ns, errors)
    gap = axis_statistics(np.where(utc_ns > 300 * NS_PER_S, utc_ns + 3600 * NS_PER_S, utc_ns), errors)
    assert gap.bias_error_arcsec == pytest.approx(axis_statistics(utc_ns, errors).bias_error_arcsec, rel=0.1)


# Drift, low-frequency error, shares


@pytest.mark.parametrize("frames", [3, 4, 41, 100])
def test_a_drift_of_few_frames_is_the_slope_of_theil_and_sen(frames):
    time_s = 7.0 * np.arange(frames)
    errors = 2.0 * time_s / 3600 + white(frames)
    assert drift(time_s, errors)[0] == pytest.approx(scipy.stats.theilslopes(errors, time_s / 3600).slope, rel=1e-9)


def test_two_frames_tell_no_drift():
    assert np.isnan(drift(np.array([0.0, 7.0]), np.array([1.0, 2.0]))[0])


def test_a_drift_in_correlated_noise_lies_between_its_bounds():
    hours = np.arange(1800) / 3600
    held = []
    for values in correlated(1800, 40.0, 40, seed=2):
        found = axis(values + 20 * hours)
        held.append(found.drift_low_arcsec_per_h < 20 < found.drift_high_arcsec_per_h)
    assert np.mean(held) >= 0.85


@pytest.mark.parametrize("step_s", [0.1, 1.0, 10.0])
def test_white_noise_has_no_low_frequency_error(step_s):
    found = [axis(white(1200, seed, 10.0), step_s) for seed in range(10)]
    assert sum(one.low_frequency_low_arcsec == 0 for one in found) >= 9
    assert sum(one.low_frequency_arcsec == 0 for one in found) >= 2


def test_low_frequency_error_beside_noise_is_found_with_its_size():
    time_s = np.arange(3600.0)
    found = axis(white(3600, 5, 10.0) + 5 * math.sqrt(2) * np.sin(2 * np.pi * time_s / 600))
    assert found.low_frequency_arcsec == pytest.approx(5.0, rel=0.1)
    assert found.low_frequency_low_arcsec < 5.0 < found.low_frequency_high_arcsec


def test_outages_in_runs_count_as_one_each():
    together = np.ones(3600, dtype=bool)
    for start in np.random.default_rng(2).integers(0, 3580, 9):
        together[start : start + 20] = False
    alone = np.random.default_rng(1).random(3600) > 0.05
    assert effective_number(together) < 3600 / 10
    assert effective_number(alone) > 3600 / 3
    assert effective_number(np.ones(500, dtype=bool)) == 500


def test_the_bounds_of_a_mean_widen_with_correlation():
    slow, fast = mean_bounds(correlated(2000, 50.0)[0]), mean_bounds(white(2000))
    assert slow.high - slow.low > 3 * (fast.high - fast.low)


# Decision, plan


def test_a_limit_is_kept_only_beyond_the_guard_band():
    assert guard(3.0, 4 / 1.645) == pytest.approx(5.0)
    assert keeps(50.0, 55.0, 60.0)
    assert not keeps(50.0, 55.0, 60.0, truth_standard=10.0)
    assert exceeds(70.0, 65.0, 60.0)
    assert not exceeds(70.0, 65.0, 60.0, truth_standard=10.0)
    assert not keeps(math.nan, math.nan, 60.0)
    assert not keeps(1.0, math.inf, 60.0)


def test_what_is_at_its_limit_can_never_be_shown():
    assert accuracy_frames(Expected(0.0, 31.0, 0.0, 1.0), 60.0, truth_arcsec=0.0) is None  # 95 %: 60.8
    assert accuracy_frames(Expected(0.0, 10.0, 0.0, 1.0), 60.0, truth_arcsec=30.0) is None
    assert availability_frames(0.95, 0.95) is None


@pytest.mark.parametrize(
    ("expected", "truth_arcsec", "least", "most"),
    [
        (Expected(0.0, 20.0, 0.0, 1.0), 3.0, 40, 150),
        (Expected(0.0, 25.0, 0.0, 1.0), 0.0, 150, 360),
        (Expected(0.0, 18.0, 8.0, 1.0), 7.0, 60, 350),
    ],
    ids=["white", "near the limit", "few independent values"],
)
def test_sessions_of_the_planned_length_pass(expected, truth_arcsec, least, most):
    n = accuracy_frames(expected, 60.0, truth_arcsec=truth_arcsec)
    assert least <= n <= most
    passed = []
    for errors in simulated_errors(expected, n, 100, np.random.default_rng(7)):
        upper = error_bounds(errors).p95_abs.upper
        passed.append(keeps(float(np.percentile(np.abs(errors), 95)), upper, 60.0, truth_arcsec))
    assert 0.8 <= np.mean(passed) <= 0.98


def test_nine_in_ten_pass_where_a_bias_leaves_few_independent_values():
    """The search alone, with 120 sessions, takes 262 frames, and 87 % pass."""
    expected = Expected(20.0, 10.0, 8.0, 1.0)
    n = accuracy_frames(expected, 60.0, truth_arcsec=3.0)
    passed = []
    for errors in simulated_errors(expected, n, 800, np.random.default_rng(11)):
        bounds = error_bounds(errors).p95_abs
        passed.append(keeps(float(np.percentile(np.abs(errors), 95)), bounds.upper, 60.0, 3.0))
    assert 0.885 <= np.mean(passed) <= 0.92


def test_very_near_a_limit_the_length_goes_as_one_over_the_square_of_the_margin():
    """The 95th percentile of noise of 1 is 1.96; what is left of 60 arcsec is 1.2, 3.2 or 7.1 arcsec."""
    lengths = {
        noise: accuracy_frames(Expected(0.0, noise, 0.0, 1.0), 60.0, truth_arcsec=0.0) for noise in (27.0, 29.0, 30.0)
    }
    scaled = [frames * ((60 - 1.959964 * noise) / noise) ** 2 for noise, frames in lengths.items()]
    assert max(scaled) < 1.03 * min(scaled)


def test_shares_are_planned_by_their_exact_bounds():
    assert false_answer_frames(0.01) == 299
    assert availability_frames(1.0, 0.95) == 59  # 0.95 ** 59 < 0.05
    n = availability_frames(0.99, 0.95)
    missing = int(scipy.stats.binom.ppf(0.9, n, 0.01))
    assert scipy.stats.beta.ppf(0.05, n - missing, missing + 1) >= 0.95


@pytest.mark.parametrize(("frames", "counts_all"), [(MIN_FRAMES - 1, True), (MIN_FRAMES, False)])
def test_so_many_frames_tell_how_much_what_happened_hangs_together(frames, counts_all):
    number = effective_number(np.arange(frames) < 12)
    assert (number == frames) is counts_all
    assert counts_all or number < 10


def test_what_scatters_about_a_slope_bounds_it_and_not_how_steep_it_is():
    at = np.linspace(0.0, 2.0, 200)
    noise = np.random.default_rng(3).normal(0, 1.0, 200)
    flat, steep = slope_bounds(0.0, at, noise), slope_bounds(50.0, at, 50.0 * at + noise)
    assert steep.high - 50.0 == pytest.approx(flat.high, rel=1e-6)
    assert steep.upper - 50.0 == pytest.approx(flat.upper, rel=1e-6)
    assert flat.upper == pytest.approx(1.645 / math.sqrt(((at - 1.0) ** 2).sum()), rel=0.2)


@pytest.mark.parametrize("scale", ["normal", "heavy"])
def test_the_bounds_of_a_quantile_hold_its_true_value_whatever_the_distribution(scale):
    law = scipy.stats.halfnorm if scale == "normal" else scipy.stats.expon(scale=3.0)
    rng, true, found = np.random.default_rng(5), law.ppf(0.99), []
    for _ in range(400):
        found.append(quantile_bounds(law.rvs(size=800, random_state=rng), 0.99)[1])
    for share in (np.mean([one.lower < true for one in found]), np.mean([one.upper > true for one in found])):
        assert 0.92 <= share <= 0.99


def test_the_upper_bound_of_997_in_1000_needs_998_independent_values():
    """As many as bring 0.997 to the power of their number below 5 %; correlation that cannot be ruled out adds some."""
    values = np.random.default_rng(1).exponential(size=1100)
    value, bounds, number = quantile_bounds(values, 0.997)
    assert 998 <= number <= 1100
    assert bounds.lower < value < bounds.upper <= values.max()
    assert math.isnan(quantile_bounds(values[:990], 0.997)[1].upper)
