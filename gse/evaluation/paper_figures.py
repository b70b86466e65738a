"""Figures as the pivot paper has them: of its sky, 2 to 7, 9 and 10, with equations 1 and 2; of success, 11 to 14.

The equations ask whether there is one distinctly bright star in a field: as many fields as eq 1 finds on the sky hold
one star each where eq 2 gives as many stars. That is a mean; how many fields have one is counted beside it. Success is
drawn against the error of distances and of magnitudes.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from drivers.host_files import write_whole
from gse.catalog import StarCatalog, brightest_per_field, load_catalog
from gse.errors import UsageError
from gse.evaluation.monte_carlo import of_angles
from gse.evaluation.plan import Plan
from gse.identifier.pivot import Cells
from gse.identifier.tables import pair_table
from gse.values.matrices import product
from gse.values.spiral import spiral_directions
from gse.view.drawing import BLUE, GREEN, ORANGE, PINK, SKY_BLUE, VERMILLION, hex_of

SOURCE_STARS = 9096
"""Stars of the Bright Star Catalogue without the 14 entries that are none: of another source its brightest ones."""
_FIELDS_COUNTED = 20_000
_BINS = 80


@dataclass(frozen=True, slots=True)
class PaperSky:
    """Source and mission catalogue of a plan with angles between stars, and the diameter of its field."""

    source: StarCatalog
    mission: StarCatalog
    field_rad: float

    @classmethod
    def from_plan(cls, plan: Plan) -> "PaperSky":
        """The catalogues as the identifiers of the plan have them."""
        source = load_catalog(plan.catalog)
        field_rad = 2 * plan.optics.radius_rad()
        mission = brightest_per_field(of_angles(source, plan.optics.magnitude_limit), field_rad)
        brightest = np.argsort(source.magnitude, kind="stable")[:SOURCE_STARS]
        return cls(source.rows(brightest), mission, field_rad)

    def distinct_star(self) -> dict[str, Any]:
        """Eqs 1 and 2: the magnitude to which a mean field has one star, and what the source has to there."""
        fields = fields_on_sky(self.field_rad)
        magnitude = distinct_magnitude(fields)
        bright = self.source.rows(np.flatnonzero(self.source.magnitude <= magnitude))
        directions = spiral_directions(_FIELDS_COUNTED)
        nearest = np.concatenate([product(part, bright.icrs.T).max(axis=1) for part in np.array_split(directions, 20)])
        return {
            "fields_eq_1": round(fields, 1),
            "magnitude": round(magnitude, 2),
            "stars_eq_2": round(stars_to(magnitude), 1),
            "stars_eq_2_to_4_5": round(stars_to(4.5), 1),
            "stars": len(bright),
            "fields_with_one": round(float((nearest >= math.cos(self.field_rad / 2)).mean()), 4),
        }


def fields_on_sky(field_rad: float) -> float:
    """Eq 1: how many circular fields of this diameter cover the sky."""
    return 2 / (1 - math.cos(field_rad / 2))


def stars_to(magnitude: float) -> float:
    """Eq 2: about how many stars are brighter."""
    return 6.75 * math.exp(1.08 * magnitude)


def distinct_magnitude(fields: float) -> float:
    """The magnitude to which eq 2 gives one star for each field."""
    return math.log(fields / 6.75) / 1.08


def write_sky_figures(sky: PaperSky, directions: int, folder: Path) -> list[Path]:
    """The plots as SVG, each named for what it shows; their paths."""
    return [_written(draw(sky, directions), folder / name) for name, draw in FIGURES.items()]


def _written(figure: Figure, path: Path) -> Path:
    with mpl.rc_context({"svg.hashsalt": "gse"}):
        drawing = StringIO()
        figure.savefig(drawing, format="svg", dpi=150, metadata={"Date": None})
    write_whole(path, [drawing.getvalue()])
    return path


def _sky_map(title: str, catalog: StarCatalog) -> Figure:
    figure, axes = _axes(title, "Right ascension (deg)", "Declination (deg)")
    ra_deg, de_deg = _degrees(catalog.icrs)
    size = 0.3 + 0.25 * np.clip(7 - catalog.magnitude, 0, 7) ** 1.5
    axes.scatter(ra_deg, de_deg, s=size, color=hex_of(BLUE), linewidths=0, rasterized=True)
    axes.set(xlim=(360, 0), ylim=(-90, 90), xticks=range(0, 361, 60), yticks=range(-90, 91, 30))
    return figure


def _source(sky: PaperSky, directions: int) -> Figure:
    return _sky_map(f"Source catalogue: {len(sky.source)} stars ({sky.source.source})", sky.source)


def _mission(sky: PaperSky, directions: int) -> Figure:
    return _sky_map(f"Mission catalogue: {len(sky.mission)} stars", sky.mission)


def _distances(sky: PaperSky, directions: int) -> Figure:
    distances = np.degrees(pair_table(sky.mission, sky.field_rad).distance_urad / 1e6)
    figure, axes = _axes(f"Angular distances: {len(distances)} pairs", "Angular distance (deg)", "Pairs")
    axes.hist(distances, bins=_BINS, color=hex_of(BLUE))
    return figure


def _cells(sky: PaperSky, directions: int) -> Figure:
    cells = Cells.for_field(sky.field_rad)
    title = f"Cells: N = {cells.order}, {len(cells)} cells"
    figure, axes = _axes(title, "Right ascension (deg)", "Declination (deg)")
    for low_deg, high_deg, parts in cells.zones_deg():
        edges = (np.arange(parts) + 0.5) * 360 / parts
        axes.vlines(edges if parts > 1 else [], low_deg, high_deg, color=hex_of(BLUE), linewidth=0.7)
        axes.hlines([low_deg, high_deg], 0, 360, color=hex_of(BLUE), linewidth=0.7)
        axes.plot(np.arange(parts) * 360 / parts, [(low_deg + high_deg) / 2] * parts, ".", color=hex_of(ORANGE), ms=2)
    axes.set(xlim=(360, 0), ylim=(-90, 90), xticks=range(0, 361, 60), yticks=range(-90, 91, 30))
    return figure


def _stars_per_cell(sky: PaperSky, catalog: StarCatalog, what: str) -> Figure:
    cells = Cells.for_field(sky.field_rad)
    counts = np.bincount(cells.index(catalog.icrs), minlength=len(cells))
    title = f"{what}: {counts.min()} to {counts.max()} stars in a cell, {counts.mean():.1f} in the mean"
    figure, axes = _axes(title, "Cell index", "Stars")
    axes.step(np.arange(len(cells)), counts, where="mid", color=hex_of(BLUE), linewidth=0.8)
    axes.set(xlim=(-1, len(cells)), ylim=(0, None))
    return figure


def _spiral(sky: PaperSky, directions: int) -> Figure:
    points = spiral_directions(directions)
    figure = Figure(figsize=(8.4, 4.4), layout="constrained")
    figure.suptitle(f"Spherical spiral: {directions} directions")
    sphere, flat = figure.subplots(1, 2, width_ratios=(1, 1.5))
    near = points[points[:, 0] > 0]
    sphere.plot(near[:, 1], near[:, 2], ".", color=hex_of(BLUE), ms=2.5)
    sphere.set(xlabel="y", ylabel="z", aspect="equal", title="the half towards x", xlim=(-1.05, 1.05))
    ra_deg, de_deg = _degrees(points)
    flat.plot(ra_deg, de_deg, ".", color=hex_of(BLUE), ms=2)
    flat.set(xlim=(360, 0), ylim=(-90, 90), xlabel="Right ascension (deg)", ylabel="Declination (deg)")
    return figure


FIGURES: dict[str, Callable[[PaperSky, int], Figure]] = {
    "figure-02-source-sky.svg": _source,
    "figure-03-mission-sky.svg": _mission,
    "figure-04-distances.svg": _distances,
    "figure-05-cells.svg": _cells,
    "figure-06-source-per-cell.svg": lambda sky, _: _stars_per_cell(sky, sky.source, "Source catalogue"),
    "figure-07-mission-per-cell.svg": lambda sky, _: _stars_per_cell(sky, sky.mission, "Mission catalogue"),
    "figure-09-10-spiral.svg": _spiral,
}
"""By file name; the numbers are those of the paper."""


def _axes(title: str, across: str, up: str) -> tuple[Figure, Any]:
    figure = Figure(figsize=(6.4, 3.8), layout="constrained")
    axes = figure.add_subplot()
    axes.set(title=title, xlabel=across, ylabel=up)
    axes.grid(alpha=0.2)
    return figure, axes


def _degrees(vectors: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    ra_deg = np.degrees(np.arctan2(vectors[:, 1], vectors[:, 0])) % 360
    return ra_deg, np.degrees(np.arctan2(vectors[:, 2], np.hypot(vectors[:, 0], vectors[:, 1])))


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
