"""``gse sensor``: commands to the sensor."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from drivers.urlhandlers.protocol_sim import register
from gse.cli import EXIT_DATA_LOST
from gse.cli.options import out_option, station_option
from gse.config.choice import station_of
from gse.errors import GseError, UsageError
from protocols import Ack, AttitudeMessage, Command, CommandLayout, ProtocolError, StatusMessage, load_protocol
from protocols.protocol import name_of

if TYPE_CHECKING:
    from gse.sessions.commanding import Commanded

_GIVEN = "gse.sensor.given"


@click.group("sensor")
def command() -> None:
    """Send a command to the sensor. It and the answer are recorded, in a new session or in that of --session."""


def _shared(function: Callable[..., None]) -> Callable[..., None]:
    port_option: Callable[[Any], Any] = click.option(
        "--port", "url", help="Port or pyserial URL; default: that of the station file."
    )
    json_option: Callable[[Any], Any] = click.option(
        "--json", "as_json", is_flag=True, help="Print the answer as one JSON object."
    )
    session_option: Callable[[Any], Any] = click.option(
        "--session",
        "beside",
        metavar="FOLDER",
        type=click.Path(path_type=Path),
        help="Send through the running session, which has the port: its folder, or the --out that it was started with.",
    )
    return station_option(port_option(session_option(out_option(json_option(function)))))  # type: ignore[no-any-return]


def _given_pairs(ctx: click.Context, param: click.Parameter, pairs: tuple[str, ...]) -> dict[str, str]:
    given: dict[str, str] = {}
    for pair in pairs:
        name, equals, value = pair.partition("=")
        if not equals or not name:
            raise click.BadParameter(
                f"{pair!r:.60} does not work; expected key=value, such as exposure=200ms", ctx, param
            )
        given[name] = value
    return given


class _Send(click.Command):
    """The command whose help and completion say what the protocol of the station has."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Keep what was given: --help stands before all else."""
        ctx.meta[_GIVEN] = list(args)
        return super().parse_args(ctx, args)

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The commands of the station's protocol, or the one that was named, then the examples."""
        given = ctx.meta.get(_GIVEN, [])
        commands = _commands(given)
        shown = {name: of for name, of in commands.items() if name in given} or commands
        with formatter.section("Commands of the protocol"):
            formatter.write_dl([(name, _in_words(of)) for name, of in shown.items()] or [("none", "it has none")])
        super().format_epilog(ctx, formatter)


def _commands(given: Sequence[str]) -> "Mapping[str, CommandLayout]":
    """The commands of the station file among the words of a command line; those of the built-in one without."""
    flags = ("--station", "-s")
    after = [word for flag, word in pairwise(given) if flag in flags]
    after += [word.partition("=")[2] for word in given if word.startswith("--station=")]
    try:
        return load_protocol(station_of(Path(after[-1]) if after else None)[0].protocol).commands
    except (GseError, ProtocolError):
        return {}


def _in_words(layout: CommandLayout) -> str:
    arguments = ", ".join(argument.text for argument in layout.arguments)
    proof = f"proved by {layout.expected} within {layout.timeout_s:g} s"
    parts = [arguments, layout.note, proof if layout.answer != "none" else "sent once, nothing proves it"]
    return "; ".join(part for part in parts if part)


