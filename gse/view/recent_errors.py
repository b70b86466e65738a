"""The errors of the last ten minutes in short stretches, for small pictures."""

import math
from collections import deque

STRETCHES = 120
STRETCH_NS = 5_000_000_000


class RecentErrors:
    """Smallest and largest value of each stretch of five seconds, over ten minutes; a stretch without one is a gap."""

    def __init__(self) -> None:
        self._stretches: deque[tuple[int, float, float]] = deque(maxlen=STRETCHES)

    def add(self, utc_ns: int, value: float) -> None:
        """Add a value; one from before the latest stretch, after a step of the clock, begins anew."""
        number = utc_ns // STRETCH_NS
        if self._stretches and number < self._stretches[-1][0]:
            self._stretches.clear()
        if self._stretches and self._stretches[-1][0] == number:
            _, low, high = self._stretches[-1]
            self._stretches[-1] = number, min(low, value), max(high, value)
        else:
            self._stretches.append((number, value, value))

    def until(self, utc_ns: int, limit: float) -> list[list[float] | None]:
        """Pairs of smallest and largest value up to an instant, oldest first, in shares of ``limit``."""
        last = utc_ns // STRETCH_NS
        found = {number: [_share(low, limit), _share(high, limit)] for number, low, high in self._stretches}
        return [found.get(number) for number in range(last - STRETCHES + 1, last + 1)]


def _share(value: float, limit: float) -> float:
    """To two decimals, and within twice the limit: a picture shows no more."""
    return round(math.copysign(min(abs(value / limit), 2.0), value), 2)
