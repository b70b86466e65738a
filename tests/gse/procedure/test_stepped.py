"""Steps that a Python program gives, in a block and in pytest."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from devices.emulated_sensor import STATION, EmulatedSensor

import gse
from drivers.errors import PortError
from gse.errors import UsageError
from gse.procedure.as_run import StepOutcome
from gse.station.results import Verdict

PAGE = (Path(__file__).parents[3] / "docs" / "python-tests.md").read_text(encoding="utf-8")


def test_a_program_gives_the_steps_and_has_the_verdict(tmp_path):
    with gse.session(out=tmp_path) as s:
        assert s.wait(until={"mode": "streaming"}, at_most_s=20)
        assert s.send("SET_EXPOSURE", exposure_s=0.05)
        assert s.check({"supply_v": [4.8, 5.2]})
        assert s.verdict is Verdict.PASS
        refused = s.send("START", period="1 ms")
        assert not refused
        assert refused.outcome is StepOutcome.FAIL
        with pytest.raises(UsageError, match=r"^no command 'PIN'; did you mean PING"):
            s.send("PIN")
        assert s.verdict is Verdict.FAIL
    report = json.loads((s.folder / "report.json").read_text())
    assert [step["outcome"] for step in report["procedure"]["steps"]] == ["PASS", "PASS", "PASS", "FAIL"]
    assert s.assessment.verdict is Verdict.FAIL
    assert report["procedure"]["is_over"]


def test_an_error_of_the_program_is_in_the_log(tmp_path):
    def ends_with_an_error():
        with gse.session(out=tmp_path) as s:
            assert s.send("PING")
            raise ZeroDivisionError("of the test")

    with pytest.raises(ZeroDivisionError):
        ends_with_an_error()
    (folder,) = tmp_path.iterdir()
    report = json.loads((folder / "report.json").read_text())
    assert report["verdict"] == "INCONCLUSIVE"
    assert "ZeroDivisionError: of the test" in report["procedure"]["steps"][0]["seen"]


def test_a_session_that_cannot_begin_says_why(tmp_path):
    station = tmp_path / "station.yaml"
    station.write_text(f"{STATION}port: {{url: {tmp_path}/no-such-port}}\n")
    with pytest.raises(PortError, match="no-such-port"), gse.session(station, out=tmp_path / "out"):
        pass


def test_a_live_session_by_steps_switches_the_sensor(tmp_path):
    with EmulatedSensor(tmp_path) as sensor:
        with gse.session(sensor.station, out=tmp_path / "out") as s:
            assert s.power(False)
            assert s.wait(until={"state": "silent"}, at_most_s=30)
            assert s.power(True)
            assert s.wait(until={"state": "acquired"}, at_most_s=30, measure="first_fix_s")
        assert s.verdict is Verdict.PASS
        assert len(s.assessment.procedure.starts) == 1


def test_the_test_of_the_page_runs_on_a_simulated_sensor(tmp_path):
    _, _, block = PAGE.partition('    """test_acquisition.py')
    lines = [line.removeprefix("    ") for line in ('    """test_acquisition.py' + block).splitlines()]
    (tmp_path / "test_acquisition.py").write_text("\n".join(lines) + "\n")
    (tmp_path / "station.yaml").write_text(STATION)
    command = [sys.executable, "-m", "pytest", "-p", "gse.pytest_plugin", "-p", "no:cacheprovider", "-q", "."]
    command += ["--gse-station", "station.yaml", "--gse-out", "sessions"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "4 passed" in done.stdout
    assert len(list((tmp_path / "sessions").glob("*/report.json"))) == 4


def test_without_a_station_a_test_is_skipped(tmp_path):
    (tmp_path / "test_it.py").write_text("def test_it(gse_session):\n    raise AssertionError\n")
    command = [sys.executable, "-m", "pytest", "-p", "gse.pytest_plugin", "-p", "no:cacheprovider", "-q", "."]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "1 skipped" in done.stdout
