"""The procedure file: what it says, and what is refused with file, line and column."""

import math
import re

import pytest
from devices.items_sensor import ITEMS_TEXT
from skies.known_nights import STATION

from gse.config.station import parse_station
from gse.errors import ConfigError
from gse.procedure.file import (
    Ask,
    CheckNow,
    Repeat,
    Send,
    ShareOf,
    SwitchPower,
    Tell,
    Wait,
    Watch,
    check,
    duration_s,
    parse_procedure,
    runs_of,
    seconds_of,
)
from protocols import load_protocol, parse_protocol

HEAD = "version: 1\nname: SS-TP-07\nsteps:\n"
ALL = """\
  - tell: Take the cap off.
  - ask: {label: serial, text: Serial number on the housing, expect: "SN \\\\d+"}
  - power: on
  - wait: {until: {mode: standby}, at_most: 10s}
  - send: {command: SET_EXPOSURE, exposure: 200 ms}
  - check: {supply_v: [4.8, 5.2], temperature_degc: [null, 40]}
  - watch: {for: 10 min, limits: {d_ra_cosde_arcsec: 60}}
    on_failure: go on
  - repeat:
      times: 30
      steps: [power: off, wait: {for: 5s}, power: on,
              wait: {until: {state: acquired}, at_most: 30s, measure: first_fix_s}]
  - check: {first_fix_s: {share: 0.95, at_most: 10}}
cleanup:
  - send: {command: STOP}
  - power: off
"""
PROTOCOL = load_protocol("panorama-v1")
NAK = re.compile(r"  NAK:\n(    .*\n)+")
WITHOUT_NAK = parse_protocol(NAK.sub("", PROTOCOL.text), "panorama-v1.yaml")
SIMULATED = STATION.model_copy(update={"port": STATION.port.model_copy(update={"url": "sim://"})})


def refused(text):
    """Why a text is no procedure, without its head of three lines."""
    with pytest.raises(ConfigError) as error:
        parse_procedure(text, "test.yaml")
    return str(error.value)


def problems(steps, station=SIMULATED):
    return check(parse_procedure(HEAD + steps, "test.yaml"), station, PROTOCOL)


def test_each_kind_of_step_is_read_with_its_times_and_its_words():
    procedure = parse_procedure(HEAD + ALL)
    acts = [step.act for step in procedure.steps]
    assert acts[:3] == [
        Tell("Take the cap off."),
        Ask("serial", "Serial number on the housing", "SN \\d+"),
        SwitchPower(on=True),
    ]
    assert acts[3] == Wait(None, {"mode": "standby"}, 10.0)
    assert acts[4] == Send("SET_EXPOSURE", {"exposure": "200 ms"})
    assert acts[5] == CheckNow({"supply_v": [4.8, 5.2], "temperature_degc": [None, 40]})
    assert acts[6] == Watch(600.0, {"d_ra_cosde_arcsec": 60})
    assert [step.goes_on for step in procedure.steps].index(True) == 6
    assert isinstance(acts[7], Repeat)
    assert (acts[7].times, [step.number for step in acts[7].steps]) == (30, ["8.1", "8.2", "8.3", "8.4"])
    assert acts[8] == CheckNow({}, (ShareOf("first_fix_s", 0.95, 10),))
    assert [step.number for step in procedure.cleanup] == ["cleanup 1", "cleanup 2"]


def test_what_a_step_plans_is_one_line_of_yaml_in_the_words_of_the_file():
    planned = [step.planned for step in parse_procedure(HEAD + ALL).steps]
    assert planned[2] == "power: on"
    assert planned[6] == "watch: {for: 10 min, limits: {d_ra_cosde_arcsec: 60}}"
    again = parse_procedure(HEAD + "".join(f"  - {line}\n" for line in planned))
    assert [step.act for step in again.steps][:7] == [step.act for step in parse_procedure(HEAD + ALL).steps][:7]


def test_no_bit_is_an_empty_text_and_no_value_at_all_is_refused():
    (step,) = parse_procedure(f'{HEAD}  - check: {{faults: ""}}\n').steps
    assert step.act.items == {"faults": ""}
    assert "faults has no value; none of the bits of an item is ''" in refused(f"{HEAD}  - check: {{faults: }}\n")


def test_all_of_it_is_known_to_a_station_and_its_description():
    assert problems(ALL.replace("mode: standby", "mode: streaming")) == []


def test_a_wait_polls_a_command_that_is_known_and_takes_nothing():
    wait = "  - wait: {until: {mode: streaming}, poll: %s}\n"
    assert problems(wait % "PING") == []
    assert "no command 'PIN'; did you mean PING?" in problems(wait % "PIN")[0]
    assert "exposure" in problems(wait % "SET_EXPOSURE")[0]
    assert "has no at_most, measure or poll" in refused(HEAD + "  - wait: {for: 5s, poll: PING}\n")


