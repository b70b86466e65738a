"""Steps that a Python program gives, in a block and in pytest."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from devices.emulated_sensor import STATION, EmulatedSensor

import gse as api
from drivers.errors import PortError
from gse.errors import UsageError
from gse.procedure.as_run import StepOutcome
from gse.station.results import Verdict

PAGE = (Path(__file__).parents[3] / "docs" / "python-tests.md").read_text(encoding="utf-8")


def test_a_program_gives_the_steps_and_has_the_verdict(tmp_path):
    with api.session(out=tmp_path) as s:
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
        with api.session(out=tmp_path) as s:
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
    with pytest.raises(PortError, match="no-such-port"), api.session(station, out=tmp_path / "out"):
        pass


def test_a_live_session_by_steps_switches_the_sensor(tmp_path):
    with EmulatedSensor(tmp_path) as sensor:
        with api.session(sensor.station, out=tmp_path / "out") as s:
            assert s.power(False)
            assert s.wait(until={"state": "silent"}, at_most_s=30)
            assert s.power(True)
            assert s.wait(until={"state": "acquired"}, at_most_s=30, measure="first_fix_s")
        assert s.verdict is Verdict.PASS
        assert len(s.assessment.procedure.starts) == 1


def test_what_a_program_does_in_its_finally_is_answered_and_in_the_log(gse, tmp_path):
    def breaks():
        with api.session(sensor.station, out=tmp_path / "out") as s:
            try:
                assert s.send("PING")
                raise ZeroDivisionError("of the test")
            finally:
                s.send("STOP")
                s.power(False)

    with EmulatedSensor(tmp_path) as sensor:
        with pytest.raises(ZeroDivisionError):
            breaks()
        assert sensor.supply.read_text() == "off"
    (folder,) = (tmp_path / "out").iterdir()
    report = json.loads((folder / "report.json").read_text())
    log = {step["number"]: (step["outcome"], step["seen"]) for step in report["procedure"]["steps"]}
    assert [log[n][0] for n in "0123"] == ["not done", "PASS", "PASS", "PASS"]
    assert log["2"][1].startswith("the sensor accepted STOP after ")
    assert report["procedure"]["power"] == "the supply was left off"
    gse("replay", folder, "--out", tmp_path / "again")
    (again,) = (tmp_path / "again").iterdir()
    assert (again / "report.json").read_bytes() == (folder / "report.json").read_bytes()


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
