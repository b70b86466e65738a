"""What the plots of a report are drawn from."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from gse.station.exclusions import Exclusion
from gse.station.frame_columns import Columns, InOrder
from gse.station.own_answers import SensorAnswers
from gse.station.results import Subject
from gse.station.session_data import SessionData
from gse.statistics.counted_frames import CountedFrames
from gse.values.axis import CROSS_X, CROSS_Y, ON_SKY
from gse.values.instant import NS_PER_S

# Fewer points that look the same: plots of a long session must stay small.

BINS = 1200
"""About one bin for each half point of the printed width."""


def extremes(values: NDArray[np.float64], bins: int = BINS) -> NDArray[np.int64]:
    """Rows to draw of values (N,): of each bin its lowest and highest, first and last; NaN keeps its gap.

    All rows where there are not more than four for each bin.
    """
    n = len(values)
    if n <= 4 * bins:
        return np.arange(n)
    edges = np.linspace(0, n, bins + 1).astype(np.int64)
    kept = [edges[:-1], edges[1:] - 1]
    kept += [_places(values, edges, extreme) for extreme in (np.fmin, np.fmax)]
    return np.unique(np.concatenate(kept))


def _places(values: NDArray[np.float64], edges: NDArray[np.int64], extreme: np.ufunc) -> NDArray[np.int64]:
    """The first row of each bin that holds its extreme value; none of a bin of NaN alone."""
    best = np.repeat(extreme.reduceat(values, edges[:-1]), np.diff(edges))
    rows = np.flatnonzero(values == best)
    bin_of_row = np.searchsorted(edges, rows, side="right") - 1
    _, first = np.unique(bin_of_row, return_index=True)
    places: NDArray[np.int64] = rows[first]
    return places


def sample(count: int, wanted: int) -> NDArray[np.int64]:
    """Row numbers of at most ``wanted`` of ``count`` rows, evenly spaced."""
    if count <= wanted:
        return np.arange(count)
    return np.linspace(0, count - 1, wanted).astype(np.int64)


_OF_ANSWERS = ("utc_ns", "de_true_deg", *(axis.column for axis in (*ON_SKY, CROSS_X, CROSS_Y)))
"""What the plots of a subject are drawn from."""
_GAP_STEPS = 3
"""Frames are missing where two are this many median steps apart, and a second."""

_EDGE_PERCENTILE = 99.5
_ARCSEC_PER_DEG = 3600.0


@dataclass(frozen=True, slots=True, eq=False)
class PlotData:
    """Frames of a session in order of time, and which of them the accuracy is taken over.

    ``frames`` are columns (N,) with the names of FRAME, ``utc`` (N,) their instants, ``good`` (N,) marks identified
    frames that are neither false nor left out; ``unidentified`` (N,) those without an answer. ``gaps`` are the rows
    before which frames are missing. All is of one ``subject``. Columns in order are those of the session, without a
    copy.
    """

    session: SessionData
    frames: Columns
    utc: NDArray[np.datetime64]
    good: NDArray[np.bool_]
    unidentified: NDArray[np.bool_]
    gaps: NDArray[np.int64]
    exclusions: tuple[Exclusion, ...]
    subject: Subject = Subject.ONBOARD

    @classmethod
    def from_session(cls, session: SessionData, counted: CountedFrames) -> Self:
        """The frames of a session; ``counted`` decides which of them the accuracy is taken over."""
        table = session.frames.columns
        return cls._in_order(session, table, (counted.used, ~counted.answered), counted.exclusions, session.subject)

    @classmethod
    def of_sensor(
        cls, session: SessionData, own: SensorAnswers, used: NDArray[np.bool_], counted: CountedFrames
    ) -> Self:
        """The sensor's own answers beside panoramas, in columns of the same names."""
        table = session.frames.columns
        columns = {name: getattr(own, name) if hasattr(own, name) else table[name] for name in _OF_ANSWERS}
        return cls._in_order(session, columns, (used, ~own.acquired), counted.exclusions, Subject.SENSOR)

    @classmethod
    def _in_order(
        cls,
        session: SessionData,
        columns: Columns,
        masks: tuple[NDArray[np.bool_], NDArray[np.bool_]],
        exclusions: tuple[Exclusion, ...],
        subject: Subject,
    ) -> Self:
        good, unidentified = masks
        if (np.diff(columns["utc_ns"]) < 0).any():  # a step of the clock
            order = np.argsort(columns["utc_ns"], kind="stable")
            columns = InOrder(columns, order)
            good, unidentified = good[order], unidentified[order]
        utc_ns = columns["utc_ns"]
        utc, gaps = utc_ns.view("datetime64[ns]"), _gaps(utc_ns)
        return cls(session, columns, utc, good, unidentified, gaps, exclusions, subject)

    def used(self, name: str) -> NDArray[Any]:
        """A column of the good frames."""
        column: NDArray[Any] = self.frames[name][self.good]
        return column


def _gaps(utc_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """The rows before which frames are missing; two frames tell no usual step."""
    if len(utc_ns) < 3:
        return np.zeros(0, dtype=np.int64)
    steps = np.diff(utc_ns)
    usual_ns = max(float(np.median(steps)), 1.0)
    return np.flatnonzero(steps > max(_GAP_STEPS * usual_ns, NS_PER_S)) + 1


def angle_unit(edge_arcsec: float) -> tuple[float, str]:
    """The unit of an axis that reaches to this edge, and its size: degrees from one degree on."""
    return (1 / 3600, "deg") if edge_arcsec >= _ARCSEC_PER_DEG else (1.0, "arcsec")


_FAR = 0.6
"""Share of a limit up to which the errors reach where it is far: a line there would flatten them."""


def close_edge_of(values: NDArray[np.float64], limit: float) -> float:
    """The range that shows the values; with the limit only where that is not far from them."""
    finite = np.abs(values[np.isfinite(values)])
    most = 1.3 * float(np.percentile(finite, _EDGE_PERCENTILE)) if len(finite) else 0.0
    return most if 0 < most < _FAR * limit else edge_of(values, limit)


def edge_of(values: NDArray[np.float64], limit: float) -> float:
    """The range that a plot needs: 1.3 limits, or more where most of the values lie further out."""
    finite = np.abs(values[np.isfinite(values)])
    most = float(np.percentile(finite, _EDGE_PERCENTILE)) if len(finite) else 0.0
    return max(1.3 * limit, 1.2 * most)