def test_a_run_takes_between_its_waits_and_its_longest_waits():
    procedure = parse_procedure(HEAD + ALL)
    assert runs_of(procedure.steps) == 9 + 30 * 4
    least_s, longest_s = duration_s(procedure.steps, PROTOCOL, settle_s=1.0)
    assert least_s == 1 + 600 + 30 * (5 + 1)
    assert longest_s == least_s + 10 + PROTOCOL.commands["SET_EXPOSURE"].timeout_s + 15 + 30 * 30 + 15


def test_arguments_named_as_words_of_the_step_stand_in_arguments():
    protocol = parse_protocol(
        ITEMS_TEXT.replace("- {name: gain, type: u8, unit: dB", "- {name: expect, type: u8"), "x.yaml"
    )

    def said(steps):
        return check(parse_procedure(HEAD + steps, "test.yaml"), SIMULATED, protocol)

    assert said("  - send: {command: SET_GAIN, arguments: {expect: 12}}\n") == []
    (problem,) = said("  - send: {command: SET_GAIN, expect: refused}\n")
    assert problem.endswith("expect is a word of the step: write arguments: {expect: ..}")
    (step,) = parse_procedure(HEAD + "  - send: {command: X, gain: 1, arguments: {expect: 100 ms, at_most: 2}}\n").steps
    assert step.act == Send("X", {"gain": 1, "expect": "100 ms", "at_most": 2})
    twice = refused(HEAD + "  - send: {command: X, gain: 1, arguments: {gain: 1}}\n")
    assert "line 4, column 51: gain stands here twice" in twice


@pytest.mark.parametrize(
    ("text", "seconds"), [("10s", 10), ("200 ms", 0.2), ("10 min", 600), ("1h30m", 5400), ("2m 5s", 125)]
)
def test_times_have_units(text, seconds):
    assert seconds_of(text) == pytest.approx(seconds)


@pytest.mark.parametrize(
    ("steps", "words"),
    [
        (
            "  - send: {command: STOP, expect: NAK}\n",
            "line 4, column 35: NAK: expected refused, {refused: REASON}, or no expect",
        ),
        ("  - send: {command: STOP, expect: {refused: }}\n", "line 4, column 44: expected a text"),
        ("  - tel: hello\n", "line 4, column 10: unknown key tel; did you mean tell?"),
        ("  - power: maybe\n", "line 4, column 12: power: maybe: expected on or off"),
        ("  - wait: {for: 5}\n", "line 4, column 17: '5' is not a time; expected one with its unit"),
        ("  - wait: {for: 5s, until: {mode: x}}\n", "line 4, column 11: expected one of for: 5s and until"),
        ("  - wait: {until: {mode: a, mode: b}}\n", "mode stands here twice; leave one out"),
        (
            "  - wait: {until: {state: acquired, link: silent}}\n",
            "a sensor that is acquired is not silent: both never hold",
        ),
        ("  - wait: {until: {state: acquired}, measure: fix}\n", "fix is a time: its name ends in _s"),
        ("  - check: {supply_v: [1, 2, 3]}\n", "line 4, column 23: supply_v: expected [low, high]"),
        ("  - repeat: {times: 0, steps: [power: on]}\n", "line 4, column 21: 0 does not work: expected a whole number"),
        ("  - repeat: {times: 901, steps: [power: on]}\n", "expected a whole number from 1 to 900"),
        ("  - repeat: {times: 300, steps: [power: on, power: off, power: on]}\n", "the run has 901 steps"),
        ("  - repeat: {times: 3, steps: []}\n", "expected a list of steps"),
        ("  - watch: {for: 60s, limits: {d_ra: 60}}\n", "unknown limit d_ra"),
        ("  - watch: {for: 60s, limits: {availability: 2}}\n", "line 4, column 46: availability is 2"),
        (
            "  - check: {first_fix_s: {share: 95, at_most: 10}}\n",
            "share 95 does not work: expected above 0",
        ),
        ("  - ask: {label: a, text: b, expect: '('}\n", "'(' is not a pattern"),
        ("  - power: on\n    on_failure: stop\n", "expected on_failure: go on"),
        ("  - power: on\n    tell: x\n", "a step does one thing, here are 2"),
        (
            "  - power: on\ncleanup:\n  - tell: x\n",
            "line 6, column 11: unknown key tell; known here: power, send",
        ),
        ("  - power: [on\n", "line 5: the text ends in the middle of something"),
        ("  power: on\n", "expected a list of steps, each with a dash"),
        ("  - *x\n", "aliases (*name) are not allowed here"),
    ],
)
def test_what_is_no_step_is_refused_with_its_place(steps, words):
    assert words in refused(HEAD + steps)


