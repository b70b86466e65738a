"""``gse completion``: completion of commands and options by the shell."""

import click
from click.shell_completion import get_completion_class

from gse.errors import UsageError

_SHELLS = ("bash", "zsh", "fish")
_BEFORE = {"zsh": "(( $+functions[compdef] )) || { autoload -U compinit && compinit -i; }\n"}
"""What a shell needs first: a start file of zsh that is new has no completion at all."""


@click.command("completion")
@click.argument("shell", type=click.Choice(_SHELLS))
def command(*, shell: str) -> None:
    """Print a script that lets SHELL complete commands and options with the Tab key.

    Add it to ~/.bashrc or ~/.zshrc, or write it to ~/.config/fish/completions/gse.fish; a new shell then knows it.
    """
    from gse.cli import cli

    kind = get_completion_class(shell)
    if kind is None:
        raise UsageError(f"no completion for {shell}; expected one of: {', '.join(_SHELLS)}")
    click.echo(_BEFORE.get(shell, "") + kind(cli, {}, "gse", "_GSE_COMPLETE").source())
