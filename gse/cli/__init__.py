"""The command line: ``gse COMMAND``; each command is a module of its own, imported when it is called.

May import every room; no room may import it.

A command imports within its function what takes more than some 10 ms (numba, scipy, astropy, rerun, the verdict): ``gse
CMD --help``, a wrong option and the shell's completion answer in 0.2 s of CPU instead of 0.5 to 1.3. Everything else is
imported at the top. In the other rooms functions import for the same reason: parts of scipy and astropy, the
identifiers one at a time, distributed, the verdict of a running session, rerun and the plots.
"""

import difflib
import errno
import importlib
import os
import shutil
import sys
import textwrap
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from drivers.errors import CaptureError, CommandError, DriverError, UrlError
from drivers.host_files import new_file
from drivers.outside_text import is_plain, plain_line, plain_lines
from gse.cli.commands import COMMANDS, dressed, epilog, retired
from gse.errors import GseError, UsageError
from gse.process import interrupts
from gse.process.broken_package import broken_package
from gse.version import __version__
from protocols.errors import ProtocolError

EXIT_FAIL = 1
EXIT_USAGE = 2
EXIT_DATA_LOST = 3
EXIT_NO_DEVICE = 4
EXIT_INCONCLUSIVE = 5
EXIT_INTERNAL = 70
EXIT_INTERRUPTED = 130

_NOT_TAKEN = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS)
"""Errors of a disk that is full, broken or locked, and of a terminal that is gone."""

_NOT_OPEN = (errno.EACCES, errno.EPERM, errno.ENAMETOOLONG, errno.ELOOP, errno.ENOTDIR, errno.EISDIR)
"""Errors of a path that this user may not open, that is no path, or that is another kind of thing than expected."""

_GIVE_ROOM = "gse takes up to 400 MiB, and 1.2 GB of addresses: raise its limit, or end other programs"
_NO_ROOM = "failed to map segment"
"""The system's words where there is no room for a library."""


class _Commands(click.Group):
    """Commands by name, imported one at a time: ``gse --help`` must not wait for rerun, numba and astropy."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        module = importlib.import_module(f"gse.cli.{cmd_name}")
        command = module.command
        assert isinstance(command, click.Command)
        return dressed(cmd_name, command)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """``gse help COMMAND`` and ``gse version`` are what a hand types that knows other programs."""
        if args[:1] == ["help"]:
            args = [*args[1:], "--help"]
        elif args == ["version"]:
            args = ["--version"]
        return super().parse_args(ctx, args)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and args[0] not in COMMANDS and not args[0].startswith("-"):
            near = difflib.get_close_matches(args[0], COMMANDS, n=1)
            hint = f"Did you mean 'gse {near[0]}'?" if near else "'gse --help' lists the commands."
            raise click.UsageError(f"No such command {args[0]!r:.60}. {hint}", ctx)
        return super().resolve_command(ctx, args)

    def make_context(self, *args: Any, **kwargs: Any) -> click.Context:
        with _quiet_on_a_closed_pipe():
            return super().make_context(*args, **kwargs)

    def invoke(self, ctx: click.Context) -> object:
        with _quiet_on_a_closed_pipe():
            return super().invoke(ctx)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@contextmanager
def _quiet_on_a_closed_pipe() -> Iterator[None]:
    """A closed stdout pipe (``gse decode FILE | head``) is not an error."""
    try:
        yield
        if sys.stdout is not None:
            sys.stdout.flush()
    except BrokenPipeError:
        # Buffered output must go somewhere, or Python reports an error when it ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise click.exceptions.Exit(0) from None


@click.group(cls=_Commands, epilog=epilog("gse"), context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="gse")
def cli() -> None:
    """Ground test station for a star sensor.

    It receives panoramas, identifies the stars, and compares RA and DE with sidereal truth. `gse run` without arguments
    tests a simulated sensor.
    """


def _check_showable(words: Sequence[str]) -> None:
    """Refuse names that steer a terminal or are not text: a shell's ``*`` finds them in a foreign folder."""
    for word in words if words[:1] != ["note"] else ():
        if not is_plain(word):
            raise click.UsageError(f"'{plain_line(word):.200}' has characters that cannot be shown; rename the file")


