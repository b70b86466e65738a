"""``gse decode``: frames and discarded bytes of a session or raw capture."""

import json
from pathlib import Path

import click

from gse.cli import EXIT_DATA_LOST, folded
from protocols import Frame


@click.command("decode")
@click.argument("path", metavar="FILE", type=click.Path(path_type=Path))
@click.option(
    "--protocol",
    "protocol_name",
    help="Built-in protocol or YAML file; default: that of the session, else panorama-v1.",
)
@click.option("--explain", is_flag=True, help="Explain each discard: what was expected, and the bytes around it.")
@click.option("--discards", "only_discards", is_flag=True, help="Show the discards only.")
@click.option("--try", "tries", is_flag=True, help="Say which framings, lengths and checksums an unknown capture fits.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object per line, schema gse.decode/1; totals last.")
@click.pass_context
def command(
    ctx: click.Context,
    *,
    path: Path,
    protocol_name: str | None,
    explain: bool,
    only_discards: bool,
    tries: bool,
    as_json: bool,
) -> None:
    """List the frames and the discarded bytes of FILE in their order, with totals.

    FILE is a session (.mcap or its folder) or a raw capture. The columns are: rx (from the sensor) or tx (to the
    sensor), UTC if it is known, offset, number of bytes, content. Discarded bytes are not an error. A damaged session
    file is one: exit code 3.
    """
    from gse.inspection.decode import Decoding, explanation, line, piece_json, totals_json, totals_lines
    from gse.inspection.unknown_capture import look

    if tries:
        looked = look(path)
        click.echo(json.dumps(looked.document()) if as_json else "\n".join(looked.lines()))
        return
    decoding = Decoding(path, protocol_name)
    protocol = decoding.protocol
    for piece in decoding:
        if only_discards and isinstance(piece.item, Frame):
            continue
        if as_json:
            click.echo(json.dumps(piece_json(piece, protocol)))
            continue
        click.echo(folded(line(piece, protocol), indent=4))
        if explain and not isinstance(piece.item, Frame):
            click.echo("\n".join(explanation(piece, protocol)))
    if as_json:
        click.echo(json.dumps(totals_json(decoding.totals, protocol)))
    else:
        click.echo(folded("\n".join(totals_lines(decoding.totals)), indent=8))
    if not decoding.totals["rx"].frames:
        hint = "try another --protocol; or the baud rate was wrong"
        click.echo(f"gse: {path} has no frame of {protocol.name}: {hint}", err=True)
    for damage in decoding.damages:
        click.echo(f"gse: {damage.file}: {damage.size} bytes at {damage.offset}: {damage.reason}", err=True)
    if decoding.is_damaged:
        click.echo(f"gse: {path} is damaged or incomplete; all intact parts were decoded", err=True)
        ctx.exit(EXIT_DATA_LOST)
