"""The questions of ``gse config init``."""

from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import click

from drivers.ports import ports_here
from gse.config.draft import Draft
from protocols import built_in_names

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
        if name not in values and not _is_of_the_mount(name):
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


def _is_of_the_mount(name: str) -> bool:
    return name in {"azimuth_deg", "altitude_deg", "roll_deg"}


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
