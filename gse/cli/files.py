"""Files of commands: what is said of one of which a part is missing, and new ones, which never overwrite."""

from pathlib import Path

import click

from drivers.host_files import new_file
from gse.cli import EXIT_DATA_LOST
from gse.errors import UsageError

# What is said of a session of which a part is missing, and its exit code.

DAMAGED = "the session is damaged or lost its end"


def damage_code(path: Path, *, damaged: bool) -> int:
    """The exit code of what was made of a damaged session, which is printed here; 0 of a whole one."""
    if not damaged:
        return 0
    click.echo(f"gse: {path}: {DAMAGED}; this covers what is intact, 'gse session verify' lists the rest", err=True)
    return EXIT_DATA_LOST


def write_new(path: Path, content: str | bytes) -> None:
    """Write a new file and print its path to stderr; UsageError where it exists or cannot be written."""
    try:
        with new_file(path) as file:
            file.write(content.encode() if isinstance(content, str) else content)
    except FileExistsError:
        raise UsageError(f"{path} exists already; choose another name") from None
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}") from error
    click.echo(f"{path} written", err=True)
