"""Figure of the sky's condition against time: stars seen, transparency, limiting magnitude."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import PercentFormatter

from gse.drawing.palette import BLUE, GREEN, GREY, ORANGE, SKY_BLUE, VERMILLION, YELLOW, hex_of
from gse.report.plot_data import PlotData
from gse.report.svg import set_margins
from gse.report.time_plots import line, time_axis
from gse.station.frame_table import SKY_CONDITIONS
from gse.station.results import SkyCondition
from gse.statistics.sky_summary import seen_share

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
    shown = _shade((top, bottom), data)
    handles, labels = top.get_legend_handles_labels()
    handles += [Patch(color=hex_of(_COLOURS[name]), alpha=_ALPHA) for name in shown]
    figure.legend(handles, [*labels, *(name.value for name in shown)], loc="lower center", ncols=6)
    time_axis(bottom)


def _shade(panels: tuple[Axes, ...], data: PlotData) -> list[SkyCondition]:
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
