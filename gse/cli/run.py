"""``gse run``: the live test of a sensor, real or simulated."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import click

from gse.cli import EXIT_INTERRUPTED
from gse.cli.finish import conclude, exit_code, show_report
from gse.cli.live_outputs import ViewMode, Watching
from gse.cli.options import (
    bind_option,
    clock_error_option,
    identifier_option,
    json_frames_option,
    json_option,
    out_option,
    save_rrd_option,
    station_of,
    station_option,
    view_option,
    with_identifier,
)
from gse.config.edit import with_values
from gse.config.station import Station


@click.command("run")
@station_option
@click.option(
    "--port", "url", help="Port or pyserial URL, instead of the station file's: /dev/ttyUSB0, sim://?speed=10"
)
@identifier_option
@click.option("--duration", "duration_s", type=click.FloatRange(min=0.1), help="Stop after so many seconds.")
@view_option
@bind_option
@save_rrd_option
@click.option("--wait-port", is_flag=True, help="Wait for a port that is not there yet.")
@clock_error_option
@json_option
@json_frames_option
@out_option
@click.pass_context
def command(
    ctx: click.Context,
    *,
    station_path: Path | None,
    url: str | None,
    identifier: str | None,
    duration_s: float | None,
    view: ViewMode,
    bind: str,
    save_rrd: Path | None,
    wait_port: bool,
    clock_error_s: float | None,
    as_json: bool,
    json_frames: bool,
    out: Path,
) -> None:
    """Receive, record, identify, compare, show, judge.

    With no arguments: a simulated sensor on the built-in station, 60 s of night. A session on a real port ends with
    Ctrl-C or after --duration. The exit code is the verdict's.
    """
    from gse.sessions.live import run_live

    station, text = station_of(station_path)
    station, text = with_identifier(station, text, identifier)
    if url is not None:
        station = station.model_copy(update={"port": station.port.model_copy(update={"url": url})})
        text = with_values(text, "port", {"url": url})
    if station.port.url.startswith("sim://"):
        station, text = _simulated(station, text)
    watching = Watching(view=view, bind=bind, save_rrd=save_rrd, json_frames=json_frames)
    click.echo("preparing catalogue and identifiers; the first time takes half a minute", err=True)
    with _stop_on_signal() as stopped, watching:
        live = run_live(
            station,
            text,
            out,
            make_listeners=watching.listeners,
            stop=stopped,
            duration_s=duration_s,
            wait_port=wait_port,
            clock_error_s=clock_error_s,
        )
        report = conclude(live.session, live.folder, live.own_elapsed_us, clock_error_s)
        watching.conclude(report)
    show_report(report, live.folder, as_json=as_json, json_frames=json_frames)
    if live.lost_bytes:
        click.echo(f"gse: {live.lost_bytes} bytes were received but could not be recorded", err=True)
    if live.damage:
        click.echo(f"gse: {live.damage}", err=True)
    ctx.exit(
        EXIT_INTERRUPTED
        if stopped()
        else exit_code(report, live.folder, data_lost=bool(live.lost_bytes or live.damage))
    )


def _simulated(station: Station, text: str) -> tuple[Station, str]:
    """The station as the scenario of its sim:// URL changes it, its sensor ready to be opened."""
    from drivers.mock.urls import parse_mock_url
    from drivers.urlhandlers.protocol_sim import register
    from gse.simulator import device_factory
    from gse.simulator.scenario import DEFAULT, load_scenario

    register(device_factory(station))
    scenario = load_scenario(parse_mock_url(station.port.url).options.get("scenario") or DEFAULT)
    return scenario.station_for(station), scenario.station_text(text)


@contextmanager
def _stop_on_signal() -> Iterator[Callable[[], bool]]:
    """Ctrl-C and SIGTERM end the session, they do not kill it."""
    received: list[int] = []

    def stop(number: int, frame: FrameType | None) -> None:
        received.append(number)

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: bool(received)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
