"""Runs of procedures on a simulated sensor: what each kind of step does, and what ends a run."""

import json
import re
import xml.etree.ElementTree as ET
from concurrent.futures import Future, ThreadPoolExecutor

import pytest
from devices.items_sensor import ITEMS_TEXT

from gse.cli import EXIT_FAIL, EXIT_INCONCLUSIVE
from gse.procedure.desk import Desk
from gse.procedure.engine import OpenRun, Run
from gse.procedure.file import parse_procedure
from gse.procedure.power import Ran as Switched
from gse.station.events import StationKind

STATION = """\
version: 1
sensor: {name: ST-1, rows: 1024, columns: 1024, focal_length_px: 4170}
site: {name: roof, latitude_deg: -6.53, longitude_deg: 106.7, height_m: 250}
port: {url: "sim://"}
"""
SELDOM = STATION.replace("sim://", "sim://?rate_hz=3")
"""The same, with fewer frames in the minutes that a test takes."""
HEAD = "version: 1\nname: SS-TP-07\nstation: station.yaml\n"
CLEANUP = "cleanup:\n  - send: {command: STOP}\n  - power: off\n"


class Ran:
    """What a run left: its exit code, its report, and what it printed."""

    def __init__(self, done, out):
        (self.folder,) = out.iterdir()
        self.code, self.err = done.code, done.err
        self.report = json.loads((self.folder / "report.json").read_text())
        self.steps = {step["number"]: step for step in self.report["procedure"]["steps"]}

    def outcomes(self):
        return {number: step["outcome"] for number, step in self.steps.items()}


@pytest.fixture
def run(gse, tmp_path):
    """A function that runs steps on a simulated sensor."""

    def run_steps(steps, *options, cleanup=CLEANUP, answers=None, station=STATION):
        (tmp_path / "station.yaml").write_text(station)
        (tmp_path / "test.yaml").write_text(HEAD + "steps:\n" + steps + cleanup)
        (tmp_path / "answers.yaml").write_text(json.dumps(answers or {}))
        out = tmp_path / f"out{len([*tmp_path.iterdir()])}"
        words = ["procedure", "run", tmp_path / "test.yaml", "--out", out, "--no-plots"]
        return Ran(gse(*words, "--answers", tmp_path / "answers.yaml", *options), out)

    return run_steps


FUNCTIONAL = """\
  - tell: Take the cap off.
  - ask: {label: serial, text: Serial number on the housing, expect: "SN \\\\d+"}
  - power: on
  - wait: {until: {mode: streaming}, at_most: 30s}
  - send: {command: SET_EXPOSURE, exposure: 50 ms}
  - send: PING
  - check: {supply_v: [4.8, 5.2], temperature_degc: [-20, 40]}
  - watch: {for: 40s, limits: {d_roll_arcsec: 500}, requirements: {mean |dDE|: SS-REQ-101}}
  - repeat: {times: 3, steps: [power: off, wait: {for: 5s}, power: on,
             wait: {until: {state: acquired}, at_most: 30s, measure: first_fix_s}]}
  - check: {first_fix_s: {share: 0.3, at_most: 10}}
"""


