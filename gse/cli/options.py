"""Options shared by several commands."""

import functools
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import click

from gse import instant
from gse.cli.folding import folded
from gse.config.edit import with_values
from gse.config.station import BUILT_IN_TEXT, Station, parse_station, read_station
from gse.errors import UsageError
from gse.identifier_options import PLUG_KEYS, Algorithm

if TYPE_CHECKING:
    from gse.sessions.replay import StationText
    from gse.station.exclusions import Exclusion
    from gse.truth.iers_tables import GivenTables

ALGORITHMS = tuple(name for name in get_args(Algorithm) if name != "external")

_PLUGS = ("command:", "library:", "entry-point:")


class IdentifierName(click.types.StringParamType):
    """A built-in identifier, or an external one by its plug."""

    name = "identifier"

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        """As the help shows it."""
        return f"[{'|'.join(ALGORITHMS)}|PLUG]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The text itself, where it names an identifier."""
        text = str(value)
        if text in ALGORITHMS or text == "external":
            return text
        try:
            plug_values(text)
        except UsageError as error:
            self.fail(str(error), param, ctx)
        return text


IDENTIFIER = IdentifierName()

PLUG_HELP = 'PLUG is an external one: "command:PROGRAM ARGS", library:FILE or entry-point:NAME.'

station_option: Callable[[Any], Any] = click.option(
    "--station", "station_path", type=click.Path(path_type=Path), help="Station file; default: the built-in station."
)
identifier_option: Callable[[Any], Any] = click.option(
    "--identifier",
    type=IDENTIFIER,
    help=f"Identifier under test; default: that of the station file. {PLUG_HELP}",
)
start_utc_option: Callable[[Any], Any] = click.option(
    "--start-utc", help="UTC of the first panorama of a raw capture, e.g. 2026-03-20T18:30:00Z."
)


threads_option: Callable[[Any], Any] = click.option(
    "--threads",
    type=click.IntRange(1, 2),
    default=2,
    show_default=True,
    help="Threads of the replay, e.g. 1 where many run at once; the results are the same.",
)


def _instant(ctx: click.Context, param: click.Parameter, text: str | None) -> int | None:
    """UTC nanoseconds of an option; a usage error where the text is not an instant."""
    try:
        return None if text is None else instant.from_text(text)
    except ValueError as error:
        raise UsageError(f"--at: {error}") from error


at_option: Callable[[Any], Any] = click.option(
    "--at", "begins_ns", callback=_instant, help="When the session begins, e.g. 2026-03-20T15:00:00Z; default: now."
)
LOOPBACK = "127.0.0.1"
view_option: Callable[[Any], Any] = click.option(
    "--view",
    type=click.Choice(("web", "native", "none")),
    default="none",
    show_default=True,
    help="Live view: web pages (at a glance, and rerun), rerun's window, or none.",
)
bind_option: Callable[[Any], Any] = click.option(
    "--bind", default=LOOPBACK, show_default=True, help="Address of the web pages; 0.0.0.0: this network."
)
http_port_option: Callable[[Any], Any] = click.option(
    "--http-port", type=click.IntRange(0, 65535), default=0, help="Port of the web pages; default: 8420, or a free one."
)
save_rrd_option: Callable[[Any], Any] = click.option(
    "--save-rrd", type=click.Path(path_type=Path, dir_okay=False), help="Save the view to this .rrd file, too."
)
clock_error_option: Callable[[Any], Any] = click.option(
    "--clock-error",
    "clock_error_s",
    callback=lambda ctx, param, value: _clock_error_s(value),
    help="Upper bound of the error of the host clock, if you measured it yourself, e.g. 0.1s",
)
anew_option: Callable[[Any], Any] = click.option(
    "--anew", is_flag=True, help="Derive all from the bytes, without results that an earlier run kept."
)
leave_out_option: Callable[[Any], Any] = click.option(
    "--leave-out",
    "excluded",
    multiple=True,
    callback=lambda ctx, param, value: _exclusions(value),
    help="Time to leave out of the statistics, with the reason: 2026-03-20T18:30:00Z/2026-03-20T18:31:00Z=clouds",
)
earth_orientation_option: Callable[[Any], Any] = click.option(
    "--earth-orientation",
    "given_orientation",
    multiple=True,
    metavar="FILE",
    callback=lambda ctx, param, value: _earth_orientation(value),
    help="Newer tables of the IERS instead of the installed ones: finals2000A.all, Leap_Second.dat.",
)
json_option: Callable[[Any], Any] = click.option(
    "--json", "as_json", is_flag=True, help="Print the report as one JSON object."
)
json_frames_option: Callable[[Any], Any] = click.option(
    "--json-frames", is_flag=True, help="Print the result of each panorama as a JSON line, schema gse.frame/1."
)
out_option: Callable[[Any], Any] = click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("sessions"),
    show_default=True,
    help="Folder in which the new session folder is made.",
)


plots_option: Callable[[Any], Any] = click.option(
    "--plots/--no-plots",
    default=True,
    help="Draw the plots of report.html, the slowest part of a report, or leave them out.",
)


