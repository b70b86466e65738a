"""Success against the error of distances and of magnitudes, in the layout of the pivot paper, figures 11 to 14."""

from io import StringIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from drivers.host_files import write_whole
from gse.errors import UsageError
from gse.view.drawing import BLUE, GREEN, ORANGE, PINK, SKY_BLUE, VERMILLION, hex_of

_AXES = {
    "success-distance.svg": ("noise_arcsec", "Error of position (arcsec, 1 sigma)", "magnitude_noise", "{:g} mag"),
    "success-magnitude.svg": ("magnitude_noise", "Error of magnitude (mag, 1 sigma)", "noise_arcsec", "{:g} arcsec"),
}
_MARKERS = "osd^vP"
_COLOURS = (BLUE, VERMILLION, GREEN, ORANGE, PINK, SKY_BLUE)


def refuse_existing(folder: Path, *others: str) -> None:
    """UsageError before long work where a plot, or one of ``others``, would be overwritten, or the folder cannot be
    made."""
    for name in (*_AXES, *others):
        if (folder / name).exists():
            raise UsageError(f"{folder / name} exists already; choose another folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"cannot make the folder {folder}: {error.strerror}") from error


def write_figures(document: dict[str, Any], folder: Path) -> list[Path]:
    """Both plots of a report of schema gse.evaluation/1, as SVG; their paths."""
    paths = []
    for name, (key, label, other, suffix) in _AXES.items():
        if key == "noise_arcsec" and document["angle_noise"]:
            label = "Error of angular distance (arcsec, 1 sigma)"
        figure = _figure(document, key, label, (other, suffix))
        path = folder / name
        with mpl.rc_context({"svg.hashsalt": "gse"}):
            drawing = StringIO()
            figure.savefig(drawing, format="svg", metadata={"Date": None})
        write_whole(path, [drawing.getvalue()])
        paths.append(path)
    return paths


def _figure(document: dict[str, Any], key: str, label: str, other: tuple[str, str]) -> Any:
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    axes = figure.add_subplot()
    axes.set_prop_cycle(color=[hex_of(colour) for colour in _COLOURS])
    lines = _lines(document, key, other)
    for place, (name, cells) in enumerate(lines.items()):
        y = [100 * cell["rates"]["right"]["share"] for cell in cells]
        bounds = [[100 * bound for bound in cell["rates"]["right"]["interval"]] for cell in cells]
        below = [value - low for value, (low, _) in zip(y, bounds, strict=True)]
        above = [high - value for value, (_, high) in zip(y, bounds, strict=True)]
        x = [cell[key] for cell in cells]
        marker = _MARKERS[place % len(_MARKERS)]
        axes.errorbar(x, y, yerr=[below, above], marker=marker, capsize=3, label=name)
    axes.set(xlabel=label, ylabel="Right (%), with 95 % interval", ylim=(_floor_percent(lines), 101))
    axes.set_xticks(sorted({cell[key] for cells in lines.values() for cell in cells}))
    axes.grid(alpha=0.3)
    if axes.get_legend_handles_labels()[0]:
        axes.legend()
    return figure


def _floor_percent(lines: dict[str, list[dict[str, Any]]]) -> int:
    """Where the axis begins: the ten below all intervals, so that what differs can be seen."""
    lowest = min((cell["rates"]["right"]["interval"][0] for cells in lines.values() for cell in cells), default=0.0)
    return min(int(10 * lowest), 8) * 10


def _lines(document: dict[str, Any], key: str, other: tuple[str, str]) -> dict[str, list[dict[str, Any]]]:
    """Cells along ``key`` by what stays the same, named for the legend; where there are lines, no lonely points."""
    fixed, suffix = other
    lines: dict[str, list[dict[str, Any]]] = {}
    for cell in document["cells"]:
        if cell["frames_counted"]:
            name = f"{cell['identifier']}, {suffix.format(cell[fixed])}"
            if cell["sky_limit"] is not None:
                name = f"{name}, sky to {cell['sky_limit']:g}"
            false_objects = cell["false_objects"]
            lines.setdefault(f"{name}, {false_objects} false" if false_objects else name, []).append(cell)
    for cells in lines.values():
        cells.sort(key=lambda cell: cell[key])
    longest = max(map(len, lines.values()), default=0)
    return {name: cells for name, cells in lines.items() if len(cells) > 1 or longest == 1}