def test_a_functional_test_passes_and_its_replay_says_the_same_with_nobody_asked(run, gse, tmp_path):
    ran = run(FUNCTIONAL, answers={"1": "done", "serial": "SN 12"})
    assert set(ran.outcomes().values()) == {"PASS"}
    assert (ran.code, ran.report["verdict"]) == (0, "PASS")
    assert ran.report["conclusion"]["headline"] == "PASS (SIMULATED)"
    log = ran.report["procedure"]
    assert [step["number"] for step in log["steps"]][7:14] == ["8", "9", "9.1.1", "9.1.2", "9.1.3", "9.1.4", "9.2.1"]
    assert (ran.steps["2"]["seen"], ran.steps["2"]["by"]) == ("SN 12", "answers file")
    assert log["power"] == "the supply was left off"
    rows = {row["name"]: row for row in ran.steps["8"]["rows"]}
    assert rows["mean |roll|"]["limit"] == 500
    assert rows["mean |dDE|"]["requirement"]["id"] == "SS-REQ-101"
    assert log["starts"]["first_fix"]["n"] == 4  # one before the watch, three in the repeat
    assert log["starts"]["first_fix"]["median_s"] == pytest.approx(2.1, abs=0.2)  # boots for 2 s, exposes 50 ms

    # A replay has nobody to ask, sends nothing and switches nothing.
    gse("replay", ran.folder, "--out", tmp_path / "again")
    (again,) = (tmp_path / "again").iterdir()
    for name in ("report.json", "report.html", "junit.xml", "frames.csv"):
        assert (again / name).read_bytes() == (ran.folder / name).read_bytes(), name

    cases = [case.get("name") for case in ET.parse(ran.folder / "junit.xml").iter("testcase")]
    assert next(name for name in cases if name.startswith("step")) == "step 1: tell: Take the cap off."
    assert len([name for name in cases if name.startswith("step")]) == len(log["steps"])
    page = (ran.folder / "report.html").read_text()
    assert page.index("As-run log: SS-TP-07") < page.index("The rows of the verdict")
    assert "SIMULATED: no sensor took part" in page
    assert "</strong> At the end the supply was left off." in page
    times = re.findall(r'<td class="utc">(.*) to ', page)
    assert times[0] == f"{log['steps'][0]['from'][:10]}<br>{log['steps'][0]['from'][11:19]}"
    assert times[1] == log["steps"][1]["from"][11:19]  # the date stands where it changes


def test_a_step_that_fails_ends_the_run_and_the_cleanup_is_done(run):
    ran = run("  - check: {supply_v: [5.5, 6]}\n  - send: PING\n")
    assert ran.outcomes() == {"1": "FAIL", "2": "not done", "cleanup 1": "PASS", "cleanup 2": "PASS"}
    assert "supply_v is 5 V (expected 5.5 to 6 V)" in ran.steps["1"]["seen"]
    assert ran.steps["2"]["seen"] == "step 1 FAIL"
    assert (ran.code, ran.report["verdict"]) == (EXIT_FAIL, "FAIL")
    assert ran.report["conclusion"]["reason"].startswith("step 1 FAIL: supply_v is 5 V")
    assert ran.report["procedure"]["deviations"] == ["step 2 was not done"]


TOO_LONG = "SET_EXPOSURE, exposure: 60 s"


@pytest.mark.parametrize(
    ("sent", "outcome", "seen"),
    [
        (f"{TOO_LONG}, expect: refused", "PASS", "the sensor refuses SET_EXPOSURE: out of range after 0."),
        (f"{TOO_LONG}, expect: {{refused: out of range}}", "PASS", "the sensor refuses SET_EXPOSURE: out of range"),
        (
            f"{TOO_LONG}, expect: {{refused: bad CRC}}",
            "FAIL",
            "out of range: SET_EXPOSURE, exposure 60 s; expected the reason bad CRC",
        ),
        (
            "SET_EXPOSURE, exposure: 2 s, expect: refused",
            "FAIL",
            "the sensor accepted SET_EXPOSURE: SET_EXPOSURE, exposure 2 s; expected a refusal (NAK)",
        ),
        ("PING, expect: refused", "FAIL", "STATUS came: PING; expected a refusal (NAK)"),
        ("STOP, expect: refused", "FAIL", "no answer within 0.5 s: expected a refusal (NAK)"),
    ],
)
def test_a_refusal_that_is_expected_is_a_pass_and_no_other_answer_is(run, gse, tmp_path, sent, outcome, seen):
    (tmp_path / "silent.yaml").write_text("text: STOP is not heard\nfirmware: {commands: {STOP: {fault: silent}}}\n")
    station = STATION.replace("sim://", f"sim://?scenario={tmp_path}/silent.yaml")
    ran = run(f"  - send: {{command: {sent}}}\n", station=station, cleanup="cleanup:\n  - power: off\n")
    assert ran.steps["1"]["outcome"] == ran.report["verdict"] == outcome
    assert seen in ran.steps["1"]["seen"]
    (case,) = [case for case in ET.parse(ran.folder / "junit.xml").iter("testcase") if "step 1:" in case.get("name")]
    assert (case.find("failure") is None) == (outcome == "PASS")
    gse("replay", ran.folder, "--out", tmp_path / "again")
    (again,) = (tmp_path / "again").iterdir()
    assert (again / "report.json").read_bytes() == (ran.folder / "report.json").read_bytes()