def was_interrupted(error: BaseException) -> bool:
    """Whether Ctrl-C is behind an error: out of compiled code it comes as any other one."""
    return interrupts.came() or isinstance(error, KeyboardInterrupt)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; expected errors become one or two lines on stderr and an exit code."""
    words = sys.argv[1:] if arguments is None else list(arguments)
    try:
        _check_showable(words)
        code = cli.main(words, prog_name="gse", standalone_mode=False)
    except click.exceptions.Exit as done:
        code = done.exit_code
    except click.ClickException as error:
        _show(error)
        code = EXIT_USAGE
    except (click.Abort, KeyboardInterrupt):
        click.echo("gse: interrupted", err=True)
        code = EXIT_INTERRUPTED
    except (GseError, DriverError, ProtocolError) as error:
        click.echo(folded(f"gse: {plain_lines(str(error))}", err=True), err=True)
        code = exit_code_of(error)
    except Exception as error:
        code = unexpected(error)
    sys.exit(code if isinstance(code, int) else 0)


def _show(error: click.ClickException) -> None:
    """Print what is wrong with a command line; of a retired option only what does it now."""
    if isinstance(error, click.NoSuchOption) and error.ctx is not None:
        sentence = retired(error.ctx.command_path, error.option_name)
        if sentence is not None:
            click.echo(folded(f"gse: {sentence}", err=True), err=True)
            return
    error.show()


def folded(text: str, *, indent: int = 0, err: bool = False) -> str:
    """``text`` for stdout, or stderr with ``err``: lines wider than the terminal go on below, ``indent`` columns in.

    A word that is wider than the terminal, such as a path, stays whole; files and pipes get all lines whole.
    """
    stream = sys.stderr if err else sys.stdout
    if stream is None or not stream.isatty():
        return text
    columns = shutil.get_terminal_size().columns
    return "\n".join(_folded(line, columns, indent) for line in text.split("\n"))


def _folded(line: str, columns: int, indent: int) -> str:
    if len(line) <= columns:
        return line
    pieces = textwrap.wrap(
        line, columns, subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False
    )
    return "\n".join(pieces)


def unexpected(error: BaseException) -> int:
    """Print an unexpected error; returns the exit code."""
    if was_interrupted(error):
        return EXIT_INTERRUPTED
    if isinstance(error, OSError) and error.errno in _NOT_TAKEN:
        hint = "check the disk" if error.errno in (errno.EIO, errno.EROFS) else "free some disk space"
        click.echo(f"gse: {error.strerror}: the output is incomplete; {hint} and repeat", err=True)
        return EXIT_DATA_LOST
    if isinstance(error, OSError) and error.errno in _NOT_OPEN and isinstance(error.filename, str | bytes):
        path = plain_line(os.fsdecode(error.filename))
        click.echo(f"gse: {path:.200}: {error.strerror}; give another path, or ask its owner for access", err=True)
        return EXIT_USAGE
    if isinstance(error, FileNotFoundError) and _working_folder_is_gone():
        click.echo("gse: the working folder was deleted; change to another one (cd) and repeat", err=True)
        return EXIT_USAGE
    if isinstance(error, MemoryError) or (isinstance(error, ImportError) and _NO_ROOM in str(error)):
        what = plain_line(str(error))[:200] or type(error).__name__
        click.echo(f"gse: not enough memory: {what}; {_GIVE_ROOM}", err=True)
        return EXIT_INTERNAL
    if package := broken_package(error):
        click.echo(f"gse: {package}", err=True)
        return EXIT_USAGE
    place = traceback.extract_tb(error.__traceback__)[-1]
    where = f"{place.filename}:{place.lineno}"
    what = f"{type(error).__name__}: {plain_lines(str(error))}"
    click.echo(f"gse: internal error: {what} at {where}; please report it", err=True)
    return EXIT_INTERNAL


def _working_folder_is_gone() -> bool:
    try:
        os.getcwd()
    except FileNotFoundError:
        return True
    return False


def exit_code_of(error: Exception) -> int:
    """The exit code of an expected error."""
    if isinstance(error, GseError):
        return error.exit_code
    if isinstance(error, CaptureError | UrlError | ProtocolError):
        return EXIT_USAGE
    if isinstance(error, CommandError):
        return EXIT_FAIL
    return EXIT_NO_DEVICE


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
