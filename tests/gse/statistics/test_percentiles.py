"""Percentiles of what is measured once per frame, by hand."""

import math

import numpy as np
import pytest

from gse.statistics.sampling import Percentiles, percentiles


def test_percentiles_of_0_to_200_are_twice_their_numbers() -> None:
    values = np.random.default_rng(1).permutation(np.arange(201.0))
    assert percentiles(values) == Percentiles(n=201, p50=100.0, p95=190.0, p99=198.0, max=200.0)


def test_what_is_not_finite_counts_for_nothing() -> None:
    assert percentiles(np.array([math.nan, 4.0, math.inf, 2.0, -math.inf])) == Percentiles(
        2, 3.0, pytest.approx(3.9), pytest.approx(3.98), 4.0
    )
    assert percentiles(np.array([7.0])) == Percentiles(1, 7.0, 7.0, 7.0, 7.0)


@pytest.mark.parametrize("values", [[], [math.nan, math.inf]])
def test_percentiles_of_nothing_are_not_known(values) -> None:
    found = percentiles(np.array(values, dtype=float))
    assert found.n == 0
    assert all(math.isnan(value) for value in (found.p50, found.p95, found.p99, found.max))
