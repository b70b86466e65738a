"""Writes docs/command-line.md: every command and every option, from the commands themselves.

python docs/make_command_line.py
"""

from collections.abc import Iterator
from pathlib import Path

import click

from gse.cli import cli
from gse.cli.commands import whole_help

HEAD = """\
# The command line

Made by `python docs/make_command_line.py`. Results go to stdout, talk and progress to stderr. Exit codes: 0 done and
PASS, 1 FAIL (identify: not identified; compare: a regression), 2 usage or configuration, 3 done but data was lost or
recovered, 4 no device, 5 INCONCLUSIVE, 70 internal error, 130 interrupted before there was a verdict. Where several
apply: 70, 3, 1, 5, 130, 0; the last line on stderr gives all of them. docs/operations.md says how a session ends.
"""


def pages(command: click.Command, context: click.Context) -> Iterator[str]:
    """The help of a command and of all below it."""
    yield f"## {context.command_path}\n\n```\n{whole_help(context)}\n```\n"
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            below = command.get_command(context, name)
            if below is not None:
                yield from pages(below, click.Context(below, context, name, max_content_width=110, terminal_width=110))


def text() -> str:
    """The whole page."""
    context = click.Context(cli, info_name="gse", max_content_width=110, terminal_width=110, **cli.context_settings)
    return "\n".join([HEAD, *pages(cli, context)])


if __name__ == "__main__":
    (Path(__file__).parent / "command-line.md").write_text(text(), encoding="utf-8")
