"""Layout of the screen: place and time range of each view."""

import math
from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from gse.config.station import Station
from gse.station.columns import UNITS, unit_of
from gse.view.rerun_columns import GRAPHS, LEGEND_ENDS, SCATTER_LEGEND_ENDS, TIMELINE

LIVE_WINDOW_S = 600.0
"""A live view shows the last ten minutes."""


_PLACED = ("stars", "cross", "roll", "identification_ms", "temperature_c")
"""Graphs with a title of their own; those of other columns stand behind them."""
_ROOM = 1.2
_FEWEST_POWERS, _MOST_POWERS = 1.2, 2.4


def layout(
    station: Station,
    *,
    window_s: float | None = None,
    boresight_icrs: NDArray[np.float64] | None = None,
    own: bool = False,
    item_units: Sequence[str] = (),
) -> rrb.Blueprint:
    """All views of a station over the last ``window_s`` seconds, or over the whole session (None).

    With ``own`` the sensor sends answers of its own, which the titles then name. ``item_units`` are
    those of the items of housekeeping that are shown, a graph for each.
    """
    ranges = _time_ranges(window_s)
    pictures = rrb.Vertical(
        rrb.Tabs(_panorama_view(station), rrb.TextDocumentView(origin="/metrics", name="Metrics")),
        rrb.Horizontal(_scatter_view(station, ranges), _sky_view(ranges, boresight_icrs)),
        row_shares=[3, 2],
    )
    words = rrb.Vertical(
        rrb.TextDocumentView(origin="/verdict", name="Verdict"),
        rrb.TextDocumentView(origin="/log", name="Log (UTC)"),
        row_shares=[3, 2],
    )
    return rrb.Blueprint(
        rrb.Horizontal(_graphs(station, window_s, item_units, own=own), pictures, words, column_shares=[5.4, 3.2, 2.2]),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TopPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
        auto_views=False,
        auto_layout=False,
    )


def _graphs(station: Station, window_s: float | None, item_units: Sequence[str], *, own: bool) -> rrb.Vertical:
    """The errors, all other numbers, and the states, over time."""
    axis = rrb.TimeAxis(view_range=_time_range(window_s))
    whole = rrb.TimeAxis(view_range=_time_range(None))
    limits = station.limits
    errors = rrb.Vertical(
        _close_view("d_ra", f"dRA* (arcsec), limit {limits.d_ra_cosde_arcsec:g}", axis, own=own),
        _limit_view("d_ra", "dRA*, whole session", limits.d_ra_cosde_arcsec, whole),
        _close_view("d_de", f"dDE (arcsec), limit {limits.d_de_arcsec:g}", axis, own=own),
        _limit_view("d_de", "dDE, whole session", limits.d_de_arcsec, whole),
        row_shares=[3, 1.5, 3, 1.5],
        name="RA, DE",
    )
    return rrb.Vertical(
        rrb.Tabs(
            errors,
            _graph("/cross", "Across x, y (arcsec)", axis),
            _graph("/roll", "Roll (arcsec)", axis, "/sensor/roll"),
        ),
        rrb.Tabs(
            _graph("/stars", "Sky (stars, mag)", axis),
            _graph("/identification_ms", f"Time (ms), limit {limits.identification_ms:g}", axis, "/sensor/latency_ms"),
            _graph("/clock", "Clock (ms)", axis),
            _graph("/temperature_c", "Detector (degC)", axis),
            *(_graph(f"/{path}", _title(path), axis) for path in GRAPHS if path not in _PLACED),
            *(
                _graph(f"/housekeeping/{number}", f"Housekeeping ({unit})" if unit else "Housekeeping", axis)
                for number, unit in enumerate(item_units)
            ),
        ),
        rrb.StateTimelineView(origin="/state", name="Link, sky, verdict", time_view=axis),
        row_shares=[7.5, 2.2, 2.8],
    )


def _time_range(window_s: float | None) -> rr.TimeRange:
    if window_s is None:
        return rr.TimeRange(start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.infinite())
    return rr.TimeRange(
        start=rr.TimeRangeBoundary.cursor_relative(seconds=-window_s),
        end=rr.TimeRangeBoundary.cursor_relative(seconds=0.0),
    )


def _time_ranges(window_s: float | None) -> rrb.VisibleTimeRanges:
    wanted = _time_range(window_s)
    return rrb.VisibleTimeRanges(timeline=TIMELINE, start=wanted.start, end=wanted.end)


