"""``gse note``: a line into a running session, and a clear word where none runs."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

from gse.cli.note import command
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.errors import UsageError
from gse.sessions.status_file import StatusFile, collect_notes, leave_note, read_status
from gse.station.events import Notes
from gse.view.live_state import LiveState


@pytest.fixture
def notes() -> Notes:
    return Notes()


@pytest.fixture
def folder(tmp_path: Path, notes: Notes) -> Iterator[Path]:
    """A folder of a session that runs in this process."""
    folder = tmp_path / "20260320T183000Z-sensor"
    folder.mkdir()
    (folder / "session.mcap").touch()
    status = StatusFile(folder, LiveState(parse_station(BUILT_IN_TEXT)), notes)
    status.enter("running")
    while (found := read_status(folder)) is None or found["state"] != "running":
        pass
    yield folder
    status.close(0)


def test_a_note_reaches_the_running_session_and_leaves_no_file(folder: Path, notes: Notes) -> None:
    done = CliRunner().invoke(command, ["dew on\tthe lens", str(folder.parent)], catch_exceptions=False)
    assert done.exit_code == 0
    assert done.output == f"noted in {folder}: dew on the lens\n"
    assert notes.take() == ["dew on the lens"]
    assert not list(folder.glob("*note-*"))


def test_a_note_that_the_mount_was_touched_says_so(folder: Path, notes: Notes) -> None:
    CliRunner().invoke(command, ["--mount", "kicked the tripod", str(folder)], catch_exceptions=False)
    assert notes.take() == ["mount: kicked the tripod"]


def test_a_session_that_has_ended_takes_no_note(folder: Path, notes: Notes) -> None:
    status = StatusFile(folder, LiveState(parse_station(BUILT_IN_TEXT)), notes)
    status.close(0)
    while (found := read_status(folder)) is None or found["state"] != "ended":
        pass
    with pytest.raises(UsageError, match="takes no notes: it is ended"):
        CliRunner().invoke(command, ["too late", str(folder)], catch_exceptions=False)


def test_an_empty_note_says_what_was_expected(folder: Path) -> None:
    with pytest.raises(UsageError, match="the note is empty; expected a line of text"):
        CliRunner().invoke(command, [" ", str(folder)], catch_exceptions=False)


def test_a_note_is_no_way_to_command_the_sensor(folder: Path) -> None:
    with pytest.raises(UsageError, match="sent by gse sensor --session"):
        CliRunner().invoke(command, ["send:1acffc1d", str(folder)], catch_exceptions=False)


def test_files_that_are_no_notes_are_thrown_away_and_hold_nothing_up(tmp_path: Path, notes: Notes) -> None:
    (tmp_path / "note-1.txt").write_bytes(b"\xff\x00\n")
    (tmp_path / "note-2.txt").write_text("x" * 100_000)
    os.mkfifo(tmp_path / "note-3.txt")
    leave_note(tmp_path, "the fourth", 4)
    collect_notes(tmp_path, notes)
    assert "the fourth" in notes.take()
    assert not list(tmp_path.glob("*note-*"))


def test_folders_and_links_in_place_of_notes_hold_nothing_up_and_take_no_other_file_in(
    tmp_path: Path, notes: Notes
) -> None:
    (tmp_path / "secret").write_text("the secret")
    for number in range(30):
        (tmp_path / f"note-{number}.txt").mkdir()
    (tmp_path / "note-30.txt").symlink_to(tmp_path / "secret")
    leave_note(tmp_path, "the last", 40)
    collect_notes(tmp_path, notes)
    assert notes.take() == ["the last"]
    assert (tmp_path / "secret").exists()