def test_what_is_no_procedure_is_refused():
    assert "expected a mapping with the keys version, name" in refused("- power: on\n")
    assert "this gse reads version 1" in refused("version: 2\nname: x\nsteps: [power: on]\n")
    assert "steps is missing" in refused("version: 1\nname: x\n")
    assert "larger than 100000 characters" in refused("#" * 100_001)


@pytest.mark.parametrize(
    ("steps", "words"),
    [
        ("  - send: SET_EXPOSUR\n", "line 4, column 5: step 1: no command 'SET_EXPOSUR'; did you mean SET_EXPOSURE?"),
        ("  - send: {command: SET_EXPOSURE}\n", "SET_EXPOSURE needs exposure=NUMBER"),
        ("  - send: {command: SET_EXPOSURE, exposure: 2 V}\n", "line 4, column 45: step 1: exposure has the unit 'V'"),
        ("  - send: {command: SET_EXPOSURE, gain: 2}\n", "line 4, column 41: step 1: SET_EXPOSURE: no argument 'gain'"),
        (
            "  - send: {command: SET_EXPOSURE, exposure_time: 100 ms}\n",
            "step 1: SET_EXPOSURE: no argument 'exposure_time'; did you mean exposure?",
        ),
        ("  - send: {command: SET_EXPOSURE, exposure: 3 s}\n", "line 4, column 45: step 1: exposure is 3e+06 us"),
        (
            "  - send: {command: START, period: 5000000 s}\n",
            "line 4, column 36: step 1: period cannot be 5000000000.0: on the wire it has 0 to 4294967295 counts",
        ),
        (
            "  - send: {command: SET_EXPOSURE, exposure: 5000 s, expect: refused}\n",
            "line 4, column 45: step 1: exposure cannot be 5000000000.0: on the wire",
        ),
        (
            "  - send: {command: STOP, expect: {refused: out of rang}}\n",
            "line 4, column 35: step 1: no reason 'out of rang'; did you mean out of range?",
        ),
        ("  - check: {suply_v: 5}\n", "line 4, column 22: step 1: no item 'suply_v'; did you mean supply_v?"),
        ("  - check: {supply_v: [5.2, 4.8]}\n", "line 4, column 23: step 1: supply_v: the low end 5.2 is over"),
        ("  - check: {supply_v: 5 kg}\n", "supply_v has the unit 'kg'"),
        ("  - wait: {until: {mode: sleeping}}\n", "mode cannot be 'sleeping': known are"),
        ("  - wait: {until: {state: asleep}}\n", "state cannot be 'asleep': known are lost, acquired, searching"),
        ("  - check: {first_fix_s: {share: 0.9, at_most: 1}}\n", "first_fix_s before; a wait with measure: names it"),
        ("  - repeat: {times: 2, steps: [send: PIN]}\n", "step 1.1: no command 'PIN'; did you mean PING?"),
    ],
)
def test_a_name_that_station_or_description_do_not_know_has_its_place(steps, words):
    (problem,) = problems(steps)
    assert words in problem


def test_a_refusal_is_expected_of_a_value_out_of_range_and_of_a_sensor_that_has_a_nak():
    refused = "  - send: {command: SET_EXPOSURE, exposure: 3 s, expect: {refused: out of range}}\n"
    assert problems(refused) == []
    no_nak = check(parse_procedure(f"{HEAD}{refused}", "test.yaml"), SIMULATED, WITHOUT_NAK)
    assert "line 4, column 58: step 1: panorama-v1 has no message NAK, with which a sensor refuses" in no_nak[0]


def test_a_station_without_a_switch_cannot_be_switched():
    station = parse_station(
        "version: 1\nsensor: {rows: 1024, columns: 1024, focal_length_px: 4170}\n"
        "site: {latitude_deg: 0, longitude_deg: 0}\nport: {url: /dev/ttyUSB0}\n"
    )
    (problem,) = problems("  - power: on\n", station)
    assert "line 4, column 5: step 1: the station file has no power" in problem
    assert problems("  - power: on\n") == []  # a simulated sensor has a supply of its own


def test_an_open_end_of_a_range_is_null():
    (step,) = parse_procedure(HEAD + "  - check: {stars: [4, null]}\n").steps
    assert step.act.items == {"stars": [4, None]}
    assert math.isfinite(step.act.at_most_s)
