"""``gse config``: write, check or show a station file."""

import json
import shlex
import sys
from pathlib import Path
from typing import Any

import click
import yaml

from drivers.clock import read_clock
from drivers.whole_file import new_file
from gse.catalog import load_catalog
from gse.cli.folding import folded
from gse.cli.options import at_option
from gse.cli.station_questions import asked, draft_options, unasked
from gse.config.choice import station_of
from gse.config.draft import draft_text
from gse.config.station import BUILT_IN_TEXT, parse_station, read_station
from gse.errors import ConfigError
from gse.inspection.check import Outcome
from protocols import load_protocol

_FEW_STARS = 100
"""Enough to see that a catalogue can be read; of a file all lines are looked at."""


@click.group("config")
def command() -> None:
    """Write, check or show a station file."""


@command.command()
@click.argument("path", type=click.Path(path_type=Path), default=Path("station.yaml"))
@draft_options
@click.option("--yes", is_flag=True, help="Ask nothing: what is not given as an option is as in the built-in station.")
def init(path: Path, *, yes: bool, **given: Any) -> None:
    """Write a commented station file to PATH (default: station.yaml).

    On a terminal it asks for site, sensor, mount and port, and shows the serial ports that it finds. An existing file
    is not changed.
    """
    if path.exists():
        raise ConfigError(f"{path} exists already; choose another name")
    text = draft_text(unasked(given) if yes or not sys.stdin.isatty() else asked(given))
    try:
        with new_file(path) as file:
            file.write(text.encode())
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror}") from error
    click.echo(f"{path} written and checked. Next: gse preflight --station {shlex.quote(str(path))}", err=True)


@command.command()
@click.argument("path", type=click.Path(path_type=Path))
@at_option
def check(path: Path, begins_ns: int | None) -> None:
    """Check the station file PATH. Each error is shown with file, line and key; the exit code is then 2.

    What cannot be is an error too, such as a boresight below the horizon; what is doubtful is said. It shows the field
    of view, when it is dark tonight, how many stars the field will hold, and how long a session must be.
    """
    from gse.inspection.plausibility import plausibility
    from gse.station.setup import check_external

    station, _ = station_of(path)
    check_external(station, load_protocol(station.protocol))
    load_catalog(station.catalog, stars=_FEW_STARS)
    camera = station.sensor.camera()
    good = (
        f"{path} is good: {station.sensor.name}, {camera.columns} x {camera.rows} px, "
        f"at {station.site.latitude_deg:g}, {station.site.longitude_deg:g}, port {station.port.url}, "
        f"protocol {station.protocol}, identifier {station.identifier.algorithm}"
    )
    items = list(plausibility(station, read_clock().utc_ns if begins_ns is None else begins_ns))
    if refused := [f"{item.name}: {item.text}; {item.advice}" for item in items if item.outcome is Outcome.FAIL]:
        raise ConfigError("\n".join(f"{path}: {text}" for text in refused))
    click.echo(folded(good, indent=2))
    if doubt := station.site.pressure_doubt():
        click.echo(f"doubtful: {doubt}", err=True)
    for item in items:
        if item.outcome is Outcome.OK:
            click.echo(folded(f"{item.name}: {item.text}", indent=2))
        else:
            doubt = f"doubtful: {item.name}: {item.text}; {item.advice}"
            click.echo(folded(doubt, indent=2, err=True), err=True)


@command.command()
@click.argument("path", type=click.Path(path_type=Path), required=False)
@click.option("--json", "as_json", is_flag=True, help="One JSON object.")
def show(path: Path | None, as_json: bool) -> None:
    """Show every value of the station file PATH, defaults included. Without PATH: of the built-in station."""

    station = read_station(path)[0] if path else parse_station(BUILT_IN_TEXT)
    values = station.model_dump(mode="json")
    values["site"] |= {
        "pressure_hpa": round(station.site.air_pressure_hpa, 1),
        "temperature_c": round(station.site.air_temperature_c, 1),
    }
    if as_json:
        click.echo(json.dumps({"schema": "gse.station/1", **values}, indent=2))
    else:
        click.echo(yaml.safe_dump(values, sort_keys=False, default_flow_style=None), nl=False)
