"""The errors of the last ten minutes in short stretches, for small pictures."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

STRETCHES = 120
STRETCH_NS = 5_000_000_000


@dataclass(frozen=True, slots=True)
class RecentErrors:
    """Smallest and largest value of each stretch of five seconds, over ten minutes; a stretch without one is a gap."""

    _stretches: tuple[tuple[int, float, float], ...] = ()

    def with_errors(self, utc_ns: NDArray[np.int64], values: NDArray[np.float64]) -> "RecentErrors":
        """These and later ones (N,); one from before the latest stretch, after a step of the clock, begins anew."""
        stretches = list(self._stretches)
        for number, value in zip((utc_ns // STRETCH_NS).tolist(), values.tolist(), strict=True):
            if stretches and stretches[-1][0] == number:
                _, low, high = stretches[-1]
                stretches[-1] = number, min(low, value), max(high, value)
                continue
            if stretches and number < stretches[-1][0]:
                stretches.clear()
            stretches.append((number, value, value))
        return RecentErrors(tuple(stretches[-STRETCHES:]))

    def until(self, utc_ns: int, limit: float) -> list[list[float] | None]:
        """Pairs of smallest and largest value up to an instant, oldest first, in shares of ``limit``."""
        last = utc_ns // STRETCH_NS
        found = {number: [_share(low, limit), _share(high, limit)] for number, low, high in self._stretches}
        return [found.get(number) for number in range(last - STRETCHES + 1, last + 1)]


def _share(value: float, limit: float) -> float:
    """To two decimals, and within twice the limit: a picture shows no more."""
    return round(math.copysign(min(abs(value / limit), 2.0), value), 2)
