"""How long a session must be: what is expected of a sensor, against scipy's distributions."""

import math

import numpy as np
import pytest
import scipy.signal
import scipy.stats

from gse.statistics.sampling import MIN_FRAMES, error_bounds
from gse.verdict.planning import (
    Expected,
    _independent_values,
    _passes,
    _settled,
    _simulate,
    _Simulated,
    _stretch,
    _true_statistics,
    accuracy_frames,
    availability_frames,
    false_answer_frames,
    simulated_errors,
)


@pytest.mark.parametrize(
    ("tau_s", "frames_per_s", "frames"), [(0.0, 10.0, 1.0), (0.05, 10.0, 1.0), (4.0, 10.0, 40.0), (40.0, 0.5, 20.0)]
)
def test_an_independent_value_takes_the_frames_of_its_correlation_time(tau_s, frames_per_s, frames):
    assert Expected(0.0, 1.0, tau_s, frames_per_s).frames_per_value == frames


@pytest.mark.parametrize(
    ("bias", "noise"), [(0.0, 5.0), (3.0, 5.0), (-3.0, 5.0), (20.0, 5.0), (1.0, 0.1), (7.0, 0.0), (-7.0, 0.0)]
)
def test_mean_and_95th_percentile_are_those_of_a_folded_normal_distribution(bias, noise):
    found = _true_statistics(Expected(bias, noise, 0.0, 1.0))
    folded = scipy.stats.foldnorm(abs(bias) / noise, scale=noise) if noise else None
    expected = (folded.mean(), folded.ppf(0.95)) if folded else (7.0, 7.0)
    assert found == pytest.approx(expected, rel=1e-9)


def test_the_same_minutes_decide_at_any_rate_of_frames_where_errors_hang_together():
    """Twenty seconds make a value, of 60 frames or of 300."""
    slow, fast = (accuracy_frames(Expected(0.0, 20.0, 20.0, hz), 60.0, truth_arcsec=0.0) for hz in (3.0, 15.0))
    assert fast == pytest.approx(5 * slow, abs=5)


@pytest.mark.parametrize(("bias", "truth", "can_pass"), [(59.9, 0.0, True), (60.0, 0.0, False), (50.0, 6.1, False)])
def test_what_truth_and_bias_leave_no_room_for_never_passes(bias, truth, can_pass):
    """1.645 times 6.1 arcsec are 10.03."""
    found = accuracy_frames(Expected(bias, 0.0, 0.0, 1.0), 60.0, truth_arcsec=truth)
    assert (found is not None) is can_pass


@pytest.mark.parametrize("tau_s", [0.0, 10.0])
def test_errors_are_made_with_their_bias_scatter_and_correlation(tau_s):
    made = simulated_errors(Expected(-2.0, 3.0, tau_s, 1.0), 4000, 50, np.random.default_rng(5))
    assert made.shape == (50, 4000)
    assert made.mean() == pytest.approx(-2.0, abs=0.1)
    assert made.std() == pytest.approx(3.0, rel=0.02)
    left = made + 2.0
    lag = (left[:, 1:] * left[:, :-1]).mean() / (left**2).mean()
    share = (tau_s - 1) / (tau_s + 1) if tau_s else 0.0  # whose sum over all lags, (1 + share) / (1 - share), is tau
    assert lag == pytest.approx(share, abs=0.01)


@pytest.mark.parametrize(("expected", "limit"), [(0.99, 0.95), (0.97, 0.95), (0.999, 0.99)])
def test_nine_of_ten_sessions_of_the_planned_length_have_their_lower_bound_above_the_limit(expected, limit):
    frames = availability_frames(expected, limit)

    def passes(count):
        missing = int(scipy.stats.binom.ppf(0.9, count, 1 - expected))
        return scipy.stats.beta.ppf(0.05, count - missing, missing + 1) >= limit

    assert passes(frames)
    assert not passes(round(0.97 * frames)) or not passes(round(0.94 * frames))
    assert availability_frames(expected, limit, frames_per_value=2.5) == pytest.approx(2.5 * frames, abs=1)
    assert availability_frames(limit, limit) is None


@pytest.mark.parametrize(("tau_s", "hz", "share"), [(0.0, 1.0, 0.0), (3.0, 1.0, 0.5), (2.0, 4.5, 0.8)])
def test_errors_are_an_autoregressive_process_that_begins_with_its_scatter(tau_s, hz, share):
    """By a filter: each value keeps a share of the one before, and what is new keeps the variance."""
    made = simulated_errors(Expected(-2.0, 3.0, tau_s, hz), 50, 4, np.random.default_rng(8))
    white = np.random.default_rng(8).standard_normal((50, 4))
    new = np.vstack([white[:1], math.sqrt(1 - share**2) * white[1:]])
    assert made == pytest.approx(-2.0 + 3.0 * scipy.signal.lfilter([1.0], [1.0, -share], new, axis=0).T)


