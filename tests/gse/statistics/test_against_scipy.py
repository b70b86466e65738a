"""Wahba's solution against scipy's Rotation.align_vectors, bounds and slopes against scipy.stats."""

import math

import numpy as np
import pytest
import scipy.stats
from scipy.spatial.transform import Rotation

from gse.statistics.slopes import theil_sen
from gse.values.attitude import solve_attitude

ARCSEC = math.radians(1 / 3600)


@pytest.mark.parametrize("spread", [0.001, 0.1, 1.0])
def test_the_attitude_is_that_of_align_vectors(spread: float) -> None:
    rng = np.random.default_rng(1)
    for _ in range(300):
        count = int(rng.integers(2, 31))
        directions = rng.normal(size=(count, 3)) * [spread, spread, 0.0] + [0, 0, 1]
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        stars = Rotation.random(random_state=int(rng.integers(2**31))).inv().apply(directions)
        measured = directions + rng.normal(0, 10 * ARCSEC, directions.shape)
        measured /= np.linalg.norm(measured, axis=1)[:, None]
        sigma = rng.uniform(1, 30, count) * ARCSEC
        expected, _ = Rotation.align_vectors(measured, stars, weights=sigma**-2.0)
        solved = Rotation.from_matrix(solve_attitude(measured, stars, sigma).icrs_to_sensor)
        assert (solved * expected.inv()).magnitude() < 1e-3 * ARCSEC


@pytest.mark.parametrize("step", [0.0, 0.5])
@pytest.mark.parametrize("count", [*range(2, 40), 60, 301])
def test_slopes_are_those_of_theilslopes_ties_included(count: int, step: float) -> None:
    rng = np.random.default_rng(count)
    at, values = np.sort(rng.normal(size=count)), rng.normal(size=count)
    if step and count > 3:
        at, values = np.round(at / step) * step, np.round(values / step) * step
    expected = scipy.stats.theilslopes(values, at)
    slope = theil_sen(values, at)
    assert (slope.slope, slope.low, slope.high) == (expected.slope, expected.low_slope, expected.high_slope)
