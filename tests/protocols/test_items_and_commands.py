"""Items of any message, commands with arguments, and the answers that prove them; wrong ones are refused by place."""

import math
import re
import struct
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from devices.items_sensor import HEALTHY, ITEMS, ITEMS_TEXT, LINES
from hypothesis import given
from hypothesis import strategies as st

from protocols import (
    Ack,
    Command,
    Condition,
    DescriptionError,
    EncodeError,
    Frame,
    FrameDecoder,
    Message,
    Nak,
    Other,
    PanoramaMessage,
    Protocol,
    load_protocol,
    parse_protocol,
)

OF_LINES = (
    LINES
    + """\
messages:
  ATTITUDE:
    code: ATT
    direction: from sensor
    fields:
      - {name: time, type: decimal, unit: ms}
      - {name: ra, type: decimal, unit: deg}
      - {name: de, type: decimal, unit: deg}
    items:
      - {name: mode, type: word, values: {0: idle, 1: busy}}
      - {name: heater_ma, type: decimal, unit: mA, digits: 1}
      - {name: status, type: hex, bits: {0: hot, 3: dark}}
  OK: {code: OK, direction: from sensor, items: [{name: echo, type: decimal}]}
commands:
  SET_HEATER: {code: HEAT, arguments: [{name: current, type: decimal, unit: mA, range: [0, 500]}], answer: OK}
"""
)


def frame_of(
    message: Message,
    items: Mapping[str, object],
    sequence: int = 0,
    protocol: Protocol = ITEMS,
) -> Frame:
    data = protocol.encode(message, sequence, items=items)  # type: ignore[arg-type]
    (frame,) = FrameDecoder(protocol, from_sensor=True).feed(data)
    assert isinstance(frame, Frame)
    return frame


def health(**changes: object) -> Frame:
    return frame_of(Other("HEALTH", bytes(6)), HEALTHY | changes)


def test_the_bytes_of_items_are_those_of_the_description() -> None:
    payload = struct.pack("<BHhB", 0x12, 5012, -105, 25)
    [frame] = FrameDecoder(ITEMS, from_sensor=True).feed(ITEMS.encode_payload("HEALTH", payload, 7))
    assert isinstance(frame, Frame)
    assert ITEMS.items_of(frame) == {
        "mode": "acquisition",
        "faults": "memory",
        "supply_v": 5.012,
        "detector_degc": -10.5,
        "gain_db": 12.5,
    }
    assert health(
        mode="acquisition", faults={"memory"}, supply_v=5.012, detector_degc=-10.5, gain_db=12.5
    ) == frame._replace(sequence=0)


@given(st.integers(0, 65535), st.integers(-32768, 32767), st.integers(0, 255))
def test_items_come_back_as_they_were_sent(supply: int, degc: int, gain: int) -> None:
    values = {"supply_v": supply / 1000, "detector_degc": degc / 10, "gain_db": gain / 2}
    found = ITEMS.items_of(health(**values))
    assert {name: found[name] for name in values} == pytest.approx(values)


def test_a_panorama_has_items_before_its_objects() -> None:
    message = PanoramaMessage(5000, 0, 0.1, frozenset(), 20.0, np.array([[3.0, 4.0]]), np.array([9.0]))
    frame = frame_of(message, {"background_counts": 517})
    assert ITEMS.items_of(frame) == {"background_counts": 517}
    decoded = ITEMS.decode(frame)
    assert isinstance(decoded, PanoramaMessage)
    assert decoded.xy_px.tolist() == [[3.0, 4.0]]


