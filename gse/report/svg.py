"""The figures of a report, as SVG text."""

import io
import re
from collections.abc import Callable

import matplotlib as mpl
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from gse.drawing.palette import GREY, hex_of

WIDTH_IN = 7.2
"""The printed width of A4 less its margins."""

_STYLE = {
    "svg.fonttype": "path",
    "svg.hashsalt": "gse",
    "font.family": ["DejaVu Sans"],
    "font.size": 8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.5,
    "axes.edgecolor": hex_of(GREY),
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "axes.formatter.useoffset": False,
    "legend.fontsize": 7,
    "legend.framealpha": 0.9,
    "lines.linewidth": 0.8,
    "figure.constrained_layout.use": True,
    "path.simplify": False,
}
_MANY_DECIMALS = re.compile(r"(?<!scale\()(\d+\.\d{3})\d+")
"""A thousandth of a point is enough for a place, and not every machine has the last of six decimals alike."""

_IDS = re.compile(r'(?<=\bid=")[^"]+|(?<=href="#)[^"]+|(?<=url\(#)[^)]+')


def svg_of(name: str, height_in: float, draw: Callable[[Figure], None]) -> str:
    """The SVG element that ``draw`` makes; ``name`` keeps its ids apart from those of other figures on the page."""
    with mpl.rc_context({**mpl.rcParamsDefault, **_STYLE, "backend": "svg"}):
        figure = Figure(figsize=(WIDTH_IN, height_in))
        draw(figure)
        _lay_out(figure)
        text = io.StringIO()
        FigureCanvasSVG(figure).print_svg(text, metadata={"Date": None, "Creator": None})
    svg = text.getvalue()
    return _MANY_DECIMALS.sub(r"\1", _renumbered(svg[svg.index("<svg") :], name))


def _lay_out(figure: Figure) -> None:
    """Find the places of all parts once; savefig would draw the whole figure two more times for that."""
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine("none")


def _renumbered(svg: str, name: str) -> str:
    """The figure with its ids numbered in their order: some of matplotlib's are addresses in memory."""
    numbers: dict[str, str] = {}
    return _IDS.sub(lambda found: numbers.setdefault(found[0], f"{name}-{len(numbers)}"), svg)
