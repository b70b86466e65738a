"""``gse protocol``: descriptions and classes of wire formats."""

import json

import click

from gse.cli import EXIT_FAIL
from protocols import load_protocol


@click.group("protocol")
def command() -> None:
    """Check the description, or the class, of a sensor's wire format."""


@command.command()
@click.argument("name", metavar="NAME")
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Seed of the random messages.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
@click.pass_context
def check(ctx: click.Context, name: str, seed: int, as_json: bool) -> None:
    """Try NAME (built in, an installed class, or a YAML file) on random messages and noise.

    Frames come back as they were sent, cuts do not matter, every byte is accounted for, and it is fast enough. Exit
    code 1 where one of these does not hold.
    """
    from protocols.check import check_protocol

    protocol = load_protocol(name)
    tried = list(check_protocol(protocol, seed))
    if as_json:
        document = {
            "schema": "gse.protocol.check/1",
            "protocol": protocol.name,
            "tried": [of._asdict() for of in tried],
        }
        click.echo(json.dumps(document))
    else:
        for of in tried:
            click.echo(f"{'holds' if of.holds else 'FAILS'}  {of.name}: {of.seen}")
    if not all(of.holds for of in tried):
        ctx.exit(EXIT_FAIL)