def _complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Names of commands, then the keys of the one that is named."""
    station = ctx.params.get("station_path")
    commands = _commands(["--station", str(station)] if station else [])
    if param.name == "name":
        return [name for name in commands if name.startswith(incomplete)]
    layout = commands.get(str(ctx.params.get("name")))
    keys = [f"{argument.name}=" for argument in layout.arguments] if layout else []
    words = [f"{of.name}={word}" for of in layout.arguments for word in of.words.values()] if layout else []
    return [word for word in keys + words if word.startswith(incomplete)]


@command.command(cls=_Send)
@click.argument("name", metavar="NAME", shell_complete=_complete)
@click.argument("given", metavar="[KEY=VALUE]...", nargs=-1, callback=_given_pairs, shell_complete=_complete)
@_shared
def send(name: str, given: dict[str, str], **options: Any) -> None:
    """Send the command NAME of the protocol, and await the answer that proves it.

    A VALUE is a number, with a unit (200ms) or in that of the description, or a word.
    """
    _send(Command(name, given), **options)


# Commands that have short words of their own.


@command.command(hidden=True)
@click.option(
    "--period",
    "period_s",
    type=click.FloatRange(min=0.001, max=3600),
    default=0.1,
    show_default=True,
    help="Seconds from one panorama to the next.",
)
@_shared
def start(period_s: float, **options: Any) -> None:
    """START: the sensor sends panoramas."""
    _send(Command("START", {"period": f"{period_s} s"}), **options)


@command.command(hidden=True)
@_shared
def stop(**options: Any) -> None:
    """STOP: the sensor sends no more panoramas."""
    _send(Command("STOP"), **options)


@command.command(hidden=True)
@_shared
def status(**options: Any) -> None:
    """PING: ask for the status of the sensor."""
    _send(Command("PING"), **options)


@command.command(hidden=True)
@_shared
def request(**options: Any) -> None:
    """REQUEST: ask for one panorama, and record it."""
    _send(Command("REQUEST"), **options)


@command.command(hidden=True)
@click.argument("exposure_s", metavar="SECONDS", type=click.FloatRange(min=0, min_open=True, max=3600))
@_shared
def exposure(exposure_s: float, **options: Any) -> None:
    """SET_EXPOSURE: set the exposure to SECONDS."""
    _send(Command("SET_EXPOSURE", {"exposure": f"{exposure_s} s"}), **options)


def _send(
    message: Command, *, station_path: Path | None, url: str | None, beside: Path | None, out: Path, as_json: bool
) -> None:
    done = _beside(message, beside) if beside else _alone(message, station_path, url, out)
    _show(done, as_json=as_json)


def _beside(message: Command, path: Path) -> "Commanded":
    from gse.cli.status import newest_session
    from gse.sessions.commanding import command_beside
    from gse.sessions.status_file import is_running

    folder, status = newest_session(path)
    if not is_running(status) or status["state"] != "running":
        raise UsageError(
            f"{folder} takes no commands: it is not running; leave out --session, or see: gse status {folder}"
        )
    return command_beside(folder, message)


def _alone(message: Command, station_path: Path | None, url: str | None, out: Path) -> "Commanded":
    from gse.sessions.commanding import command_sensor
    from gse.simulator import device_factory

    station, text = station_of(station_path)
    if url is not None:
        station = station.model_copy(update={"port": station.port.model_copy(update={"url": url})})
    if station.port.url.startswith("sim://"):
        register(device_factory(station))
        click.echo(f"simulated sensor ({station.port.url}); a real one: --station FILE, or --port", err=True)
    return command_sensor(station, text, message, out)


def _show(done: "Commanded", *, as_json: bool) -> None:
    answer = done.answer
    fields = {}
    if isinstance(answer.message, Ack | AttitudeMessage | StatusMessage):
        fields = {name: value for name, value in asdict(answer.message).items() if name != "problems"}
    if as_json:
        document = {"schema": "gse.sensor/1", "answer": name_of(answer.message), **fields, "items": answer.items}
        click.echo(json.dumps({**document, "session": str(done.session)}, default=str))
    elif answer.items:
        own = {name: value for name, value in answer.items.items() if name not in fields}
        for name, value in {**fields, **own}.items():
            click.echo(f"{name:<14} {'.'.join(map(str, value)) if isinstance(value, tuple) else value}")
    else:
        click.echo(answer.text)
    for problem in answer.message.problems:
        click.echo(f"gse: {problem}", err=True)
    click.echo(f"recorded in {done.session}", err=True)
    if done.lost_bytes or done.damage:
        lost = f"{done.lost_bytes} bytes could not be recorded: check the disk of --out"
        click.echo(f"gse: {done.damage or lost}", err=True)
        click.get_current_context().exit(EXIT_DATA_LOST)
