"""Bounds of errors against their definitions, written out with numpy from the error of a mean."""

import math

import numpy as np
import pytest
import scipy.stats

from gse.statistics.error_model import SESSION, error_model
from gse.statistics.sampling import (
    _at_share,
    _bent,
    _beyond,
    _exp,
    _folded,
    _growth,
    _level,
    _shape_error,
    effective_number,
    error_bounds,
    mean_bounds,
    root_mean_square_bounds,
    slope_bounds,
)

TWO_SIDED, ONE_SIDED = 0.975, 0.95


def half_width(values, probability):
    return error_model(values).mean_error().half_width(probability)


def exceeded(absolute, share):
    """What a share of further values exceeds, the values taken as those at 1, 2, ... of n + 1."""
    n = len(absolute)
    return float(np.interp((1 - share) * (n + 1), np.arange(1, n + 1), np.sort(absolute)))


@pytest.mark.parametrize("bias", [0.0, 0.3, 1.7, 6.0])
def test_the_figures_of_normal_errors_are_those_of_the_folded_normal_distribution(bias) -> None:
    mean, p95 = _folded(np.array([-2 * bias]), np.array([2.0]))[:, 0]
    assert mean == pytest.approx(2 * scipy.stats.foldnorm.mean(bias))
    assert p95 == pytest.approx(2 * scipy.stats.foldnorm.ppf(0.95, bias), abs=1e-4)


def test_the_bounds_are_those_of_the_model_about_the_figures_seen_with_the_error_of_their_shape() -> None:
    errors = np.random.default_rng(3).normal(1.0, 2.0, 300)
    absolute, found, model = np.abs(errors), error_bounds(errors), error_model(errors)
    seen = absolute.mean(), np.percentile(absolute, 95)
    plain = _folded(np.array([errors.mean()]), np.array([errors.std()]))[:, 0]
    level = _level(errors.mean() / errors.std(), found.n_eff)
    of_points = np.quantile(_folded(*model.points(SESSION)), level, axis=1) - plain
    shape = _shape_error(absolute, np.sort(absolute), model.shape_number, 1.644854)
    upper = seen + np.hypot(of_points, shape)
    assert (found.mean_abs.upper, found.p95_abs.upper) == pytest.approx(tuple(upper))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_shape_of_a_percentile_is_known_as_the_share_of_values_beyond_it(side) -> None:
    """Woodruff (1952), on the logarithm of the share."""
    absolute = np.abs(np.random.default_rng(3).normal(0, 1.0, 3000))
    log = side * 1.645 * math.sqrt(0.95 / 0.05 / 3000)
    expected = exceeded(absolute, 0.05 * math.exp(-log)) - exceeded(absolute, 0.05)
    assert _shape_error(absolute, np.sort(absolute), 3000.0, side * 1.645)[1] == pytest.approx(0.8 * expected)


@pytest.mark.parametrize(
    ("bias", "n_eff", "level"),
    [(0.0, 7.0, 0.74), (0.0, 1.0, 0.74), (0.0, 70.0, 0.938), (0.6, 4.0, 0.85), (1.2, 1.0, 0.96), (5.0, 1.0, 0.96)],
)
def test_u_is_taken_at_a_lower_level_where_a_bias_is_not_known(bias, n_eff, level) -> None:
    assert _level(bias, n_eff) == pytest.approx(level)


def test_a_bend_is_the_departure_from_a_line_beyond_its_noise() -> None:
    s = (np.arange(400) + 0.5) / 400
    wave = np.sin(2 * np.pi * s)
    residuals = wave - np.polyval(np.polyfit(s, wave, 1), s)
    assert _bent(residuals) == pytest.approx(1.3 * np.ptp(residuals.reshape(8, 50).mean(axis=1)), rel=0.01)
    assert np.median([_bent(np.random.default_rng(seed).normal(size=400)) for seed in range(9)]) < 0.1


def test_a_root_mean_square_is_bounded_on_the_scale_of_its_logarithm() -> None:
    values = np.random.default_rng(5).normal(0, 3.0, 100)
    mean, found = float((values**2).mean()), root_mean_square_bounds(values)
    two, one = (half_width(values**2, probability) / mean / 2 for probability in (TWO_SIDED, ONE_SIDED))
    expected = [math.sqrt(mean) * math.exp(power) for power in (-two, two, -one, one)]
    assert [found.low, found.high, found.lower, found.upper] == pytest.approx(expected)


