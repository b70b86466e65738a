"""Bounds of errors against their definitions, written out with numpy from the error of a mean."""

import math

import numpy as np
import pytest

from gse.assessment.autocorrelation import mean_error
from gse.assessment.sampling import effective_number, error_bounds, percentile_95, root_mean_square_bounds

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
