"""gse sensor: the operator's commands, on the simulated sensor."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from devices.live_session import LiveSession
from devices.patience import PATIENCE_S

from drivers.errors import CommandError, PortError
from drivers.session_file.reader import messages
from drivers.session_file.records import RX, TX
from gse.cli.sensor import command


def run(tmp_path: Path, *arguments: str) -> Result:
    return CliRunner().invoke(command, [*arguments, "--out", str(tmp_path)])


@pytest.mark.parametrize("words", [["start"], ["stop"], ["request"], ["exposure", "0.05"]])
def test_the_sensor_obeys_and_the_command_is_recorded(tmp_path: Path, words: list[str]) -> None:
    result = run(tmp_path, *words, "--json", "--port", "sim://?standby=yes")
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert (document["schema"], document["answer"]) == ("gse.sensor/1", "ACK")
    assert len(list(messages(document["session"], TX))) == 1
    assert list(messages(document["session"], RX))


def test_status_says_how_the_sensor_is(tmp_path: Path) -> None:
    result = run(tmp_path, "status", "--port", "sim://?standby=yes")
    assert result.exit_code == 0
    assert "standby" in result.stdout
    assert "firmware       1.2.0" in result.stdout


def test_a_command_to_the_simulator_says_that_no_real_sensor_got_it(tmp_path: Path) -> None:
    assert run(tmp_path, "start").stderr.startswith("simulated sensor (sim://); a real one: --station FILE, or --port")


def test_a_refusal_gives_the_sensors_reason(tmp_path: Path) -> None:
    result = run(tmp_path, "start", "--period", "0.001")
    assert isinstance(result.exception, CommandError)
    assert "out of range" in str(result.exception)


def test_a_port_that_is_not_there_leaves_no_folder_behind(tmp_path: Path) -> None:
    result = run(tmp_path, "start", "--port", "/dev/ttyNOWHERE")
    assert isinstance(result.exception, PortError)
    assert list(tmp_path.iterdir()) == []


def test_a_command_goes_through_the_session_that_has_the_port(tmp_path: Path) -> None:
    out, gse = tmp_path / "sessions", [sys.executable, "-m", "gse"]
    out.mkdir()
    emulator = subprocess.Popen([*gse, "emulate", "--pty", "--standby", "--dark"], stdout=subprocess.PIPE, text=True)
    assert emulator.stdout is not None
    address = emulator.stdout.readline().strip()
    session = subprocess.Popen([*gse, "run", "--port", address, "--out", str(out), "--no-plots"])
    try:
        live = LiveSession(out)
        until_s = time.monotonic() + PATIENCE_S
        while not list(out.iterdir()) and time.monotonic() < until_s:
            time.sleep(0.05)
        live.await_state("running")
        assert isinstance(run(tmp_path, "start", "--port", address).exception, PortError)
        refused = run(tmp_path, "start", "--period", "0.001", "--session", str(out))
        assert "out of range" in str(refused.exception)
        result = run(tmp_path, "start", "--session", str(out), "--json")
        assert result.exit_code == 0, result.output
        assert json.loads(result.stdout)["answer"] == "ACK"
        live.await_frames(3)
        assert len(list(messages(live.folder, TX))) == 2
        assert not list(live.folder.glob("command-*"))
    finally:
        for process in (session, emulator):
            process.send_signal(signal.SIGTERM)
            process.wait(PATIENCE_S)
        emulator.stdout.close()
