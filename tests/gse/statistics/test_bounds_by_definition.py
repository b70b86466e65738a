"""Bounds of errors against their definitions, written out with numpy from the error of a mean."""

import math

import numpy as np
import pytest

from gse.statistics.autocorrelation import mean_error, weighted_sum_error
from gse.statistics.sampling import (
    Bounds,
    _above,
    _at_share,
    _beyond,
    _exp,
    _growth,
    _shifted,
    _widened,
    effective_number,
    error_bounds,
    mean_bounds,
    percentile_95,
    root_mean_square_bounds,
    slope_bounds,
)

TWO_SIDED, ONE_SIDED = 0.975, 0.95
QUANTILE = {TWO_SIDED: 1.959964, ONE_SIDED: 1.644854}


def half_width(values, probability):
    return mean_error(values).half_width(probability)


def exceeded(absolute, share):
    """What a share of further values exceeds, the values taken as those at 1, 2, ... of n + 1."""
    n = len(absolute)
    return float(np.interp((1 - share) * (n + 1), np.arange(1, n + 1), np.sort(absolute)))


def moved(errors, probability):
    """Errors with their bias at either end of its interval: least, and most with the variance of the mean beside."""
    mean, sd, half = errors.mean(), errors.std(), half_width(errors, probability)
    wider = math.sqrt(1 + (half / QUANTILE[probability] / sd) ** 2)
    return errors - np.clip(mean, -half, half), wider * (errors - mean) + mean + math.copysign(half, mean)


def log_of_share(absolute, probability):
    """How far the share of values beyond the 95th percentile may be off: known no better than their mean is."""
    beyond = (absolute >= exceeded(absolute, 0.05)).astype(float)
    by_mean = half_width(absolute, probability) * beyond.std() / absolute.std()
    return max(half_width(beyond, probability), by_mean) / beyond.mean()


@pytest.mark.parametrize("side", [1, -1])
def test_errors_of_one_sign_have_the_bounds_of_their_bias_and_of_their_logarithm(side) -> None:
    errors = side * np.random.default_rng(1).uniform(0.5, 3.5, 40)
    mean, found = float(np.abs(errors).mean()), error_bounds(errors).mean_abs
    two, one = (half_width(errors, probability) for probability in (TWO_SIDED, ONE_SIDED))
    assert (found.low, found.lower) == (pytest.approx(mean - two), pytest.approx(mean - one))
    assert (found.high, found.upper) == (
        pytest.approx(mean * math.exp(two / mean)),
        pytest.approx(mean * math.exp(one / mean)),
    )


def test_errors_about_zero_are_bounded_by_what_a_bias_may_have_hidden() -> None:
    errors = np.random.default_rng(2).normal(0.02, 1.0, 400)
    found = error_bounds(errors)
    least, lower = (moved(errors, probability)[0] for probability in (TWO_SIDED, ONE_SIDED))
    assert found.mean_abs.low <= np.abs(least).mean()
    assert found.mean_abs.lower <= np.abs(lower).mean()


@pytest.mark.parametrize("place", [0.3, 0.7])
def test_errors_that_change_sides_once_are_bounded_by_their_bias_at_the_ends_of_its_interval(place) -> None:
    """Their sizes are all alike and well known; what is not known is where they stay."""
    sides = np.where(np.arange(400) < place * 400, -1.0, 1.0)
    errors = sides * np.random.default_rng(2).normal(1.0, 0.1, 400)
    found = error_bounds(errors)
    (least, most), (lower, upper) = moved(errors, TWO_SIDED), moved(errors, ONE_SIDED)
    assert found.p95_abs.high == pytest.approx(np.percentile(np.abs(most), 95))
    assert found.p95_abs.upper == pytest.approx(np.percentile(np.abs(upper), 95))
    assert found.mean_abs.high == pytest.approx(np.abs(most).mean())
    assert found.mean_abs.upper == pytest.approx(np.abs(upper).mean())
    assert found.mean_abs.low <= np.abs(least).mean()
    assert found.mean_abs.lower <= np.abs(lower).mean()


