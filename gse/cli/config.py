"""``gse config``: write, check or show a station file."""

import json
import math
import shlex
import sys
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import click
import yaml

from drivers.clock import read_clock
from drivers.host_files import new_file
from drivers.ports import ports_here
from gse.catalog import load_catalog
from gse.cli import folded
from gse.cli.options import at_option
from gse.config.choice import station_of
from gse.config.station import BUILT_IN_TEXT, parse_station, read_station
from gse.errors import ConfigError
from gse.inspection.plausibility import CheckOutcome, plausibility
from gse.station.setup import check_external, protocol_of
from protocols import built_in_names, load_protocol

# A commented station file from a few answers.


@dataclass(frozen=True, slots=True, kw_only=True)
class Draft:
    """What a station file cannot do without. Without ``azimuth_deg`` the mount is fitted on the first minute."""

    name: str = "LAPAN-like"
    rows: int = 1024
    columns: int = 1024
    field_of_view_deg: float = 14.0
    """Along a row of the image."""
    site: str = "rooftop"
    latitude_deg: float = -6.53
    longitude_deg: float = 106.70
    height_m: float = 250.0
    azimuth_deg: float | None = 0.0
    altitude_deg: float = 90.0
    roll_deg: float = 0.0
    port: str = "sim://"
    baudrate: int = 115200
    protocol: str = "panorama-v1"

    @property
    def focal_length_px(self) -> float:
        """Of a lens with this field of view, in pixels."""
        return self.columns / 2 / math.tan(math.radians(self.field_of_view_deg / 2))


def draft_text(draft: Draft) -> str:
    """The text of the station file; ConfigError where a value cannot be."""
    text = f"""\
# Station file. Every key: docs/station-file.md. Check it: gse config check FILE
version: 1
sensor:
  name: {_quoted(draft.name)}
  rows: {draft.rows}
  columns: {draft.columns}
  # {draft.field_of_view_deg:g} deg along a row. From a data sheet: focal length in mm / pixel size in mm.
  # gse calibrate finds it from a session to a few parts in ten thousand.
  focal_length_px: {draft.focal_length_px:.3f}
  mirrored: false            # true where the image is a mirror image of the sky
site:
  name: {_quoted(draft.site)}
  latitude_deg: {draft.latitude_deg!r:12}# north is positive; 0.0001 deg is 0.4 arcsec of error
  longitude_deg: {draft.longitude_deg!r:11}# east is positive
  height_m: {draft.height_m:g}
  # uncertainty: {{position_m: 3}}   # how well a survey knows the place, 95 %
  # Air for refraction; without these keys: the standard atmosphere at this height.
  # pressure_hpa: 985        # at the site, not reduced to sea level
  # temperature_c: 25
  # relative_humidity: 0.8
{_mount(draft)}
port:
  url: {_quoted(draft.port)}
  baudrate: {draft.baudrate}
protocol: {_quoted(draft.protocol)}      # or the path of a YAML description: docs/protocols.md
limits:
  d_ra_cosde_arcsec: 60      # the limit of the LAPAN paper: 1 arcmin
  d_de_arcsec: 60
  identification_ms: 200
"""
    parse_station(text, "the new station file")
    return text


def _mount(draft: Draft) -> str:
    if draft.azimuth_deg is None:
        return """\
mount:
  # The first minute of stars tells where the sensor looks; absolute pointing, site and clock are not tested then.
  align: first 60 s"""
    return f"""\
mount:                       # where the sensor looks; gse align finds the angles from a session
  azimuth_deg: {draft.azimuth_deg!r:14}# from north through east
  altitude_deg: {draft.altitude_deg!r:13}# above the horizon; the zenith is 90
  roll_deg: {draft.roll_deg!r:17}# image up from the direction of the zenith, counter-clockwise
  # How well a survey knows them, half-widths that hold the truth with 95 %. Only what is stated here can show that a
  # turned sensor is not a turned mount: docs/uncertainty.md
  # uncertainty: {{azimuth_arcsec: 5, altitude_arcsec: 4, roll_arcsec: 20}}"""


