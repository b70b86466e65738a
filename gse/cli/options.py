"""Options shared by several commands."""

import functools
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gse.cli import folded
from gse.config.choice import ALGORITHMS, plug_values
from gse.errors import UsageError
from gse.values import instant

if TYPE_CHECKING:
    from gse.station.exclusions import Exclusion
    from gse.truth.orientation import GivenTables


# Durations on the command line: 90, 90s, 5m, 1h30m.

_PARTS = re.compile(r"(?:(\d+(?:\.\d*)?) ?h)? ?(?:(\d+(?:\.\d*)?) ?m(?:in)?)? ?(?:(\d+(?:\.\d*)?) ?s?)?")
_SHORTEST_S, _LONGEST_S = 0.1, 30 * 86_400.0


def parsed_duration(ctx: click.Context, param: click.Parameter, text: str | None) -> float | None:
    """A callback of an option: seconds of a text such as 90, 90s, 5m or 1h30m; click's own error otherwise."""
    if text is None:
        return None
    found = _PARTS.fullmatch(text.strip().lower())
    hours, minutes, seconds = found.groups() if found else (None, None, None)
    total_s = 3600 * float(hours or 0) + 60 * float(minutes or 0) + float(seconds or 0)
    if not _SHORTEST_S <= total_s <= _LONGEST_S:
        raise click.BadParameter(
            f"{text!r:.60} does not work; expected a time from {_SHORTEST_S:g} s to 30 days, "
            "for example 90, 90s, 5m or 1h30m",
            ctx,
            param,
        )
    return total_s


def duration_text(seconds: float) -> str:
    """A length of time for a person: 90 s, 12 min, 2.5 h."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


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


def given_or_newest(ctx: click.Context, param: click.Parameter, given: Any) -> Any:
    """The given path or paths, or the newest session below ./sessions, which is said."""
    if given:
        return given
    path = newest_sessions()[0]
    say(f"the newest session: {path}")
    return (path,) if param.nargs == -1 else path


def newest_sessions() -> list[Path]:
    """The sessions below ./sessions, newest first, without those of a command; UsageError where there is none."""
    from gse.sessions.status_file import OF_A_COMMAND, session_folders

    folders = [folder for folder in session_folders(Path("sessions")) if not folder.name.endswith(OF_A_COMMAND)]
    if not folders:
        raise UsageError("there is no session below ./sessions; give the path of one, or record one with: gse run")
    return folders[::-1]


session_argument: Callable[[Any], Any] = click.argument(
    "path", metavar="[SESSION]", required=False, type=click.Path(path_type=Path), callback=given_or_newest
)
station_option: Callable[[Any], Any] = click.option(
    "-s",
    "--station",
    "station_path",
    type=click.Path(path_type=Path),
    help="Station file; default: the built-in station.",
)
identifier_option: Callable[[Any], Any] = click.option(
    "--identifier",
    type=IDENTIFIER,
    help=f"Identifier under test; default: that of the station file. {PLUG_HELP}",
)
start_utc_option: Callable[[Any], Any] = click.option(
    "--start-utc", help="UTC of the first panorama of a raw capture, e.g. 2026-03-20T18:30:00Z."
)


def _instant(ctx: click.Context, param: click.Parameter, text: str | None) -> int | None:
    """UTC nanoseconds of an option; a usage error where the text is not an instant."""
    try:
        return None if text is None else instant.from_text(text)
    except ValueError as error:
        raise UsageError(f"--start-utc: {error}") from error


at_option: Callable[[Any], Any] = click.option(
    "--start-utc",
    "begins_ns",
    callback=_instant,
    help="When the session begins, e.g. 2026-03-20T15:00:00Z; default: now.",
)
LOOPBACK = "127.0.0.1"
view_option: Callable[[Any], Any] = click.option(
    "--view",
    type=click.Choice(("web", "native", "none")),
    default="none",
    show_default=True,
    help="Show it: web pages, rerun, none.",
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
    help="Measured bound of this clock's error: 0.1s",
)
anew_option: Callable[[Any], Any] = click.option(
    "--anew", is_flag=True, help="Derive all from the bytes, without results that an earlier run kept."
)
leave_out_option: Callable[[Any], Any] = click.option(
    "--leave-out",
    "excluded",
    multiple=True,
    callback=lambda ctx, param, value: _exclusions(value),
    help="Time in which no answer is expected, with the reason: 2026-03-20T18:30:00Z/2026-03-20T18:31:00Z=clouds. "
    "Answers that were given are judged all the same, but where the mount was touched: =mount: kicked",
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
verbose_option: Callable[[Any], Any] = click.option(
    "-v", "--verbose", is_flag=True, help="Print each row, reason and event, too."
)
paper_option: Callable[[Any], Any] = click.option(
    "--paper", is_flag=True, help="Print Table 4-1 of the LAPAN paper with this sensor, too."
)
json_frames_option: Callable[[Any], Any] = click.option(
    "--json-frames", is_flag=True, help="Print the result of each panorama as a JSON line, schema gse.frame/1."
)


class NewFolder(click.Path):
    """A folder that may have to be made; a name that looks like a file's is refused, as 'report.pdf'."""

    _OF_FILES = frozenset({".pdf", ".html", ".json", ".csv", ".xml", ".mcap", ".png", ".svg", ".zip"})

    def __init__(self) -> None:
        super().__init__(path_type=Path, file_okay=False)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path; click's own error where it looks like a file's."""
        folder = Path(str(super().convert(value, param, ctx)))
        if folder.suffix.lower() in self._OF_FILES and not folder.is_dir():
            name = folder.with_suffix("")
            pdf = " (gse report --pdf prints a PDF)" if folder.suffix.lower() == ".pdf" else ""
            self.fail(f"{folder} looks like a file, but a folder is made: write for example {name}{pdf}", param, ctx)
        return folder


out_option: Callable[[Any], Any] = click.option(
    "--out",
    type=NewFolder(),
    default=Path("sessions"),
    show_default=True,
    help="Folder for new sessions.",
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


def _clock_error_s(text: str | None) -> float | None:
    if text is None:
        return None
    from gse.statistics.clock_health import stated_error_s

    return stated_error_s(text)


def _earth_orientation(texts: tuple[str, ...]) -> "GivenTables | None":
    from gse.truth.orientation import read_given

    return read_given([Path(part) for text in texts for part in text.split(",") if part])


def _exclusions(texts: tuple[str, ...]) -> tuple["Exclusion", ...]:
    from gse.station.exclusions import parse_exclusion

    return tuple(parse_exclusion(text) for text in texts)


def say(text: str) -> None:
    """A line on stderr."""
    click.echo(folded(f"gse: {text}", err=True), err=True)
