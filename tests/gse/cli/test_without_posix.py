"""The way from port to report on a system without POSIX, as far as one can be had here: see without_posix.py."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from drivers.mock.urls import parse_mock_url, replay_url

ROOT = Path(__file__).resolve().parents[3]
TABLES = ROOT / "replays" / "night-sky"


def answers(folder: Path, *commands: list[str]) -> list[tuple[int, str]]:
    """Exit code and output of each command, in one process."""
    program = [sys.executable, str(ROOT / "tests" / "devices" / "without_posix.py")]
    lines = "".join(json.dumps(command) + "\n" for command in commands)
    done = subprocess.run(program, input=lines, capture_output=True, text=True, cwd=folder, check=False)
    assert "Traceback" not in done.stderr, done.stderr
    found, text = [], ""
    for line in done.stdout.splitlines(keepends=True):
        if line.startswith('{"exit_code"'):
            found.append((json.loads(line)["exit_code"], text))
            text = ""
        else:
            text += line
    assert len(found) == len(commands), done.stderr
    return found


def with_crlf(path: Path, to: Path) -> Path:
    """A copy with the line ends of Windows."""
    to.write_bytes(path.read_bytes().replace(b"\r\n", b"\n").replace(b"\n", b"\r\n"))
    return to


def test_the_way_from_port_to_report_needs_no_posix(tmp_path):
    station = with_crlf(TABLES / "tripod-vega-05sec.yaml", tmp_path / "station.yaml")
    table = with_crlf(TABLES / "tables" / "tripod-vega-05sec.csv", tmp_path / "table.csv")
    session = "sessions/*/session.mcap"
    commands = (
        ["identify", str(table), "--station", str(station)],
        ["config", "check", str(station)],
        ["run", "--port", "sim://?frames=320", "--out", "sessions"],
        ["status", "sessions"],
        ["replay", session, "--out", "again"],
        ["report", "sessions/*"],
        ["view", session, "--save", "view.rrd"],
        ["session", "verify", session],
        ["calibrate", session],
    )
    found = answers(tmp_path, *commands)
    assert [code for code, _ in found] == [0] * len(commands)
    assert "RA" in found[0][1]
    assert all(word in found[3][1] for word in ("ended", "PASS"))


def test_what_such_a_system_lacks_is_told_with_a_way_round(tmp_path):
    program = [sys.executable, str(ROOT / "tests" / "devices" / "without_posix.py")]
    asked = json.dumps(["run", "--detach"]) + "\n" + json.dumps(["emulate", "--pty"]) + "\n"
    done = subprocess.run(program, input=asked, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert [json.loads(line)["exit_code"] for line in done.stdout.splitlines()] == [2, 2]
    assert "keep the window of the session open" in done.stderr
    assert "--tcp 127.0.0.1:4000" in done.stderr


@pytest.mark.parametrize("path", ["C:\\nights\\a b\\session.mcap", "D:/nights/session.mcap", "\\\\server\\x.mcap"])
def test_paths_with_drive_letters_keep_their_letters(path):
    assert parse_mock_url(replay_url(path)).path == path
