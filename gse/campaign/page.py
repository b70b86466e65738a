"""campaign.html: one page, readable offline, printable, in the style of a session's report."""

import math
from collections.abc import Callable
from functools import partial
from importlib import resources
from typing import Any

import jinja2
from markupsafe import Markup
from matplotlib.figure import Figure

from gse.assessment.requirements import requirement_named
from gse.campaign.decision import length_text
from gse.campaign.plots import (
    draw_field,
    draw_phase,
    draw_rows,
    draw_sky,
    draw_trends,
    rows_with_upper_limit,
    trends_height_in,
)
from gse.count_text import count_text
from gse.percent import percent
from gse.report.page import numbered, quantity_text
from gse.report.svg import svg_of


def campaign_html(report: dict[str, Any]) -> str:
    """The page of a campaign's report; it follows from the report alone."""
    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    environment.filters.update(number=_number, of_row=_of_row, with_digits_of=with_digits_of)
    environment.filters.update(count_text=count_text, length_text=length_text)
    template = environment.from_string(
        resources.files("gse.campaign").joinpath("campaign.html.jinja").read_text("utf-8")
    )
    caption = numbered("Figure", "figcaption")
    return template.render(
        report=report,
        style=resources.files("gse.report").joinpath("report.css").read_text("utf-8"),
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
