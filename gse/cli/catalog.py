"""``gse catalog``: the star catalogue in use."""

import json
import math
import time
from collections.abc import Callable, Iterator
from io import StringIO
from pathlib import Path
from typing import Any, TextIO, TypeVar

import click
import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog, load_catalog
from gse.catalog.flight import write_list, write_table
from gse.catalog.mission import MAP_DEG, coverage, thinned
from gse.catalog.readers import credit_of
from gse.cli import folded, write_new
from gse.cli.options import json_option, station_option
from gse.config.choice import station_of
from gse.config.station import Station
from gse.errors import UsageError
from gse.identifier import make_identifier
from gse.process.terminal import working
from gse.values.camera import Camera

Facts = dict[str, Any]
NEW_FILE = click.Path(path_type=Path, dir_okay=False)
Result = TypeVar("Result")


@click.group("catalog")
def command() -> None:
    """Show the star catalogue in use, or write it."""


@command.command()
@station_option
@click.option(
    "--fewer-than", type=click.IntRange(1, 1000), help="Coverage: fields with fewer stars.  [default: min_fit]"
)
@click.option("--magnitude", type=float, help="Coverage of stars down to this magnitude.  [default: all that are used]")
@json_option
def info(station_path: Path | None, fewer_than: int | None, magnitude: float | None, as_json: bool) -> None:
    """Show the stars that a station works with: source, epoch, counts, tables, build time, credit and licence.

    Coverage is the share of directions, all over the sky, whose field has too few stars, with a map of them; and what
    is left where only the brightest of each field are kept.
    """
    station, _ = station_of(station_path)
    with working("reading the catalogue and its tables"):
        sections, stars = _sections(station)
        covered, cells = _coverage(stars, station, fewer_than, magnitude)
    sections["coverage"] = covered
    if as_json:
        covered["map"] = [[None if math.isnan(share) else round(share, 3) for share in row] for row in cells.tolist()]
        click.echo(json.dumps({"schema": "gse.catalog/1", **sections}))
        return
    for section, facts in sections.items():
        click.echo(section)
        for name, value in (facts or {"none": "the identifier makes its own tables"}).items():
            click.echo(folded(f"  {name:<22} {_text(value)}", indent=25))
    for line in _map_lines(cells, covered["fewer_than"]):
        click.echo(line)


@command.command()
@station_option
@click.option(
    "--flight", "table_path", type=NEW_FILE, help="Write the table of the LAPAN paper, figure 2-5, to this new file."
)
@click.option(
    "--list", "list_path", type=NEW_FILE, help="Write a plain list (id, RA, DE, magnitude, epoch) to this new file."
)
@click.option(
    "--epoch",
    "epoch_jyear",
    type=click.FloatRange(1900, 2200),
    help="Julian year of the places.  [default: the catalogue's own]",
)
def export(
    station_path: Path | None, table_path: Path | None, list_path: Path | None, epoch_jyear: float | None
) -> None:
    """Write the mission catalogue of a station as a flight catalogue (CSV).

    The table has each star with its neighbours in the field and their distances in whole microradians. Both forms can
    be the `catalog` of a station file: they are used as they are.

    A session moves the stars of its own catalogue to its date. To compare them with the exported ones, give that
    date as --epoch.
    """
    from gse.identifier.tables import field_diameter_rad, listed_neighbours, pair_table

    if table_path is None and list_path is None:
        raise UsageError("nothing to write; expected --flight FILE, --list FILE, or both")
    with working("reading the catalogue"):
        stars, camera = _mission_stars(station_of(station_path)[0], epoch_jyear)
    if list_path is not None:
        _write(list_path, lambda out: write_list(stars, out))
    if table_path is not None:
        neighbours = listed_neighbours(pair_table(stars, field_diameter_rad(camera)))
        _write(table_path, lambda out: write_table(stars, neighbours, out))


def _mission_stars(station: Station, epoch_jyear: float | None) -> tuple[StarCatalog, Camera]:
    source, camera = load_catalog(station.catalog), station.sensor.camera()
    if epoch_jyear is not None:
        source = source.at_epoch(epoch_jyear)
    return make_identifier(station.identifier, camera, source).catalog, camera


def _write(path: Path, write: Callable[[TextIO], None]) -> None:
    text = StringIO()
    write(text)
    write_new(path, text.getvalue())


