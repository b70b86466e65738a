"""The switch of the supply: a small program that works, hangs, fails and lies."""

import json
import math
import os
import sys
import time

import pytest
from devices.patience import PATIENCE_S
from devices.terminal import Terminal

from gse.config.station import Power, parse_station
from gse.errors import ConfigError
from gse.procedure.power import PowerSwitch, reading_of, run_program
from gse.recording.session_format import PowerReading, read_recorded
from gse.sessions.replay import sealed
from gse.station.events import StationKind
from gse.statistics.session_statistics import power_use
from gse.values.instant import NS_PER_S

SWITCH = """\
import pathlib, subprocess, sys, time
supply, what = pathlib.Path(sys.argv[1]), sys.argv[2]
if what == "read":
    print("5.02 V 310 mA" if supply.read_text() == "on" else "0 0")
elif what == "hang":
    subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    time.sleep(600)
elif what == "fail":
    sys.exit("no such relay")
elif what == "lie":
    print("about half an ampere")
else:
    supply.write_text(what)
    print("relay", what)
"""
STATION = """\
version: 1
sensor: {rows: 1024, columns: 1024, focal_length_px: 4170}
site: {latitude_deg: 0, longitude_deg: 0}
"""


@pytest.fixture
def switch(tmp_path):
    """A function that gives the command of the switch for a word."""
    (tmp_path / "switch.py").write_text(SWITCH)
    (tmp_path / "supply").write_text("off")
    return lambda what: (sys.executable, str(tmp_path / "switch.py"), str(tmp_path / "supply"), what)


def options(switch, *, on="on", off="off", read="read", **more):
    given = {"settle_s": 0.0, "period_s": 3600.0, "timeout_s": 30.0, **more}
    return Power(on=switch(on), off=switch(off), read=switch(read) if read else (), **given)


def test_a_supply_is_switched_and_what_the_program_said_is_an_event(switch, tmp_path):
    with PowerSwitch(options(switch)) as power:
        assert power.switch(on=True).result(PATIENCE_S).is_done
        assert (tmp_path / "supply").read_text() == "on"
        power.switch(on=False).result(PATIENCE_S)
    kinds = [(kind, text) for _, (kind, text) in power.news()]
    assert [kind for kind, _ in kinds] == ["POWER_ON", "POWER_SAID", "POWER_OFF", "POWER_SAID"]
    assert kinds[1][1] == "relay on"
    assert (tmp_path / "supply").read_text() == "off"


def test_a_program_that_hangs_is_killed_with_all_that_it_started(switch):
    began_s = time.monotonic()
    ran = run_program(switch("hang"), 1.0)
    assert not ran.is_done
    assert "did not end within 1 s" in ran.words
    assert time.monotonic() - began_s < PATIENCE_S  # not the ten minutes of the grandchild that holds the pipe


@pytest.mark.parametrize(
    ("what", "words"), [("fail", "ended with 1: no such relay"), ("/no/such", "cannot be started: No such file")]
)
def test_a_program_that_fails_says_why(switch, what, words):
    command = (what,) if what.startswith("/") else switch(what)
    with PowerSwitch(options(switch).model_copy(update={"on": command})) as power:
        ran = power.switch(on=True).result(PATIENCE_S)
    assert not ran.is_done
    assert words in ran.words
    assert power.news()[-1][1][0] == StationKind.POWER_FAILED


def test_a_program_is_never_given_to_a_shell(switch, tmp_path):
    ran = run_program((*switch("on"), f"; touch {tmp_path}/shell", "$(touch dollar)"), 30.0)
    assert ran.is_done
    assert not {"shell", "dollar"} & {*os.listdir(tmp_path), *os.listdir()}


@pytest.mark.parametrize(
    ("printed", "volts", "amperes"),
    [
        ("0.31\n", math.nan, 0.31),
        ("310 mA", math.nan, 0.31),
        ("5.02 V 0.31 A", 5.02, 0.31),
        ("5020mV, 310mA", 5.02, 0.31),
        ("+5.0E+00,3.1E-01\n", 5.0, 0.31),
    ],
)
def test_readings_have_the_units_that_they_are_printed_with(printed, volts, amperes):
    found = reading_of(printed, 7)
    assert found.utc_ns == 7
    assert found.amperes == pytest.approx(amperes)
    assert found.volts == pytest.approx(volts, nan_ok=True)


