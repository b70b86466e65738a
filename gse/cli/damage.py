"""What is said of a session of which a part is missing, and its exit code."""

from pathlib import Path

import click

from gse.cli import EXIT_DATA_LOST

DAMAGED = "the session is damaged or lost its end"


def damage_code(path: Path, *, damaged: bool) -> int:
    """The exit code of what was made of a damaged session, which is printed here; 0 of a whole one."""
    if not damaged:
        return 0
    click.echo(f"gse: {path}: {DAMAGED}; this covers what is intact, 'gse session verify' lists the rest", err=True)
    return EXIT_DATA_LOST