def test_a_sensor_refuses_what_is_out_of_the_range_of_its_description(run, tmp_path):
    (tmp_path / "sensor.yaml").write_text(ITEMS_TEXT)
    ran = run(
        "  - send: {command: START, period: 50 ms, expect: {refused: out of range}}\n"
        "  - send: {command: SET_MODE, mode: value 9, expect: {refused: out of range}}\n"
        "  - send: {command: SET_MODE, mode: tracking}\n"
        "  - send: {command: SET_MODE, mode: tracking, expect: refused}\n",
        station=STATION + "protocol: sensor.yaml\n",
    )
    assert [ran.steps[n]["outcome"] for n in "1234"] == ["PASS", "PASS", "PASS", "FAIL"]
    assert "mode is tracking: SET_MODE, mode tracking; expected a refusal (NAK)" in ran.steps["4"]["seen"]


@pytest.mark.parametrize(("poll", "outcome"), [("", "FAIL"), (", poll: HEALTH_REQUEST", "PASS")])
def test_a_wait_asks_for_an_item_that_comes_only_when_it_is_asked_for(run, gse, tmp_path, poll, outcome):
    (tmp_path / "sensor.yaml").write_text(ITEMS_TEXT)
    (tmp_path / "slow.yaml").write_text("text: it boots\nfirmware: {items: {mode: [[0, boot], [9, tracking]]}}\n")
    station = STATION.replace("sim://", f"sim://?scenario={tmp_path}/slow.yaml") + "protocol: sensor.yaml\n"
    ran = run(f"  - wait: {{until: {{mode: tracking}}, at_most: 20s{poll}}}\n", station=station)
    assert ran.steps["1"]["outcome"] == outcome
    assert ("mode has not come" in ran.steps["1"]["seen"]) == (outcome == "FAIL")
    gse("replay", ran.folder, "--out", tmp_path / "again")
    (again,) = (tmp_path / "again").iterdir()
    assert (again / "report.json").read_bytes() == (ran.folder / "report.json").read_bytes()


class QuietBench:
    """A bench on which nothing happens but that somebody ends the run; it keeps what is recorded."""

    def __init__(self, reason=""):
        self.reason, self.recorded = reason, []

    def now(self):
        return 0, 0

    def interrupted(self):
        return self.reason

    def record(self, kind, text):
        self.recorded.append((kind, text))


@pytest.mark.parametrize("ends", ["at the first tick", "before any tick"])
def test_a_run_that_is_ended_before_its_first_step_leaves_every_step_by_name(ends):
    bench = QuietBench("Ctrl-C")
    one = Run(parse_procedure(HEAD + "steps:\n  - wait: {for: 5s}\n  - wait: {for: 6s}\n", "test"), Desk())
    one.begin(bench)
    if ends == "at the first tick":
        one.tick()
    else:
        one.finish("Ctrl-C")
    assert one.is_over
    left = [text for kind, text in bench.recorded if kind == StationKind.STEP_DONE]
    assert [text.split(" | ")[:2] for text in left] == [["1", "not done"], ["2", "not done"]]
    assert all("Ctrl-C" in text for text in left)


def test_a_program_that_has_not_begun_is_not_waited_for_when_its_session_ends():
    bench = QuietBench()
    one = OpenRun(parse_procedure(HEAD + "steps:\n  - power: on\n", "test"), Desk())
    one.begin(bench)
    one.finish("an internal error")
    assert bench.recorded[1:] == [
        (StationKind.STEP_DONE, "0 | not done | the steps of the program | an internal error | "),
        (StationKind.PROCEDURE_ENDED, "the supply was not switched"),
    ]


