"""Faults of the sensor's time tags: tags that stand still, leap, or run fast or slow for a while."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkEvent
from gse.instant import to_text
from gse.percent import percent
from gse.station.clock_steps import clock_steps, first_rows
from gse.station.frame_columns import Columns

LEAP_S = 0.5
"""A tag that is ahead of the host by this much more than in the frame before, though no frame is missing, has leapt."""

_FEWEST_STUCK = 3
_OFTEN_STUCK = 0.1
"""Of the frames: the instants of these are not known, and what fits their errors is no cause."""
_RATE_FRAMES = 40
_RATE_OFF = 0.05
"""A share that no oscillator is off by."""
_SIGMAS = 5.0
_MAD, _OF_MEDIAN = 1.4826, 1.2533
"""Standard deviation of normal numbers in their median deviation, and error of their median in that of their mean."""


def time_tag_faults(frames: Columns, events: Sequence[LinkEvent]) -> tuple[str, ...]:
    """A line for each kind of fault in frames (rows of FRAME, in order of arrival); nothing without host times."""
    if len(frames) < 3 or not (frames["host_utc_ns"] > 0).all():
        return ()
    return (*_stuck(frames), *_leaps(frames, events), *_rate(frames))


def often_stand_still(frames: Columns) -> bool:
    """Whether so many tags stood still that the instants of the frames (rows of FRAME) tell no cause."""
    return len(frames) >= _FEWEST_STUCK and _still(frames) > _OFTEN_STUCK * len(frames)


def _still(frames: Columns) -> int:
    """In how many frames the tag stood still while the host's clock went on."""
    tags_us = frames["time_us"].astype(np.int64)
    host_ns = np.diff(frames["host_utc_ns"])
    return int(((np.diff(tags_us) == 0) & (host_ns > np.median(host_ns) / 2)).sum())


def _stuck(frames: Columns) -> Iterator[str]:
    if (still := _still(frames)) >= _FEWEST_STUCK:
        yield f"sensor time tag: it stood still in {still} frames while the host's clock went on"


def _leaps(frames: Columns, events: Sequence[LinkEvent]) -> Iterator[str]:
    tags_s: NDArray[np.float64] = np.diff(frames["time_us"].astype(np.float64)) / 1e6
    host_s: NDArray[np.float64] = np.diff(frames["host_utc_ns"] - frames["host_utc_ns"][0]).astype(np.float64) / 1e9
    numbers = np.maximum(np.diff(frames["frame_no"].astype(np.int64)), 1)
    ahead_s: NDArray[np.float64] = tags_s - host_s
    leaps = (tags_s > 0) & (ahead_s > LEAP_S + 1.5 * np.median(tags_s) * numbers)
    for row in first_rows(frames["host_utc_ns"], clock_steps(events)):
        leaps[row - 1 : row] = False
    rows = np.flatnonzero(leaps)
    if len(rows):
        first = int(rows[0])
        when = to_text(int(frames["host_utc_ns"][first + 1]), 1)
        more = f", and {len(rows) - 1} times more" if len(rows) > 1 else ""
        yield f"sensor time tag: it leapt by {ahead_s[first]:+.2f} s at {when}{more}"


def _rate(frames: Columns) -> Iterator[str]:
    """The stretch of frames in which tags were fastest or slowest against the host's clock, if by far too much."""
    tags_s: NDArray[np.float64] = np.diff(frames["time_us"].astype(np.float64)) / 1e6
    host_s: NDArray[np.float64] = np.diff(frames["host_utc_ns"] - frames["host_utc_ns"][0]).astype(np.float64) / 1e9
    regular = np.flatnonzero((tags_s > 0) & (host_s > np.median(host_s) / 2))
    blocks = regular[: len(regular) // _RATE_FRAMES * _RATE_FRAMES].reshape(-1, _RATE_FRAMES)
    off = _off(tags_s[blocks] / host_s[blocks])
    if len(off) and np.abs(off).max() > _RATE_OFF:
        worst = int(np.abs(off).argmax())
        when = to_text(int(frames["host_utc_ns"][blocks[worst, 0]]), 1)
        how = "fast" if off[worst] > 0 else "slow"
        yield f"sensor time tag: it ran {percent(abs(off[worst]), 0)} {how} from {when}"


def _off(rates: NDArray[np.float64]) -> NDArray[np.float64]:
    """By how much the median of each row of rates (K, N) is off (K,), zero where their jitter explains it."""
    median = np.median(rates, axis=1)
    deviation = np.median(np.abs(rates - median[:, None]), axis=1)
    error = _OF_MEDIAN * _MAD * deviation / math.sqrt(rates.shape[1])
    return np.where(np.abs(median - 1) > _SIGMAS * error, median - 1, 0.0)
