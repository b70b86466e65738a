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


def runner(capsys: pytest.CaptureFixture[str]) -> Gse:
    """Runs ``gse`` with arguments in this process."""

    def run(*arguments: object) -> Done:
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main([str(argument) for argument in arguments])
        out, err = capsys.readouterr()
        assert "Traceback" not in out + err
        return Done(int(ended.value.code or 0), out, err)

    return run
