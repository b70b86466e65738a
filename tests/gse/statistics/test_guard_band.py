"""Guarded acceptance: limits met from both sides, lengths against scipy's distributions."""

import math

import numpy as np
import pytest
import scipy.stats

from gse.statistics.decision import exceeds, further_share, guard, keeps, lengths_to_pass
from gse.statistics.sampling import error_bounds
from gse.verdict.planning import Expected, simulated_errors

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
    ("distance", "sampling", "truth", "n_eff"),
    [(10.0, 20.0, 0.0, math.inf), (15.0, 16.0, 4.0, 6.0), (-12.0, 20.0, 2.0, 40.0)],
)
def test_four_in_five_sessions_are_decided_after_the_length_that_is_said(distance, sampling, truth, n_eff) -> None:
    """Drawn: where the true figure lies, and what the rest of the session shows of it."""
    more, generator = further_share(distance, sampling, truth, n_eff), np.random.default_rng(1)
    true, new = sampling / 1.645 * generator.normal(size=(2, 100_000))

    def decided(times):
        ahead = ((times - 1) * (true + new / math.sqrt(times - 1))) / times
        narrower = 1 / math.sqrt(times)
        if n_eff < math.inf:
            narrower *= scipy.stats.t.ppf(0.95, n_eff * times) / scipy.stats.t.ppf(0.95, n_eff)
        uncertainty = math.hypot(sampling * narrower, 1.645 * truth)
        return ((ahead + uncertainty <= distance) | (ahead - uncertainty > distance)).mean()

    assert 0 < more < 100
    assert decided(1 + more) == pytest.approx(0.8, abs=0.03)


@pytest.mark.parametrize(
    ("distance", "sampling", "truth", "more"),
    [
        (10.0, 10.0, 0.0, 0.0),
        (-10.0, 9.0, 0.0, 0.0),
        (5.0, 3.0, TRUTH_OF_4, 0.0),
        (4.0, 1.0, 4.001 / 1.645, math.inf),
        (1.0, 5.0, 2.0, math.inf),
        (0.0, 10.0, 3.0, math.inf),
        (10.0, math.nan, 0.0, math.nan),
        (10.0, math.inf, 0.0, math.inf),
        (10.0, 20.0, math.inf, math.inf),
    ],
)
def test_what_is_decided_takes_no_time_and_what_truth_hides_no_length_decides(distance, sampling, truth, more) -> None:
    assert further_share(distance, sampling, truth) == pytest.approx(more, nan_ok=True)
    assert further_share(distance, sampling, truth, 5.0) == pytest.approx(more, nan_ok=True)


def test_nine_in_ten_sessions_of_the_length_that_is_said_pass() -> None:
    """U is 1.645 times the scatter of a figure: both have to fit into the room, the scatter 1.2816 times."""
    times = lengths_to_pass(20.0, 10.0, 0.0)
    assert times == pytest.approx((10 / 20 * (1 + 1.2816 / 1.645)) ** 2, rel=0.12)
    assert lengths_to_pass(40.0, 10.0, 0.0, 8.0) > lengths_to_pass(40.0, 10.0, 0.0)
    assert lengths_to_pass(20.0, 10.0, 13.0) == math.inf
    assert lengths_to_pass(-1.0, 10.0, 0.0) == math.inf
    assert math.isnan(lengths_to_pass(20.0, math.nan, 0.0))


def test_less_than_one_independent_value_counts_as_one() -> None:
    few = [further_share(20.0, 30.0, 0.0, n_eff) for n_eff in (0.3, 1.0, 3.0)]
    assert few[0] == few[1] != few[2]


def test_a_session_that_goes_on_as_long_as_it_was_told_is_decided() -> None:
    """A correlation time of a twentieth of the session, a sensor at 0.7 of its limit."""
    limit, decided = 1.95996 / 0.7, []

    def further(errors):
        found, p95 = error_bounds(errors), float(np.percentile(np.abs(errors), 95))
        sampling = found.p95_abs.upper - p95 if p95 <= limit else p95 - found.p95_abs.lower
        return further_share(limit - p95, sampling, 0.0, found.n_eff)

    for errors in simulated_errors(Expected(0.0, 1.0, 20.0, 1.0), 6000, 40, np.random.default_rng(5)):
        times = 1 + further(errors[:200])
        if 1 < times <= 30:
            decided.append(further(errors[: round(200 * times)]) == 0)
    assert len(decided) > 10
    assert np.mean(decided) >= 0.75