class SwitchedBench(QuietBench):
    """A bench whose supply breaks when it is switched on, and which knows no commands."""

    is_live = False

    def __init__(self):
        super().__init__()
        self.switched = []

    def switch(self, *, on):
        if on:
            raise ZeroDivisionError("of the supply")
        self.switched.append(on)
        done = Future()
        done.set_result(Switched(True, ""))
        return done

    def log(self):
        done = [text.split(" | ") for kind, text in self.recorded if kind == StationKind.STEP_DONE]
        return {number: (outcome, seen) for number, outcome, _, seen, _ in done}


def test_the_cleanup_is_done_after_an_internal_error_which_is_raised_then():
    bench = SwitchedBench()
    steps = "steps:\n  - power: on\n  - wait: {for: 6s}\ncleanup:\n  - send: STOP\n  - power: off\n"
    one = Run(parse_procedure(HEAD + steps, "test"), Desk())
    one.begin(bench)
    one.tick()
    with pytest.raises(ZeroDivisionError, match="of the supply"):
        one.tick()
    one.finish()
    log = bench.log()
    assert bench.switched == [False]
    assert log["1"] == ("not done", "internal error of gse: ZeroDivisionError: of the supply")
    assert log["2"] == ("not done", "an internal error in step 1")
    assert log["cleanup 1"][0] == "not done"
    assert "AttributeError" in log["cleanup 1"][1]
    assert log["cleanup 2"][0] == "PASS"
    assert bench.recorded[-1] == (StationKind.PROCEDURE_ENDED, "the supply was left off")


def test_a_program_that_is_told_an_internal_error_can_still_switch_off():
    bench, session = SwitchedBench(), Future()
    on, off = parse_procedure(HEAD + "steps:\n  - power: on\n  - power: off\n", "test").steps
    one = OpenRun(parse_procedure(HEAD + "steps:\n  - power: on\n", "test"), Desk())
    one.begin(bench)

    def program():
        try:
            one.do(on, session)
        finally:
            assert one.do(off, session)
            one.end("its end")

    with ThreadPoolExecutor(1) as threads:
        told = threads.submit(program)
        one.tick()
        with pytest.raises(ZeroDivisionError, match="of the supply"):
            one.tick()
        with pytest.raises(ZeroDivisionError, match="of the supply"):
            told.result()
    assert bench.log() == {
        "1": ("not done", "internal error of gse: ZeroDivisionError: of the supply"),
        "2": ("PASS", "switched off"),
        "0": ("not done", "its end"),
    }
    assert bench.recorded[-1] == (StationKind.PROCEDURE_ENDED, "the supply was left off")


def test_nothing_interrupts_the_cleanup():
    bench = SwitchedBench()
    steps = "steps:\n  - power: off\ncleanup:\n  - wait: {for: 5s}\n  - power: off\n"
    one = Run(parse_procedure(HEAD + steps, "test"), Desk())
    one.begin(bench)
    one.tick()
    one.tick()
    bench.reason = "Ctrl-C"
    one.tick()
    assert not one.is_over
    one.finish("Ctrl-C")
    assert bench.log() == {
        "1": ("PASS", "switched off"),
        "cleanup 1": ("not done", "no time was left to wait"),
        "cleanup 2": ("PASS", "switched off"),
    }


def test_a_step_may_fail_and_the_run_goes_on(run):
    ran = run("  - check: {supply_v: [5.5, 6]}\n    on_failure: go on\n  - send: PING\n")
    assert ran.outcomes() == {"1": "FAIL", "2": "PASS", "cleanup 1": "PASS", "cleanup 2": "PASS"}
    assert ran.report["verdict"] == "FAIL"