def brute_force(expected, limit):
    """The least number whose lower bound keeps the limit in nine of ten sessions."""

    def passes(count):
        missing = int(scipy.stats.binom.ppf(0.9, count, 1 - expected)) if expected < 1 else 0
        return missing < count and scipy.stats.beta.ppf(0.05, count - missing, missing + 1) >= limit

    return next(count for count in range(1, 300) if passes(count))


@pytest.mark.parametrize(
    ("expected", "limit"), [(1.0, 0.95), (1.0, 0.5), (0.99, 0.95), (0.98, 0.9), (0.9, 0.75), (0.5, 0.3), (0.3, 0.2)]
)
def test_the_first_number_of_frames_that_passes_is_the_one_planned(expected, limit):
    assert availability_frames(expected, limit) == brute_force(expected, limit)


@pytest.mark.parametrize(("expected", "can_pass"), [(0.95071, True), (0.9505, False), (0.94, False)])
def test_no_more_than_a_million_frames_are_planned(expected, can_pass):
    """By the normal distribution 0.071 % above the limit take 0.8 million, 0.05 % take 1.6."""
    frames = availability_frames(expected, 0.95)
    assert (frames is not None) is can_pass
    if frames:
        normal = ((1.2816 * math.sqrt(expected * (1 - expected)) + 1.6449 * math.sqrt(0.0475)) / (expected - 0.95)) ** 2
        assert frames == pytest.approx(normal, rel=0.02)


def test_runs_of_frames_count_as_one_each_and_their_last_is_not_cut():
    assert availability_frames(1.0, 0.95, frames_per_value=2.51) == 149  # 59 of 2.51 are 148.09


@pytest.mark.parametrize(("limit", "frames"), [(0.05, 59), (0.01, 299), (0.001, 2995), (0.5, 5)])
def test_frames_without_a_false_answer_show_less_than_a_limit_with_95_percent(limit, frames):
    assert false_answer_frames(limit) == frames
    assert (1 - limit) ** frames <= 0.05 < (1 - limit) ** (frames - 1)


@pytest.mark.parametrize(
    ("values", "guards", "truth", "passes"),
    [
        ((50.0, 30.0), (10.0, 30.0), 0.0, True),  # both at the limit itself
        ((50.0, 30.0), (10.001, 30.0), 0.0, False),
        ((50.0, 30.0), (10.0, 30.001), 0.0, False),
        ((57.0, 30.0), (0.0, 30.0), 0.0, True),
        ((55.0, 50.0), (3.0, 6.0), 4 / 1.645001, True),  # 3 and 4 make 5
        ((55.0, 50.0), (3.0, 6.0), 4 / 1.644999, False),
    ],
)
def test_a_session_passes_where_both_figures_keep_the_limit_with_their_guards(values, guards, truth, passes):
    assert _passes(np.array([values]), np.array([guards]), 60.0, truth).tolist() == [passes]


def ten_sessions(first, second=1.0, value=10.0):
    """Distances to the bounds of both figures, the greatest of the first one by one."""
    guards = np.column_stack([first - np.arange(10.0), np.full(10, second)])
    return _Simulated(np.full((10, 2), value), guards)


TRUE_TEN = Expected(10.0, 0.0, 0.0, 1.0)


@pytest.mark.parametrize(
    ("simulated", "truth", "most", "times"),
    [
        # Nine of ten must pass, so that the second of the distances counts; 50 arcsec are left of the limit.
        (ten_sessions(49.0), 0.0, 2.0, (48 / 50) ** 2),
        (ten_sessions(61.0), 0.0, 2.0, (60 / 50) ** 2),
        (ten_sessions(20.0, second=55.0), 0.0, 2.0, (55 / 50) ** 2),
        (ten_sessions(41.0, value=20.0), 0.0, 2.0, (50 / 50) ** 2),  # what lies 10 beyond the true value shrinks too
        (ten_sessions(47.0, value=4.0), 0.0, 2.0, (40 / 50) ** 2),
        (ten_sessions(41.0), 30 / 1.645, 2.0, 1.0),  # 30 and 40 make 50
        (ten_sessions(101.0), 0.0, 2.0, 2.0),  # four times as long, but twice at most in a step
        (ten_sessions(101.0), 0.0, 1e6, 4.0),
        (ten_sessions(26.0), 0.0, 2.0, 0.5),
        (ten_sessions(26.0), 0.0, 1e6, 0.25),
    ],
)
def test_distances_shrink_with_the_root_of_the_length_until_nine_of_ten_sessions_pass(simulated, truth, most, times):
    assert _stretch(simulated, TRUE_TEN, 60.0, truth, most=most) == pytest.approx(times, rel=1e-9)


