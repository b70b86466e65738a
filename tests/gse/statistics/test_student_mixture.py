"""Mixtures of Student's t distributions against scipy's."""

import math

import numpy as np
import pytest
import scipy.optimize
import scipy.stats

from gse.statistics.error_model import MixedStudent


@pytest.mark.parametrize(
    ("weights", "scales", "standard"),
    [
        ((1.0,), (3.0,), 3.0),
        ((0.25, 0.5, 0.25), (3.0, 1.0, 2.0), 1.0),  # half of the weight is reached with the least
        ((0.375, 0.375, 0.25), (3.0, 1.0, 2.0), 2.0),
        ((0.75, 0.125, 0.125), (3.0, 1.0, 2.0), 3.0),
        ((0.25, 0.25, 0.25, 0.25), (1.0, 2.0, 3.0, 4.0), 2.0),
    ],
)
def test_the_standard_error_is_the_scale_that_half_of_the_weight_reaches(weights, scales, standard) -> None:
    assert MixedStudent(np.array(weights), np.array(scales), 5).standard == standard


@pytest.mark.parametrize("freedom", [2, 3, 4, 5, 8, 31, 32])
@pytest.mark.parametrize("probability", [0.501, 0.8, 0.95, 0.975, 0.99999])
@pytest.mark.parametrize(
    ("weights", "scales"),
    [
        ((1.0,), (0.5,)),
        ((0.7, 0.2, 0.1), (1.0, 5.0, 100.0)),
        ((0.999, 0.001), (1.0, 1e4)),
        ((0.001, 0.999), (1e-3, 7.0)),
    ],
)
def test_a_half_width_is_reached_with_its_probability(weights, scales, freedom, probability) -> None:
    error = MixedStudent(np.array(weights), np.array(scales), freedom)

    def missing(half_width):
        return float(error.weights @ scipy.stats.t.cdf(half_width / error.scales, freedom)) - probability

    most = float(error.scales.max() * scipy.stats.t.ppf(probability, freedom)) * (1 + 1e-9)
    expected = scipy.optimize.brentq(missing, 0.0, most, xtol=1e-15, rtol=1e-13)
    assert error.half_width(probability) == pytest.approx(expected, rel=1e-6)
    assert math.isfinite(expected)