def test_what_is_less_certain_than_by_its_size_is_bounded_by_the_tangent() -> None:
    """e x instead of exp(x), beyond 1: no figure is bounded by its own thousandfold."""
    values = np.append(0.1 * np.random.default_rng(2).exponential(1.0, 39), [40.0] * 2)
    mean = float((values**2).mean())
    wide = half_width(values**2, TWO_SIDED) / mean / 2
    assert wide > 1
    assert root_mean_square_bounds(values).high == pytest.approx(math.sqrt(mean) * math.e * wide)


def test_a_share_of_frames_has_the_number_whose_binomial_interval_is_as_wide() -> None:
    happened = np.repeat(np.random.default_rng(7).random(400) > 0.2, 10)
    share, half = happened.mean(), half_width(happened.astype(float), TWO_SIDED)
    number = effective_number(happened)
    assert 1.959964 * math.sqrt(share * (1 - share) / number) == pytest.approx(half, rel=1e-6)


# Parts, by hand


ONE_TO_TEN = np.arange(1.0, 11.0)


@pytest.mark.parametrize(
    ("share", "value"),
    [
        (1.5, 0.0),
        (1.0, 0.0),  # all of them exceed it: an absolute value is 0 at least
        (0.999, 1.0),
        (10 / 11, 1.0),  # further values fall into each of eleven gaps alike
        (9.5 / 11, 1.5),
        (0.5, 5.5),
        (1.25 / 11, 9.75),
        (1 / 11, 10.0),
        (0.01, 10.0),
    ],
)
def test_a_share_of_further_values_exceeds_an_interpolated_one(share, value) -> None:
    assert _at_share(ONE_TO_TEN, share) == pytest.approx(value)


@pytest.mark.parametrize(
    ("n_eff", "is_of_the_tail"), [(2.99 / 0.025, True), (3.01 / 0.025, False), (1e9, False), (1.0, True)]
)
def test_below_three_independent_values_a_tail_falls_as_the_mean_excess_of_the_upper_fifth(n_eff, is_of_the_tail):
    """Of 0, 1, ... 39: the fifth from 32 on has a mean excess of 3.5. Twice as far out, where an exponential one falls
    to a half, lies log(2) of it farther."""
    ascending = np.arange(40.0)
    percentile, farther = 0.95 * 41 - 1, 0.975 * 41 - 1
    expected = percentile + 3.5 * math.log(2) if is_of_the_tail else farther
    assert _beyond(ascending, math.log(2), n_eff) == pytest.approx(expected)


def test_a_tail_is_no_shorter_than_the_values_themselves() -> None:
    ascending = np.append(np.ones(39), 100.0)
    assert _beyond(ascending, math.log(2), 1.0) == pytest.approx(1.0 + 99.0 * (0.975 * 41 - 39))


@pytest.mark.parametrize(
    ("log", "grown"),
    [(0.0, 1.0), (0.5, math.sqrt(math.e)), (0.99, math.exp(0.99)), (1.01, 1.01 * math.e), (3.0, 3 * math.e)],
)
def test_growth_is_exponential_up_to_e_and_its_tangent_beyond(log, grown) -> None:
    assert _growth(log) == pytest.approx(grown)


@pytest.mark.parametrize(("log", "held"), [(3.0, 3.0), (-3.0, -3.0), (49.0, 49.0), (51.0, 50.0), (-1e9, -50.0)])
def test_an_exponential_neither_overflows_nor_vanishes(log, held) -> None:
    assert math.log(_exp(log)) == pytest.approx(held)


# What an effective number is, and what tells nothing


def test_the_effective_number_is_that_of_independent_values_with_such_an_error() -> None:
    slow = np.cumsum(np.random.default_rng(1).normal(size=300))
    found = error_bounds(slow)
    assert found.n_eff == pytest.approx(slow.var() / error_model(slow).mean_error(SESSION).standard ** 2)
    assert found.tau_frames == pytest.approx(300 / found.n_eff)
    to_and_fro = np.resize([1.0, -1.0], 300) + 0.1 * np.random.default_rng(1).normal(size=300)
    assert error_bounds(to_and_fro).n_eff == 300
    assert error_bounds(to_and_fro).tau_frames == 1.0


