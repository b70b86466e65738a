"""The sensor's clock against the host's: UTC of an exposure from the sensor's own time tag.

A first byte is read some 0.1-20 ms late, never early; the sensor's tag has no such jitter. So the least
(host - sensor) difference of the last frames is the clock offset, and the tag gives the time. Differences are taken on
the host's monotonic clock: a step of its UTC clock moves no frame against another.
"""

from collections import deque

from gse.instant import NS_PER_S

WINDOW_FRAMES = 200
"""Frames that the least difference is taken over: good to some 30 us."""

WINDOW_NS = 30 * NS_PER_S
"""Nothing older counts: a sensor clock that drifts by 50 ppm moves 1.5 ms in this time."""


class SensorClock:
    """Turns the sensor's time tags into UTC, from what was seen up to now."""

    def __init__(self) -> None:
        self._least: deque[tuple[int, int, int]] = deque()
        self._count = 0

    def reset(self) -> None:
        """Forget all: the sensor's clock has started anew."""
        self._least.clear()

    def utc_ns(self, time_us: int, *, arrived_mono_ns: int, utc_minus_mono_ns: int) -> int:
        """UTC of a time tag whose event would have been seen at ``arrived_mono_ns`` or a little before."""
        sensor_ns = time_us * 1000
        difference = arrived_mono_ns - sensor_ns
        while self._least and self._least[-1][0] >= difference:
            self._least.pop()
        self._least.append((difference, self._count, sensor_ns))
        self._count += 1
        while self._least[0][1] < self._count - WINDOW_FRAMES or self._least[0][2] < sensor_ns - WINDOW_NS:
            self._least.popleft()
        return sensor_ns + self._least[0][0] + utc_minus_mono_ns
