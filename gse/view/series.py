"""Time series of the frames, as rerun columns."""

import zlib
from collections.abc import Sequence

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from drivers.clock import ClockReading
from gse.station.columns import COLUMNS, Column, unit_of
from gse.values.axis import D_DE, D_RA_COSDE, D_ROLL
from gse.values.instant import NS_PER_S
from gse.values.limits import Limits
from gse.view.drawing import BLUE, GREEN, GREY, ORANGE, PALE, PINK, SKY_BLUE, VERMILLION, YELLOW

TIMELINE = "utc"
EDGE = 1.4
"""Points outside the limits are drawn at this many limits at most: one false answer is off by degrees."""

OUTAGE_NS = 3 * NS_PER_S
"""Longest time without a frame over which a line is drawn."""

_PATHS = {"d_ra": D_RA_COSDE, "d_de": D_DE}
"""The series that have a limit."""

NEAR = np.dtype([("utc_ns", "i8"), *((path, "f8", 4) for path in _PATHS)])
"""Of a frame the error where it is within its limit, running mean, and mean less and plus a standard deviation."""

OWN_PATHS = {
    "/sensor/d_ra": D_RA_COSDE.column,
    "/sensor/d_de": D_DE.column,
    "/sensor/roll": D_ROLL.column,
    "/sensor/latency_ms": "latency_ms",
}
"""The series of the sensor's own answers, beside those of the identifier under test."""

GRAPHS: dict[str, list[Column]] = {}
"""The columns that are drawn, by graph."""
for _column in COLUMNS:
    if _column.graph:
        GRAPHS.setdefault(_column.graph, []).append(_column)
_COLOURS = {
    "temperature_c": (ORANGE,),
    "identification_ms": (GREEN,),
    "roll": (PINK,),
    "stars": (SKY_BLUE, YELLOW),
}
_OTHER_COLOURS = (SKY_BLUE, ORANGE, YELLOW, PINK, GREEN)
"""Colours of the lines of a graph that has none of its own."""

_DECIMALS = 3
"""Milliarcseconds, microseconds: rerun's tooltips print every digit there is."""


MEAN_S = 20.0
"""The window of the running mean: longer than the noise of a star, shorter than what happens to a mount."""


def times(utc_ns: Sequence[int] | NDArray[np.int64]) -> rr.TimeColumn:
    """The time column of instants in UTC nanoseconds."""
    return rr.TimeColumn(TIMELINE, timestamp=np.asarray(utc_ns, dtype=np.int64).astype("datetime64[ns]"))


_ITEM_COLOURS = (SKY_BLUE, ORANGE, YELLOW, VERMILLION, BLUE, PALE)


def begin_series(stream: rr.RecordingStream) -> None:
    """Names, colours and widths of every series; they hold for the whole recording."""
    for path in _PATHS:
        _lines(stream, f"/{path}/value", ["value", "limit", "limit"], [SKY_BLUE, VERMILLION, VERMILLION])
        points = rr.SeriesPoints(colors=[VERMILLION], markers=["cross"], names=["outside limit"], marker_sizes=[5.0])
        stream.log(f"/{path}/outside", points, static=True)
        names = ["error", "mean of 20 s", "- sigma", "+ sigma"]
        _lines(stream, f"/near/{path}", names, [PALE, SKY_BLUE, BLUE, BLUE], [1.0, 3.0, 1.0, 1.0])
    for path, columns in GRAPHS.items():
        colours = list(_COLOURS.get(path, _OTHER_COLOURS))[: len(columns)]
        _lines(stream, f"/{path}", [column.line or column.name for column in columns], colours)
    for path in ("/sensor/d_ra", "/sensor/d_de", "/near/d_ra/own", "/near/d_de/own"):
        _lines(stream, path, ["sensor's own"], [ORANGE])
    _lines(stream, "/sensor/roll", ["sensor's own"], [YELLOW])
    _lines(stream, "/sensor/latency_ms", ["sensor's own"], [ORANGE])
    _lines(stream, "/clock", ["offset", "+ error bound", "- error bound"], [BLUE, GREY, GREY])


def _lines(
    stream: rr.RecordingStream,
    path: str,
    names: list[str],
    colours: list[tuple[int, int, int]],
    widths: Sequence[float] = (),
) -> None:
    widths = widths or [1.5] * len(names)
    lines = rr.SeriesLines(names=names, colors=colours, widths=widths, aggregation_policy="MinMax")
    stream.log(path, lines, static=True)


