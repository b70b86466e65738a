"""The plots of a report, as SVG text."""

import gc
import io
import re
from collections.abc import Callable, Iterable

import matplotlib as mpl
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from gse.view.drawing import GREY, hex_of

WIDTH_IN = 7.2
"""The printed width of A4 less its margins."""

_LEFT_IN = 0.75
"""Room for a label of two lines and for numbers of six characters."""

_RIGHT_IN = 0.32
"""Room for half of a time to the second, whose mark may be at the end of the axis."""

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
    "axes.titley": 1.0,
    "axes.formatter.useoffset": False,
    "legend.fontsize": 7,
    "legend.framealpha": 0.9,
    "lines.linewidth": 0.8,
    "path.simplify": False,
}
_MANY_DECIMALS = re.compile(r"(?<=\.\d{3})(?<!scale\(0\.\d{3})\d+")
"""A thousandth of a point is enough for a place, and not every machine has the last of six decimals alike."""

_IDS = re.compile(r'( id="|href="#|url\(#)([^")]+)')


Draw = Callable[[Figure], None]


def svgs_of(plots: Iterable[tuple[str, float, Draw]]) -> dict[str, str]:
    """SVG elements by name, of each plot's name, height in inches and what draws it."""
    elements = {}
    with mpl.rc_context({**mpl.rcParamsDefault, **_STYLE, "backend": "svg"}):
        for name, height_in, draw in plots:
            elements[name] = _svg_of(name, height_in, draw)
            gc.collect(1)  # the figure, whose parts know each other, and its arrays
    return elements


def set_margins(
    figure: Figure,
    *,
    right_in: float = _RIGHT_IN,
    bottom_in: float = 0.5,
    top_in: float = 0.3,
    between: tuple[float, float] = (0.25, 0.12),
) -> None:
    """Place the panels by margins in inches, and the gaps ``between`` columns and rows as shares of a panel.

    matplotlib's layout engines find them by drawing all text twice, which takes almost as long as the drawing.
    """
    width_in, height_in = figure.get_size_inches()
    figure.subplots_adjust(
        left=_LEFT_IN / width_in,
        right=1 - right_in / width_in,
        bottom=bottom_in / height_in,
        top=1 - top_in / height_in,
        wspace=between[0],
        hspace=between[1],
    )


def svg_of(name: str, height_in: float, draw: Draw) -> str:
    """The one SVG element that ``draw`` makes."""
    return svgs_of([(name, height_in, draw)])[name]


def _svg_of(name: str, height_in: float, draw: Draw) -> str:
    """The SVG element that ``draw`` makes; ``name`` keeps its ids apart from those of other plots on the page."""
    figure = Figure(figsize=(WIDTH_IN, height_in))
    set_margins(figure)
    draw(figure)
    text = io.StringIO()
    FigureCanvasSVG(figure).print_svg(text, metadata={"Date": None, "Creator": None})
    svg = text.getvalue()
    return _MANY_DECIMALS.sub("", _renumbered(svg[svg.index("<svg") :], name))


def _renumbered(svg: str, name: str) -> str:
    """The plot with its ids numbered in their order: some of matplotlib's are addresses in memory."""
    numbers: dict[str, str] = {}
    return _IDS.sub(lambda found: found[1] + numbers.setdefault(found[2], f"{name}-{len(numbers)}"), svg)
