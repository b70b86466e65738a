"""Plots against time: the errors, as in figures 3-1 to 3-6 of [S], and what surrounds them."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter, date2num
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, PercentFormatter
from numpy.typing import NDArray

from gse.report.plot_data import PlotData, angle_unit, close_edge_of, edge_of, extremes, sample
from gse.report.summary import LIMIT_DEG
from gse.report.svg import set_margins
from gse.station.columns import SKY_CONDITIONS
from gse.station.events import LINK_WORDS, StationKind
from gse.station.results import SkyCondition, Subject
from gse.station.session_data import SessionData
from gse.statistics.sky_summary import seen_share
from gse.values.axis import D_DE, D_RA_COSDE, ON_SKY, Axis
from gse.view.drawing import BLUE, GREEN, GREY, ORANGE, SKY_BLUE, VERMILLION, YELLOW, hex_of
from gse.view.live_state import LINK_COLOURS
from protocols import Item

_MAX_MARKS = 400
_SHARE_BINS = 120
_WITH_LEGEND_IN = 0.75
"""The margin below a plot with its legend there."""


def draw_errors(figure: Figure, data: PlotData) -> None:
    """dRA* and dDE on axes that follow them, frames outside their limits, without an answer, and stretches left out."""
    limits = data.session.station.limits
    set_margins(figure, bottom_in=_WITH_LEGEND_IN)
    top, bottom = figure.subplots(2, 1, sharex=True)
    for panel, axis in zip((top, bottom), ON_SKY, strict=True):
        _error_panel(panel, data, axis, limits.of(axis))
    top.set_title(f"{data.subject}: dRA* = dRA cos DE, and dDE, against their limits")
    handles, labels = top.get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncols=5)
    time_axis(bottom)


def _error_panel(axes: Axes, data: PlotData, axis: Axis, limit: float) -> None:
    values = np.where(data.good, data.frames[axis.column], np.nan)
    scale, unit = angle_unit(edge_of(values, limit))
    text: str | None = f"limit {limit:g} arcsec"
    values, limit = values * scale, limit * scale
    edge = close_edge_of(values, limit)
    axes.axhline(0, color=hex_of(GREY), linewidth=0.8)
    for sign in (1, -1):
        axes.axhline(sign * limit, color=hex_of(VERMILLION), linewidth=1, label=text)
        text = None
        if edge < limit:
            place, side, before = ((0.995, 0.97), "top", "+") if sign > 0 else ((0.995, 0.03), "bottom", "-")
            words = f"limit {before}{limit:g} beyond"
            axes.annotate(words, place, xycoords="axes fraction", ha="right", va=side, color=hex_of(VERMILLION))
    line(axes, data, values, SKY_BLUE, "measured - true")
    outside = np.flatnonzero(np.abs(values) > limit)
    shown = outside[sample(len(outside), _MAX_MARKS)]
    clipped = np.clip(values[shown], -edge, edge)
    style: dict[str, Any] = {"linestyle": "", "markersize": 4}
    axes.plot(data.utc[shown], clipped, marker="x", color=hex_of(VERMILLION), label="outside", **style)
    missing = np.flatnonzero(data.unidentified)
    missing = missing[sample(len(missing), _MAX_MARKS)]
    ground = np.full(len(missing), -edge)
    axes.plot(data.utc[missing], ground, marker="|", color=hex_of(ORANGE), label="no answer", **style)
    _shade(axes, data)
    axes.set_ylim(-1.05 * edge, 1.05 * edge)
    axes.set_ylabel(f"{axis.label} ({unit})")


def _shade(axes: Axes, data: PlotData) -> None:
    for number, item in enumerate(data.exclusions):
        axes.axvspan(_day(item.from_ns), _day(item.until_ns), color="#dddddd", label=None if number else "left out")
    notes = [event for event in data.session.events if event.kind == StationKind.NOTE]
    for number, event in enumerate(notes):
        axes.axvline(
            _day(event.utc_ns), color=hex_of(GREY), linewidth=1, linestyle=":", label=None if number else "note"
        )


def _day(utc_ns: int) -> float:
    """An instant as matplotlib counts it."""
    return float(date2num(np.datetime64(utc_ns, "ns")))


def draw_paper(figure: Figure, data: PlotData) -> None:
    """dRA (not times cos DE) and dDE in degrees, as [S] draws them for each of its sensors."""
    top, bottom = figure.subplots(2, 1, sharex=True)
    cos_de = np.cos(np.radians(data.frames["de_true_deg"]))
    d_ra_deg = np.where(data.good, data.frames[D_RA_COSDE.column], np.nan) / cos_de / 3600
    d_de_deg = np.where(data.good, data.frames[D_DE.column], np.nan) / 3600
    for axes, values, label in ((top, d_ra_deg, "dRA (deg)"), (bottom, d_de_deg, "dDE (deg)")):
        for sign in (1, -1):
            axes.axhline(sign * LIMIT_DEG, color=hex_of(VERMILLION), linewidth=1, linestyle="--")
        line(axes, data, values, BLUE, label)
        edge = edge_of(values, LIMIT_DEG)
        axes.set_ylim(-1.05 * edge, 1.05 * edge)
        axes.set_ylabel(label)
    top.set_title(f"{data.subject}: dRA and dDE, as figures 3-1 to 3-6 of the LAPAN paper; dashed: its limit")
    time_axis(bottom)


_IDENTIFICATION_TIME = "Identification time (as recorded in the session)"
_ALIKE = 1.1


def draw_identification_time(figure: Figure, data: PlotData) -> None:
    """Time of the identification against time, and its distribution."""
    set_margins(figure, between=(0.06, 0))
    left, right = figure.subplots(1, 2, width_ratios=[3, 1], sharey=True)
    values = data.frames["elapsed_us"].astype(np.float64) / 1000
    limit = data.session.station.limits.identification_ms
    stated = data.subject is Subject.SENSOR
    left.set_title("Processing time (as the sensor states it)" if stated else _IDENTIFICATION_TIME)
    left.set_ylabel("ms")
    finite = values[np.isfinite(values) & (values > 0)]
    left.axhline(limit, color=hex_of(VERMILLION), linewidth=1)
    line(left, data, values, GREEN, "time")
    left.set_yscale("log")
    left.yaxis.set_major_formatter("{x:g}")
    left.yaxis.set_minor_locator(LogLocator(subs=(2, 5)))
    left.set_ylim(float(finite.min()) / 1.5, 4 * max(limit, float(finite.max())))
    left.text(0.01, limit, f"limit {limit:g} ms", transform=left.get_yaxis_transform(), va="bottom", fontsize=7)
    few = finite.max() < _ALIKE * finite.min()  # bins of one time would be too narrow to be seen
    bins = np.geomspace(finite.min() / 1.05, finite.max() * 1.05, 2 if few else 60)
    right.stairs(*np.histogram(finite, bins), orientation="horizontal", fill=True, color=hex_of(GREEN))
    right.set_xlabel("frames")
    time_axis(left)


def draw_timelines(figure: Figure, data: PlotData) -> None:
    """Share of frames identified, link state, host clock, detector temperature."""
    set_margins(figure, between=(0, 0.36))
    share, link, clock, temperature = figure.subplots(4, 1, sharex=True, height_ratios=[2, 0.7, 1.6, 1.6])
    _share(share, data)
    _link(link, data)
    _clock(clock, data)
    line(temperature, data, data.frames["temperature_c"].astype(np.float64), ORANGE, "detector")
    temperature.set_ylabel("detector\n(degC)")
    time_axis(temperature)


MOST_ITEMS = 12
"""Items that are drawn: those with limits first, then in the order of the description."""


def items_to_draw(session: SessionData) -> list[tuple[int, Item]]:
    """The numeric items that came, each with its place among the items."""
    seen = session.housekeeping.summaries
    came = [
        (at, item)
        for at, item in enumerate(session.housekeeping.items)
        if item.name in seen and not (item.words or item.are_bits)
    ]
    return sorted(came, key=lambda one: one[1].yellow is None and one[1].red is None)[:MOST_ITEMS]


def draw_housekeeping(figure: Figure, data: PlotData, items: list[tuple[int, Item]]) -> None:
    """A panel for each item, with its limits where they are near."""
    set_margins(figure, between=(0, 0.3))
    rows = data.session.housekeeping.rows
    numbers, all_ns, all_values = (np.asarray(rows[name]) for name in ("item", "utc_ns", "value"))
    panels = np.atleast_1d(figure.subplots(len(items), 1, sharex=True))
    for axes, (number, item) in zip(panels, items, strict=True):
        mine = numbers == number
        utc_ns, values = all_ns[mine], all_values[mine]
        shown = extremes(values)
        axes.plot(date2num(utc_ns[shown].astype("datetime64[ns]")), values[shown], color=hex_of(SKY_BLUE), linewidth=1)
        low, high = axes.get_ylim()
        for limits, style in ((item.yellow, "--"), (item.red, "-")):
            for end in limits or ():
                if end is not None and low - (high - low) <= end <= high + (high - low):
                    axes.axhline(
                        end, color=hex_of(VERMILLION if style == "-" else ORANGE), linestyle=style, linewidth=1
                    )
        axes.set_ylabel(f"{item.name}\n({item.unit})" if item.unit else item.name, fontsize=6)
    time_axis(panels[-1])


def _share(axes: Axes, data: PlotData) -> None:
    axes.set_ylabel("identified")
    axes.set_ylim(-0.03, 1.05)
    axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    availability = data.session.station.limits.availability
    axes.axhline(availability, color=hex_of(VERMILLION), linewidth=1)
    utc_ns = data.frames["utc_ns"]
    if not len(utc_ns):
        return
    edges = np.linspace(utc_ns[0], utc_ns[-1] + 1, min(_SHARE_BINS, len(utc_ns)) + 1)
    place = np.clip(np.searchsorted(edges, utc_ns, side="right") - 1, 0, len(edges) - 2)
    total = np.bincount(place, minlength=len(edges) - 1)
    good = np.bincount(place, ~data.unidentified, len(edges) - 1)
    with np.errstate(invalid="ignore"):
        values = good / total
    axes.stairs(values, edges.astype(np.int64).astype("datetime64[ns]"), color=hex_of(BLUE), baseline=None)


def _link(axes: Axes, data: PlotData) -> None:
    """Coloured stretches, each from an event to the next."""
    axes.set_ylabel("link")
    axes.set_yticks([])
    axes.set_ylim(0, 1)
    states = [event for event in data.session.events if event.kind in LINK_WORDS]
    ends = [event.utc_ns for event in states[1:]]
    ends.append(max(int(data.frames["utc_ns"][-1]) if len(data.utc) else 0, states[-1].utc_ns if states else 0))
    for event, end in zip(states, ends, strict=False):
        axes.axvspan(_day(event.utc_ns), _day(end), color=hex_of(LINK_COLOURS[LINK_WORDS[event.kind]]), linewidth=0)
    for word in dict.fromkeys(LINK_WORDS[event.kind] for event in states):
        axes.plot([], [], linewidth=5, color=hex_of(LINK_COLOURS[word]), label=word)
    if states:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, frameon=False, borderpad=0)


def _clock(axes: Axes, data: PlotData) -> None:
    axes.set_ylabel("host clock\n(ms)")
    readings = data.session.clock
    if not readings:
        _nothing(axes, "the clock was not read")
        return
    at = np.array([reading.utc_ns for reading in readings]).astype("datetime64[ns]")
    offset = 1000 * np.array([reading.offset_s for reading in readings])
    bound = 1000 * np.array([reading.error_bound_s for reading in readings])
    colour = GREY if all(reading.synchronised for reading in readings) else VERMILLION
    axes.fill_between(at, offset - bound, offset + bound, color=hex_of(colour), alpha=0.3, linewidth=0)
    axes.plot(at, offset, color=hex_of(BLUE), marker="." if len(at) < 100 else "", markersize=3)


def _nothing(axes: Axes, text: str) -> None:
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=hex_of(GREY))


def line(axes: Axes, data: PlotData, values: NDArray[np.float64], colour: tuple[int, int, int], label: str) -> None:
    """A line over the frames, broken where frames are missing; thinned to its extremes."""
    rows = extremes(values)
    utc_ns, shown = data.frames["utc_ns"][rows], values[rows].copy()
    broken = np.searchsorted(rows, data.gaps)
    broken = broken[broken < len(rows)]
    utc_ns = np.insert(utc_ns, broken, utc_ns[broken] - 1)
    shown = np.insert(shown, broken, np.nan)
    marker = "." if np.isfinite(values).sum() < 60 else ""
    axes.plot(utc_ns.astype("datetime64[ns]"), shown, color=hex_of(colour), label=label, marker=marker)


def time_axis(axes: Axes) -> None:
    """UTC along the bottom, with its date."""
    locator = AutoDateLocator(minticks=4, maxticks=9)
    axes.xaxis.set_major_locator(locator)
    formatter = ConciseDateFormatter(locator, show_offset=True)
    formatter.formats[5] = "%H:%M:%S.%f"
    formatter.offset_formats[3:] = ["%Y-%m-%d"] * 3
    axes.xaxis.set_major_formatter(formatter)
    axes.set_xlabel("UTC")


# Figure of the sky's condition against time: stars seen, transparency, limiting magnitude.

_COLOURS = {
    SkyCondition.CLOUDED: SKY_BLUE,
    SkyCondition.NO_STARS: VERMILLION,
    SkyCondition.DAYLIGHT: YELLOW,
    SkyCondition.UNKNOWN: GREY,
}
_MOST_STRETCHES = 500
_ALPHA = 0.25


def draw_sky_condition(figure: Figure, data: PlotData) -> None:
    """Shares above, the magnitude of the faintest star below; coloured where the sky was not clear."""
    set_margins(figure, bottom_in=0.75, top_in=0.1)
    top, bottom = figure.subplots(2, 1, sharex=True)
    line(top, data, seen_share(data.frames), GREEN, "stars seen of those expected")
    line(top, data, data.frames["transparency"].astype(np.float64), BLUE, "transparency")
    top.set_ylim(-0.03, 1.08)
    top.yaxis.set_major_formatter(PercentFormatter(1.0))
    line(bottom, data, data.frames["limiting_mag"].astype(np.float64), ORANGE, "faintest star")
    bottom.set_ylabel("magnitude")
    bottom.invert_yaxis()
    shown = _shade_conditions((top, bottom), data)
    handles, labels = top.get_legend_handles_labels()
    handles += [Patch(color=hex_of(_COLOURS[name]), alpha=_ALPHA) for name in shown]
    figure.legend(handles, [*labels, *(name.value for name in shown)], loc="lower center", ncols=6)
    time_axis(bottom)


def _shade_conditions(panels: tuple[Axes, ...], data: PlotData) -> list[SkyCondition]:
    """Colour the stretches that are not clear; which conditions they have."""
    codes, utc = data.frames["sky_condition"], data.utc
    if not len(codes):
        return []
    begins = np.concatenate([[0], np.flatnonzero(np.diff(codes)) + 1])
    shown: list[SkyCondition] = []
    for begin, end in list(zip(begins, [*begins[1:], len(codes) - 1], strict=True))[:_MOST_STRETCHES]:
        condition = SKY_CONDITIONS[int(codes[begin])]
        if condition is SkyCondition.CLEAR:
            continue
        shown.append(condition)
        for axes in panels:
            axes.axvspan(utc[begin], utc[end], color=hex_of(_COLOURS[condition]), alpha=_ALPHA, linewidth=0)
    return list(dict.fromkeys(shown))
