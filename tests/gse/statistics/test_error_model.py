"""The likelihood behind the bounds, against dense covariance matrices and draws."""

import math

import numpy as np
import pytest

from gse.statistics.error_model import BLOCKS, SESSION, _blocks, _cells, _filtered, error_model
from gse.verdict.planning import Expected, simulated_errors


def correlated(n, tau_s, seed=1):
    return simulated_errors(Expected(0.0, 1.0, tau_s, 1.0), n, 1, np.random.default_rng(seed))[0]


def white(n, seed=1, scale=1.0):
    return np.random.default_rng(seed).normal(0, scale, n)


@pytest.mark.parametrize(("tau", "strength"), [(1.0, 0.0), (0.02, 3.0), (0.3, 0.1), (8.0, 500.0)])
def test_the_filter_gives_the_products_with_the_inverse_of_the_covariance(tau, strength):
    generator = np.random.default_rng(1)
    means, middles = generator.normal(size=40), np.sort(generator.uniform(0, 1.3, 40))
    of_white = generator.uniform(0.5, 3.0, 40)
    covariance = strength * np.exp(-np.abs(middles[:, None] - middles) / tau) + np.diag(of_white)
    columns = np.array([means, np.ones(40), middles - 0.5])
    products = columns @ np.linalg.solve(covariance, columns.T)
    found = _filtered(means, middles, of_white, np.array([tau]), np.array([strength]))[:, 0]
    assert found[:6] == pytest.approx(products[np.triu_indices(3)])
    assert found[6] == pytest.approx(np.linalg.slogdet(covariance)[1])


def test_half_of_the_belief_is_in_white_noise_alone():
    cells = _cells(100)
    belief = np.exp(cells.log_prior)
    assert (cells.strengths[0], belief[0]) == (0.0, pytest.approx(0.5))
    assert belief[cells.taus <= SESSION].sum() == pytest.approx(1.0)


def test_the_error_of_a_mean_of_white_noise_is_one_over_the_root_of_its_number():
    found = [error_model(white(2000, seed, 3.0)).mean_error().standard for seed in range(9)]
    assert np.median(found) == pytest.approx(3 / math.sqrt(2000), rel=0.1)


@pytest.mark.parametrize("tau_s", [6.0, 60.0])
def test_the_error_of_a_mean_of_correlated_noise_is_that_of_its_correlation(tau_s):
    found = [error_model(correlated(6000, tau_s, seed)).mean_error().standard for seed in range(9)]
    assert np.median(found) == pytest.approx(math.sqrt(tau_s / 6000), rel=0.25)


def test_the_error_of_a_slope_of_white_noise_is_that_of_least_squares():
    at = np.linspace(0.0, 5.0, 300)
    found = [error_model(white(300, seed), at).slope_error().standard for seed in range(9)]
    assert np.median(found) == pytest.approx(1 / math.sqrt(((at - at.mean()) ** 2).sum()), rel=0.1)


@pytest.mark.parametrize("longest", [SESSION, math.inf])
def test_the_points_are_spread_as_draws_from_the_model_are(longest):
    model, generator = error_model(correlated(600, 40.0)), np.random.default_rng(2)
    cells = generator.choice(len(model.means), 100_000, p=model.weights(longest))
    variances = model.variances[cells] * 239 / generator.chisquare(239, 100_000)
    means = model.means[cells] + generator.normal(size=100_000) * np.sqrt(variances * model.of_mean[cells])
    spreads = np.sqrt(variances * (1 + _cells(240).strengths[cells]) + model.within / 600)
    shares = [0.05, 0.25, 0.5, 0.75, 0.95]
    for found, drawn in zip(model.points(longest), (means, spreads), strict=True):
        scale = np.subtract(*np.quantile(drawn, [0.75, 0.25]))
        assert np.quantile(found, shares) == pytest.approx(np.quantile(drawn, shares), abs=0.3 * scale, rel=0.05)


def test_blocks_end_at_a_gap_and_their_time_is_that_of_the_session_without_it():
    time_s = np.arange(6000.0)
    first, middles, length = _blocks(time_s + 9000.0 * (time_s >= 2000))
    assert 2000 in first
    assert len(first) <= BLOCKS + 1
    assert length == pytest.approx(6000, rel=0.01)
    assert np.diff(middles).max() == pytest.approx(9000 / length, rel=0.02)


def test_frames_that_share_an_instant_have_a_model():
    model = error_model(white(400), np.repeat(np.arange(10.0), 40))
    assert np.isfinite(model.log_weights).all()
    assert math.isfinite(model.mean_error().half_width(0.95))


def test_the_shape_is_told_by_as_many_values_as_do_not_repeat_one_another():
    assert error_model(white(5000)).shape_number == pytest.approx(5000, rel=0.05)
    assert error_model(correlated(5000, 6.0)).shape_number == pytest.approx(5000 / 1.5, rel=0.4)
    assert 10 < error_model(correlated(5000, 500.0)).shape_number < 200
