"""report.html: one page, readable offline, printable."""

import functools
import itertools
import json
from collections.abc import Callable
from functools import partial
from importlib import resources
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup, escape

from drivers.outside_text import plain_lines
from gse import instant
from gse.assessment.sensor_convention import is_wrong
from gse.assessment.statistics import Statistics, sensor_masks
from gse.assessment.verdict import Assessment
from gse.report.condition_plots import draw_sky_condition
from gse.report.distribution_plots import draw_histogram, draw_scatter, draw_spectrum
from gse.report.fingerprint import canonical, fingerprint
from gse.report.metric_table import metric_table
from gse.report.plot_data import PlotData
from gse.report.provenance import Provenance
from gse.report.sky_plots import draw_residual_map, draw_sky
from gse.report.svg import svgs_of
from gse.report.terminal import quantity
from gse.report.time_plots import draw_errors, draw_identification_time, draw_paper, draw_timelines
from gse.station.session_data import SessionData

_PLOTS_OF_SUBJECT = (
    ("errors", 4.0, draw_errors),
    ("paper", 3.6, draw_paper),
    ("scatter", 3.6, draw_scatter),
    ("histogram", 2.4, draw_histogram),
    ("spectrum", 2.6, draw_spectrum),
)
_PLOTS = (
    ("sky", 3.2, draw_sky),
    ("sky_condition", 3.2, draw_sky_condition),
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
)
_MAX_EVENTS = 200
_ARCSEC_PER_DEG = 3600.0


def report_html(
    session: SessionData, assessment: Assessment, report: dict[str, Any], made_by: Provenance | None = None
) -> str:
    """The page of a session; all but its last section, which says what it is ``made_by``, follows from the session."""
    drawn = plot_data(session, assessment.statistics)
    times_recorded = bool((np.nan_to_num(session.frames.columns["elapsed_us"]) > 0).any())
    wanted = [
        (name, height_in, partial(draw, drawn=drawn[0]))
        for name, height_in, draw in _PLOTS
        if name != "identification" or times_recorded
    ]
    for of_subject in drawn:
        wanted += [
            (f"{of_subject.subject}-{name}", height_in, partial(draw, drawn=of_subject))
            for name, height_in, draw in _PLOTS_OF_SUBJECT
        ]
    plots = svgs_of(wanted)
    return _template().render(
        report=report,
        fingerprint=canonical(fingerprint(report)),
        style=_resource("report.css"),
        caption=numbered("Table", "caption"),
        plot=_plot(plots),
        times_recorded=times_recorded,
        axis_names=_AXIS_NAMES,
        axis_columns=_AXIS_COLUMNS,
        metric_tables={subject: metric_table(report["metrics"], subject) for subject in report["accuracy"]},
        events=[(instant.to_text(event.utc_ns, 0), event.kind, event.text) for event in session.events[:_MAX_EVENTS]],
        events_more=max(len(session.events) - _MAX_EVENTS, 0) + session.events_not_kept,
        station_text=plain_lines(session.station_text),
        provenance_json=json.dumps(made_by, separators=(",", ":")),
        provenance=[(key.replace("_", " "), _in_words(key, value)) for key, value in (made_by or {}).items()],
    )


@functools.cache
def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    environment.filters.update(quantity=quantity_text, number=_number, angle=_angle, given=_given)
    return environment.from_string(_resource("report.html.jinja"))


def plot_data(session: SessionData, stats: Statistics) -> list[PlotData]:
    """What each subject's plots are drawn from, that of the frame table first."""
    drawn = [PlotData.of(session, stats.counted)]
    if stats.own is not None:
        _, used = sensor_masks(stats.own, session.frames.columns, stats.counted)
        used &= not is_wrong(stats.convention, session.station.sensor.attitude)
        drawn.append(PlotData.of_sensor(session, stats.own, used, stats.counted))
    return drawn


def numbered(word: str, element: str) -> Callable[[str], Markup]:
    """A function that gives a text its number, one more with each call."""
    numbers = itertools.count(1)
    return lambda text: Markup(f"<{element}>{word} {next(numbers)}. {escape(text)}</{element}>")


def _plot(plots: dict[str, str]) -> Callable[[str, str], Markup]:
    caption = numbered("Figure", "figcaption")
    return lambda name, text: Markup(f"<figure>{plots[name]}{caption(text)}</figure>")


def _in_words(key: str, value: Any) -> str:
    if value is None:
        return "never run" if key == "self_check" else "unknown"
    if isinstance(value, dict):
        return ", ".join(f"{name.replace('_', ' ')} {item}" for name, item in value.items())
    return str(value)


def _resource(name: str) -> str:
    return resources.files("gse.report").joinpath(name).read_text(encoding="utf-8")


def _number(value: float | None, decimals: int = 2) -> str:
    """A number with a fixed count of decimals and no minus before zero, a dash where it is unknown."""
    return "–" if value is None else f"{value:z.{decimals}f}"


def quantity_text(value: float | None, unit: str) -> str:
    """A value with its unit, a dash where it is unknown."""
    return "–" if value is None else quantity(value, unit)


def _angle(arcsec: float | None, decimals: int = 2) -> str:
    """An angle in arcsec without its unit, with it in degrees from one degree on."""
    if arcsec is None or abs(arcsec) < _ARCSEC_PER_DEG:
        return _number(arcsec, decimals)
    return f"{arcsec / _ARCSEC_PER_DEG:.3f}°"


def _given(value: Any) -> str:
    """What somebody stated, or that nobody did."""
    return "missing" if value in (None, "", []) else str(value)