def gathered(name: str, make: Callable[..., Any], *options: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Options whose values, by their names, a command takes as one: what ``make`` makes of them."""

    def decorated(command: Any) -> Any:
        @functools.wraps(command)
        def whole(*arguments: Any, **values: Any) -> Any:
            own = {key: values.pop(key) for key in keys}
            return command(*arguments, **{name: make(**own)}, **values)

        others = len(getattr(command, "__click_params__", ()))
        for option in reversed(options):
            option(whole)
        keys = [param.name for param in vars(whole)["__click_params__"][others:]]
        return whole

    return decorated


def fit_options(*, write_help: str, schema: str) -> Callable[[Any], Any]:
    """FILE and the options of a command that fits something of the station file to a session."""
    parts = (
        click.argument("path", metavar="FILE", type=click.Path(path_type=Path)),
        station_option,
        click.option("--from", "from_utc", help="Use the frames from this UTC on, e.g. 2026-03-20T18:30:00Z."),
        click.option("--to", "to_utc", help="Use the frames before this UTC."),
        start_utc_option,
        click.option("--write", "write_path", type=click.Path(path_type=Path, dir_okay=False), help=write_help),
        click.option("--json", "as_json", is_flag=True, help=f"One JSON object, schema {schema}."),
    )

    def decorated(command: Any) -> Any:
        for part in reversed(parts):
            command = part(command)
        return command

    return decorated


def change_to(path: Path | None, algorithm: str | None = None) -> "Callable[[StationText], StationText]":
    """What a replay does to the recorded station: another file in its place, another identifier under test.

    The file is read here, once: results, and the key that they are kept under, follow from the same text.
    """
    given = station_of(path) if path else None

    def change(recorded: "StationText") -> "StationText":
        return with_identifier(*(given or recorded), algorithm)

    return change


def station_of(path: Path | None) -> tuple[Station, str]:
    """The station of a file, or the built-in one, with its text."""
    if path is None:
        return parse_station(BUILT_IN_TEXT), BUILT_IN_TEXT
    station, text = read_station(path)
    return _beside(station, path), text


def with_identifier(station: Station, text: str, name: str | None) -> tuple[Station, str]:
    """The station with another identifier under test, and its text for the session file.

    An external one is named by its plug: ``command:./onboard --flight``, ``library:./libonboard.so,symbol=identify``,
    ``entry-point:tetra3rs``; further options of the plug follow after commas. Paths are those of the working directory.
    """
    if name is None or name == station.identifier.algorithm:
        return station, text
    if name == "external":
        raise UsageError("--identifier external names no program; expected one of command:, library:, entry-point:")
    values = {"algorithm": name} if name in ALGORITHMS else plug_values(name)
    text = with_values(text, "identifier", values, drop=PLUG_KEYS)
    return station.model_copy(update={"identifier": parse_station(text).identifier}), text


def plug_values(text: str) -> dict[str, object]:
    """The section ``identifier`` of an external one that is named by its plug; UsageError."""
    plug = next((prefix for prefix in _PLUGS if text.startswith(prefix)), None)
    if plug is None:
        known = ", ".join((*ALGORITHMS, *(f"{prefix}..." for prefix in _PLUGS)))
        raise UsageError(f"there is no identifier {text!r:.60}; known are {known}")
    rest = text.removeprefix(plug)
    try:
        words = shlex.split(rest) if plug == "command:" else rest.split(",")
    except ValueError as error:
        raise UsageError(f"{text!r:.60}: {error}") from error
    if not words or not words[0]:
        raise UsageError(f"{plug} names no program; expected for example command:./onboard or library:./libonboard.so")
    values: dict[str, object] = {"algorithm": "external", "directory": str(Path.cwd())}
    if plug == "command:":
        return values | {"command": words}
    values["library" if plug == "library:" else "entry_point"] = words[0]
    for word in words[1:]:
        key, _, value = word.partition("=")
        if key not in ("symbol", "config"):
            raise UsageError(f"{text!r:.60}: unknown option {key!r:.30}; known are symbol=NAME and config=FILE")
        values[key] = value
    return values


def _beside(station: Station, path: Path) -> Station:
    """Paths in a station file are relative to the file, not to the working directory."""
    changes: dict[str, object] = {}
    if station.catalog != "gaia":
        changes["catalog"] = str(path.parent / station.catalog)
    if station.protocol.endswith((".yaml", ".yml")):
        changes["protocol"] = str(path.parent / station.protocol)
    if station.identifier.algorithm == "external":
        folder = (path.parent / (station.identifier.directory or ".")).absolute()
        changes["identifier"] = replace(station.identifier, directory=str(folder))
    return station.model_copy(update=changes) if changes else station


def _clock_error_s(text: str | None) -> float | None:
    if text is None:
        return None
    from gse.statistics.clock_health import stated_error_s

    return stated_error_s(text)


def _earth_orientation(texts: tuple[str, ...]) -> "GivenTables | None":
    from gse.truth.iers_tables import read_given

    return read_given([Path(part) for text in texts for part in text.split(",") if part])


def _exclusions(texts: tuple[str, ...]) -> tuple["Exclusion", ...]:
    from gse.station.exclusions import parse_exclusion

    return tuple(parse_exclusion(text) for text in texts)


def say(text: str) -> None:
    """A line on stderr."""
    click.echo(folded(f"gse: {text}", err=True), err=True)
