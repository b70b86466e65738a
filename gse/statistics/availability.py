"""Availability: which exposures never came, and what the answers that are absent say of the share.

A sensor's star field is a condition of a session, not a draw. So absences that come and go, as noise, false objects and
fields poor in stars make them, are trials whose probability changes slowly: the share over the session is as good as
its runs of absences are many. A solid outage, a run longer than such trials make, is an event: its number is Poisson,
its share is bounded by the number of outages and by their lengths: from above, as if one more had come, as long as the
longest. Both bounds add. Outages of which fewer than five are expected in a session may be short there by chance: then
a sensor at its limit passes more often than the decision states.

Runs that follow each other closely are one: what causes them lasts. Runs of unequal length tell as little as fewer
equal ones, (sum of lengths)^2 / (sum of their squares) of them (Kish 1965).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv, gammaincinv

from gse.station.frame_columns import Columns
from gse.statistics.decision import RISK, Share, share_of

LONGEST_S = 60.0
"""A longer time without a frame is a pause of the session, which its events and plots show."""
_WINDOW = 15
"""Frames that tell the sensor's output step: START may change it in the middle of a session."""
_CLOSE = 0.1
"""Runs are one where the good answers between them are fewer than this share of those that usually lie between
absences: of independent absences a tenth are joined by it."""
_RARELY = 0.05
"""A run that independent absences would make in fewer than this share of the sessions is an outage."""
_HALVINGS = 40
_MOST_ABSENT = 0.5
"""Of a sensor that answers less than every second frame, every longer run is an outage all the same."""


def never_sent(frames: Columns) -> NDArray[np.int64]:
    """How many exposures before each frame (M,) were never sent, by the sensor's own numbers and its output step.

    The step is the most frequent one of the frames about, of equals the smaller: a constant step is the output rate,
    an irregular one is a missing frame. None is missing where the numbers begin anew or say nothing, nor where they
    leap and the sensor's time does not. A time longer than LONGEST_S is a pause of the session.
    """
    missing = np.zeros(len(frames), dtype=np.int64)
    if len(frames) <= _WINDOW:
        return missing
    steps = _steps(frames["frame_no"].astype(np.int64))
    counted = steps > 0
    if counted.sum() < _WINDOW or steps[counted].min() == steps[counted].max():
        return missing
    usual = _usual_steps(steps, counted)
    by_number = np.rint(steps / usual) - 1
    tags_us: NDArray[np.float64] = np.diff(frames["time_us"].astype(np.float64))
    one_us = float(np.median(tags_us[counted] / steps[counted]))
    by_time = np.rint(tags_us / (usual * one_us)) - 1 if one_us > 0 else by_number
    # Frames that came under a number that stood still are not missing where it goes on.
    came_since = _since(steps != 0)
    counted &= tags_us <= 1e6 * LONGEST_S
    missing[1:] = np.where(counted, np.minimum(by_number, by_time) - came_since, 0)
    missing = np.maximum(missing, 0)
    for row in (np.flatnonzero((steps < 0) & (steps >= -_WINDOW)) + 1).tolist():  # it came late, and fills a gap
        gaps = np.flatnonzero(missing[max(row - _WINDOW, 0) : row])
        if len(gaps):
            missing[max(row - _WINDOW, 0) + gaps[-1]] -= 1
    return missing


def _steps(number: NDArray[np.int64]) -> NDArray[np.int64]:
    """From the greatest number so far to each but the first (M - 1,): a frame that comes late makes none after it.

    A number that falls by more than a window begins anew.
    """
    life = np.cumsum(np.diff(number, prepend=number[:1]) < -_WINDOW)
    far = number + life * (int(number.max()) + 2 * _WINDOW)
    greatest = np.maximum.accumulate(far)
    steps: NDArray[np.int64] = far[1:] - greatest[:-1]
    return np.where(life[1:] == life[:-1], steps, -2 * _WINDOW)