@pytest.mark.parametrize("count", [300, 3000])
def test_the_bounds_of_a_percentile_are_percentiles_at_the_ends_of_its_share(count) -> None:
    """Woodruff (1952), on the logarithm of the share of values that lie beyond the percentile."""
    errors = np.random.default_rng(3).normal(0, 1.0, count)
    absolute, found = np.abs(errors), error_bounds(errors).p95_abs
    for probability, low, high in ((TWO_SIDED, found.low, found.high), (ONE_SIDED, found.lower, found.upper)):
        wide = log_of_share(absolute, probability)
        assert low == pytest.approx(exceeded(absolute, 0.05 * math.exp(wide)))
        assert high == pytest.approx(exceeded(absolute, 0.05 * math.exp(-wide)))


def test_where_few_values_lie_beyond_the_percentile_its_tail_is_exponential() -> None:
    errors = np.random.default_rng(8).normal(0, 1.0, 60)
    absolute, found = np.abs(errors), error_bounds(errors).p95_abs
    tail = np.sort(absolute)[48:]  # the upper fifth
    beyond = log_of_share(absolute, TWO_SIDED) * (tail - tail[0]).mean()
    assert found.high == pytest.approx(exceeded(absolute, 0.05) + beyond)


def test_a_root_mean_square_is_bounded_on_the_scale_of_its_logarithm() -> None:
    values = np.random.default_rng(5).normal(0, 3.0, 100)
    mean, found = float((values**2).mean()), root_mean_square_bounds(values)
    two, one = (half_width(values**2, probability) / mean / 2 for probability in (TWO_SIDED, ONE_SIDED))
    expected = [math.sqrt(mean) * math.exp(power) for power in (-two, two, -one, one)]
    assert [found.low, found.high, found.lower, found.upper] == pytest.approx(expected)


def test_what_is_less_certain_than_by_its_size_is_bounded_by_the_tangent() -> None:
    """e x instead of exp(x), beyond 1: no figure is bounded by its own thousandfold."""
    values = np.random.default_rng(2).exponential(1.0, 40) ** 4
    mean = float((values**2).mean())
    wide = half_width(values**2, TWO_SIDED) / mean / 2
    assert wide > 1
    assert root_mean_square_bounds(values).high == pytest.approx(math.sqrt(mean) * math.e * wide)


def test_a_share_of_frames_has_the_number_whose_binomial_interval_is_as_wide() -> None:
    happened = np.repeat(np.random.default_rng(7).random(400) > 0.2, 10)
    share, half = happened.mean(), half_width(happened.astype(float), TWO_SIDED)
    number = effective_number(happened)
    assert 1.959964 * math.sqrt(share * (1 - share) / number) == pytest.approx(half, rel=1e-6)


@pytest.mark.parametrize("count", [2, 3, 20, 21, 22, 1000])
def test_the_95th_percentile_is_numpys(count) -> None:
    values = np.random.default_rng(count).normal(size=count)
    assert percentile_95(values) == pytest.approx(np.percentile(values, 95), rel=1e-12)


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


def test_bounds_of_what_is_greater_are_no_lower() -> None:
    assert _above(Bounds(1.0, 9.0, 2.0, 8.0), Bounds(0.5, 99.0, 2.5, 99.0)) == Bounds(1.0, 9.0, 2.5, 8.0)
    assert _above(Bounds(1.0, 9.0, 2.0, 8.0), Bounds(1.5, 99.0, 1.0, 99.0)) == Bounds(1.5, 9.0, 2.0, 8.0)


def test_bounds_are_widened_to_both_sides_by_their_own_ends() -> None:
    bounds = Bounds(1.0, 9.0, 2.0, 8.0)
    assert _widened(bounds, np.array([0.5, 9.5]), np.array([1.5, 8.5])) == Bounds(0.5, 9.5, 1.5, 8.5)
    assert _widened(bounds, np.array([1.5, 8.5]), np.array([2.5, 7.5])) == bounds


