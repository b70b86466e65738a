"""docs/tutorial.md is run as it stands, command by command."""

import doctest
import io
import os
import re
import shlex
import signal
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest

from gse.cli import main

PAGE = Path(__file__).parents[1] / "docs" / "tutorial.md"
END = "--- end of the answer ---"
_BLOCK = re.compile(r"```console\n(.*?)```", re.DOTALL)


def steps() -> list[tuple[str, str]]:
    """Each command of the page, with the answer that stands below it."""
    found = []
    for block in _BLOCK.findall(PAGE.read_text(encoding="utf-8")):
        for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
            command, _, answer = part.partition("\n")
            found.append((command, answer))
    return found


class Shell:
    """A bash in a folder, and what it prints, stdout and stderr in one."""

    def __init__(self, folder: Path) -> None:
        programs = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        self._process = subprocess.Popen(
            ["bash", "--norc"],
            cwd=folder,
            env={**os.environ, "PATH": programs},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )

    def answer(self, command: str) -> str:
        """Of one command."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{command}\necho '{END}'\n")
        self._process.stdin.flush()
        return "".join(iter(self._process.stdout.readline, f"{END}\n"))

    def __enter__(self) -> "Shell":
        return self

    def __exit__(self, *error: object) -> None:
        os.killpg(self._process.pid, signal.SIGKILL)
        self._process.communicate()


def answer_here(command: str) -> str:
    """Of a ``gse`` in this process: what a new one needs to begin is shown often enough."""
    text = io.StringIO()
    with redirect_stdout(text), redirect_stderr(text), pytest.raises(SystemExit):
        main(shlex.split(command)[1:])
    return text.getvalue()


def test_each_command_of_the_tutorial_answers_as_the_page_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    checker = doctest.OutputChecker()
    with Shell(tmp_path) as shell:
        for command, expected in steps():
            is_plain = command.startswith("gse ") and not set(command) & set("<>|&;*$")
            answer = answer_here(command) if is_plain else shell.answer(command)
            assert checker.check_output(expected, answer, doctest.ELLIPSIS), f"$ {command}\n{answer}"
