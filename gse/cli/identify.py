"""``gse identify``: stars, RA, DE and roll of one panorama table."""

import json
import math
from pathlib import Path

import click

from gse.cli.options import identifier_option, say, station_option
from gse.config.choice import station_of, with_identifier
from gse.errors import UsageError
from gse.imaging.panorama_table import read_panorama_table
from gse.station.frame_json import frame_json
from gse.station.frame_results import FrameResult
from gse.station.results import Status
from gse.values import instant
from gse.values.panorama import Panorama


@click.command("identify")
@click.argument("table", type=click.Path(path_type=Path))
@station_option
@identifier_option
@click.option(
    "--utc",
    "utc_text",
    help="UTC of the exposure, e.g. 2026-03-20T18:30:00Z; with it the result is compared with the mount.",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object, schema gse.frame/1.")
@click.pass_context
def command(
    ctx: click.Context,
    table: Path,
    station_path: Path | None,
    identifier: str | None,
    utc_text: str | None,
    as_json: bool,
) -> None:
    """Identify the stars of TABLE: lines of y, x, index value, as in the LAPAN paper.

    The exit code is 1 if the panorama is not identified.
    """
    from gse.station.loop import StationLoop
    from gse.station.setup import set_up

    xy_px, brightness = read_panorama_table(table)
    station, text = station_of(station_path)
    try:
        utc_ns = instant.from_text(utc_text) if utc_text else 0
    except ValueError as error:
        raise UsageError(f"--utc: {error}") from error
    setup = set_up(*with_identifier(station, text, identifier), tell=say)
    result = StationLoop(setup).observe(Panorama(utc_ns, xy_px, brightness))
    if as_json:
        document = frame_json(result)
        if utc_text is None:
            document["utc"] = None
        click.echo(json.dumps(document))
    else:
        _print(result, setup.station.identifier.label)
    ctx.exit(0 if result.status is Status.IDENTIFIED else 1)


def _print(result: FrameResult, identifier: str) -> None:
    attitude = result.attitude
    if attitude is None:
        click.echo(f"{result.status}: {result.detail}")
        return
    count = len(result.panorama.brightness)
    click.echo(f"RA {attitude.ra_deg:.5f}  DE {attitude.de_deg:+.5f}  roll {attitude.roll_deg:.4f} deg (ICRS)")
    probability = result.false_match_probability
    stated = "not stated" if math.isnan(probability) else f"{probability:.1g}"
    summary = f"{len(result.matches)} of {count} objects identified by {identifier}"
    click.echo(f"{summary}, false-match probability {stated}")
    if result.attitude_error:
        error = result.attitude_error
        click.echo(f"dRA* {error.d_ra_cosde_arcsec:+.1f}  dDE {error.d_de_arcsec:+.1f} arcsec from the mount")
    names = {match.object: match for match in result.matches}
    others = dict(result.others)
    for row, ((x, y), brightness) in enumerate(zip(result.panorama.xy_px, result.panorama.brightness, strict=True)):
        match = names.get(row)
        what = f"{match.star:28} {match.residual_arcsec:5.1f} arcsec" if match else others.get(row, "-")
        click.echo(f"  y {y:8.2f}  x {x:8.2f}  index {brightness:5.0f}  {what}")
