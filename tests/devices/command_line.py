"""The command line as a device under test: arguments in, exit code and text out."""

from collections.abc import Callable
from dataclasses import dataclass

import pytest

from gse.cli import main


@dataclass(frozen=True, slots=True)
class Done:
    """What a command left: exit code, stdout, stderr."""

    code: int
    out: str
    err: str


Gse = Callable[..., Done]

REPORTING = ("run", "replay", "report")
"""Commands that draw plots, which takes a second: here only where ``--plots`` is among the arguments."""


def runner(capsys: pytest.CaptureFixture[str]) -> Gse:
    """Runs ``gse`` with arguments in this process."""

    def run(*arguments: object) -> Done:
        capsys.readouterr()
        words = [str(argument) for argument in arguments]
        if words[:1] and words[0] in REPORTING and "--plots" not in words:
            words.append("--no-plots")
        with pytest.raises(SystemExit) as ended:
            main(words)
        out, err = capsys.readouterr()
        assert "Traceback" not in out + err
        return Done(int(ended.value.code or 0), out, err)

    return run
