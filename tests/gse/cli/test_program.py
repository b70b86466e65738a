"""The program from its very start."""

import contextlib
import itertools
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from devices.command_line import Gse

from gse.cli import cli, main
from gse.cli.options import parsed_duration
from gse.errors import GseError

ANY = click.Option(["--duration"])


def read_duration(text: str) -> float | None:
    """Of a text on the command line."""
    return parsed_duration(click.Context(cli), ANY, text)


GSE = str(Path(sys.executable).with_name("gse"))

INTERRUPTED_AT_AN_IMPORT = """
import runpy, signal, sys

class Finder:
    @staticmethod
    def find_spec(name, path=None, target=None):
        if name == "pydantic":
            signal.raise_signal(signal.SIGINT)

sys.meta_path.insert(0, Finder)
runpy.run_module("gse", run_name="__main__")
"""


def test_ctrl_c_while_the_packages_are_imported_ends_without_a_traceback() -> None:
    done = subprocess.run([sys.executable, "-c", INTERRUPTED_AT_AN_IMPORT], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


INTERRUPTED_AT_ITS_END = """
import atexit, runpy, signal, sys

atexit.register(signal.raise_signal, signal.SIGINT)
sys.argv[1:] = ["--version"]
runpy.run_module("gse", run_name="__main__")
"""


def test_ctrl_c_while_python_ends_shows_no_traceback() -> None:
    done = subprocess.run([sys.executable, "-c", INTERRUPTED_AT_ITS_END], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "")


WARNED_AT_AN_IMPORT = """
import runpy, sys, warnings

class Finder:
    @staticmethod
    def find_spec(name, path=None, target=None):
        if name == "click":
            warnings.warn("click is old", FutureWarning)
            compile("'\\\\d'", "click.py", "eval")

sys.meta_path.insert(0, Finder)
sys.argv[1:] = ["--version"]
runpy.run_module("gse", run_name="__main__")
"""


@pytest.mark.parametrize(("options", "is_shown"), [((), False), (("-W", "default"), True)])
def test_a_package_s_warning_is_shown_to_those_who_ask_for_it(options: tuple[str, ...], is_shown: bool) -> None:
    command = [sys.executable, *options, "-c", WARNED_AT_AN_IMPORT]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0
    assert ("FutureWarning: click is old" in done.stderr) == is_shown
    assert ("invalid escape sequence" in done.stderr) == is_shown


def test_the_program_starts_as_a_module() -> None:
    done = subprocess.run([sys.executable, "-m", "gse", "--version"], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


def every_command() -> Iterator[tuple[str, click.Command]]:
    """All commands, and those below them, by what is typed after ``gse``."""
    for name in cli.list_commands(click.Context(cli)):
        command = cli.get_command(click.Context(cli), name)
        assert command is not None
        yield name, command
        if isinstance(command, click.Group):
            yield from ((f"{name} {below}", of) for below, of in command.commands.items())


def test_the_help_of_each_command_fits_80_columns_and_ends_with_two_examples_that_it_takes() -> None:
    for name, command in every_command():
        help_text = command.get_help(click.Context(command, info_name=f"gse {name}", terminal_width=80))
        assert max(map(len, help_text.splitlines())) <= 80, name
        examples = [shlex.split(line) for line in help_text.partition("Examples:\n")[2].splitlines()]
        assert len(examples) == 2, name
        for example in examples:
            called = ["gse", *name.split()]
            assert example[: len(called)] == called
            own = list(itertools.takewhile(lambda word: word not in {">", ">>"}, example[len(called) :]))
            with contextlib.suppress(GseError):  # a file that is not here
                command.make_context(name, own)


@pytest.mark.parametrize(("given", "meant"), [("runn", "gse run"), ("calibarte", "gse calibrate"), ("xyzzy", "--help")])
def test_a_mistyped_command_is_answered_with_the_nearest(capsys, given: str, meant: str) -> None:
    with pytest.raises(SystemExit) as done:
        main([given])
    assert done.value.code == 2
    assert meant in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("90", 90), ("90s", 90), ("0.5", 0.5), ("5m", 300), ("5 min", 300), ("1h30m", 5400), ("2H", 7200)],
)
def test_a_duration_is_read_in_seconds_minutes_and_hours(text: str, seconds: float) -> None:
    assert read_duration(text) == seconds


@pytest.mark.parametrize("text", ["", "0", "-5", "5x", "m", "1e3", "nan", "99999h", "5m3h"])
def test_what_is_not_a_duration_is_answered_with_examples(text: str) -> None:
    with pytest.raises(click.BadParameter, match="1h30m"):
        read_duration(text)


NO_START_FILE = {"bash": ["--norc"], "zsh": ["-f"], "fish": ["--no-config"]}


@pytest.mark.parametrize("shell", NO_START_FILE)
def test_a_shell_that_sources_the_script_completes_commands(gse: Gse, shell: str) -> None:
    script = gse("completion", shell).out
    assert f"_GSE_COMPLETE={shell}_complete" in script
    if shutil.which(shell):
        bare = subprocess.run([shell, *NO_START_FILE[shell]], input=script, capture_output=True, text=True, check=True)
        assert (bare.stdout, bare.stderr) == ("", "")


def test_bash_is_given_the_commands_that_fit() -> None:
    asked = {**os.environ, "_GSE_COMPLETE": "bash_complete", "COMP_WORDS": "gse rep", "COMP_CWORD": "1"}
    done = subprocess.run([GSE], capture_output=True, text=True, env=asked)
    assert [line.partition(",")[2] for line in done.stdout.splitlines()] == ["replay", "report"]


@pytest.mark.parametrize(("redirected", "code"), [("2>/dev/full", 2), ("2>&-", 2), (">/dev/full 2>&1", 2)])
def test_messages_that_nobody_takes_leave_the_exit_code(redirected: str, code: int) -> None:
    done = subprocess.run(f'"{sys.executable}" -m gse xyzzy {redirected}', shell=True, capture_output=True)
    assert (done.returncode, done.stdout) == (code, b"")


def test_streams_that_are_closed_from_the_start_are_no_error(tmp_path: Path) -> None:
    command = f'"{sys.executable}" -m gse config init "{tmp_path / "new.yaml"}" <&- >&- 2>&-'
    assert subprocess.run(command, shell=True).returncode == 0
    assert (tmp_path / "new.yaml").is_file()


def test_a_terminal_that_is_gone_makes_a_result_incomplete() -> None:
    master, terminal = os.openpty()
    os.close(master)
    done = subprocess.run([sys.executable, "-m", "gse", "--version"], stdout=terminal, stderr=terminal)
    os.close(terminal)
    assert done.returncode == 3


@pytest.mark.parametrize(
    "command", ["run", "replay night.mcap", "report night.mcap", "evaluate", "campaign report dataset"]
)
def test_a_folder_with_the_name_of_a_file_is_refused_with_what_to_write(gse, tmp_path: Path, command: str) -> None:
    option = "--figures" if command == "evaluate" else "--out"
    done = gse(*command.split(), option, tmp_path / "night.pdf")
    assert done.code == 2
    assert f"write for example {tmp_path / 'night'} (gse report --pdf" in done.err
    assert not list(tmp_path.iterdir())
