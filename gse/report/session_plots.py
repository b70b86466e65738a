"""The plots of a session's report, by name; whoever imports this waits for matplotlib."""

from functools import partial

from gse.report.distribution_plots import draw_histogram, draw_scatter, draw_slew, draw_spectrum
from gse.report.plot_data import PlotData
from gse.report.sky_plots import draw_residual_map, draw_sky
from gse.report.svg import Draw, svgs_of
from gse.report.time_plots import (
    draw_errors,
    draw_housekeeping,
    draw_identification_time,
    draw_paper,
    draw_sky_condition,
    draw_timelines,
    items_to_draw,
)
from gse.station.results import Subject
from gse.station.session_data import SessionData
from gse.statistics.session_statistics import Statistics
from gse.verdict.assessment import Assessment

_PLOTS_OF_SUBJECT = (
    ("errors", 3.0, draw_errors),
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
_OF_STARS = ("sky_condition", "residuals")
"""A sensor that sends its own answers alone shows no stars."""


def session_plots(session: SessionData, assessment: Assessment, *, times_recorded: bool) -> dict[str, str]:
    """SVG elements by name; those of a subject have its name before theirs."""
    plotted = _plot_data(session, assessment.statistics)
    items = items_to_draw(session)
    of_stars = _OF_STARS if session.subject is Subject.SENSOR else ()
    without = {*(() if times_recorded else ("identification",)), *of_stars}
    wanted: list[tuple[str, float, Draw]] = [
        (name, height_in, partial(draw, data=plotted[0])) for name, height_in, draw in _PLOTS if name not in without
    ]
    if items:
        height_in = min(0.5 + 0.8 * len(items), 9.0)
        wanted.append(("housekeeping", height_in, partial(draw_housekeeping, data=plotted[0], items=items)))
    for of_subject in plotted:
        wanted += [
            (f"{of_subject.subject}-{name}", height_in, partial(draw, data=of_subject))
            for name, height_in, draw in _PLOTS_OF_SUBJECT
        ]
    for subject, steps in assessment.slew.items():
        wanted.append((f"{subject}-slew", 2.8, partial(draw_slew, steps=steps, limits=session.station.limits)))
    return svgs_of(wanted)


def _plot_data(session: SessionData, stats: Statistics) -> list[PlotData]:
    """What each subject's plots are drawn from, that of the frame table first."""
    found = [PlotData.from_session(session, stats.counted)]
    if stats.own is not None and stats.own_counted is not None:
        found.append(PlotData.of_sensor(session, stats.own, stats.own_counted.used, stats.counted))
    return found
