"""``gse screen``: a star field on a monitor, to aim at and to calibrate."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gse.cli.options import station_option
from gse.config.choice import station_of
from gse.config.station import Station
from gse.errors import GseError, UsageError

if TYPE_CHECKING:
    from gse.sessions.screen import Stage

SCREEN_PORT = 8430
"""Of the page for the monitor: always the same, so that one of two that want the screen is refused."""
_LOOK_S = 0.2

scene_option = click.option(
    "--scene",
    metavar="SCENARIO",
    help="Scenario whose scene the screen of the station file shows; without it: mount.inertial.",
)


@click.command("screen")
@station_option
@scene_option
def command(station_path: Path | None, scene: str | None) -> None:
    """Show the stars of a station's screen section on a page, full-screen on the monitor before the sensor.

    Nothing is received, recorded or judged: 'gse run' with the same station file does that, and shows the same page.
    Ctrl-C ends it.
    """
    station, _ = station_of(station_path)
    stage = stage_of(station, scene)
    with served(stage, lambda text: click.echo(text, err=True)):
        while not stage.is_over:
            for news in stage.take():
                click.echo(str(news) if not isinstance(news, tuple) else f"{news[0]}: {news[1]}", err=True)
            time.sleep(_LOOK_S)


def stage_of(station: Station, scene: str | None, rates: str | None = None) -> "Stage":
    """The stage of a station with a screen; UsageError where it has none."""
    from gse.sessions.screen import Stage
    from gse.simulator.device import rates_of
    from gse.simulator.scenario import DEFAULT, load_scenario

    if station.screen is None:
        raise UsageError("the station file has no screen section; docs/screen.md shows one")
    scenario = load_scenario(scene or DEFAULT)
    return Stage(station, scenario if rates is None else scenario.at_rates(rates_of(rates), station))


@contextmanager
def served(stage: "Stage | None", say: Callable[[str], None]) -> Iterator[None]:
    """Serve the page of a stage while a block runs; nothing without a stage."""
    if stage is None:
        yield
        return
    from gse.sessions.screen import screen_content
    from gse.view.server import ViewServer

    try:
        server = ViewServer("127.0.0.1", SCREEN_PORT, screen_content(stage))
    except GseError as error:
        raise UsageError(f"{error}; perhaps a session or another gse screen shows the stars already") from error
    with server:
        say(f"stars for the sensor: open {server.url} on its monitor and click into it")
        if gap := stage.screen.gap_beside(stage.station.sensor.camera()):
            say(gap)
        yield
