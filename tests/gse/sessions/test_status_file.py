"""The status of a session, as it is read by others: which process it is, and whether a report is due."""

import json
import math
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from devices.command_line import runner
from devices.patience import PATIENCE_S
from skies.known_nights import NONE, START_NS, frame, session, unanswered
from skies.one_by_one import results_of

from drivers.host_files import _beside
from drivers.outside_text import is_plain
from gse.cli.status import command as status_command
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.errors import UsageError
from gse.recording.recorder import Recorder
from gse.sessions.status_file import (
    StatusFile,
    is_running,
    is_unfinished,
    may_be_ended,
    process_mark,
    read_status,
    session_folders,
)
from gse.station.events import Notes
from gse.values import instant
from gse.view.live_state import LiveState


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a closed session file."""
    folder = tmp_path / "20260320T183000Z-sensor"
    folder.mkdir()
    Recorder(folder / "session.mcap", live=False).close()
    return folder


def test_the_status_is_renewed_until_the_session_has_ended(folder: Path) -> None:
    status_file = StatusFile(folder, LiveState(parse_station(BUILT_IN_TEXT)), Notes())
    status_file.enter("running")
    while (status := read_status(folder)) is None or status["state"] != "running":
        pass
    assert is_running(status)
    assert not is_unfinished(folder)
    status_file.close(5, "INCONCLUSIVE")
    status = read_status(folder)
    assert status is not None
    assert (status["state"], status["verdict"], status["exit_code"]) == ("ended", "INCONCLUSIVE", 5)
    assert not is_running(status)
    assert sorted(path.name for path in folder.iterdir()) == ["session.mcap", "status.json"]


def test_the_last_answer_is_the_latest_of_its_block_and_stays_while_none_comes(folder: Path) -> None:
    made = session(0)
    made.link.frames_lost = 4
    answered = [frame(START_NS + k * instant.NS_PER_S, k, NONE) for k in range(25)]
    results = results_of([*answered, *(unanswered(k) for k in range(25, 30))])
    live = LiveState(made.station)
    status_file = StatusFile(folder, live, Notes())
    for begin, end in ((0, 20), (20, 28), (28, 30)):
        live.on_results(results.part(begin, end), made)
    status_file.close(5)
    status = read_status(folder)
    assert status is not None
    assert status["last_answer_utc"] == instant.to_text(answered[24].panorama.host_utc_ns, 1)
    assert (status["frames"], status["frames_lost"]) == (30, 4)
    assert status["identified"] == round(25 / 30, 4)


def test_the_end_is_told_where_the_disk_takes_no_new_file(folder: Path) -> None:
    status_file = StatusFile(folder, LiveState(parse_station(BUILT_IN_TEXT)), Notes())
    while read_status(folder) is None:
        pass
    status_file.enter("reporting")
    until_s = time.monotonic() + PATIENCE_S
    while (status := read_status(folder)) and status["state"] != "reporting" and time.monotonic() < until_s:
        pass
    _beside(folder / "status.json").mkdir()
    status_file.close(0, "PASS")
    status = read_status(folder)
    assert status is not None
    assert (status["state"], status["exit_code"], status["verdict"]) == ("ended", 0, "PASS")


@pytest.mark.parametrize("state", ["running", "reporting"])
def test_no_process_is_ended_that_does_not_record_into_the_folder_whoever_it_is(folder: Path, state: str) -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as stranger:
        document = {
            "schema": "gse.status/1",
            "state": state,
            "pid": stranger.pid,
            "process": process_mark(stranger.pid),
        }
        (folder / "status.json").write_text(json.dumps(document))
        status = read_status(folder)
        assert status is not None
        assert is_running(status)
        assert not may_be_ended(folder, status)
        with pytest.raises(UsageError, match="it was not ended" if state == "running" else "is reporting already"):
            status_command.main([str(folder), "--stop"], standalone_mode=False)
        assert stranger.poll() is None
        stranger.communicate(b"\n")
    assert stranger.returncode == 0


def test_a_process_that_records_into_the_folder_may_be_ended_where_the_folder_is_the_users_own(folder: Path) -> None:
    status = {"state": "running", "pid": os.getpid(), "process": process_mark(os.getpid())}
    (folder / "status.json").write_text(json.dumps(status))
    assert not may_be_ended(folder, status)
    with (folder / "session.mcap").open("rb"):
        assert may_be_ended(folder, status)
        if os.getuid() == 0:
            os.chown(folder, 12345, -1)
            assert not may_be_ended(folder, status)
            os.chown(folder, 0, -1)


def test_another_process_with_its_number_is_not_taken_for_it() -> None:
    mark = process_mark(os.getpid())
    status = {"state": "running", "pid": os.getpid(), "process": mark}
    assert is_running(status)
    assert not is_running({**status, "process": f"{mark}0"})


def test_without_a_mark_a_status_that_is_renewed_is_of_a_running_process() -> None:
    now_ns = time.time_ns()
    status = {"state": "running", "pid": os.getpid(), "process": None}
    renewed = {**status, "utc": instant.to_text(now_ns, 1)}
    assert is_running(renewed, has_marks=False)
    assert not is_running({**status, "utc": instant.to_text(now_ns - 60 * instant.NS_PER_S, 1)}, has_marks=False)
    assert not is_running({**status, "utc": "yesterday"}, has_marks=False)
    assert not is_running(status, has_marks=False)
    assert not is_running(renewed), "of another computer, and no process of this one is ended for it"
    assert not is_running({**status, "pid": 1 << 30})


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, "[]", '{"schema": "gse.status/1", "pid": "1"}', "{}"])
def test_a_status_that_is_broken_or_foreign_is_none(folder: Path, text: str) -> None:
    (folder / "status.json").write_text(text)
    assert read_status(folder) is None


OURS = {"schema": "gse.status/1", "state": "running", "pid": 4000, "process": "boot:1", "utc": "2026-03-20T18:30:00.0Z"}


@pytest.mark.parametrize(
    "change",
    [
        *({"pid": pid} for pid in (-1, 0, 1, 1 << 40, True, "1")),
        *({"state": state} for state in ("running\x1b[2J", "", None)),
        *({"utc": utc} for utc in ("yesterday", 5, "9" * 30_000)),
        *({"frames": frames} for frames in ("x", [], -1, 1 << 70)),
        {"identified": "a"},
        {"identified": math.nan},
        {"session_bytes": "1"},
        {"process": 5},
    ],
    ids=repr,
)
def test_a_status_of_a_stranger_with_a_value_out_of_order_is_none(folder: Path, change: dict[str, object]) -> None:
    (folder / "status.json").write_text(json.dumps(OURS))
    assert read_status(folder) is not None
    (folder / "status.json").write_text(json.dumps(OURS | change))
    assert read_status(folder) is None


def test_the_words_of_a_stranger_steer_no_terminal(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = dict.fromkeys(("port", "link", "so_far", "verdict", "page", "forecast", "sky"), "\x1b[2J\x9b31m\u202e")
    (folder / "status.json").write_text(json.dumps(OURS | words))
    steering = folder.with_name("20270320T183000Z-\x1b[2Jsensor")
    shutil.copytree(folder, steering)
    done = runner(capsys)("status", folder.parent)
    assert done.code == 1
    assert folder.name in done.out
    assert all(is_plain(line) for line in (done.out + done.err).split("\n"))
    done = runner(capsys)("report", steering)
    assert done.code == 2
    assert "rename" in done.err
    assert all(is_plain(line) for line in (done.out + done.err).split("\n"))


def test_a_session_is_unfinished_where_no_report_stands_and_nobody_is_at_it(folder: Path) -> None:
    status = {"schema": "gse.status/1", "state": "running", "pid": os.getpid(), "process": "an earlier one"}
    (folder / "status.json").write_text(json.dumps(status))
    assert is_unfinished(folder)
    (folder / "report-2").mkdir()
    (folder / "report-2" / "report.json").touch()
    assert not is_unfinished(folder)


def test_a_closed_session_without_a_status_waits_for_no_report_and_a_cut_one_does(folder: Path) -> None:
    assert not is_unfinished(folder)
    session = folder / "session.mcap"
    session.write_bytes(session.read_bytes()[:-1])
    assert is_unfinished(folder)


def test_sessions_are_found_in_their_folder_and_as_one(folder: Path) -> None:
    (folder.parent / "notes.txt").touch()
    assert session_folders(folder.parent) == session_folders(folder) == [folder]
    assert session_folders(folder.parent / "absent") == []


def test_a_pipe_in_place_of_a_file_is_waited_for_by_nobody(folder: Path) -> None:
    os.mkfifo(folder / "status.json")
    assert read_status(folder) is None
    assert not is_unfinished(folder)
    (folder / "session.mcap").unlink()
    os.mkfifo(folder / "session.mcap")
    assert session_folders(folder.parent) == []