@pytest.mark.parametrize(
    ("expected", "n_eff", "frames", "unit"),
    [
        (Expected(4.0, 2.0, 0.0, 1.0), 40.0, 40, Expected(2.0, 1.0, 0.0, 1.0)),
        (Expected(0.0, 3.0, 4.0, 1.0), 12.0, 48, Expected(0.0, 1.0, 4.0, 1.0)),
        (Expected(0.0, 3.0, 300.0, 1.0), 5.0, 300, Expected(0.0, 1.0, 60.0, 1.0)),  # 60 a value tell as much as 300
        (Expected(-3.0, 3.0, 0.0, 1.0), 12.0, MIN_FRAMES, Expected(-1.0, 1.0, 0.0, 1.0)),  # fewer frames have no bounds
    ],
)
def test_sessions_are_simulated_in_units_of_the_noise_and_bounded_as_a_verdict_bounds_them(
    expected, n_eff, frames, unit
):
    found = _simulate(expected, n_eff)
    errors = expected.noise_arcsec * simulated_errors(unit, frames, 120, np.random.default_rng(1))
    assert found.values == pytest.approx(
        np.column_stack([np.abs(errors).mean(1), np.percentile(np.abs(errors), 95, 1)])
    )
    assert found.values.shape == (120, 2)
    for row in (0, 7, 119):
        bounds = error_bounds(errors[row])
        upper = found.values[row] + found.guards[row]
        assert upper == pytest.approx((bounds.mean_abs.upper, bounds.p95_abs.upper))


def test_an_error_that_never_changes_is_simulated_as_it_is():
    found = _simulate(TRUE_TEN, 30.0)
    assert found.values == pytest.approx(np.full((120, 2), 10.0))
    assert np.isnan(found.guards).all()


def shares(expected, n_eff, limit, truth, sessions=120):
    made = _simulate(expected, n_eff, sessions)
    return float(_passes(made.values, made.guards, limit, truth).mean())


@pytest.mark.parametrize(
    ("expected", "limit", "truth"),
    [(Expected(0.0, 20.0, 0.0, 1.0), 60.0, 3.0), (Expected(0.0, 25.0, 0.0, 1.0), 60.0, 0.0)],
)
def test_the_length_that_is_searched_lies_between_one_that_fails_and_one_that_passes(expected, limit, truth):
    found = _independent_values(expected, limit, truth)
    assert 10 < found < 400
    assert shares(expected, 1.15 * found, limit, truth) >= 0.9 > shares(expected, found / 1.15, limit, truth)


def test_beyond_what_is_simulated_the_length_goes_with_the_square_of_the_distance():
    expected = Expected(0.0, 29.0, 0.0, 1.0)
    found = _independent_values(expected, 60.0, 0.0)
    made = _simulate(expected, 400.0)
    true = np.array(_true_statistics(expected))
    scale = math.sqrt(400 / found)
    assert found > 400
    assert np.sort((true + scale * (made.values - true + made.guards)).max(axis=1))[107] == pytest.approx(60.0)


def test_what_lies_far_within_its_limit_needs_five_independent_values():
    """Ten are the fewest that are tried, and one step halves them."""
    assert _independent_values(Expected(0.0, 1.0, 0.0, 1.0), 1000.0, 0.0) == pytest.approx(5.0)
    assert accuracy_frames(Expected(0.0, 1.0, 0.0, 1.0), 1000.0, truth_arcsec=0.0) == MIN_FRAMES


def test_a_length_is_settled_by_a_line_through_the_shares_of_more_sessions():
    """The shares as quantiles of a normal distribution, over the logarithm of the length, a fifth longer at most."""
    expected, asked = Expected(0.0, 20.0, 0.0, 1.0), {}
    for n_eff in (30.0, 36.0):
        lengths = n_eff * np.array([0.85, 1.0, 1.2])
        seen = [shares(expected, length, 60.0, 3.0, 400) for length in lengths.tolist()]
        line = scipy.stats.linregress(np.log(lengths), scipy.stats.norm.ppf(seen))
        asked[n_eff] = math.exp((scipy.stats.norm.ppf(0.9) - line.intercept) / line.slope)
        found = _settled(n_eff, expected, 60.0, 3.0)
        assert found == pytest.approx(min(max(asked[n_eff], n_eff), 1.2 * n_eff))
    assert asked[30.0] > 36.0
    assert 36.0 < asked[36.0] < 43.2


@pytest.mark.parametrize("n_eff", [400.5, 1e6])
def test_a_length_beyond_what_is_simulated_stays(n_eff):
    assert _settled(n_eff, Expected(0.0, 20.0, 0.0, 1.0), 60.0, 0.0) == n_eff
