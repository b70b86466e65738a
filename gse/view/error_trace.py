"""The errors of a session over time in few numbers: each bin has count, mean, spread and extremes of every axis.

Two levels: bins of a second over the last ten minutes, for a close-up, and at most MOST_BINS over the whole session,
which grow in length as it does. The loop adds; a page's thread reads at any time without a lock: a bin never changes,
and what is read is a list that only grows, or the one before.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkEvent, LinkKind
from gse.station.events import StationKind
from gse.station.frame_results import FrameResults
from gse.values.axis import ALL_AXES, AXES, CROSS_X, CROSS_Y, D_DE, D_RA_COSDE, D_ROLL, Axis
from gse.values.instant import NS_PER_S
from gse.values.limits import Limits
from gse.view.live_state import SessionSoFar

CLOSE_S = 600
"""Seconds, and bins, of the close-up."""
MOST_BINS = 1000
"""Bins of the whole session: one for each column of pixels of a plot that fills half of a large screen."""

VIEWS: dict[str, tuple[Axis, ...]] = {"sky": (D_RA_COSDE, D_DE), "across": (CROSS_X, CROSS_Y), "roll": (D_ROLL,)}
"""The axes that a page shows together."""

_COUNT, _MEAN, _SQUARES, _LOW, _HIGH = range(5)
_DECIMALS = 2


@dataclass(frozen=True, slots=True, eq=False)
class TraceBin:
    """The errors of a stretch of time: ``stats`` (5, A) has count, mean, squares about it, least, greatest by axis."""

    number: int
    stats: NDArray[np.float64]


_Bins = list[TraceBin]


class ErrorTrace:
    """The errors of one subject, columns named ``columns``, in the order of their coming."""

    def __init__(self, columns: Sequence[str]) -> None:
        self._columns = tuple(columns)
        self._close: _Bins = []
        self._whole: tuple[int, _Bins] = (1, [])

    def add(self, rows: NDArray[np.void]) -> None:
        """Add rows with ``utc_ns`` and the columns; rows without errors (NaN) leave a gap."""
        known = rows[~np.isnan(rows[self._columns[0]])]
        if not len(known):
            return
        seconds = known["utc_ns"] // NS_PER_S
        errors = np.column_stack([known[name].astype(np.float64) for name in self._columns])
        begins = np.flatnonzero(np.diff(seconds, prepend=seconds[0] - 1))
        for begin, end in zip(begins.tolist(), [*begins[1:].tolist(), len(known)], strict=True):
            self._take(TraceBin(int(seconds[begin]), _stats(errors[begin:end])))

    def _take(self, part: TraceBin) -> None:
        self._close = _with(self._close, part)
        if self._close[0].number <= part.number - CLOSE_S:
            first = next(place for place, one in enumerate(self._close) if one.number > part.number - CLOSE_S)
            self._close = self._close[first:]
        step_s, bins = self._whole
        bins = _with(bins, TraceBin(part.number // step_s, part.stats))
        if len(bins) > MOST_BINS:
            step_s, halves = 2 * step_s, bins
            bins = []
            for one in halves:
                bins = _with(bins, TraceBin(one.number // 2, one.stats))
        self._whole = step_s, bins

    def close_after(self, number: int, places: Sequence[int]) -> dict[str, Any]:
        """The bins of the close-up from ``number`` on; all where there is none such (the clock was set back)."""
        return _document(1, self._close, number, places)

    def whole_after(self, step_s: int, number: int, places: Sequence[int]) -> dict[str, Any]:
        """The bins of the whole session from ``number`` on; all where they have another length than ``step_s``."""
        now_s, bins = self._whole
        return _document(now_s, bins, number if step_s == now_s else -1, places)


def _stats(errors: NDArray[np.float64]) -> NDArray[np.float64]:
    mean = errors.mean(axis=0)
    squares = ((errors - mean) ** 2).sum(axis=0)
    return np.stack([np.full(len(mean), float(len(errors))), mean, squares, errors.min(axis=0), errors.max(axis=0)])


def _with(bins: _Bins, part: TraceBin) -> _Bins:
    """The bins with one more, or with its errors in the last one; one from before that begins anew."""
    if bins and part.number == bins[-1].number:
        bins[-1] = TraceBin(part.number, _merged(bins[-1].stats, part.stats))
        return bins
    if bins and part.number < bins[-1].number:
        return [part]
    bins.append(part)
    return bins


def _merged(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """The statistics of both (Chan, Golub and LeVeque 1979, equation 2.1)."""
    count = one[_COUNT] + other[_COUNT]
    step = other[_MEAN] - one[_MEAN]
    mean = one[_MEAN] + step * other[_COUNT] / count
    squares = one[_SQUARES] + other[_SQUARES] + step**2 * one[_COUNT] * other[_COUNT] / count
    return np.stack([count, mean, squares, np.minimum(one[_LOW], other[_LOW]), np.maximum(one[_HIGH], other[_HIGH])])


def _document(step_s: int, bins: _Bins, number: int, places: Sequence[int]) -> dict[str, Any]:
    """``bins``: number, count, and by axis mean, standard deviation, least and greatest error (arcsec).

    ``anew``: they take the place of all that came before.
    """
    shown = bins[:]
    anew = not any(one.number == number for one in shown)
    kept = shown if anew else [one for one in shown if one.number >= number]
    return {"step_s": step_s, "anew": anew, "bins": [_row(one, places) for one in kept]}


def _row(one: TraceBin, places: Sequence[int]) -> list[float]:
    row: list[float] = [one.number, int(one.stats[_COUNT, 0])]
    for place in places:
        count, mean, squares, low, high = one.stats[:, place].tolist()
        row += [round(value, _DECIMALS) for value in (mean, math.sqrt(squares / count), low, high)]
    return row


MARKED = frozenset(
    {
        *(LinkKind.LOST, LinkKind.REOPENED, LinkKind.STALE),
        *(StationKind.NOTE, StationKind.FINDING, StationKind.ALIGNED, StationKind.NO_TRUTH, StationKind.FROZEN),
        *(StationKind.CLEAR, StationKind.CLOUDED, StationKind.NO_STARS, StationKind.DAYLIGHT, StationKind.DARK_NIGHT),
        *(StationKind.CLOCK_STEP, StationKind.SENSOR_RESET),
    }
)
"""Events that a plot of the errors shows at their time."""
MOST_MARKS = 200


class ErrorTraces:
    """A display of a session: the traces of the identifier under test and of the sensor's own answers, with marks."""

    def __init__(self) -> None:
        self._marks: tuple[tuple[int, float, str, str], ...] = ()
        self._onboard = ErrorTrace([axis.column for axis in ALL_AXES])
        self._own = ErrorTrace([axis.column for axis in AXES])
        self._sends_own = False

    def on_results(self, results: FrameResults, so_far: SessionSoFar) -> None:
        """Add results, and what came of the sensor's own answers with them."""
        self._onboard.add(results.rows)
        if len(so_far.own_errors):
            self._own.add(so_far.own_errors)
            self._sends_own = True

    def on_event(self, event: LinkEvent, so_far: SessionSoFar) -> None:
        """Keep an event that a plot shows."""
        if event.kind in MARKED:
            number = self._marks[-1][0] + 1 if self._marks else 1
            mark = (number, round(event.utc_ns / NS_PER_S, 1), str(event.kind), event.text)
            self._marks = (*self._marks, mark)[-MOST_MARKS:]

    def document(self, request: Sequence[str], limits: Limits) -> dict[str, Any] | None:
        """What a page asked for: a view, a subject, and the last bins that it has; None of another request."""
        try:
            view, subject, *texts = request
            axes, (close, step_s, whole, mark) = VIEWS[view], map(int, texts)
        except (ValueError, KeyError):
            return None
        is_own = subject == "own" and self._sends_own and view != "across"
        trace, places = (self._own if is_own else self._onboard), [ALL_AXES.index(axis) for axis in axes]
        return {
            "view": view,
            "subject": "own" if is_own else "onboard",
            "sends_own": self._sends_own,
            "axes": [{"name": axis.label, "limit_arcsec": limits.of(axis) if axis in AXES else None} for axis in axes],
            "close": trace.close_after(close, places),
            "whole": trace.whole_after(step_s, whole, places),
            "marks": [one for one in self._marks if one[0] > mark],
        }
