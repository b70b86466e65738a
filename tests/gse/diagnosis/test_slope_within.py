"""The slope within stars, against a regression with an intercept for each star, clustered by star."""

import numpy as np
import pytest
import scipy.stats

from gse.statistics.slopes import slope_within


def test_the_slope_within_stars_has_the_interval_of_a_regression_clustered_by_star() -> None:
    random = np.random.default_rng(3)
    stars, at = np.repeat([2, 3, 5, 8, 11, 40], 40), np.tile(np.linspace(0, 2, 40), 6)
    place = np.repeat(np.arange(6), 40)
    values = 0.3 * at + random.normal(size=6)[place] * (1 + at) + random.normal(scale=0.1, size=240)
    design = np.column_stack([at, *(place == one for one in range(6))]).astype(float)
    inverse = np.linalg.inv(design.T @ design)
    fit = inverse @ design.T @ values
    scores = [design[place == one].T @ (values - design @ fit)[place == one] for one in range(6)]
    sigma = np.sqrt((inverse @ np.transpose(scores) @ scores @ inverse)[0, 0])
    half = float(scipy.stats.t(5).ppf(0.975)) * sigma
    assert slope_within(at, values, stars.astype(np.int32), 6) == pytest.approx((fit[0], half))


def test_too_few_stars_tell_no_slope() -> None:
    stars, at = np.repeat(np.arange(5, dtype=np.int32), 30), np.tile(np.linspace(0, 1, 30), 5)
    assert slope_within(at, at, stars, 6) is None
    assert slope_within(at, at, stars, 5) == pytest.approx((1.0, 0.0))


def test_stars_of_one_instant_have_no_slope() -> None:
    stars = np.arange(12, dtype=np.int32) % 6
    assert slope_within(np.zeros(12), np.arange(12.0), stars, 5) is None
    assert slope_within(np.arange(12.0) // 6, np.arange(12.0), stars, 5) is not None
