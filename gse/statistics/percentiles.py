"""Percentiles of something measured once per frame."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class Percentiles:
    """Percentiles of ``n`` values; NaN where there is none."""

    n: int
    p50: float
    p95: float
    p99: float
    max: float


def percentiles(values: NDArray[np.float64]) -> Percentiles:
    """Percentiles of the finite values."""
    finite = values[np.isfinite(values)]
    if len(finite) == 0:
        return Percentiles(0, _NAN, _NAN, _NAN, _NAN)
    p50, p95, p99 = (float(value) for value in np.percentile(finite, [50, 95, 99]))
    return Percentiles(len(finite), p50, p95, p99, float(finite.max()))