def test_items_of_a_line_of_text_stand_behind_its_fields() -> None:
    protocol = parse_protocol(OF_LINES, "lines.yaml")
    decoder = FrameDecoder(protocol, from_sensor=True)
    [frame] = decoder.feed(b"ATT,1500,10.5,-3.25,busy,12.5,9\r\n")
    assert isinstance(frame, Frame)
    assert protocol.items_of(frame) == {"mode": "busy", "heater_ma": 12.5, "status": "hot, dark"}
    assert protocol.commands["SET_HEATER"].encode(current="0.25 A") == b"HEAT,250.0\r\n"
    [done] = decoder.feed(b"OK,250\r\n")
    assert isinstance(done, Frame)
    layout = protocol.commands["SET_HEATER"]
    answered = layout.awaited(layout.made(current=250)).take(done)
    assert answered is not None
    assert (answered.is_done, answered.items) == (True, {"echo": 250.0})


def test_standard_fields_of_status_are_items_too() -> None:
    protocol = load_protocol("panorama-v1")
    assert protocol.items["supply_v"].unit == "V"
    payload = struct.pack(">QIIHHhHB3BI", 1, 2, 3, 4, 5, 2150, 5100, 1, 1, 2, 3, 77)
    [frame] = FrameDecoder(protocol, from_sensor=True).feed(protocol.encode_payload("STATUS", payload, 0))
    assert isinstance(frame, Frame)
    assert protocol.items_of(frame) == {
        "frames_taken": 2,
        "frames_sent": 3,
        "commands_ok": 4,
        "commands_bad": 5,
        "temperature_degc": 21.5,
        "supply_v": 5.1,
        "mode": "streaming",
        "serial": 77,
    }


@pytest.mark.parametrize(
    ("name", "number", "colour"),
    [
        ("supply_v", 5.0, 1),
        ("supply_v", 5.15, 2),
        ("supply_v", 5.3, 3),
        ("supply_v", 4.75, 2),
        ("supply_v", math.nan, 3),
        ("detector_degc", -200.0, 1),
        ("detector_degc", 60.1, 3),
        ("gain_db", 1e9, 0),
    ],
)
def test_an_item_has_the_colour_of_its_limits(name: str, number: float, colour: int) -> None:
    assert ITEMS.items[name].colour(number) == colour


@pytest.mark.parametrize(
    "given_as",
    [
        {"period": 200},
        {"period": "200"},
        {"period": "200 ms"},
        {"period": "0.2s"},
        {"period_s": 0.2},
        {"period_ms": 200},
    ],
    ids=str,
)
def test_an_argument_may_have_another_unit(given_as: dict[str, object]) -> None:
    assert ITEMS.commands["START"].made(**given_as) == Command("START", {"period": 200})


@pytest.mark.parametrize(
    ("name", "given_as", "said"),
    [
        ("START", {"period": 50}, "period is 50 ms: expected a number in ms 100 to 1000"),
        ("START", {"period": "5 V"}, "has the unit 'V': known here: ns, us, ms, s, min, h"),
        ("START", {"period": "soon"}, "expected a number in ms, such as 5 ms"),
        ("START", {"periode": 200}, "no argument 'periode'; did you mean period?"),
        ("START", {}, "START needs period=NUMBER in ms 100 to 1000"),
        ("START", {"period": 200, "period_s": 0.2}, "given twice"),
        ("SET_MODE", {"mode": "boot"}, "known are standby, tracking"),
        ("SET_GAIN", {"gain": math.nan}, "expected a number"),
        ("SET_GAIN", {"gain": True}, "expected a number"),
    ],
)
def test_an_argument_that_cannot_be_is_refused(name: str, given_as: dict[str, object], said: str) -> None:
    with pytest.raises(EncodeError) as refused:
        ITEMS.commands[name].made(**given_as)
    assert said in str(refused.value)


def test_a_command_that_is_to_be_refused_says_what_the_wire_can_say() -> None:
    assert ITEMS.commands["START"].free.made(period=50) == Command("START", {"period": 50})
    wrong = ITEMS.commands["SET_MODE"].free.made(mode="value 200")
    assert ITEMS.encode(wrong, 0)[5] == 200
    with pytest.raises(EncodeError, match="known are standby"):
        ITEMS.encode(ITEMS.commands["SET_MODE"].free.made(mode="boots"), 0)


