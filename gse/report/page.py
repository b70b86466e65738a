"""report.html: one page, readable offline, printable."""

from functools import partial
from importlib import resources
from typing import Any

import jinja2

from gse import instant
from gse.assessment.verdict import Assessment
from gse.report.distribution_plots import draw_histogram, draw_scatter, draw_spectrum
from gse.report.plot_data import PlotData
from gse.report.sky_plots import draw_residual_map, draw_sky
from gse.report.svg import svg_of
from gse.report.terminal import quantity
from gse.report.time_plots import draw_errors, draw_identification_time, draw_paper, draw_timelines
from gse.station.session_data import SessionData

_FIGURES = (
    ("errors", 4.0, draw_errors),
    ("paper", 3.6, draw_paper),
    ("scatter", 3.6, draw_scatter),
    ("histogram", 2.4, draw_histogram),
    ("spectrum", 2.6, draw_spectrum),
    ("sky", 3.2, draw_sky),
    ("residuals", 4.6, draw_residual_map),
    ("identification", 2.4, draw_identification_time),
    ("timelines", 4.4, draw_timelines),
)
"""Name, height in inches, and what draws it."""

_AXIS_NAMES = {
    "d_ra_cosde": "dRA*",
    "d_de": "dDE",
    "d_roll": "roll",
    "cross_x": "cross-boresight x",
    "cross_y": "cross-boresight y",
    "half_cone_95": "off the boresight",
}
_AXIS_COLUMNS = (
    ("bias_arcsec", "bias"),
    ("bias_error_arcsec", "± (95 %)"),
    ("std_arcsec", "std (1 σ)"),
    ("three_sigma_arcsec", "3 σ"),
    ("rms_arcsec", "RMS"),
    ("mean_abs_arcsec", "mean |x|"),
    ("p95_abs_arcsec", "95 % |x|"),
    ("max_abs_arcsec", "max |x|"),
    ("low_frequency_arcsec", "low freq."),
    ("nea_arcsec", "NEA"),
    ("drift_arcsec_per_h", "drift (/h)"),
)
_MAX_EVENTS = 200


def report_html(session: SessionData, assessment: Assessment, report: dict[str, Any]) -> str:
    """The page of a night; the same night gives the same bytes."""
    drawn = PlotData.of(session, assessment.statistics.counted)
    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    environment.filters.update(quantity=quantity, number=_number)
    template = environment.from_string(_resource("report.html.jinja"))
    figures = {name: svg_of(name, height_in, partial(draw, drawn=drawn)) for name, height_in, draw in _FIGURES}
    return template.render(
        report=report,
        style=_resource("report.css"),
        figures=figures,
        axis_names=_AXIS_NAMES,
        axis_columns=_AXIS_COLUMNS,
        terms=assessment.budget.terms,
        events=[(instant.to_text(event.utc_ns, 0), event.kind, event.text) for event in session.events[:_MAX_EVENTS]],
        events_more=max(len(session.events) - _MAX_EVENTS, 0),
        station_text=session.station_text,
    )


def _resource(name: str) -> str:
    return resources.files("gse.report").joinpath(name).read_text(encoding="utf-8")


def _number(value: float | None, decimals: int = 2) -> str:
    """A number with a fixed count of decimals, a dash where it is unknown."""
    return "–" if value is None else f"{value:.{decimals}f}"
