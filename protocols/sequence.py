"""Sequence accounting: duplicates, gaps and restarts of one direction of a link."""

from collections import deque
from collections.abc import Callable
from enum import Enum
from statistics import median

# Largest number of frames sent in a time: the bound of the losses that a jump of sequence numbers may count.

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


MODULUS = 65536
"""A sequence number of 16 bits wraps here."""

RECENT = 64
"""Frames that are remembered: a copy or a straggler that comes later than this is no longer recognised as one."""


LONGEST_GAP_S = 600.0
"""A sensor clock that is further ahead has leapt, where no host's clock says how long it was."""


class Arrival(Enum):
    """Class of a frame by its sequence number."""

    NEXT = "next"
    """One after the frame before, or the first of all."""
    GAP = "gap"
    """Frames before it are missing; ``SequenceTracker.last_gap`` says how many."""
    DUPLICATE = "duplicate"
    """Seen before: to be dropped."""
    LATE = "late"
    """Counted as lost before, here after all: it came after a frame that was sent after it."""
    CHAOS = "chaos"
    """Frames before it seem to be missing, more than can have been sent: its number makes no sense."""
    RESET = "reset"
    """The sensor has started anew: its clock or its counter jumped back, or it says so itself."""


_NEXT, _GAP, _DUPLICATE, _LATE, _CHAOS, _RESET = Arrival
"""By name: each look into the enumeration would take a tenth of a microsecond, ten times a frame."""


class SequenceTracker:
    """Classifies and counts the sequence numbers of one direction; all message types share one counter.

    ``modulus`` is where the number wraps, ``step`` by which it goes on; 0 stands for a protocol without sequence
    numbers, where a frame is NEXT unless its clock jumps back, or it is a copy with the time of the one before.
    """

    def __init__(self, modulus: int = MODULUS, step: int = 1) -> None:
        self.duplicates = 0
        self.lost = 0
        self.late = 0
        self.resets = 0
        self.last_gap = 0
        self._modulus, self._step = modulus, step
        self._budget = FrameBudget()
        self.start_anew()

    def start_anew(self) -> None:
        """Take the next frame as the first: the sensor has started anew."""
        self._last: int | None = None
        self._last_time_us: int | None = None
        self._timed: int | None = None
        self._seen: dict[tuple[int, int | None], None] = {}
        self._missing: deque[int] = deque(maxlen=RECENT)

    @property
    def last(self) -> int | None:
        """The sequence number of the latest frame; None before the first."""
        return self._last

    def accept(
        self,
        sequence: int,
        *,
        time_us: int | None = None,
        restarted: bool = False,
        elapsed_s: float | None = None,
        is_copy: Callable[[], bool] = lambda: True,
    ) -> Arrival:
        """What this frame is, counted.

        ``time_us`` is the sensor's clock where the message carries it; leave it out for stored data, which is older
        than what came before. ``restarted`` is the sensor's own word that its clock was reset. ``elapsed_s`` is the
        host's time since the frame before, where it is known; else the sensor's clock bounds what can be lost.
        ``is_copy`` tells, where it is asked, whether its bytes are those of the frame that had its number before.
        """
        arrival = self._classify(sequence, time_us, restarted)
        if arrival is _DUPLICATE and not is_copy():
            arrival = _CHAOS if self._modulus else _NEXT
        if arrival is _DUPLICATE:
            self.duplicates += 1
            return arrival
        knows_time = self._pass_time(sequence, time_us, elapsed_s)
        if arrival is _RESET:
            self.resets += 1
            self.start_anew()
        elif arrival is _GAP:
            self.last_gap = self._gap_before(sequence)
            if self._budget.lose(self.last_gap) or not knows_time:
                self._count_gap(sequence)
            else:
                arrival = _CHAOS
                self._missing.clear()
        elif arrival is _LATE:
            self.late += 1
            self.lost -= 1
            self._budget.find(1)
            self._missing.remove(sequence)
        self._budget.came()
        if arrival is not _LATE:
            self._last = sequence
            self._last_time_us = self._last_time_us if time_us is None else time_us
        self._seen[sequence, time_us] = None
        if len(self._seen) > RECENT:
            del self._seen[next(iter(self._seen))]
        return arrival

    def _pass_time(self, sequence: int, time_us: int | None, elapsed_s: float | None) -> bool:
        """Account for the time since the frame before, in which others can have been sent; whether it is known."""
        sensor_s = None
        if time_us is not None and self._last_time_us is not None:
            sensor_s = (time_us - self._last_time_us) / 1e6
        if elapsed_s is None and sensor_s is not None:
            elapsed_s = min(sensor_s, LONGEST_GAP_S)
        if elapsed_s is not None:
            self._budget.pass_time(elapsed_s)
        if sensor_s is not None and self._timed is not None:
            self._budget.learn(sensor_s, self._steps(self._timed, sequence) if self._modulus else 0)
        if time_us is not None:
            self._timed = sequence
        return elapsed_s is not None

    def _classify(self, sequence: int, time_us: int | None, restarted: bool) -> Arrival:
        clock_back = time_us is not None and self._last_time_us is not None and time_us < self._last_time_us
        if self._modulus == 0:
            if time_us is not None and time_us == self._last_time_us:
                return _DUPLICATE
            return _RESET if restarted or clock_back else _NEXT
        if (sequence, time_us) in self._seen or (sequence == self._last and not clock_back):
            return _DUPLICATE
        if restarted:
            return _RESET
        if self._last is None:
            return _NEXT
        steps = self._steps(self._last, sequence)
        if self._missing and self._steps(sequence, self._last) <= RECENT and sequence in self._missing:
            return _LATE
        if clock_back:
            return _RESET
        if steps == 1:
            return _NEXT
        # Without a clock, more than half a turn forward is taken for a step back: the counter started anew.
        return _GAP if time_us is not None or steps <= self._modulus // self._step // 2 else _RESET

    def _steps(self, before: int, sequence: int) -> int:
        """How many steps lead from one number to another; one between two steps counts as the later of them."""
        return -(-((sequence - before) % self._modulus) // self._step)

    def _gap_before(self, sequence: int) -> int:
        assert self._last is not None
        return self._steps(self._last, sequence) - 1

    def _count_gap(self, sequence: int) -> None:
        self.lost += self.last_gap
        for back in range(min(self.last_gap, RECENT), 0, -1):
            self._missing.append((sequence - back * self._step) % self._modulus)