def _usual_steps(steps: NDArray[np.int64], counted: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The most frequent step about each of the steps (M,), the smallest of those that are as frequent but for one."""
    candidates, often = np.unique(steps[counted], return_counts=True)
    candidates = np.sort(candidates[np.argsort(often)[-_WINDOW:]])
    near = np.array([_about(steps == step) for step in candidates])
    return np.asarray(candidates[np.argmax(near >= near.max(axis=0) - 1, axis=0)])


def _since(moved: NDArray[np.bool_]) -> NDArray[np.int64]:
    """How many places lie between each (M,) and the last before it that moved."""
    places = np.arange(len(moved))
    last = np.maximum.accumulate(np.where(moved, places, -1))
    return np.asarray(places - 1 - np.concatenate([[-1], last[:-1]]))


def _about(happened: NDArray[np.bool_]) -> NDArray[np.int64]:
    """In how many places of a window about each (M,) something happened."""
    sums = np.concatenate([[0], np.cumsum(happened)])
    last = np.arange(len(happened))
    return np.asarray(
        sums[np.minimum(last + _WINDOW // 2 + 1, len(happened))] - sums[np.maximum(last - _WINDOW // 2, 0)]
    )


@dataclass(frozen=True, slots=True)
class Outages:
    """Outages: how many there are, of how many frames the shortest and the longest is, and all together."""

    number: int = 0
    shortest: int = 0
    longest: int = 0
    frames: int = 0

    def __str__(self) -> str:
        length = f"{self.shortest} to {self.longest}" if self.longest > self.shortest else f"{self.longest}"
        return f"{self.number} outage{'' if self.number == 1 else 's'} of {length} frames"


def available_share(
    good: NDArray[np.bool_], *, missing: NDArray[np.int64] | None = None, unplaced: int = 0
) -> tuple[Share, Outages]:
    """The share of good answers among frames (M,) in their order and those that never came, and its outages.

    ``missing`` (M,) never came before each frame, ``unplaced`` ones nobody knows when: each alone or all together,
    whichever leaves more open.
    """
    never = np.zeros(len(good), dtype=np.int64) if missing is None else missing
    of, count = len(good) + int(never.sum()) + unplaced, int(good.sum())
    if count in (0, of):
        return share_of(count, of), Outages()
    runs = _runs(good, never, of)
    lower, upper, outages = _bounds_of_absence(np.append(runs, np.ones(unplaced, dtype=np.int64)), of)
    if unplaced:
        together = _bounds_of_absence(np.append(runs, unplaced), of)
        lower, upper = max(lower, together[0]), max(upper, together[1])
    return Share(count, of, count / of, _equivalent(count, of, 1 - upper), 1 - upper, 1 - lower), outages


def _runs(good: NDArray[np.bool_], missing: NDArray[np.int64], of: int) -> NDArray[np.int64]:
    """Lengths of the runs of absences among frames (M,), of which so many never came before each."""
    before: NDArray[np.int64] = np.cumsum(good) - good  # good answers so far: those between two runs part them
    weight = missing + ~good
    at = np.flatnonzero(weight)
    if not len(at):
        return np.zeros(0, dtype=np.int64)
    close = int(_CLOSE * of / weight.sum())
    run = np.cumsum(np.diff(before[at], prepend=before[at[0]]) > close)
    return np.bincount(run, weight[at]).astype(np.int64)


def _bounds_of_absence(runs: NDArray[np.int64], of: int) -> tuple[float, float, Outages]:
    """One-sided 95 % bounds, lower and upper, of the share of absences that came in such runs."""
    share = min(float(runs.sum()) / of, _MOST_ABSENT)
    solid = runs > math.ceil(math.log(_RARELY / of) / math.log(share))
    lower, upper = _of_trials(runs[~solid], of)
    if not solid.any():
        return lower, upper, Outages()
    outages, frames = runs[solid], float(runs[solid].sum())
    found = Outages(len(outages), int(outages.min()), int(outages.max()), int(frames))
    one_more = np.append(outages, found.longest)
    return lower + _of_events(outages, RISK) / of, min(upper + _of_events(one_more, 1 - RISK) / of, 1.0), found


def _of_events(outages: NDArray[np.int64], probability: float) -> float:
    """The frames that so many outages, of such lengths, are expected to take, by the quantile of a Poisson number."""
    frames = float(outages.sum())
    number = frames**2 / float((outages**2).sum())
    return frames * float(gammaincinv(number, probability)) / number


def _of_trials(runs: NDArray[np.int64], of: int) -> tuple[float, float]:
    """The same of runs of independent absences, by Clopper and Pearson on their effective number."""
    absences = float(runs.sum())
    if absences == 0:
        return 0.0, 1 - RISK ** (1 / of)
    number = of * absences / float((runs**2).sum())
    happened = number * absences / of
    lower, upper = (
        betaincinv(happened, number - happened + 1, RISK),
        betaincinv(happened + 1, number - happened, 1 - RISK),
    )
    return float(lower), float(upper)


def _equivalent(count: int, of: int, lower: float) -> float:
    """The number of independent frames whose exact bound of the same share is as low, at most all of them."""
    few, many = 1.0, float(of)
    for _ in range(_HALVINGS):
        middle = math.sqrt(few * many)
        few, many = (middle, many) if share_of(count, of, middle).lower < lower else (few, middle)
    return many
