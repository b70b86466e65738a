"""campaign.html: one page, readable offline, printable, in the style of a session's report."""

import json
import math
from collections.abc import Callable
from datetime import date
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter, date2num
from matplotlib.figure import Figure

from drivers.host_files import write_whole
from gse.campaign.decision import length_text
from gse.campaign.star_places import SIGMAS
from gse.errors import UsageError
from gse.report.page import numbered, page_environment, page_style, quantity_text
from gse.report.svg import svg_of
from gse.values.text import count_text, percent
from gse.verdict.requirements import REQUIREMENTS, requirement_named
from gse.view.drawing import BLUE, GREEN, GREY, ORANGE, SKY_BLUE, VERMILLION, hex_of

# The plots of a campaign report: trends over nights, the error atlas, the sky.

TREND_COLUMNS = 3
_ROW_IN = 1.5


def trends_height_in(sensor: dict[str, Any]) -> float:
    """The height that the trends of a sensor need."""
    return _ROW_IN * math.ceil(len(sensor["trends"]) / TREND_COLUMNS) + 0.2


def draw_trends(figure: Figure, sensor: dict[str, Any]) -> None:
    """One small plot per quantity: a point per night, and the slope where there is one."""
    shown = sensor["trends"]
    grid = figure.subplots(math.ceil(len(shown) / TREND_COLUMNS), TREND_COLUMNS, squeeze=False).ravel()
    for axes, trend in zip(grid, shown, strict=False):
        _trend(axes, trend)
    for axes in grid[len(shown) :]:
        axes.set_visible(False)


def _trend(axes: Axes, trend: dict[str, Any]) -> None:
    days = np.array([_day(night) for night in trend["nights"]])
    values = np.array(trend["values"])
    axes.plot(days, values, marker="o", markersize=2.5, linestyle="", color=hex_of(BLUE))
    axes.set_title(f"{trend['name']} ({trend['unit']})", fontsize=7.5)
    if trend["per_month"] is not None and len(days):
        colour = VERMILLION if trend["significant"] else GREY
        middle = float(np.median(values - trend["per_month"] * (days - days[0]) / 30))
        axes.plot(days, middle + trend["per_month"] * (days - days[0]) / 30, color=hex_of(colour), linewidth=1)
    _date_axis(axes, days)


def draw_field(figure: Figure, sensor: dict[str, Any]) -> None:
    """Mean residuals over the detector as arrows, their significance as colour."""
    field = np.array(sensor["atlas"]["field_arcsec"], dtype=np.float64)
    sigmas = np.array(sensor["atlas"]["field_sigmas"], dtype=np.float64)
    cells = len(sigmas)
    axes = figure.subplots()
    picture = axes.imshow(
        np.ma.masked_invalid(sigmas), cmap="YlOrRd", vmin=0, vmax=max(SIGMAS, float(np.nanmax(sigmas, initial=0)))
    )
    at = np.arange(cells)
    longest = float(np.nanmax(np.hypot(field[..., 0], field[..., 1]), initial=0.0)) or 1.0
    arrows = axes.quiver(
        at,
        at,
        field[..., 0],
        field[..., 1],
        angles="xy",
        scale_units="xy",
        scale=longest / 0.9,
        color="#1a1a1a",
        width=0.004,
    )
    axes.quiverkey(arrows, 0.86, 1.04, longest, f"{longest:.2g} arcsec", labelpos="E", coordinates="axes")
    axes.set_title("mean residual by place in the field")
    axes.set_xticks(at, [f"{(2 * k + 1) / cells - 1:.2f}" for k in at], fontsize=6)
    axes.set_yticks(at, [f"{(2 * k + 1) / cells - 1:.2f}" for k in at], fontsize=6)
    axes.set_xlabel("columns, from -1 to 1 over the detector")
    axes.set_ylabel("rows")
    axes.grid(visible=False)
    figure.colorbar(picture, ax=axes, label="significance (sigma)")


def draw_phase(figure: Figure, sensor: dict[str, Any]) -> None:
    """Mean residual over the pixel phase, along columns and rows."""
    atlas = sensor["atlas"]
    for place, (axes, found) in enumerate(zip(figure.subplots(1, 2, sharey=True), atlas["phase"], strict=True)):
        curve = np.array(atlas["curves_px"][place])
        error = np.array(atlas["curve_errors_px"][place])
        phase = (np.arange(len(curve)) + 0.5) / len(curve) - 0.5
        colour = hex_of(VERMILLION if found["found"] else BLUE)
        axes.errorbar(phase, curve, error, marker="o", markersize=3, linestyle="-", linewidth=0.6, color=colour)
        axes.axhline(0, color=hex_of(GREY), linewidth=0.6)
        axes.set_title(
            f"{found['axis']}: {found['amplitude_px']:.4f} px of the sensor's own, {found['sigmas']:.1f} sigma"
        )
        axes.set_xlabel("pixel phase (px)")
        if place == 0:
            axes.set_ylabel("mean residual (px)")


def draw_sky(figure: Figure, sensor: dict[str, Any]) -> None:
    """Zero point and left-out share of each session over the nights."""
    top, bottom = figure.subplots(2, 1, sharex=True)
    known = [one for one in sensor["sky"] if one["night"] != "unknown"]
    for counts, colour, label in ((True, GREEN, "counts"), (False, ORANGE, "left out")):
        some = [one for one in known if one["counts"] is counts]
        days = [_day(one["night"]) for one in some]
        zero = [math.nan if one["zero_point_mag"] is None else one["zero_point_mag"] for one in some]
        share = [sum(one["excluded"].values()) / one["frames"] if one["frames"] else math.nan for one in some]
        style: dict[str, Any] = {
            "linestyle": "",
            "marker": "o",
            "markersize": 3,
            "color": hex_of(colour),
            "label": label,
        }
        top.plot(days, zero, **style)
        bottom.plot(days, 100 * np.array(share), **style)
    top.set_title("clearness of the sky: median zero point of each session; a cloud of one magnitude lowers it by one")
    top.set_ylabel("zero point (mag)")
    bottom.set_title("panoramas that were left out of the statistics")
    bottom.set_ylabel("share (%)")
    bottom.set_ylim(-4, 104)
    if known:
        top.legend(loc="best")
        _date_axis(bottom, np.array([_day(one["night"]) for one in known]))