def test_an_argument_without_a_unit_is_refused_in_a_whole_sentence() -> None:
    [period] = ITEMS.commands["START"].arguments
    with pytest.raises(EncodeError, match=r"^period is 50: expected a number 100 to 1000$"):
        replace(period, unit="").value(50)


def test_the_bytes_of_a_command_are_those_of_the_description() -> None:
    assert ITEMS.commands["SET_GAIN"].encode(sequence=3, gain=12.5)[:6] == bytes([0xEB, 0x90, 0x74, 1, 3, 25])


def test_a_command_goes_to_the_address_that_the_station_states() -> None:
    protocol = load_protocol("nsp-polled").with_addresses(0x21, 0x22)
    assert protocol.commands["PING"].encode() == protocol.encode(Command("PING"), 0)
    assert protocol.commands["PING"].encode() != load_protocol("nsp-polled").commands["PING"].encode()


def answers(name: str, given_as: dict[str, object], *frames: Frame) -> tuple[list[bool | None], str]:
    layout = ITEMS.commands[name]
    awaited = layout.awaited(layout.made(**given_as))
    awaited.sent(5)
    found = [awaited.take(frame) for frame in frames]
    return [answer and answer.is_done for answer in found], awaited.late


def test_an_ack_proves_the_command_that_it_names() -> None:
    other, earlier, right = Ack("STOP", 5), Ack("SET_GAIN", 4), Ack("SET_GAIN", 5)
    found, late = answers("SET_GAIN", {"gain": 1}, *(frame_of(message, {}) for message in (other, earlier, right)))
    assert found == [None, None, True]
    assert late.endswith("within 0.5 s: ACK of STOP came, not of SET_GAIN")


def test_a_nak_refuses_whatever_else_would_prove_the_command() -> None:
    found, _ = answers("SET_MODE", {"mode": "tracking"}, frame_of(Nak("SET_MODE", "not in this mode", 5), {}))
    assert found == [False]


def test_a_message_proves_a_command() -> None:
    assert answers("HEALTH_REQUEST", {}, frame_of(Ack("HEALTH_REQUEST", 5), {}), health())[0] == [None, True]


def test_an_item_that_takes_the_value_of_an_argument_proves_a_command() -> None:
    found, late = answers("SET_MODE", {"mode": "tracking"}, health(), frame_of(Ack("SET_MODE", 5), {}))
    assert found == [None, None]
    assert late.endswith("mode is standby (expected tracking)")
    assert answers("SET_MODE", {"mode": "tracking"}, health(), health(mode="tracking"))[0] == [None, True]


@pytest.mark.parametrize(
    ("wanted", "holds"),
    [
        ({"mode": "standby"}, True),
        ({"mode": "boot"}, False),
        ({"supply_v": [4.9, 5.1]}, True),
        ({"supply_v": [None, 4.9]}, False),
        ({"supply_v": "5000 mV"}, True),
        ({"supply_v": 5.0004}, True),
        ({"supply_v": 5.0006}, False),
        ({"mode": "standby", "gain_db": [0, 1]}, False),
        ({"background_counts": [0, 9]}, False),
    ],
    ids=str,
)
def test_a_condition_holds_where_all_items_are_as_wanted(wanted: dict[str, object], holds: bool) -> None:
    condition = Condition(wanted, ITEMS.items)  # type: ignore[arg-type]
    values = ITEMS.items_of(health())
    assert condition.holds(values) is holds
    assert (condition.what_differs(values) == "") is holds


def test_what_differs_says_which_end_of_a_range_is_open() -> None:
    said = [
        Condition({"supply_v": ends}, ITEMS.items).what_differs({"supply_v": 5.0}) for ends in ((None, 4), (6, None))
    ]
    assert said == ["supply_v is 5 V (expected at most 4 V)", "supply_v is 5 V (expected at least 6 V)"]