@pytest.mark.parametrize("mean", [0.0, 0.4, -0.4])
def test_errors_are_shifted_by_a_half_width_towards_zero_and_away_from_it(mean) -> None:
    """Ten errors of scatter 1; three quarters of the scatter, known of the mean, make 1.25 of 1."""
    errors = np.resize([1.0, -1.0], 10) + mean
    (mean_least, mean_most), (p95_least, p95_most) = _shifted(errors, 1.5, 2.0)
    far = 1.25 + abs(mean) + 1.5
    assert (mean_least, p95_least) == pytest.approx((1.0, 1.0))  # the bias may be none
    assert p95_most == pytest.approx(far)
    assert mean_most == pytest.approx((far + (abs(mean) + 1.5 - 1.25)) / 2)


@pytest.mark.parametrize(("mean", "least"), [(4.0, 2.5), (-4.0, 2.5)])
def test_a_bias_that_is_beyond_doubt_is_taken_at_the_near_end_of_its_interval(mean, least) -> None:
    errors = np.resize([1.0, -1.0], 10) + mean
    assert _shifted(errors, 1.5, 2.0)[0, 0] == pytest.approx(least)


# What an effective number is, and what tells nothing


def test_the_effective_number_is_that_of_independent_values_with_such_an_error() -> None:
    slow = np.cumsum(np.random.default_rng(1).normal(size=300))
    found = error_bounds(slow)
    assert found.n_eff == pytest.approx(slow.var() / mean_error(slow).standard ** 2)
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
    assert found.n_eff == pytest.approx(min(errors.var() / mean_error(errors).standard ** 2, 60))
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


def test_a_percentile_that_nearly_all_values_reach_has_no_bounds() -> None:
    errors = np.where(np.arange(100) % 50 == 7, 2.0, 1.0)
    assert nothing(error_bounds(errors).p95_abs)
    assert not nothing(error_bounds(errors).mean_abs)


def test_a_slope_is_bounded_by_the_error_of_its_weighted_sum() -> None:
    at = np.sort(np.random.default_rng(6).uniform(3.0, 9.0, 80))
    values = 2.0 * at + np.random.default_rng(7).normal(0, 1.0, 80)
    weights = (at - at.mean()) / ((at - at.mean()) ** 2).sum()
    error = weighted_sum_error(weights, values - np.polyval(np.polyfit(at, values, 1), at))
    two, one = error.half_width(TWO_SIDED), error.half_width(ONE_SIDED)
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


def test_the_end_of_a_percentile_is_of_the_tail_where_less_than_three_independent_values_lie_beyond() -> None:
    """The number whose share is as well known on the scale of its logarithm: of a share p of n, (1 - p) / p / n."""
    seen = set()
    for count in range(40, 420, 20):
        errors = np.random.default_rng(count).normal(0, 1.0, count)
        absolute, found = np.abs(errors), error_bounds(errors).p95_abs
        wide = {probability: log_of_share(absolute, probability) for probability in (TWO_SIDED, ONE_SIDED)}
        share = (absolute >= exceeded(absolute, 0.05)).mean()
        number = (1 - share) / share / (wide[TWO_SIDED] / 1.959964) ** 2
        tail = np.sort(absolute)[int(0.8 * count) :]
        for probability, high in ((TWO_SIDED, found.high), (ONE_SIDED, found.upper)):
            log = wide[probability]
            inside = exceeded(absolute, 0.05 * math.exp(-log))
            is_tail = 0.05 * math.exp(-log) * number < 3
            beyond = max(inside, exceeded(absolute, 0.05) + log * (tail - tail[0]).mean()) if is_tail else inside
            assert high == pytest.approx(max(beyond, np.percentile(np.abs(moved(errors, probability)[1]), 95)))
            seen.add(is_tail)
    assert seen == {True, False}


@pytest.mark.parametrize("at", [[0.0] * 39 + [1.0], [0.0] + [1.0] * 39], ids=["but the last", "but the first"])
def test_a_slope_over_two_places_has_bounds(at) -> None:
    values = np.random.default_rng(7).normal(size=40)
    assert not nothing(slope_bounds(1.0, np.array(at), values))