@pytest.mark.parametrize(
    ("steps", "outcome", "seen"),
    [
        ("  - send: {command: START, period: 1 ms}\n", "FAIL", "the sensor refuses START: out of range"),
        ("  - wait: {until: {state: silent}, at_most: 3s}\n", "FAIL", "after 3 s state is acquired  (expected silent)"),
        ("  - check: {power_a: [0, 1], at_most: 2s}\n", "INCONCLUSIVE", "after 2 s no value of power_a had come"),
        ("  - tell: Take the cap off.\n", "not done", "--answers FILE that has a line 1: .."),
        ("  - ask: {label: serial, text: Serial}\n", "not done", "--answers FILE that has a line serial: .."),
    ],
)
def test_an_outcome_says_what_happened(run, steps, outcome, seen):
    ran = run(steps)
    assert (ran.steps["1"]["outcome"], ran.outcomes()["cleanup 2"]) == (outcome, "PASS")
    assert seen.replace("  ", " ") in ran.steps["1"]["seen"].replace("  ", " ")
    assert ran.report["verdict"] == ("FAIL" if outcome == "FAIL" else "INCONCLUSIVE")
    assert ran.code == {"FAIL": EXIT_FAIL, "INCONCLUSIVE": EXIT_INCONCLUSIVE}[ran.report["verdict"]]


def test_the_frames_before_a_start_are_no_link_after_it(run):
    waits = "  - wait: {until: {link: streaming}}\n"
    ran = run(f"{waits}  - power: on\n{waits}  - wait: {{for: 4s}}\n{waits}")
    assert set(ran.outcomes().values()) == {"PASS"}
    assert ran.steps["1"]["seen"].endswith(" s after the step began")
    seen = re.fullmatch(r"it came ([0-9.]+) s after power on", ran.steps["3"]["seen"])
    assert float(seen[1]) > 1  # it boots for 2 s, of which `power` waits for one
    assert ran.steps["5"]["seen"].startswith("it was so already ")


def test_a_sensor_without_power_does_not_answer(run):
    ran = run("  - power: off\n  - send: PING\n    on_failure: go on\n  - wait: {until: {state: silent}}\n")
    assert ran.outcomes()["2"] == "FAIL"
    assert "no answer within 0.5 s: expected the answer STATUS" in ran.steps["2"]["seen"]
    assert ran.outcomes()["3"] == "PASS"
    assert ran.outcomes()["cleanup 1"] == "FAIL"  # and the next is done all the same
    assert ran.outcomes()["cleanup 2"] == "PASS"
    assert "The rows of the verdict" not in (ran.folder / "report.html").read_text()  # nothing was watched


def test_answers_come_from_a_file_and_must_be_what_is_expected(run):
    ask = '  - ask: {label: serial, text: Serial, expect: "SN \\\\d+"}\n'
    assert run(ask, answers={"serial": "SN 7"}).steps["1"]["seen"] == "SN 7"
    wrong = run(ask, answers={"serial": "twelve"})
    assert wrong.steps["1"]["outcome"] == "FAIL"
    assert "'twelve' does not do: expected SN \\d+" in wrong.steps["1"]["seen"]
    refused = run("  - tell: Take the cap off.\n", answers={"1": "no"})
    assert (refused.steps["1"]["outcome"], refused.report["verdict"]) == ("not done", "INCONCLUSIVE")


def test_a_run_may_begin_at_a_step_and_is_not_whole_then(run):
    ran = run("  - check: {supply_v: 9}\n  - send: PING\n", "--from", "2")
    assert ran.outcomes() == {"1": "not done", "2": "PASS", "cleanup 1": "PASS", "cleanup 2": "PASS"}
    assert ran.report["verdict"] == "INCONCLUSIVE"
    assert "the run began at step 2" in ran.steps["1"]["seen"]


def test_data_that_end_in_a_step_leave_it_undone_and_the_cleanup_done(run):
    ran = run("  - wait: {for: 60s}\n  - send: PING\n", station=STATION.replace("sim://", "sim://?frames=50"))
    assert ran.outcomes()["1"] == "not done"
    assert "interrupted by the end of the data" in ran.steps["1"]["seen"]
    assert ran.outcomes()["2"] == "not done"
    assert ran.outcomes()["cleanup 2"] == "PASS"
    assert ran.report["procedure"]["power"] == "the supply was left off"


