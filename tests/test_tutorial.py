"""docs/tutorial.md is run as it stands, command by command."""

import doctest
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

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


def test_each_command_of_the_tutorial_answers_as_the_page_says(tmp_path: Path) -> None:
    programs = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    shell = subprocess.Popen(
        ["bash", "--norc"],
        cwd=tmp_path,
        env={**os.environ, "PATH": programs, "COLUMNS": "80"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    assert shell.stdin is not None
    assert shell.stdout is not None
    checker = doctest.OutputChecker()
    try:
        for command, expected in steps():
            shell.stdin.write(f"{command}\necho '{END}'\n")
            shell.stdin.flush()
            answer = "".join(iter(shell.stdout.readline, f"{END}\n"))
            assert checker.check_output(expected, answer, doctest.ELLIPSIS), f"$ {command}\n{answer}"
    finally:
        os.killpg(shell.pid, signal.SIGKILL)
        shell.wait()
        shell.stdin.close()
        shell.stdout.close()
