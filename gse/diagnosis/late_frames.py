"""How late frames are read against the sensor's time tags: a link that delays them from some moment on.

UTC of a frame comes from the least lateness of the last half minute (gse.station.reception), so a delay that begins
moves the frames half a minute afterwards, and one that ends at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkEvent
from gse.station.frame_columns import Columns
from gse.station.host_clock import clock_steps
from gse.values.instant import NS_PER_S

CRYSTAL_PPM = 100.0
"""A crystal keeps within 50 ppm over its whole temperature range."""
_BEFORE_S, _AFTER_S = 90.0, 60.0
"""Around a step that the stars show: their noise leaves its place open."""
_FEWEST = 8
"""Frames on either side: of so many one is read at once."""
_LEAP_S = 10.0
"""No link delays a frame by more, and no clock drifts so far between two frames."""
_STEADY = 0.25
"""Largest share of a step that may change on one side of it; a drift has half of it there."""


@dataclass(frozen=True, slots=True, eq=False)
class LateFrames:
    """Host stamps less time tags (M,) in s of frames at instants (M,), in order of arrival; the host's zero is any."""

    utc_ns: NDArray[np.int64]
    late_s: NDArray[np.float64]

    @classmethod
    def from_frames(cls, frames: Columns, events: Sequence[LinkEvent]) -> "LateFrames | None":
        """Of frames (rows of FRAME); None without host stamps, and where the host's clock stepped by itself."""
        host_ns = frames["host_utc_ns"]
        if not len(host_ns) or not (host_ns > 0).all() or clock_steps(events):
            return None
        tags_s = frames["time_us"].astype(np.int64) - int(frames["time_us"][0])
        return cls(frames["utc_ns"], (host_ns - host_ns[0]) / NS_PER_S - tags_s / 1e6)

    def step(self, near_ns: int) -> tuple[int, float]:
        """The greatest lasting change near an instant: first instant after it, and by how much later frames are.

        Of the least on either side: single frames may be read late.
        """
        since = (self.utc_ns - near_ns) / NS_PER_S
        rows = np.flatnonzero((since > -_BEFORE_S) & (since < _AFTER_S))
        if len(rows) < 2 * _FEWEST:
            return near_ns, 0.0
        late_s = self.late_s[rows]
        before = np.minimum.accumulate(late_s)[_FEWEST - 1 : -_FEWEST]
        after = np.minimum.accumulate(late_s[::-1])[::-1][_FEWEST : len(rows) - _FEWEST + 1]
        changes = after - before
        sizes = np.abs(changes)
        greatest = np.flatnonzero(sizes > 0.9 * sizes.max(initial=0.0))
        if not len(greatest):
            return near_ns, 0.0
        change_s = float(changes[greatest[0]])
        place = int(greatest[0] if change_s > 0 else greatest[-1]) + _FEWEST
        if max(_change_within(late_s[:place]), _change_within(late_s[place:])) > _STEADY * abs(change_s):
            return near_ns, 0.0  # a clock that runs fast or slow makes frames later all the time
        return int(self.utc_ns[rows[place]]), change_s

    @property
    def span_s(self) -> float:
        """From the first instant to the last."""
        return float(np.ptp(self.utc_ns)) / NS_PER_S

    @property
    def drift(self) -> float:
        """By how much the host's clock runs fast against the tags, in s per s, from the first quarter to the last.

        Of the longest stretch without a leap: a sensor that restarts counts anew.
        """
        leaps = np.flatnonzero(np.abs(np.diff(self.late_s)) > _LEAP_S) + 1
        rows = max(np.split(np.arange(len(self.late_s)), leaps), key=len)
        quarter, late_s, span_s = len(rows) // 4, self.late_s[rows], float(np.ptp(self.utc_ns[rows])) / NS_PER_S
        if quarter < _FEWEST or span_s == 0.0:
            return 0.0
        rise_s = float(late_s[-quarter:].min() - late_s[:quarter].min())
        return rise_s / (0.75 * span_s)  # the least is at the begin of both, or at the end of both


def _change_within(late_s: NDArray[np.float64]) -> float:
    """How far the halves of one side differ."""
    half = len(late_s) // 2
    return abs(float(late_s[half:].min() - late_s[:half].min()))