def near_rows(columns: NDArray[np.void], limits: Limits, latest: int | None = None) -> NDArray[np.void]:
    """Rows of NEAR of the ``latest`` frames, or of all; the mean is of errors cut at EDGE limits."""
    rows = np.zeros(len(columns), NEAR)
    rows["utc_ns"] = columns["utc_ns"]
    begin_ns = np.maximum.accumulate(columns["utc_ns"]) - round(MEAN_S * NS_PER_S)
    begins = np.searchsorted(np.maximum.accumulate(columns["utc_ns"]), begin_ns, "right")
    for path, axis in _PATHS.items():
        edge = EDGE * limits.of(axis)
        errors = np.clip(columns[axis.column].astype(np.float64), -edge, edge)
        known = np.isfinite(errors)
        sums = [
            np.append(0.0, np.cumsum(part))
            for part in (known, np.where(known, errors, 0), np.where(known, errors**2, 0))
        ]
        count, total, squares = (one[1:] - one[begins] for one in sums)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.where(known, total / count, np.nan)
            sigma = np.sqrt(np.maximum(squares / count - mean**2, 0))
        near = np.where(np.abs(errors) <= limits.of(axis), errors, np.nan)  # one far off would flatten all others
        rows[path] = np.column_stack([near, mean, mean - sigma, mean + sigma])
    return rows if latest is None else rows[len(rows) - latest :].copy()  # who keeps it keeps nothing else


def send_near(stream: rr.RecordingStream, rows: NDArray[np.void]) -> None:
    """The errors close up, with running mean and band, rows of NEAR."""
    for path in _PATHS:
        _send(stream, f"/near/{path}", times(rows["utc_ns"]), rows[path])


def send_series(stream: rr.RecordingStream, columns: NDArray[np.void], limits: Limits) -> None:
    """All series of some frames (rows of FRAME); frames without a value leave a gap."""
    utc_ns = columns["utc_ns"]
    at = times(utc_ns)
    for path, axis in _PATHS.items():
        values, limit = columns[axis.column], limits.of(axis)
        bounds = np.full((len(values), 2), limit) * (1, -1)
        _send(stream, f"/{path}/value", at, np.column_stack([values, bounds]))
        outside = np.flatnonzero(np.abs(values) > limit)
        if len(outside):
            edge = np.clip(values[outside], -EDGE * limit, EDGE * limit)
            _send(stream, f"/{path}/outside", times(utc_ns[outside]), edge[:, None])
    for path, drawn in GRAPHS.items():
        scale = 1000 if unit_of(path) == "ms" else 1  # of columns in microseconds
        _send(stream, f"/{path}", at, _stacked(columns, *(column.name for column in drawn)) / scale)


def send_own_answers(stream: rr.RecordingStream, errors: NDArray[np.void], limits: Limits) -> None:
    """The series of the sensor's own answers, rows of OWN_ERROR; a gap where it has none, or was silent."""
    utc_ns = errors["utc_ns"]
    silent = np.flatnonzero(np.diff(utc_ns) > OUTAGE_NS)
    for path, name in OWN_PATHS.items():
        _send(stream, path, times(utc_ns), _stacked(errors, name))
        if len(silent):
            _send(stream, path, times(utc_ns[silent] + 1), np.full((len(silent), 1), np.nan))
    for path, axis in _PATHS.items():
        values = _stacked(errors, axis.column)
        near = np.where(np.abs(values) <= limits.of(axis), values, np.nan)
        _send(stream, f"/near/{path}/own", times(utc_ns), near)


def begin_item(stream: rr.RecordingStream, graph: int, name: str) -> None:
    """Name and colour of an item of housekeeping, in the graph of its unit."""
    colour = _ITEM_COLOURS[zlib.crc32(name.encode()) % len(_ITEM_COLOURS)]
    _lines(stream, f"/housekeeping/{graph}/{name}", [name], [colour])


def send_item(
    stream: rr.RecordingStream, graph: int, name: str, utc_ns: NDArray[np.int64], values: NDArray[np.float64]
) -> None:
    """The values (N,) of an item of housekeeping that has begun."""
    _send(stream, f"/housekeeping/{graph}/{name}", times(utc_ns), values[:, None])


def send_outages(stream: rr.RecordingStream, utc_ns: NDArray[np.int64], limits: Limits) -> None:
    """Break the lines of all series where no frames came, right after the last frames before (their instants, (M,))."""
    at, nothing = times(utc_ns + 1), np.full((len(utc_ns), 1), np.nan)
    for path, axis in _PATHS.items():
        bounds = np.full((len(utc_ns), 2), limits.of(axis)) * (1, -1)
        _send(stream, f"/{path}/value", at, np.column_stack([nothing, bounds]))
        _send(stream, f"/near/{path}", at, np.repeat(nothing, 4, axis=1))
    for path, drawn in GRAPHS.items():
        _send(stream, f"/{path}", at, np.repeat(nothing, len(drawn), axis=1))


def _stacked(columns: NDArray[np.void], *names: str) -> NDArray[np.float64]:
    return np.column_stack([columns[name].astype(np.float64) for name in names])


def send_clock(stream: rr.RecordingStream, readings: Sequence[ClockReading]) -> None:
    """Offset of the host clock and its error bound, in milliseconds."""
    rows = [(r.offset_s, r.error_bound_s, -r.error_bound_s) for r in readings]
    _send(stream, "/clock", times([r.utc_ns for r in readings]), np.array(rows) * 1000)


def _send(stream: rr.RecordingStream, path: str, at: rr.TimeColumn, rows: NDArray[np.float64]) -> None:
    values = np.round(rows, _DECIMALS)
    columns = rr.Scalars.columns(scalars=values.ravel()).partition(np.full(len(values), values.shape[1]))
    stream.send_columns(path, [at], columns)
