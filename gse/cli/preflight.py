"""``gse preflight``: checks before a session."""

import json
from dataclasses import asdict
from pathlib import Path

import click

from gse.cli import EXIT_FAIL, folded
from gse.cli.options import at_option, earth_orientation_option, out_option, station_option
from gse.config.choice import station_of
from gse.errors import ConfigError
from gse.inspection.plausibility import Check, CheckOutcome
from gse.truth.orientation import GivenTables


@click.command("preflight")
@station_option
@click.option("--port", "url", help="Port or pyserial URL; default: that of the station file.")
@click.option(
    "--hours",
    type=click.FloatRange(min=0.1, max=1000),
    default=10.0,
    show_default=True,
    help="Planned length of the session.",
)
@at_option
@earth_orientation_option
@out_option
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
@click.pass_context
def command(
    ctx: click.Context,
    *,
    station_path: Path | None,
    url: str | None,
    hours: float,
    begins_ns: int | None,
    given_orientation: GivenTables | None,
    out: Path,
    as_json: bool,
) -> None:
    """Check station file, port, clock, disk, cache, Earth orientation, catalogue, field, mount, night and viewer.

    Each has its advice. It says when it is dark tonight, where Sun and Moon are, how many stars the field will hold,
    and how long a session must be.

    The exit code is 1 if one of them would spoil the session.
    """
    from gse.inspection.preflight import checks

    found: list[Check] = []

    def show(check: Check) -> None:
        found.append(check)
        if not as_json:
            click.echo(folded(f"{check.outcome:<5} {check.name:<10} {check.text}", indent=17))
            if check.advice:
                click.echo(folded(f"{'':<16} -> {check.advice}", indent=20))

    try:
        station, _ = station_of(station_path)
    except ConfigError as error:
        show(
            Check(
                "station",
                CheckOutcome.FAIL,
                str(error),
                "run 'gse config check' for details; 'gse config init' writes a station file",
            )
        )
    else:
        show(
            Check(
                "station", CheckOutcome.OK, f"{station_path or 'built-in'}: {station.sensor.name}, {station.site.name}"
            )
        )
        if url is not None:
            station = station.model_copy(update={"port": station.port.model_copy(update={"url": url})})
        for check in checks(station, out, hours, given_orientation, begins_ns):
            show(check)
    failed = any(check.outcome is CheckOutcome.FAIL for check in found)
    if as_json:
        document = {"schema": "gse.preflight/1", "ready": not failed, "checks": [asdict(check) for check in found]}
        click.echo(json.dumps(document))
    if failed:
        ctx.exit(EXIT_FAIL)