def _quoted(text: str) -> str:
    """As YAML, whatever it holds."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


# The questions of ``gse config init``.

_BUILT_IN = Draft()


class _ProtocolName(click.types.StringParamType):
    """The name of a built-in protocol, or a path, which is relative to the station file."""

    name = "protocol"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        text = str(value)
        if Path(text).suffix not in (".yaml", ".yml") and text not in built_in_names():
            self.fail(f"{text!r:.60} is none of {', '.join(built_in_names())}, and no .yaml file", param, ctx)
        return text


_LATITUDE, _LONGITUDE = click.FloatRange(-90, 90), click.FloatRange(-180, 360)
_OPTIONS: tuple[tuple[str, "click.ParamType[Any]", str], ...] = (
    ("name", click.STRING, "Name of the sensor."),
    ("rows", click.IntRange(16, 16384), "Rows of the detector."),
    ("columns", click.IntRange(16, 16384), "Columns of the detector."),
    ("field_of_view_deg", click.FloatRange(0.1, 120), "Field of view along a row of the image, in degrees."),
    ("site", click.STRING, "Name of the site."),
    ("latitude_deg", _LATITUDE, "Latitude of the site in degrees, north positive."),
    ("longitude_deg", _LONGITUDE, "Longitude of the site in degrees, east positive."),
    ("height_m", click.FloatRange(-500, 9000), "Height of the site above sea level, in metres."),
    ("azimuth_deg", click.FloatRange(-360, 360), "Azimuth of the boresight, from north through east."),
    ("altitude_deg", click.FloatRange(-90, 90), "Altitude of the boresight; the zenith is 90."),
    ("roll_deg", click.FloatRange(-360, 360), "Roll: image up from the direction of the zenith."),
    ("port", click.STRING, "Serial port or pyserial URL."),
    ("baudrate", click.IntRange(50, 8_000_000), "Baud rate."),
    ("protocol", _ProtocolName(), "Name of a built-in protocol, or the path of a YAML description."),
)
_OF_THE_MOUNT = ("azimuth_deg", "altitude_deg", "roll_deg")


def draft_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """An option for each value of a Draft: --latitude-deg and so on."""
    for name, kind, text in reversed(_OPTIONS):
        command = click.option("--" + name.replace("_", "-"), name, type=kind, help=text)(command)
    return command


def asked(given: dict[str, Any]) -> Draft:
    """A draft of what was given as options and of the answers to the rest; Enter takes the value in brackets."""
    click.echo("Enter takes the value in brackets; each value can be changed in the file later.", err=True)
    values = {name: value for name, value in given.items() if value is not None}
    for name, kind, text in _OPTIONS:
        if name not in values and name not in _OF_THE_MOUNT:
            values[name] = click.prompt(_question(text), default=_default(name), type=kind, err=True)
    if "azimuth_deg" not in values and not _mount_is_known():
        return Draft(**{**values, "azimuth_deg": None})
    for name, kind, text in _OPTIONS:
        if name not in values:
            values[name] = click.prompt(_question(text), default=_default(name), type=kind, err=True)
    return Draft(**values)


def unasked(given: dict[str, Any]) -> Draft:
    """A draft of the options, with the built-in station's values for the rest."""
    return Draft(**{name: value for name, value in given.items() if value is not None})


def _mount_is_known() -> bool:
    return click.confirm("Is the direction of the mount known? (if not, the first minute of stars tells)", err=True)


def _question(text: str) -> str:
    return text.rstrip(".")


def _default(name: str) -> Any:
    if name == "port":
        return _found_port()
    (default,) = (item.default for item in fields(Draft) if item.name == name)
    return default


def _found_port() -> str:
    """The first adapter that is plugged in; the simulated sensor without one."""
    found = ports_here()
    for port in found:
        click.echo(f"  found {port.device}: {port.description or 'no description'}", err=True)
    adapters = [port for port in found if port.vid is not None]
    return adapters[0].device if adapters else _BUILT_IN.port


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
    draft = unasked(given) if yes or not sys.stdin.isatty() else asked(given)
    if draft.protocol not in built_in_names():
        load_protocol(str(path.parent / draft.protocol))
    text = draft_text(draft)
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
    from gse.station.polling import check_asking

    station, _ = station_of(path)
    protocol = protocol_of(station)
    check_external(station, protocol)
    check_asking(station.sensor, station.port, protocol)
    load_catalog(station.catalog, stars=_FEW_STARS)
    camera = station.sensor.camera()
    site = station.site
    place = f"at {site.latitude_deg:g}, {site.longitude_deg:g}" if station.subject is None else "without site"
    good = (
        f"{path} is good: {station.sensor.name}, {camera.columns} x {camera.rows} px, "
        f"{place}, port {station.port.url}, "
        f"protocol {station.protocol}, identifier {station.identifier.algorithm}"
    )
    items = list(plausibility(station, read_clock().utc_ns if begins_ns is None else begins_ns))
    if refused := [f"{item.name}: {item.text}; {item.advice}" for item in items if item.outcome is CheckOutcome.FAIL]:
        raise ConfigError("\n".join(f"{path}: {text}" for text in refused))
    click.echo(folded(good, indent=2))
    if doubt := station.site.pressure_doubt():
        click.echo(f"doubtful: {doubt}", err=True)
    for item in items:
        if item.outcome is CheckOutcome.OK:
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