def test_what_was_measured_is_decided_by_its_share_with_confidence(run):
    steps = (
        "  - repeat: {times: 4, steps: [power: on, "
        "wait: {until: {state: acquired}, at_most: 30s, measure: first_fix_s}]}\n"
        "  - check: {first_fix_s: {share: 0.95, at_most: 10}}\n"
    )
    ran = run(steps)
    assert ran.steps["2"]["outcome"] == "INCONCLUSIVE"  # 4 of 4 show 47 % with 95 % confidence: 0.05 ** (1 / 4)
    assert "4 of 4 within 10, 95.0 % asked, at least 47.3 %" in ran.steps["2"]["seen"]


def test_a_watched_stretch_has_its_own_limits(run):
    ran = run("  - watch: {for: 30s, limits: {output_rate_hz: 50}}\n", station=SELDOM)
    assert ran.steps["1"]["outcome"] == "FAIL"
    assert [row["name"] for row in ran.steps["1"]["rows"] if row["outcome"] == "FAIL"] == ["output rate"]
    assert ran.report["verdict"] == "FAIL"


def test_a_run_whose_steps_pass_cannot_where_the_stated_parameters_never_came(run):
    ran = run("  - wait: {for: 1s}\n", station=STATION + "test: {parameters: {threshold_counts: 120}}\n")
    assert set(ran.outcomes().values()) == {"PASS"}
    assert (ran.code, ran.report["verdict"]) == (EXIT_INCONCLUSIVE, "INCONCLUSIVE")
    assert ran.report["conclusion"]["reason"].startswith("the sensor's parameters never came: send the command")


def test_starts_in_one_line_are_judged_by_the_limit_of_the_station(gse, tmp_path):
    (tmp_path / "station.yaml").write_text(f"{STATION}limits: {{first_fix_s: 10, decision: simple}}\n")
    options = ("--starts", "4", "--off", "3s", "--out", tmp_path / "out", "--no-plots")
    done = gse("run", tmp_path / "station.yaml", *options)
    (folder,) = (tmp_path / "out").iterdir()
    report = json.loads((folder / "report.json").read_text())
    steps = {step["number"]: step for step in report["procedure"]["steps"]}
    assert (done.code, report["verdict"]) == (0, "PASS")
    assert steps["2"]["seen"].startswith("first_fix_s: 4 of 4 within 10")
    assert report["procedure"]["starts"]["first_fix"]["n"] == 4
    assert report["procedure"]["starts"]["first_fix"]["p95_bound_s"] is None  # of four
    assert "a session of its own" in gse("run", "--starts", "4", "--duration", "5s").err


ANSWERS = {"serial": "ST 1", "weather": "clear", **{str(number): "done" for number in range(1, 10)}}


@pytest.mark.parametrize(("like", "steps"), [("functional", 17), ("acquisition", 3 + 30 * 4 + 1), ("night", 9)])
def test_the_examples_run_from_start_to_end_on_a_simulated_sensor(gse, tmp_path, like, steps):
    test, answers = tmp_path / f"{like}.yaml", tmp_path / "answers.yaml"
    assert gse("procedure", "init", test, like).code == 0
    assert gse("procedure", "check", test).code == 0
    answers.write_text(json.dumps(ANSWERS))
    (tmp_path / "station.yaml").write_text(SELDOM)
    options = ("--answers", answers, "--station", tmp_path / "station.yaml", "--out", tmp_path / "out", "--no-plots")
    ran = Ran(gse("procedure", "run", test, *options), tmp_path / "out")
    assert {number: outcome for number, outcome in ran.outcomes().items() if outcome != "PASS"} == {}, ran.err
    assert len(ran.steps) == steps
    assert (ran.code, ran.report["conclusion"]["headline"]) == (0, "PASS (SIMULATED)")
    assert "exists; give another name" in gse("procedure", "init", test).err
