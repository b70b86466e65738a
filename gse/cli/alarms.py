"""``gse alarms``: try the alarms of a station file."""

from pathlib import Path

import click

from gse.cli.options import station_option
from gse.config.choice import station_of
from gse.errors import UsageError


@click.group("alarms")
def command() -> None:
    """Try the alarms of a station file."""


@command.command()
@station_option
def test(station_path: Path | None) -> None:
    """Send a message as an alarm of a running session would; exit code 2 where it could not be sent."""
    from gse.sessions.alarms import send_message

    station, _ = station_of(station_path)
    asked = station.alarms
    if not (asked.command or asked.post):
        raise UsageError("the station file has no alarms.command and no alarms.post; see docs/station-file.md")
    send_message(
        asked, f"{station.sensor.name}: a test of the alarms: {', '.join(asked.on)}, after {asked.after_s:g} s"
    )
    click.echo("sent")
