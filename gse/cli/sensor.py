"""``gse sensor``: commands to the sensor."""

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from drivers.urlhandlers.protocol_sim import register
from gse.cli import EXIT_DATA_LOST
from gse.cli.options import out_option, station_option
from gse.config.choice import station_of
from gse.errors import UsageError
from protocols import Message, Ping, Request, SetExposure, Start, StatusMessage, Stop

if TYPE_CHECKING:
    from gse.sessions.commanding import Commanded


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


@command.command()
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
    _send(Start(period_s), **options)


@command.command()
@_shared
def stop(**options: Any) -> None:
    """STOP: the sensor sends no more panoramas."""
    _send(Stop(), **options)


@command.command()
@_shared
def status(**options: Any) -> None:
    """PING: ask for the status of the sensor."""
    _send(Ping(), **options)


@command.command()
@_shared
def request(**options: Any) -> None:
    """REQUEST: ask for one panorama, and record it."""
    _send(Request(), **options)


@command.command()
@click.argument("exposure_s", metavar="SECONDS", type=click.FloatRange(min=0, min_open=True, max=3600))
@_shared
def exposure(exposure_s: float, **options: Any) -> None:
    """SET_EXPOSURE: set the exposure to SECONDS."""
    _send(SetExposure(exposure_s), **options)


def _send(
    message: Message, *, station_path: Path | None, url: str | None, beside: Path | None, out: Path, as_json: bool
) -> None:
    done = _beside(message, beside) if beside else _alone(message, station_path, url, out)
    _show(done, as_json=as_json)


def _beside(message: Message, path: Path) -> "Commanded":
    from gse.cli.status import newest_session
    from gse.sessions.commanding import command_beside
    from gse.sessions.status_file import is_running

    folder, status = newest_session(path)
    if not is_running(status) or status["state"] != "running":
        raise UsageError(
            f"{folder} takes no commands: it is not running; leave out --session, or see: gse status {folder}"
        )
    return command_beside(folder, message)


def _alone(message: Message, station_path: Path | None, url: str | None, out: Path) -> "Commanded":
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
    answer = {name: value for name, value in asdict(done.answer).items() if name != "problems"}
    if as_json:
        kind = "STATUS" if isinstance(done.answer, StatusMessage) else "ACK"
        document = {"schema": "gse.sensor/1", "answer": kind, **answer, "session": str(done.session)}
        click.echo(json.dumps(document, default=str))
    elif isinstance(done.answer, StatusMessage):
        for name, value in answer.items():
            click.echo(f"{name:<14} {'.'.join(map(str, value)) if isinstance(value, tuple) else value}")
    else:
        click.echo(f"the sensor accepted {done.answer.command}")
    for problem in done.answer.problems:
        click.echo(f"gse: {problem}", err=True)
    click.echo(f"recorded in {done.session}", err=True)
    if done.lost_bytes or done.damage:
        lost = f"{done.lost_bytes} bytes could not be recorded: check the disk of --out"
        click.echo(f"gse: {done.damage or lost}", err=True)
        click.get_current_context().exit(EXIT_DATA_LOST)
