"""The way from port to report on a system without POSIX, as far as one can be had here: see without_posix.py."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from drivers.mock_ports import parse_mock_url, replay_url
from gse.config.station import BUILT_IN_TEXT

ROOT = Path(__file__).resolve().parents[3]
TABLES = ROOT / "replays" / "night-sky"


def answers(folder: Path, *commands: list[str]) -> tuple[list[tuple[int, str]], str]:
    """Exit code and output of each command, in one process; then its messages."""
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
    return found, done.stderr


def with_crlf(path: Path, to: Path) -> Path:
    """A copy with the line ends of Windows."""
    to.write_bytes(path.read_bytes().replace(b"\r\n", b"\n").replace(b"\n", b"\r\n"))
    return to


def test_the_way_from_port_to_report_needs_no_posix_and_what_is_lacking_is_told_with_a_way_round(tmp_path):
    quick = tmp_path / "quick.yaml"
    quick.write_text(BUILT_IN_TEXT + "limits: {identification_ms: 60000, decision: simple}\n")
    station = with_crlf(TABLES / "tripod-vega-05sec.yaml", tmp_path / "station.yaml")
    checked = tmp_path / "hopeless.yaml"  # no length of session passes, so that none is simulated, for seconds
    checked.write_text(station.read_text() + "limits: {d_ra_cosde_arcsec: 0.1, d_de_arcsec: 0.1, d_roll_arcsec: 0.1}\n")
    table = with_crlf(ROOT / "benchmarks/real-sky/tables/tripod-vega-05sec.csv", tmp_path / "table.csv")
    session = "sessions/*/session.mcap"
    commands = (
        ["identify", str(table), "--station", str(station)],
        ["config", "check", str(with_crlf(checked, checked))],
        ["run", "--station", str(quick), "--port", "sim://?frames=100", "--no-plots", "--out", "sessions"],
        ["status", "sessions"],
        ["replay", session, "--no-plots", "--out", "again"],
        ["report", "sessions/*"],
        ["view", session, "--save", "view.rrd"],
        ["session", "verify", session],
        ["calibrate", session],
    )
    lacking = (["run", "--detach"], ["emulate", "--pty"])
    sensor, port = os.openpty()
    ports = (["run", "--port", os.ttyname(port), "--duration", "1", "--out", "silent"], ["run", "--port", "COM3"])
    found, messages = answers(tmp_path, *commands, *lacking, *ports)
    os.close(sensor)
    os.close(port)
    *found, silent, absent = found
    assert (silent[0], absent[0]) == (5, 4)
    assert f"OPENED: {os.path.realpath('/dev/pts')}" in messages
    assert "there is no port COM3; ports here:" in messages
    assert [code for code, _ in found] == [0] * len(commands) + [2] * len(lacking)
    assert "RA" in found[0][1]
    assert all(word in found[3][1] for word in ("ended", "PASS"))
    assert "keep the window of the session open" in messages
    assert "--tcp 127.0.0.1:4000" in messages


@pytest.mark.parametrize("path", ["C:\\nights\\a b\\session.mcap", "D:/nights/session.mcap", "\\\\server\\x.mcap"])
def test_paths_with_drive_letters_keep_their_letters(path):
    assert parse_mock_url(replay_url(path)).path == path
