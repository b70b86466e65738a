"""Largest number of frames sent in a time: the bound of the losses that a jump of sequence numbers may count."""

from collections import deque
from statistics import median

SLACK = 8
"""Frames that may be missing although no time has passed for them: they were read from a buffer at once."""
_SAMPLES = 15
_MOST_STEPS = 8
"""Two frames that are further apart tell no period: what lies between them may be missing, or their numbers wrong."""


class FrameBudget:
    """Allows a loss only where time has passed in which the lost frames can have been sent.

    The sum of all losses allowed never exceeds the time that has passed by the sensor's period, and SLACK. The period
    is known from two frames that follow each other, or from two pairs that are a few numbers apart: one such pair may
    be chance where numbers make no sense.
    """

    def __init__(self) -> None:
        self._periods: deque[float] = deque(maxlen=_SAMPLES)
        self._period = 0.0
        self._is_known = False
        self._left = 0.0

    def pass_time(self, seconds: float) -> None:
        """So much time lies between the frame before and this one."""
        if self._is_known:
            self._left += max(seconds, 0.0) / self._period

    def learn(self, seconds: float, steps: int) -> None:
        """Two frames are so far apart by the sensor's own clock, and by so many sequence numbers."""
        if seconds > 0 and 1 <= steps <= _MOST_STEPS:
            period = seconds / steps
            stays = len(self._periods) == _SAMPLES and self._periods[0] == period
            self._periods.append(period)
            if not stays:
                self._period = median(self._periods)
            self._is_known = steps == 1 or len(self._periods) > 1

    def came(self) -> None:
        """One of the frames that can have been sent is here."""
        self._left = max(self._left - 1, min(self._left, 0.0))

    def find(self, count: int) -> None:
        """So many that counted as lost have come after all."""
        self._left += count

    def lose(self, count: int) -> bool:
        """Whether so many frames can have been sent and lost; they are charged then."""
        if count > self._left + SLACK:
            return False
        self._left -= count
        return True
