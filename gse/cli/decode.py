"""``gse decode``: frames and discarded bytes of a session or raw capture."""

import json
from pathlib import Path

import click

from gse.cli import EXIT_DATA_LOST


@click.command("decode")
@click.argument("path", metavar="FILE", type=click.Path(path_type=Path))
@click.option(
    "--protocol", "protocol_name", help="Built-in name or YAML file; default: the session's own, else panorama-v1."
)
@click.option("--explain", is_flag=True, help="Say of each discard what was expected, and show the bytes around it.")
@click.option("--discards", "only_discards", is_flag=True, help="Leave out the frames.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object per line, schema gse.decode/1; totals last.")
@click.pass_context
def command(
    ctx: click.Context, *, path: Path, protocol_name: str | None, explain: bool, only_discards: bool, as_json: bool
) -> None:
    """Take the bytes of FILE apart: frames and discards in order, and totals that add up.

    FILE is a session (.mcap or its folder) or a raw capture. Columns: rx from the sensor or tx to it, UTC where it is
    known, offset, bytes, and what they are. Discarded bytes are no error; a damaged session file is (exit code 3).
    """
    from gse.inspection.decode import Decoding
    from gse.inspection.decode_text import explanation, line, piece_json, totals_json, totals_lines
    from protocols import Frame

    decoding = Decoding(path, protocol_name)
    protocol = decoding.protocol
    for piece in decoding:
        if only_discards and isinstance(piece.item, Frame):
            continue
        if as_json:
            click.echo(json.dumps(piece_json(piece, protocol)))
            continue
        click.echo(line(piece, protocol))
        if explain and not isinstance(piece.item, Frame):
            click.echo("\n".join(explanation(piece, protocol)))
    if as_json:
        click.echo(json.dumps(totals_json(decoding.totals, protocol)))
    else:
        click.echo("\n".join(totals_lines(decoding.totals)))
    if not decoding.totals["rx"].frames:
        hint = "is it another protocol (--protocol), or was it another baud rate?"
        click.echo(f"gse: not one frame of {protocol.name} in {path}: {hint}", err=True)
    for damage in decoding.damages:
        click.echo(f"gse: {damage.file}: {damage.size} bytes at {damage.offset}: {damage.reason}", err=True)
    if decoding.is_damaged:
        click.echo(f"gse: {path} is damaged or lacks its end; what is whole in it was decoded", err=True)
        ctx.exit(EXIT_DATA_LOST)