def _coverage(
    stars: StarCatalog, station: Station, fewer_than: int | None, magnitude: float | None
) -> tuple[Facts, NDArray[np.float64]]:
    """The facts, and the map of shares."""
    camera, number = station.sensor.camera(), fewer_than or station.identifier.min_fit
    used = stars if magnitude is None else stars.rows(np.flatnonzero(stars.magnitude <= magnitude))
    if not len(used):
        raise UsageError(f"no star is brighter than {magnitude:g} mag; the brightest has {stars.magnitude[0]:.2f} mag")
    found, fewer = coverage(used, camera), thinned(used, camera, number)
    left = coverage(fewer, camera)
    facts = {
        "fewer_than": number,
        "faintest_magnitude": round(float(used.magnitude.max()), 2),
        "directions": len(found.stars),
        "share": round(found.share_below(number), 4),
        "fewest_stars": int(found.stars.min()),
        "median_stars": int(np.median(found.stars)),
        "thinned_stars": len(fewer),
        "thinned_of": len(used),
        "thinned_share": round(left.share_below(number), 4),
        "thinned_median_stars": int(np.median(left.stars)),
    }
    return facts, found.map_below(number)


def _map_lines(cells: NDArray[np.float64], fewer_than: int) -> Iterator[str]:
    """The map in text: a dot where no field has too few stars, else tenths of them from 1 to 9, # where all have."""
    yield f"share of fields with fewer than {fewer_than} stars (. none, 1 to 9 tenths, # all)"
    for row, shares in enumerate(cells):
        marks = "".join(_mark(float(share)) for share in shares)
        yield f"  DE {90 - (row + 1) * MAP_DEG:+4d} to {90 - row * MAP_DEG:+4d} deg  {marks}"
    yield f"{'':22}RA 0h{'24h':>{cells.shape[1] - 5}}"


def _mark(share: float) -> str:
    if math.isnan(share):
        return " "
    return "." if share == 0 else "#" if share == 1 else str(min(max(round(10 * share), 1), 9))


def _sections(station: Station) -> tuple[dict[str, Facts | None], StarCatalog]:
    """The facts of a station's catalogues, and the stars that its identifier uses."""
    source, load_s = _timed(lambda: load_catalog(station.catalog))
    credit = credit_of(source.designation)
    mission, stars = _mission(station, source)
    sections: dict[str, Facts | None] = {
        "source": {
            "name": source.source,
            "catalog": station.catalog,
            "epoch_jyear": source.epoch_jyear,
            "proper_motions": source.motion_rad_yr is not None,
            "stars": len(source),
            "brightest_magnitude": round(float(source.magnitude[0]), 2),
            "faintest_magnitude": round(float(source.magnitude[-1]), 2),
            "load_s": load_s,
            "credit": credit.text,
            "licence": credit.licence,
        },
        **mission,
    }
    return sections, stars


def _mission(station: Station, source: StarCatalog) -> tuple[dict[str, Facts | None], StarCatalog]:
    camera = station.sensor.camera()
    identifier, ready_s = _timed(lambda: make_identifier(station.identifier, camera, source))
    stars = identifier.catalog
    mission = {
        "identifier": identifier.name,
        "catalog_stars": station.identifier.catalog_stars,
        "stars": len(stars),
        "faintest_magnitude": round(float(stars.magnitude[-1]), 2),
        "stars_per_mean_field": round(len(stars) * camera.solid_angle_sr / (4 * math.pi), 1),
        "ready_s": ready_s,
    }
    pairs = None if identifier.name == "robust" else _pairs(camera, stars)
    return {"mission_catalog": mission, "pair_table": pairs}, stars


def _pairs(camera: Camera, stars: StarCatalog) -> Facts:
    from gse.identifier.tables import build_pair_table, cache_path, field_diameter_rad

    widest_rad = field_diameter_rad(camera)
    table, build_s = _timed(lambda: build_pair_table(stars, widest_rad))
    path = cache_path(stars, widest_rad)
    return {
        "pairs": len(table.distance_urad),
        "widest_deg": round(math.degrees(widest_rad), 2),
        "unit": "whole microradians",
        "bytes": sum(column.nbytes for column in table),
        "build_s": build_s,
        "cache": str(path),
        "cached": path.exists(),
    }


def _timed(action: Callable[[], Result]) -> tuple[Result, float]:
    start = time.perf_counter()
    result = action()
    return result, round(time.perf_counter() - start, 3)


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return str(value)