def test_bits_are_named_in_any_order_and_none_of_them_by_an_empty_text() -> None:
    both = Condition({"faults": "detector,memory"}, ITEMS.items)
    assert both.holds({"faults": "memory, detector"})
    assert both.what_differs({"faults": ""}) == "faults is '' (expected memory, detector)"
    assert Condition({"faults": ""}, ITEMS.items).holds({"faults": ""})


@pytest.mark.parametrize(
    ("wanted", "said"),
    [
        ({"suply_v": 5}, "no item 'suply_v'; did you mean supply_v?"),
        ({"mode": "asleep"}, "known are boot, standby, acquisition, tracking"),
        ({"faults": "memry"}, "faults has no bit memry: known are memory, detector"),
        ({"supply_v": [5, 4]}, "swap them"),
        ({"supply_v": "5 A"}, "known here: uV, mV, V"),
        ({"supply_v": [None, None]}, "both ends are open"),
        ({"supply_v": [1, 2, 3]}, "[low, high]"),
        ({}, "expected items"),
    ],
    ids=str,
)
def test_a_condition_that_cannot_be_is_refused(wanted: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        Condition(wanted, ITEMS.items)  # type: ignore[arg-type]


WRONG = {
    "limits that cross": ("red: [4.75, 5.25]", "red: [4.95, 5.25]", "HEALTH.items[2].limits", "the limits cross"),
    "a range reversed": ("range: [100, 1000]", "range: [1000, 100]", "START.arguments[0].range", "swap them"),
    "limits reversed": ("yellow: [4.9, 5.1]", "yellow: [5.1, 4.9]", "items[2].limits.yellow", "swap them"),
    "limits of a word": ("0x0F, values", "0x0F, limits: {red: [0, 1]}, values", "items[0].limits", "only a number"),
    "an unknown unit": ("unit: degC, scale: 0.1", "unit: degc, scale: 0.1", "items[3].unit", "did you mean degC?"),
    "an item twice": ("name: gain_db", "name: supply_v", "HEALTH.items[4].name", "given twice"),
    "an item of two messages": ("name: gain_db", "name: background_counts", "items[4].name", "an item of PANORAMA"),
    "an item that is a field": ("name: background_counts", "name: exposure", "items[0].name", "is a field"),
    "an array": ("gain_db, type: u8", "gain_db, array: 2, type: u8", "items[4]", "has none"),
    "an unknown answer": ("answer: HEALTH", "answer: HELATH", "HEALTH_REQUEST.answer", "did you mean HEALTH?"),
    "an unknown item": ("answer: {mode: mode}", "answer: {mod: mode}", "answer.mod", "did you mean mode?"),
    "an unknown word": ("answer: {mode: mode}", "answer: {mode: asleep}", "answer.mode", "known are boot"),
    "a code twice": ("code: 0x71", "code: 0x70", "commands.STOP.code", "START already"),
    "a period in volts": ("period, type: u16, unit: ms", "period, type: u16, unit: V", "arguments[0].unit", "ns, us"),
    "an unknown key": ("timeout_s: 5", "timeout: 5", "commands.SET_MODE.timeout", "did you mean timeout_s?"),
    "a command beside a message": ("  STOP: {code: 0x71}", "  ACK: {code: 0x71}", "commands.ACK", "is a message"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_item_or_command_is_refused_by_file_line_and_key(name: str) -> None:
    old, new, key, reason = WRONG[name]
    assert ITEMS_TEXT.count(old) == 1
    with pytest.raises(DescriptionError) as refused:
        parse_protocol(ITEMS_TEXT.replace(old, new), "mine.yaml")
    line = ITEMS_TEXT[: ITEMS_TEXT.index(old)].count("\n") + 1
    assert f"mine.yaml, line {line}: " in str(refused.value)
    assert key in str(refused.value)
    assert reason in str(refused.value)
