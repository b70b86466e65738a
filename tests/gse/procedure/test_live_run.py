"""Runs on an emulated sensor whose supply a program switches: the terminal, notes, signals, a port that is lost."""

import json
import os
import re
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import pytest
from devices.emulated_sensor import EmulatedSensor
from devices.live_session import LiveSession, ended
from devices.patience import PATIENCE_S

from drivers.errors import DriverError
from drivers.session_file.reader import read_capture
from drivers.session_file.records import EVENTS, RX, RecordedMessage
from gse.cli import EXIT_FAIL, EXIT_INCONCLUSIVE
from gse.config.choice import station_of
from gse.config.station import parse_station
from gse.procedure.desk import Desk
from gse.procedure.engine import OpenRun, Run
from gse.procedure.file import parse_procedure
from gse.sessions.live import Ending, Operator, run_live
from gse.sessions.replay import replay_session
from gse.station.events import StationKind

FAULTS = Path(__file__).parents[3] / "replays" / "golden" / "faults.mcap"
SIMULATED = """\
version: 1
sensor: {name: ST-1, rows: 1024, columns: 1024, focal_length_px: 4170}
site: {name: roof, latitude_deg: -6.53, longitude_deg: 106.7, height_m: 250}
port: {url: "sim://"}
"""
HEAD = "version: 1\nname: SS-TP-07\nstation: station.yaml\nsteps:\n"
EXPOSURES = "exposures_s: [0.02, 0.3], frames_each: 12"
CLEANUP = "cleanup:\n  - send: STOP\n  - power: off\n"
STARTS = """\
  - power: off
  - wait: {until: {state: silent}, at_most: 30s}
  - power: on
  - wait: {until: {state: acquired}, at_most: 30s, measure: first_fix_s}
  - check: {power_a: [300 mA, 320 mA], power_v: [4.8, 5.2]}
  - send: PING
  - check: {supply_v: [4.8, 5.2]}
"""