def _close_view(path: str, name: str, axis: rrb.TimeAxis, *, own: bool) -> rrb.TimeSeriesView:
    """The errors with running mean and band, on an axis that follows them."""
    return rrb.TimeSeriesView(
        origin=f"/near/{path}",
        contents=["$origin/**"],
        name=f"{name}{'; orange: the sensor itself' if own else ''}",
        axis_x=axis,
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=False),
    )


def _limit_view(path: str, name: str, limit: float, axis: rrb.TimeAxis) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=f"/{path}",
        contents=["$origin/**", f"/sensor/{path}"],
        name=name,
        axis_x=axis,
        axis_y=rrb.ScalarAxis(range=(-_reach(limit), _reach(limit))),
        plot_legend=rrb.PlotLegend(visible=False),
    )


def _reach(limit: float) -> float:
    """How far an axis reaches on either side, at least to 1.2 limits, so that it has numbers beside 0.

    rerun puts them at powers of ten that are 20 points apart: on an axis of 95 points up to 2.4 of them fit.
    """
    power = 10.0 ** math.floor(math.log10(_ROOM * limit))
    wanted = max(_ROOM * limit / power, _FEWEST_POWERS)
    return power * (wanted if wanted <= _MOST_POWERS else 10 * _FEWEST_POWERS)


def _graph(path: str, name: str, axis: rrb.TimeAxis, *beside: str) -> rrb.TimeSeriesView:
    legend = rrb.PlotLegend(rrb.Corner2D.LeftTop)
    contents = ["$origin/**", *beside]
    return rrb.TimeSeriesView(origin=path, contents=contents, name=name, axis_x=axis, plot_legend=legend)


def _title(path: str) -> str:
    """The title of a graph by its name, its unit in brackets: boresight_drift_arcsec is Boresight drift (arcsec)."""
    end = next((end for end in UNITS if path.endswith(f"_{end}")), "")
    words = path.removesuffix(f"_{end}").replace("_", " ").capitalize()
    return f"{words} ({unit_of(path)})" if end else words


def _panorama_view(station: Station) -> rrb.Spatial2DView:
    columns, rows = station.sensor.columns, station.sensor.rows
    margin = 0.03 * columns
    bounds = rrb.VisualBounds2D(x_range=(-margin, columns + margin), y_range=(-margin, LEGEND_ENDS * rows))
    passive = rrb.EntityBehavior(interactive=False)  # the mouse finds the star, not the foot of its arrow
    around = {f"/panorama/{name}": passive for name in ("residuals", "named", "detector", "legend")}
    return rrb.Spatial2DView(origin="/panorama", name="Panorama (px)", visual_bounds=bounds, overrides=around)


def _scatter_view(station: Station, ranges: rrb.VisibleTimeRanges) -> rrb.Spatial2DView:
    limits = station.limits
    x, y = 1.5 * limits.d_ra_cosde_arcsec, 1.5 * limits.d_de_arcsec
    return rrb.Spatial2DView(
        origin="/scatter",
        name="Scatter",
        visual_bounds=rrb.VisualBounds2D(x_range=(-x, x), y_range=(-y, SCATTER_LEGEND_ENDS * limits.d_de_arcsec)),
        overrides={"/scatter/points": ranges},
    )


def _sky_view(ranges: rrb.VisibleTimeRanges, boresight_icrs: NDArray[np.float64] | None) -> rrb.Spatial3DView:
    """The sky seen from inside the sphere, along the boresight."""
    eye = None
    if boresight_icrs is not None:
        eye = rrb.EyeControls3D(
            kind="Orbital", position=-0.4 * boresight_icrs, look_target=boresight_icrs, eye_up=_up(boresight_icrs)
        )
    return rrb.Spatial3DView(
        origin="/sky",
        name="Sky",
        eye_controls=eye,
        line_grid=False,
        overrides={"/sky/true": ranges, "/sky/measured": ranges},
    )


def _up(boresight_icrs: NDArray[np.float64]) -> tuple[float, float, float]:
    """North, or the vernal equinox where the sensor looks at a celestial pole."""
    return (1.0, 0.0, 0.0) if abs(boresight_icrs[2]) > 0.98 else (0.0, 0.0, 1.0)
