"""CPU times of any number of frames, counted to four digits: memory does not grow with the frames."""

import math
from collections import Counter

import numpy as np

from gse.statistics.percentiles import Percentiles

_NAN = float("nan")


class CpuTimes:
    """Counts of times in us; one that is unknown is a frame, but no time."""

    def __init__(self) -> None:
        self.frames = 0
        self._counts: Counter[float] = Counter()

    def add(self, cpu_us: float) -> None:
        """Count the time of a frame."""
        self.frames += 1
        if math.isfinite(cpu_us):
            self._counts[float(f"{cpu_us:.4g}")] += 1

    def percentiles(self) -> Percentiles:
        """As numpy's of the rounded times."""
        times = np.array(sorted(self._counts), dtype=np.float64)
        if not len(times):
            return Percentiles(0, _NAN, _NAN, _NAN, _NAN)
        ends = np.cumsum([self._counts[time] for time in times.tolist()])
        ranks = np.array([0.5, 0.95, 0.99]) * (ends[-1] - 1)
        lower, upper = (times[np.searchsorted(ends, rank, side="right")] for rank in (np.floor(ranks), np.ceil(ranks)))
        p50, p95, p99 = (lower + (ranks % 1) * (upper - lower)).tolist()
        return Percentiles(int(ends[-1]), p50, p95, p99, float(times[-1]))
