"""Supply of the sensor: voltage and current as its switch reads them."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from gse.values.instant import NS_PER_S


@dataclass(frozen=True, slots=True)
class PowerReading:
    """One reading at an instant; ``volts`` is NaN where the switch reads the current alone."""

    utc_ns: int
    amperes: float
    volts: float = math.nan


@dataclass(frozen=True, slots=True)
class PowerUse:
    """Mean current of the sensor while it is on, and its greatest current while it is switched on; NaN if unknown."""

    mean_a: float = math.nan
    inrush_a: float = math.nan


def power_use(readings: Sequence[PowerReading], switched: Iterable[tuple[int, bool]], settle_s: float) -> PowerUse:
    """The currents of readings, where the supply was ``switched`` on (True) or off at instants of UTC.

    A sensor that nobody switches is on. The mean leaves out ``settle_s`` after each time that it was switched on; the
    greatest reading of these seconds is the inrush current, as far as readings that often show it.
    """
    turns = [(-1, True, False), *((utc_ns, on, on) for utc_ns, on in sorted(switched))]
    steady, rush = [], []
    for reading in readings:
        began_ns, is_on, was_switched_on = next(turn for turn in reversed(turns) if turn[0] <= reading.utc_ns)
        if was_switched_on and reading.utc_ns - began_ns <= settle_s * NS_PER_S:
            rush.append(reading.amperes)
        elif is_on:
            steady.append(reading.amperes)
    return PowerUse(math.fsum(steady) / len(steady) if steady else math.nan, max(rush, default=math.nan))
