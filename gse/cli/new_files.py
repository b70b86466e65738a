"""Files that commands write for the user: nothing is overwritten."""

from pathlib import Path

import click

from drivers.whole_file import new_file
from gse.errors import UsageError


def write_new(path: Path, text: str) -> None:
    """Write a new text file and print its path to stderr; UsageError where it exists or cannot be written."""
    try:
        with new_file(path) as file:
            file.write(text.encode())
    except FileExistsError:
        raise UsageError(f"{path} exists already; choose another name") from None
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}") from error
    click.echo(f"{path} written", err=True)
