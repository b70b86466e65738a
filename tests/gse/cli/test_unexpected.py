"""What a person reads where something failed that no command expects."""

import errno
import os
from pathlib import Path

import pytest

from gse.cli import EXIT_DATA_LOST, EXIT_INTERNAL, EXIT_USAGE, unexpected

NO_ROOM = "scipy/spatial/_qhull.so: failed to map segment from shared object"


def os_error(number: int, path: str | None = None) -> OSError:
    return OSError(number, os.strerror(number), path)


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (os_error(errno.ENOSPC), EXIT_DATA_LOST, ("output is incomplete", "free some disk space")),
        (os_error(errno.EIO), EXIT_DATA_LOST, ("output is incomplete", "check the disk")),
        (os_error(errno.EACCES, "/secret"), EXIT_USAGE, ("/secret", "give another path")),
        (MemoryError("unable to allocate 4 MiB"), EXIT_INTERNAL, ("not enough memory", "4 MiB", "raise its limit")),
        (MemoryError(), EXIT_INTERNAL, ("not enough memory: MemoryError;", "raise its limit")),
        (ImportError(NO_ROOM), EXIT_INTERNAL, ("not enough memory", "_qhull", "raise its limit")),
        (ImportError("No module named 'x'"), EXIT_INTERNAL, ("internal error", "ImportError", "please report it")),
        (ValueError("first\nsecond"), EXIT_INTERNAL, ("internal error", "ValueError", "please report it")),
    ],
)
def test_an_error_that_no_command_expects_says_what_to_do(
    error: Exception, code: int, words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(type(error)) as raised:
        raise error
    assert unexpected(raised.value) == code
    said = capsys.readouterr().err
    assert all(word in said for word in words)
    assert said.startswith("gse: ")
    assert ("please report it" in said) == ("internal error" in said)


def test_a_working_folder_that_was_deleted_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    with pytest.raises(FileNotFoundError) as raised:
        Path("session.mcap").resolve()
    assert unexpected(raised.value) == EXIT_USAGE
    assert "the working folder was deleted; change to another one (cd)" in capsys.readouterr().err
