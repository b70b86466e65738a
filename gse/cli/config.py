"""``gse config``: write, check or show a station file."""

import json
from pathlib import Path

import click

from gse.cli.options import station_of
from gse.config.station import BUILT_IN_TEXT, parse_station, read_station
from gse.errors import ConfigError

_FEW_STARS = 100
"""Enough to see that a catalogue can be read; of a file all lines are looked at."""


@click.group("config")
def command() -> None:
    """Write, check or show a station file."""


@command.command()
@click.argument("path", type=click.Path(path_type=Path), default=Path("station.yaml"))
def init(path: Path) -> None:
    """Write the built-in station to PATH (default: station.yaml). An existing file is not changed."""
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(BUILT_IN_TEXT)
    except FileExistsError:
        raise ConfigError(f"{path} exists already; choose another name") from None
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror}") from error
    click.echo(
        f"{path} written. Next: set sensor, site, mount and port in it, then run: gse config check {path}", err=True
    )


@command.command()
@click.argument("path", type=click.Path(path_type=Path))
def check(path: Path) -> None:
    """Check the station file PATH. Each error is shown with file, line and key; the exit code is then 2."""
    from gse.catalog import load_catalog
    from gse.station.setup import check_external
    from protocols import load_protocol

    station, _ = station_of(path)
    check_external(station, load_protocol(station.protocol))
    load_catalog(station.catalog, stars=_FEW_STARS)
    camera = station.sensor.camera()
    click.echo(
        f"{path} is good: {station.sensor.name}, {camera.columns} x {camera.rows} px, "
        f"at {station.site.latitude_deg:g}, {station.site.longitude_deg:g}, port {station.port.url}, "
        f"protocol {station.protocol}, identifier {station.identifier.algorithm}"
    )
    if doubt := station.site.pressure_doubt():
        click.echo(f"doubtful: {doubt}", err=True)


@command.command()
@click.argument("path", type=click.Path(path_type=Path), required=False)
@click.option("--json", "as_json", is_flag=True, help="One JSON object.")
def show(path: Path | None, as_json: bool) -> None:
    """Show every value of the station file PATH, defaults included. Without PATH: of the built-in station."""
    import yaml

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