def draw_rows(figure: Figure, sensor: dict[str, Any]) -> None:
    """Each row that has an upper limit in units of it: the mean of the nights with U, and the worst night."""
    axes = figure.subplots()
    shown = rows_with_upper_limit(sensor)
    for place, row in enumerate(reversed(shown)):
        share, error = row["value"] / row["limit"], (row["uncertainty"] or 0) / row["limit"]
        axes.errorbar(share, place, xerr=error, marker="o", markersize=4, capsize=3, color=hex_of(BLUE))
        if row["worst"] is not None:
            axes.plot(row["worst"] / row["limit"], place, marker="x", color=hex_of(SKY_BLUE), markersize=5)
    axes.axvline(1, color=hex_of(VERMILLION), linewidth=1)
    axes.set_yticks(range(len(shown)), [f"{row['subject']} {row['name']}" for row in reversed(shown)])
    axes.set_xlim(left=0)
    axes.set_xlabel("value / limit")


def rows_with_upper_limit(sensor: dict[str, Any]) -> list[dict[str, Any]]:
    """The rows that draw_rows draws: those with a value and an upper limit."""
    lowest = {requirement.name for requirement in REQUIREMENTS if requirement.at_least}
    return [row for row in sensor["rows"] if row["limit"] and row["value"] is not None and row["name"] not in lowest]


def _date_axis(axes: Axes, days: Any) -> None:
    locator = AutoDateLocator(minticks=2, maxticks=5)
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))
    if len(days):
        margin = max(float(np.ptp(days)) * 0.05, 1.0)
        axes.set_xlim(float(np.min(days)) - margin, float(np.max(days)) + margin)


def _day(night: str) -> float:
    return float(date2num(date.fromisoformat(night)))


def campaign_html(report: dict[str, Any]) -> str:
    """The page of a campaign's report; it follows from the report alone."""
    pages = page_environment()
    pages.filters.update(number=_number, of_row=_of_row, with_digits_of=with_digits_of)
    pages.filters.update(count_text=count_text, length_text=length_text, share=_share_text)
    template = pages.from_string(resources.files("gse.campaign").joinpath("campaign.html.jinja").read_text("utf-8"))
    caption = numbered("Figure", "figcaption")
    return template.render(
        report=report,
        style=page_style(),
        caption=numbered("Table", "caption"),
        plots=[_plots(place, sensor) for place, sensor in enumerate(report["sensors"])],
        figure=lambda svg, text: Markup(f"<figure>{svg}{caption(text)}</figure>"),
    )


def _plots(place: int, sensor: dict[str, Any]) -> dict[str, str]:
    wanted = {}
    if shown := rows_with_upper_limit(sensor):
        wanted["rows"] = (0.2 * len(shown) + 0.7, draw_rows)
    if sensor["trends"]:
        wanted["trends"] = (trends_height_in(sensor), draw_trends)
    if sensor["atlas"]:
        wanted |= {"field": (4.6, draw_field), "phase": (2.6, draw_phase)}
    if sensor["sky"]:
        wanted["sky"] = (3.2, draw_sky)
    return {
        name: svg_of(f"{name}-{place}", height, partial(_laid_out, draw=draw, sensor=sensor))
        for name, (height, draw) in wanted.items()
    }


def _laid_out(figure: Figure, draw: Callable[[Figure, dict[str, Any]], None], sensor: dict[str, Any]) -> None:
    """A plot whose panels make room for all their labels, which the margins of a session's report do not know."""
    figure.set_layout_engine("constrained")
    draw(figure, sensor)


def _number(value: float | None, digits: int = 3) -> str:
    """A number with significant digits, a dash where it is unknown."""
    return "–" if value is None else f"{value:.{digits}g}"


def _share_text(value: float | None) -> str:
    """A share in per cent, a dash where it is unknown."""
    return "–" if value is None else percent(value, 2)


def _of_row(value: float | None, row: dict[str, Any]) -> str:
    """A value of a row of the verdict with its unit: shares in per cent."""
    requirement = requirement_named(row["name"])
    is_share = requirement is not None and requirement.share_column is not None
    return percent(value, 2) if is_share and value is not None else quantity_text(value, row["unit"])


def with_digits_of(value: float | None, scatter: float | None) -> str:
    """A value to the second significant digit of its scatter; with six digits where that is zero or unknown."""
    if value is None or not scatter:
        return _number(value, 6)
    return f"{value:z.{max(0, 1 - math.floor(math.log10(scatter)))}f}"


# The files of a campaign's report: campaign.html and campaign.json in a new folder.


def write_campaign_report(report: dict[str, Any], folder: Path) -> Path:
    """Write the report into a new folder; the path of its page. campaign.json comes last: then the report is whole."""
    page = campaign_html(report)
    try:
        folder.mkdir(parents=True)
        write_whole(folder / "campaign.html", [page])
        write_whole(folder / "campaign.json", [json.dumps(report, indent=2, allow_nan=False) + "\n"])
    except OSError as error:
        raise UsageError(f"cannot write the report into {folder}: {error.strerror}; is the disk full?") from error
    return folder / "campaign.html"