def test_a_bias_is_bounded_by_both_half_widths_about_it() -> None:
    errors = np.random.default_rng(3).normal(4.0, 1.0, 50)
    two, one, mean = half_width(errors, TWO_SIDED), half_width(errors, ONE_SIDED), errors.mean()
    expected = pytest.approx([mean - two, mean + two, mean - one, mean + one])
    for found in (error_bounds(errors).bias, mean_bounds(errors)):
        assert [found.low, found.high, found.lower, found.upper] == expected


def nothing(bounds):
    return all(math.isnan(value) for value in (bounds.low, bounds.high, bounds.lower, bounds.upper))


def test_errors_of_one_size_bound_their_bias_alone() -> None:
    errors = np.resize([1.0, -1.0, 1.0], 60)
    found = error_bounds(errors)
    assert found.n_eff == pytest.approx(min(errors.var() / error_model(errors).mean_error(SESSION).standard ** 2, 60))
    assert found.tau_frames == pytest.approx(60 / found.n_eff)
    assert found.bias.high - found.bias.low == pytest.approx(2 * half_width(errors, TWO_SIDED))
    assert nothing(found.mean_abs)
    assert nothing(found.p95_abs)


@pytest.mark.parametrize(("count", "value"), [(29, None), (30, 5.0)])
def test_few_values_and_equal_ones_bound_nothing(count, value) -> None:
    values = np.random.default_rng(1).normal(size=count) if value is None else np.full(count, value)
    found = error_bounds(values)
    assert math.isnan(found.n_eff)
    assert math.isnan(found.tau_frames)
    at = np.arange(float(count))
    bounds = (found.bias, found.mean_abs, found.p95_abs, mean_bounds(values), root_mean_square_bounds(values))
    assert all(map(nothing, (*bounds, slope_bounds(1.0, at, values))))


def test_thirty_values_bound_all() -> None:
    values = np.random.default_rng(1).normal(size=30)
    found = error_bounds(values)
    bounds = (found.bias, found.mean_abs, found.p95_abs, mean_bounds(values), root_mean_square_bounds(values))
    assert not any(map(nothing, (*bounds, slope_bounds(1.0, np.arange(30.0), values))))


def test_a_slope_is_bounded_by_its_own_error_and_by_the_bend() -> None:
    at = np.sort(np.random.default_rng(6).uniform(3.0, 9.0, 80))
    values = 2.0 * at + np.sin(at) + np.random.default_rng(7).normal(0, 1.0, 80)
    bent = _bent(values - np.polyval(np.polyfit(at, values, 1), at)) / (at[-1] - at[0])
    error = error_model(values, at).slope_error()
    two, one = (math.hypot(error.half_width(probability), bent) for probability in (TWO_SIDED, ONE_SIDED))
    found = slope_bounds(1.75, at, values)
    assert [found.low, found.high, found.lower, found.upper] == pytest.approx(
        [1.75 - two, 1.75 + two, 1.75 - one, 1.75 + one]
    )


def test_a_slope_over_one_place_or_without_any_scatter_has_no_bounds() -> None:
    values = np.random.default_rng(7).normal(size=40)
    assert nothing(slope_bounds(1.0, np.full(40, 3.0), values))
    assert nothing(slope_bounds(1.0, np.arange(40.0), np.zeros(40)))
    two_places = np.repeat([-1.0, 1.0], 16)  # exact in binary
    assert nothing(slope_bounds(0.5, two_places, 0.5 * two_places))


@pytest.mark.parametrize(
    ("happened", "number"),
    [(np.zeros(50, dtype=bool), 50.0), (np.ones(50, dtype=bool), 50.0), (np.zeros(0, dtype=bool), 0.0)],
)
def test_what_happened_always_or_never_counts_as_its_frames(happened, number) -> None:
    assert effective_number(happened) == number


def test_what_happens_in_turn_counts_as_its_frames_at_most() -> None:
    assert effective_number(np.resize([True, False], 400)) == 400


@pytest.mark.parametrize("at", [[0.0] * 39 + [1.0], [0.0] + [1.0] * 39], ids=["but the last", "but the first"])
def test_a_slope_over_two_places_has_bounds(at) -> None:
    values = np.random.default_rng(7).normal(size=40)
    assert not nothing(slope_bounds(1.0, np.array(at), values))