@pytest.mark.parametrize("printed", ["", "about half an ampere", "nan", "5 V", "1e9", "1 2 3", "0.31 kg"])
def test_what_is_no_reading_is_none(printed):
    assert reading_of(printed, 0) is None


def test_nonsense_is_told_a_few_times_and_not_for_ever(switch):
    with PowerSwitch(options(switch, read="lie", period_s=0.1)) as power:
        told = []
        until_s = time.monotonic() + PATIENCE_S
        while len(told) < 3 and time.monotonic() < until_s:
            told += power.news()
        for _ in range(3):
            power.switch(on=True).result(PATIENCE_S)
    assert "expected amperes, or volts and amperes" in told[0][1][1]
    assert StationKind.POWER_FAILED not in [kind for _, (kind, _) in power.news()]


def test_the_supply_is_read_after_it_is_switched_on(switch):
    with PowerSwitch(options(switch, settle_s=1.0)) as power:
        power.switch(on=True).result(PATIENCE_S)
    readings = [news for _, news in power.news() if isinstance(news, PowerReading)]
    assert readings
    assert readings[0].amperes == pytest.approx(0.31)


def test_currents_are_a_mean_while_on_and_a_greatest_while_settling():
    readings = [
        PowerReading(s * NS_PER_S, a) for s, a in [(1, 9.0), (10, 1.5), (11, 1.0), (13, 0.3), (14, 0.5), (21, 7.0)]
    ]
    use = power_use(readings, [(9 * NS_PER_S, True), (20 * NS_PER_S, False), (0, False)], 2.0)
    assert use.inrush_a == 1.5
    assert use.mean_a == pytest.approx(0.4)


def test_a_sensor_that_nobody_switches_is_on():
    use = power_use([PowerReading(1, 0.25), PowerReading(2, 0.75)], [], 1.0)
    assert use.mean_a == pytest.approx(0.5)
    assert math.isnan(use.inrush_a)


def test_yaml_words_for_on_and_off_are_the_keys():
    station = parse_station(STATION + "power: {on: [relay, 'on'], off: [relay, 'off']}\n")
    assert station.power.on == ("relay", "on")
    assert station.power.off == ("relay", "off")


@pytest.mark.parametrize(
    ("power", "words"),
    [
        ("{on: relay on, off: [relay]}", "line 4: power.on: expected a list of a program and its arguments"),
        ("{on: [relay]}", "power.off is missing"),
        ("{on: [relay], off: [relay], timeout_s: 0}", "power.timeout_s is 0"),
        ("{on: [], off: [relay]}", "power.on is []"),
        ("{on: [relay], off: [relay], reed: [x]}", "unknown key power.reed; did you mean read?"),
    ],
)
def test_a_switch_that_cannot_work_is_refused_with_its_line(power, words):
    with pytest.raises(ConfigError, match=r".") as refused:
        parse_station(f"{STATION}power: {power}\n")
    assert words in str(refused.value)


def test_the_station_of_a_session_switches_nothing():
    station = sealed(parse_station(STATION + "power: {on: [relay], off: [relay], read: [meter]}\n"))
    assert "relay" not in (*station.power.on, *station.power.off)
    assert station.power.read == ()


def test_a_session_records_the_supply_and_its_replay_says_the_same(gse, switch, tmp_path):
    terminal = Terminal(tmp_path / "tty")
    read = str(list(switch("read")))
    (tmp_path / "supply").write_text("on")
    station = tmp_path / "station.yaml"
    station.write_text(
        f"{STATION}port: {{url: {terminal.path}}}\nlimits: {{mean_current_a: 0.5}}\n"
        f"power: {{on: [relay], off: [relay], read: {read}, period_s: 0.1}}\n"
    )
    gse("run", station, "--duration", "2s", "--out", tmp_path / "out")
    (folder,) = (tmp_path / "out").iterdir()
    recorded = read_recorded(folder / "session.mcap")
    assert recorded.power
    assert recorded.power[0].volts == pytest.approx(5.02)
    live = json.loads((folder / "report.json").read_text())
    row = next(row for row in live["measurements"] if row["name"] == "mean current")
    assert (row["value"], row["outcome"]) == (0.31, "PASS")
    (tmp_path / "supply").unlink()  # a replay reads no supply
    replayed = gse("replay", folder, "--out", tmp_path / "again", "--json")
    assert json.loads(replayed.out) == live
