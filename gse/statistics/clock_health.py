"""The clocks of a session: how wrong the host's may be, its steps, and the drift of the sensor's against it."""

import itertools
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkEvent
from drivers.clock import ClockReading
from gse.errors import UsageError
from gse.station.events import ClockStep
from gse.station.frame_columns import Columns
from gse.station.host_clock import clock_steps, clock_stretches, first_rows
from gse.statistics.slopes import theil_sen
from gse.values.instant import NS_PER_S

CLOCK_REMEDY = "run chrony on this computer, or measure the error of its clock and state it: --clock-error 0.1s"
"""What to do about a clock of unknown error, in the same words wherever it is named."""

_BLOCKS = 60
_MIN_DRIFT_S = 30.0
"""Arrival jitters by up to 20 ms, its least value by 30 us: over 30 s that is 1 ppm."""
_DURATION = re.compile(r"(\d+(?:\.\d*)?|\.\d+)\s*(s|ms|us)")
_UNITS_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class ClockHealth:
    """What is known of time in a session.

    ``error_bound_s`` is inf where nothing bounds it: no reading, or one that was not synchronised, and nothing stated.
    It is no less than a step that put right the clock of frames that count. ``stated`` is true where the operator's
    bound took the kernel's place. ``steps`` are the texts of steps of the host clock. ``sensor_drift_ppm`` is the
    sensor's clock against the host's, positive where it is slow, with the half-width of its 95 % interval; NaN where
    the session is too short.
    """

    source: str
    synchronised: bool
    readings: int
    offset_s: float
    error_bound_s: float
    stated: bool
    steps: tuple[str, ...]
    sensor_drift_ppm: float
    sensor_drift_error_ppm: float

    @property
    def vouched_by(self) -> str:
        """Whose bound is in force; empty where nobody's is."""
        if not math.isfinite(self.error_bound_s):
            return ""
        bound = f"{self.error_bound_s:.2g} s"
        return f"--clock-error ({bound})" if self.stated else f"the host's clock ({self.source}, {bound})"


def clock_health(
    readings: Sequence[ClockReading],
    events: Sequence[LinkEvent],
    frames: Columns,
    *,
    stated_error_s: float | None = None,
) -> ClockHealth:
    """The health of the clocks; ``frames`` is a structured array with utc_ns, host_utc_ns and time_us."""
    synchronised = bool(readings) and all(reading.synchronised for reading in readings)
    bound_s = max((abs(reading.offset_s) + reading.error_bound_s for reading in readings), default=math.inf)
    sources = dict.fromkeys(reading.source for reading in readings)
    steps = clock_steps(events)
    bound_s = max(bound_s, _stepped_s(frames, steps))
    drift_ppm, drift_error_ppm = _sensor_drift_ppm(frames, steps)
    return ClockHealth(
        source=", ".join(sources) or "not recorded",
        synchronised=synchronised,
        readings=len(readings),
        offset_s=max((reading.offset_s for reading in readings), key=abs, default=_NAN),
        error_bound_s=stated_error_s if stated_error_s is not None else bound_s if synchronised else math.inf,
        stated=stated_error_s is not None,
        steps=tuple(event.text for event in steps),
        sensor_drift_ppm=drift_ppm,
        sensor_drift_error_ppm=drift_error_ppm,
    )


def _stepped_s(frames: Columns, steps: Sequence[ClockStep]) -> float:
    """How far the clocks of frames that count were from the one that was set last."""
    stretches = clock_stretches(frames["host_utc_ns"], steps)
    judged = (item for item in stretches if item.until > item.first and not item.is_wrong)
    return max((abs(item.offset_ns) for item in judged), default=0) / NS_PER_S


def _sensor_drift_ppm(frames: Columns, steps: Sequence[ClockStep]) -> tuple[float, float]:
    """Slope of the least (host - sensor) difference in the longest stretch without a reset or a step of a clock."""
    timestamped = frames["host_utc_ns"] > 0
    host_ns, time_us = frames["host_utc_ns"][timestamped], frames["time_us"][timestamped]
    stretch = _longest_stretch(time_us, first_rows(host_ns, steps))
    host_ns, time_us = host_ns[stretch], time_us[stretch]
    if len(host_ns) < 2 * _BLOCKS:
        return _NAN, _NAN
    sensor_s = (time_us - time_us[0]).astype(np.float64) / 1e6
    if sensor_s[-1] < _MIN_DRIFT_S:
        return _NAN, _NAN
    host_s = (host_ns - host_ns[0]) / 1e9
    late_s = host_s - sensor_s
    edges = np.searchsorted(sensor_s, np.linspace(0, sensor_s[-1], _BLOCKS + 1)[1:-1])
    earliest = [int(rows[late_s[rows].argmin()]) for rows in np.split(np.arange(len(late_s)), edges) if len(rows)]
    fit = theil_sen(late_s[earliest], sensor_s[earliest])
    return fit.slope * 1e6, (fit.high - fit.low) / 2 * 1e6


def _longest_stretch(time_us: NDArray[np.uint64], stepped: list[int]) -> slice:
    if len(time_us) == 0:
        return slice(0)
    resets = np.flatnonzero(time_us[1:] < time_us[:-1]) + 1
    edges = sorted({0, len(time_us), *resets.tolist(), *stepped})
    return slice(*max(itertools.pairwise(edges), key=lambda pair: pair[1] - pair[0]))


def stated_error_s(text: str) -> float:
    """The seconds of a bound that an operator states: 0.1s, 20ms, 50us; UsageError says what was expected."""
    found = _DURATION.fullmatch(text.strip())
    if found is None:
        raise UsageError(f"a clock error of {text!r} is not a time; expected for example 0.1s, 20ms or 50us")
    return float(found[1]) * _UNITS_S[found[2]]
