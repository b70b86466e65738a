"""Guarded acceptance: limits met from both sides, lengths against scipy's distributions."""

import math

import pytest
import scipy.optimize
import scipy.stats

from gse.statistics.decision import exceeds, further_share, guard, keeps

TRUTH_OF_4 = 4 / 1.645


def test_what_sampling_and_truth_leave_open_adds_in_squares() -> None:
    assert guard(3.0, TRUTH_OF_4) == pytest.approx(5.0)
    assert guard(3.0, 0.0) == 3.0
    assert guard(0.0, 1.0) == 1.645
    assert math.isnan(guard(math.nan, 1.0))
    assert guard(math.inf, 1.0) == math.inf


@pytest.mark.parametrize(
    ("value", "upper", "limit", "truth", "is_kept"),
    [
        (50.0, 55.0, 55.0, 0.0, True),  # the limit itself keeps it
        (50.0, 55.0, 54.999, 0.0, False),
        (50.0, 53.0, 55.001, TRUTH_OF_4, True),
        (50.0, 53.0, 54.999, TRUTH_OF_4, False),
        (50.0, math.nan, 60.0, 0.0, False),
        (50.0, math.inf, 60.0, 0.0, False),
    ],
)
def test_a_limit_is_kept_where_figure_and_guard_reach_it_at_most(value, upper, limit, truth, is_kept) -> None:
    assert keeps(value, upper, limit, truth) is is_kept


@pytest.mark.parametrize(
    ("value", "lower", "limit", "truth", "is_beyond"),
    [
        (70.0, 65.0, 65.0, 0.0, False),  # at the limit itself nothing is shown
        (70.0, 65.0, 64.999, 0.0, True),
        (70.0, 67.0, 64.999, TRUTH_OF_4, True),
        (70.0, 67.0, 65.001, TRUTH_OF_4, False),
        (70.0, math.nan, 60.0, 0.0, False),
        (70.0, -math.inf, 60.0, 0.0, False),
    ],
)
def test_a_limit_is_exceeded_where_the_figure_less_its_guard_is_above(value, lower, limit, truth, is_beyond) -> None:
    assert exceeds(value, lower, limit, truth) is is_beyond


def test_without_a_word_truth_is_known() -> None:
    assert keeps(50.0, 55.0, 55.0)
    assert exceeds(70.0, 65.0, 64.999)


@pytest.mark.parametrize(
    ("distance", "sampling", "truth", "more"),
    [
        (10.0, 20.0, 0.0, 3.0),  # half the distance takes four times as long
        (-10.0, 20.0, 0.0, 3.0),
        (0.5, 1.0, 0.0, 3.0),
        (10.0, 10.0, 0.0, 0.0),
        (10.0, 9.0, 0.0, 0.0),
        (10.0, 0.0, 0.0, 0.0),
        (5.0, 6.0, TRUTH_OF_4, 3.0),  # truth takes 4 of 5 and leaves 3
        (5.0, 2.0, TRUTH_OF_4, 0.0),
        (0.0, 1.0, 0.0, math.inf),
        (4.0, 1.0, 4.001 / 1.645, math.inf),
        (10.0, math.inf, 0.0, math.inf),
        (math.nan, 1.0, 0.0, math.inf),
    ],
)
def test_uncertainty_falls_with_the_root_of_the_length_until_it_is_as_the_distance(
    distance, sampling, truth, more
) -> None:
    assert further_share(distance, sampling, truth) == pytest.approx(more, rel=1e-9)


def test_nothing_can_be_told_of_a_figure_without_bounds() -> None:
    assert math.isnan(further_share(10.0, math.nan, 0.0))
    assert math.isnan(further_share(10.0, math.nan, 0.0, 5.0))
    assert further_share(10.0, math.inf, 0.0, 5.0) == math.inf
    assert further_share(10.0, 9.0, 0.0, 5.0) == 0.0


@pytest.mark.parametrize(
    ("sampling", "n_eff"), [(12.0, 1.0), (12.5, 2.5), (20.0, 3.0), (20.0, 40.0), (60.0, 1.5), (300.0, 10.0)]
)
def test_few_independent_values_learn_their_scatter_too(sampling, n_eff) -> None:
    """Student's quantile falls with the values; of 500 lengths the next one is told."""

    def left(log_times):
        times = math.exp(log_times)
        quantile = scipy.stats.t.ppf(0.95, n_eff * times) / scipy.stats.t.ppf(0.95, n_eff)
        return sampling * quantile / math.sqrt(times) - 10.0

    most = (sampling / 10) ** 2
    exact = math.exp(scipy.optimize.brentq(left, 0.0, math.log(most) + 1e-9))
    found = further_share(10.0, sampling, 0.0, n_eff) + 1
    assert exact * (1 - 1e-6) <= found <= exact * most ** (1 / 499) * (1 + 1e-6)


def test_less_than_one_independent_value_counts_as_one_and_very_many_know_their_scatter() -> None:
    assert further_share(10.0, 20.0, 0.0, 0.3) == further_share(10.0, 20.0, 0.0, 1.0)
    assert further_share(10.0, 20.0, 0.0, 1e12) == pytest.approx(3.0)
    assert further_share(10.0, 20.0, 0.0, 1.2) != further_share(10.0, 20.0, 0.0, 1.0)


@pytest.mark.parametrize(("sampling", "n_eff"), [(20.0, 3.0), (35.0, 6.0), (300.0, 10.0)])
def test_the_length_is_one_of_five_hundred_of_even_ratios_from_that_of_the_session_to_that_of_a_known_scatter(
    sampling, n_eff
) -> None:
    most = (sampling / 10) ** 2
    steps = math.log(further_share(10.0, sampling, 0.0, n_eff) + 1) / math.log(most) * 499
    assert 0 < steps < 499
    assert steps == pytest.approx(round(steps), abs=1e-6)