@pytest.fixture
def begin(tmp_path):
    """A function that begins a run of steps on a sensor as a process: the process, and its session."""
    begun = []

    def begin_run(steps, *options):
        (tmp_path / "test.yaml").write_text(HEAD + steps + CLEANUP)
        out = tmp_path / "out"
        out.mkdir()
        command = [sys.executable, "-m", "gse", "procedure", "run", str(tmp_path / "test.yaml"), "--out", str(out)]
        process = subprocess.Popen(
            [*command, "--no-plots", *options], stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        begun.append(process)
        return process, LiveSession(out)

    yield begin_run
    for process in begun:
        process.kill()
        process.communicate()


def await_step(session, number):
    """Wait until a step of the running session has begun."""
    until_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            if session.events().get("STEP_BEGUN", "").startswith(f"{number} | "):
                return
        except (ValueError, OSError, DriverError):
            pass  # there is no session yet
        assert time.monotonic() < until_s
        time.sleep(0.1)


def log_of(session):
    report = json.loads((session.folder / "report.json").read_text())
    return report, {step["number"]: (step["outcome"], step["seen"]) for step in report["procedure"]["steps"]}


def test_a_program_switches_the_sensor_and_the_run_says_what_it_drew(gse, tmp_path):
    (tmp_path / "test.yaml").write_text(HEAD + STARTS + CLEANUP)
    with EmulatedSensor(tmp_path) as sensor:
        done = gse("procedure", "run", tmp_path / "test.yaml", "--out", tmp_path / "out", "--no-plots")
        assert sensor.supply.read_text() == "off"
    (folder,) = (tmp_path / "out").iterdir()
    report = json.loads((folder / "report.json").read_text())
    assert {step["outcome"] for step in report["procedure"]["steps"]} == {"PASS"}, done.err
    assert done.code == 0
    (start,) = report["procedure"]["starts"]["each"]
    assert 0.5 <= start["boot_s"] <= start["first_fix_s"]  # it boots for half a second
    gse("replay", folder, "--out", tmp_path / "again")
    (again,) = (tmp_path / "again").iterdir()
    assert (again / "report.json").read_bytes() == (folder / "report.json").read_bytes()


def test_a_signal_ends_the_run_and_the_cleanup_is_done(begin, tmp_path):
    with EmulatedSensor(tmp_path) as sensor:
        process, session = begin("  - wait: {for: 10 min}\n  - send: PING\n")
        await_step(session, 1)
        process.send_signal(signal.SIGINT)
        assert ended(process) == EXIT_INCONCLUSIVE
        assert sensor.supply.read_text() == "off"
    report, log = log_of(session)
    assert log["1"][0] == "not done"
    assert "interrupted by" in log["1"][1]
    assert log["2"][0] == "not done"
    assert [log[f"cleanup {n}"][0] for n in (1, 2)] == ["PASS", "PASS"]
    assert report["verdict"] == "INCONCLUSIVE"
    assert session.is_closed_judged_and_reported()


class BrokenView:
    """A listener that cannot show results, from ``breaks`` on."""

    def __init__(self, breaks=lambda: True):
        self._breaks = breaks

    def on_results(self, results, session):
        if self._breaks():
            raise ZeroDivisionError("of the view")

    def on_event(self, event):
        pass


def test_an_internal_error_outside_of_the_steps_leaves_the_supply_as_the_cleanup_says(tmp_path):
    procedure = parse_procedure(HEAD + "  - wait: {for: 10 min}\n" + CLEANUP)
    with EmulatedSensor(tmp_path) as sensor:
        station, text = station_of(sensor.station)
        run = Run(procedure, Desk())
        with Ending(print) as ending, pytest.raises(ZeroDivisionError, match="of the view"):
            run_live(
                station,
                text,
                tmp_path / "out",
                Operator(ending),
                make_listeners=lambda loop, folder, live: [BrokenView()],
                procedure=run,
            )
        assert sensor.supply.read_text() == "off"
    records = read_capture(LiveSession(tmp_path / "out").folder / "session.mcap")
    events = [one.event() for one in records if isinstance(one, RecordedMessage) and one.topic == EVENTS]
    log = [event.text for event in events if event.kind == StationKind.STEP_DONE]
    assert "an internal error of gse: ZeroDivisionError: of the view" in log[0]
    assert log[-1].startswith("cleanup 2 | PASS")


def test_a_program_switches_off_after_an_internal_error_outside_of_its_steps(tmp_path):
    wait, off = parse_procedure(HEAD + "  - wait: {for: 10 min}\n  - power: off\n").steps
    with EmulatedSensor(tmp_path) as sensor:
        station, text = station_of(sensor.station)
        run, began = OpenRun(parse_procedure(HEAD + "  - power: on\n"), Desk()), threading.Event()
        run.on_begin = began.set

        def program():
            outcomes = [str(run.do(step, Future()).outcome) for step in (wait, off)]
            run.end()
            return outcomes

        with ThreadPoolExecutor(1) as threads:
            outcomes = threads.submit(program)
            with pytest.raises(ZeroDivisionError, match="of the view"):
                run_live(
                    station,
                    text,
                    tmp_path / "out",
                    Operator(Ending(print)),
                    make_listeners=lambda loop, folder, live: [BrokenView(began.is_set)],
                    procedure=run,
                )
            assert outcomes.result() == ["not done", "PASS"]
        assert sensor.supply.read_text() == "off"
    assert LiveSession(tmp_path / "out").events()["PROCEDURE_ENDED"] == "the supply was left off"


@pytest.mark.parametrize(
    ("step", "outcome"),
    [("wait: {until: {sky: daylight}, at_most: 6s}", "not done"), ("watch: {for: 6s}", "INCONCLUSIVE")],
    ids=["wait", "watch"],
)
def test_a_port_that_is_lost_in_a_step_is_no_fault_of_the_sensor(begin, tmp_path, step, outcome):
    with EmulatedSensor(tmp_path) as sensor:
        process, session = begin(f"  - {step}\n")
        await_step(session, 1)
        sensor.unplug()
        assert ended(process) == EXIT_INCONCLUSIVE
        assert sensor.supply.read_text() == "off"
    _, log = log_of(session)
    assert log["1"][0] == outcome
    assert "the port is gone" in log["1"][1]
    assert log["cleanup 1"][0] == "not done"
    assert log["cleanup 2"][0] == "PASS"


@pytest.mark.parametrize(
    ("word", "seen"), [("hang", "did not end within 2 s (power.timeout_s), and was killed"), ("fail", "no such relay")]
)
def test_a_switch_that_hangs_or_fails_leaves_its_step_undone(gse, tmp_path, word, seen):
    (tmp_path / "test.yaml").write_text(HEAD + "  - power: on\n  - send: PING\n" + CLEANUP)
    with EmulatedSensor(tmp_path, on=word) as sensor:
        gse("procedure", "run", tmp_path / "test.yaml", "--out", tmp_path / "out", "--no-plots")
        assert sensor.supply.read_text() == "off"
    (folder,) = (tmp_path / "out").iterdir()
    steps = json.loads((folder / "report.json").read_text())["procedure"]["steps"]
    assert [step["outcome"] for step in steps] == ["not done", "not done", "PASS", "PASS"]
    assert seen in steps[0]["seen"]


def test_a_switch_that_lies_is_found_by_what_the_sensor_does(gse, tmp_path):
    (tmp_path / "test.yaml").write_text(HEAD + "  - power: off\n  - wait: {until: {state: silent}, at_most: 4s}\n")
    with EmulatedSensor(tmp_path, off="lie"):
        done = gse("procedure", "run", tmp_path / "test.yaml", "--out", tmp_path / "out", "--no-plots")
    assert done.code == EXIT_FAIL
    assert "step 1 PASS: switched" in done.err
    assert "step 2 FAIL: after 4 s state is acquired" in done.err


def test_a_note_answers_the_step_that_waits_for_the_operator(begin, gse, tmp_path):
    with EmulatedSensor(tmp_path):
        process, session = begin("  - ask: {label: serial, text: Serial number}\n", "--view", "web")
        await_step(session, 1)
        gse("note", "answer: SN 12", session.folder)
        assert ended(process) == 0, process.stderr.read()
    _, log = log_of(session)
    assert log["1"] == ("PASS", "SN 12")


def test_a_sensor_on_a_port_is_swept_over_its_exposures(gse, tmp_path):
    with EmulatedSensor(tmp_path) as sensor:
        text = sensor.station.read_text()
        sensor.station.write_text(text.replace("focal_length_px: 4170", "focal_length_px: 4170, " + EXPOSURES))
        done = gse("run", sensor.station, "--out", tmp_path / "out", "--no-plots")
    (folder,) = (tmp_path / "out").iterdir()
    report = json.loads((folder / "report.json").read_text())
    watches = [step for step in report["procedure"]["steps"] if step["number"].endswith(".1.3")]
    assert [step["seen"].partition(":")[0] for step in watches] == [
        "12 of 12 frames of 0.02 s",
        "12 of 12 frames of 0.3 s",
    ], done.err
    assert all(step["rows"] for step in watches)
    gse("replay", folder, "--out", tmp_path / "again")
    (again,) = (tmp_path / "again").iterdir()
    assert (again / "report.json").read_bytes() == (folder / "report.json").read_bytes()


def test_a_note_answers_while_the_time_of_a_simulation_stands_still(begin, gse, tmp_path):
    (tmp_path / "station.yaml").write_text(SIMULATED)
    process, session = begin("  - ask: {label: serial, text: Serial number}\n", "--view", "web")
    await_step(session, 1)
    gse("note", "answer: SN 12", session.folder)
    ended(process)
    assert log_of(session)[1]["1"] == ("PASS", "SN 12")


def test_nothing_is_written_where_the_operator_types_and_a_wrong_answer_is_told_why(tmp_path):
    (tmp_path / "station.yaml").write_text(SIMULATED)
    ask = '  - ask: {label: serial, text: Serial number, expect: "SN \\\\d+"}\n  - wait: {for: 2s}\n'
    (tmp_path / "test.yaml").write_text(HEAD + ask)
    command = [sys.executable, "-m", "gse", "procedure", "run", str(tmp_path / "test.yaml"), "--no-plots"]
    master, slave = os.openpty()
    environment = os.environ | {"TERM": "xterm"}
    process = subprocess.Popen(
        [*command, "--out", str(tmp_path / "out")], stdin=slave, stdout=slave, stderr=slave, env=environment
    )
    os.close(slave)
    came = ""

    def read_until(pattern, within_s=PATIENCE_S):
        nonlocal came
        until_s = time.monotonic() + within_s
        while not re.search(pattern, came) and (left_s := until_s - time.monotonic()) > 0:
            if select.select([master], [], [], left_s)[0]:
                try:
                    came += os.read(master, 4096).decode()
                except OSError:  # Linux says so of a terminal that nobody has open any more
                    return

    try:
        read_until(r"\[type the answer\]\r\n.*> ")
        came = ""
        read_until("nothing", within_s=1.5)  # the status line is renewed twice a second
        os.write(master, b"twelve\n")
        read_until(r"expected SN \\d\+; type the answer\]\r\n.*> ")
        assert came.startswith("twelve\r\n")
        os.write(master, b"SN 12\n")
        read_until("exit code")
        assert "step 1 PASS: SN 12" in came
        process.wait(PATIENCE_S)
    finally:
        process.kill()
        process.wait()
        os.close(master)


@pytest.fixture
def played():
    """A function that gives the URL of a network port, which sends bytes at once and then nothing."""
    servers = []

    def serve(data):
        server = socket.create_server(("127.0.0.1", 0))
        servers.append(server)

        def play():
            client, _ = server.accept()
            servers.append(client)
            client.sendall(data)

        threading.Thread(target=play, daemon=True).start()
        return f"socket://127.0.0.1:{server.getsockname()[1]}"

    yield serve
    for one in servers:
        one.close()


class Noting(Operator):
    """An operator who leaves notes as soon as there are results."""

    def on_results(self, results, session):
        self.notes.put("the first panoramas came")

    def on_event(self, event):
        if event.kind == StationKind.SENSOR_RESET:
            self.notes.put("it started anew")


def test_a_note_stands_where_its_replay_has_it_though_frames_waited_when_it_came(played, tmp_path):
    records = read_capture(FAULTS)
    data = b"".join(one.data for one in records if isinstance(one, RecordedMessage) and one.topic == RX)
    text = SIMULATED.replace("sim://", played(data))
    operator = Noting(Ending(print))
    live = run_live(
        parse_station(text), text, tmp_path, operator, make_listeners=lambda *given: [operator], duration_s=3.0
    )
    again = replay_session(live.folder / "session.mcap").session
    shown, replayed = ([(event.kind, event.text) for event in one.events] for one in (live.session, again))
    assert next(text for kind, text in shown if kind == StationKind.NOTE) == "the first panoramas came"
    assert len({kind for kind, _ in shown}) > 5
    assert shown == replayed
