"""A simulated sensor of any protocol: items drift, commands set them, a scenario spoils the answers."""

import json
from collections import Counter
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner, Result
from devices.items_sensor import ITEMS, ITEMS_TEXT

from drivers.errors import CommandError
from gse.cli.sensor import command
from gse.cli.simulate import command as simulate
from gse.config.station import BUILT_IN_TEXT
from gse.errors import ConfigError
from gse.sessions.replay import replay_session
from gse.simulator.items import SimulatedItems
from gse.simulator.scenario import Firmware
from protocols import Command

NS = 1_000_000_000


@pytest.fixture
def station(tmp_path: Path) -> Path:
    (tmp_path / "sensor.yaml").write_text(ITEMS_TEXT, encoding="utf-8")
    path = tmp_path / "station.yaml"
    path.write_text(f"{BUILT_IN_TEXT.replace('protocol: panorama-v1', '')}\nprotocol: sensor.yaml\n", encoding="utf-8")
    return path


def send(station: Path, *words: str, **firmware: object) -> Result:
    scenario = station.with_name("scenario.yaml")
    scenario.write_text(yaml.safe_dump({"text": "items", "seconds": 60, "firmware": firmware}), encoding="utf-8")
    port = f"sim://?standby=yes&scenario={scenario}"
    out = str(station.parent / "out")
    return CliRunner().invoke(
        command, ["send", *words, "--station", str(station), "--port", port, "--out", out, "--json"]
    )


def test_a_command_sets_the_item_that_proves_it(station: Path) -> None:
    result = send(station, "SET_MODE", "mode=tracking")
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert (document["answer"], document["items"]["mode"]) == ("HEALTH", "tracking")


def test_a_message_answers_the_command_that_asks_for_it(station: Path) -> None:
    items = {"supply_v": [[0, 4.2]], "mode": [[0, "boot"], [3600, "standby"]], "faults": [[0, "memory, detector"]]}
    document = json.loads(send(station, "HEALTH_REQUEST", items=items).stdout)
    assert document["items"] == {
        "mode": "boot",
        "faults": "memory, detector",
        "supply_v": 4.2,
        "detector_degc": 0.0,
        "gain_db": 0.0,
    }


def test_an_ack_answers_a_command_and_its_argument_is_read_back() -> None:
    items = SimulatedItems(ITEMS, Firmware())
    items.obey(Command("SET_GAIN", {"gain": 12.5}))
    assert items.values(5 * NS)["gain_db"] == 12.5
    assert [type(answer).__name__ for answer in items.answers(Command("SET_GAIN", {"gain": 12.5}), 3)] == ["Ack"]
    items.power_on(6 * NS)
    assert items.values(7 * NS)["gain_db"] == 0.0


def test_an_item_drifts_as_the_scenario_says() -> None:
    items = SimulatedItems(ITEMS, Firmware(items={"detector_degc": ((0, 20), (100, 70))}))
    items.power_on(1000 * NS)
    assert [items.values((1000 + s) * NS)["detector_degc"] for s in (0, 50, 200)] == [20, 45, 70]


@pytest.mark.parametrize(
    ("words", "fault", "said"),
    [
        (["SET_GAIN", "gain=3"], {"fault": "nak"}, "the sensor refuses SET_GAIN: unknown"),
        (["SET_GAIN", "gain=3"], {"fault": "silent"}, "did not answer"),
        (["SET_GAIN", "gain=3"], {"fault": "wrong"}, "ACK of START came"),
        (["SET_GAIN", "gain=3"], {"fault": "late", "late_s": 9}, "did not answer"),
        (["SET_MODE", "mode=tracking"], {"fault": "wrong"}, "mode is boot (expected tracking)"),
        (["HEALTH_REQUEST"], {"fault": "silent"}, "did not answer"),
    ],
    ids=lambda of: "-".join(of) if isinstance(of, list) else str(of),
)
def test_a_spoiled_answer_proves_nothing(station: Path, words: list[str], fault: dict[str, object], said: str) -> None:
    result = send(station, *words, commands={words[0]: fault})
    assert isinstance(result.exception, CommandError), result.output
    assert said in str(result.exception)


@pytest.mark.parametrize(
    ("firmware", "tubes", "healths"),
    [
        ({}, 8, 0),
        ({"items_every_s": 0.5}, 16, 0),
        ({"items_every_s": {"HEALTH": 0.25, "TUBE": 4}}, 2, 32),
    ],
    ids=["once a second", "all", "by name"],
)
def test_messages_come_unasked_at_their_rates(station: Path, firmware: object, tubes: int, healths: int) -> None:
    tube = "  TUBE: {code: 0x0A, direction: from sensor, items: [{name: tube_degc, type: i16, scale: 0.1}]}\n"
    (station.parent / "sensor.yaml").write_text(ITEMS_TEXT.replace("  ACK:\n", f"{tube}  ACK:\n"), encoding="utf-8")
    scenario, session = station.with_name("scenario.yaml"), station.with_name("session.mcap")
    scenario.write_text(yaml.safe_dump({"text": "items", "seconds": 8, "firmware": firmware}), encoding="utf-8")
    options = ["--station", str(station), "--scenario", str(scenario), "--file", str(session)]
    assert CliRunner().invoke(simulate, options).exit_code == 0
    housekeeping = replay_session(session).session.housekeeping
    came = Counter(housekeeping.items[at].name for at in housekeeping.rows["item"])
    assert came["tube_degc"] in (tubes, tubes + 1)  # the first comes when it begins
    assert came["gain_db"] in (healths, healths + (healths > 0))


def test_a_late_answer_within_the_time_out_and_a_fault_that_is_over_are_fine(station: Path) -> None:
    late = {"SET_MODE": {"fault": "late", "late_s": 3}}
    assert send(station, "SET_MODE", "mode=tracking", commands=late).exit_code == 0
    once = {"SET_GAIN": {"fault": "silent", "times": 1}}
    assert send(station, "SET_GAIN", "gain=3", commands=once).exit_code == 0


@pytest.mark.parametrize(
    ("firmware", "said"),
    [
        (Firmware(items={"suply_v": ((0, 1),)}), "firmware.items: no item 'suply_v'; did you mean supply_v?"),
        (Firmware(commands={"SET_GAINS": {"fault": "nak"}}), "no command 'SET_GAINS'; did you mean SET_GAIN?"),  # type: ignore[dict-item]
        (Firmware(items_every_s={"HEALT": 1}), "no message that has items only 'HEALT'; did you mean HEALTH?"),
    ],
    ids=["item", "command", "message"],
)
def test_a_scenario_that_names_what_is_not_there_is_refused(firmware: Firmware, said: str) -> None:
    with pytest.raises(ConfigError) as refused:
        SimulatedItems(ITEMS, firmware)
    assert said in str(refused.value)


def test_help_shows_the_commands_of_the_station(station: Path) -> None:
    shown = CliRunner().invoke(command, ["send", "--help", "--station", str(station)]).output
    assert "SET_GAIN" in shown
    assert "gain=NUMBER in dB 0 to 30; proved by the answer ACK within 0.5 s" in " ".join(shown.split())
    assert "RESET sent once, nothing proves it" in " ".join(shown.split())
    one = CliRunner().invoke(command, ["send", "SET_MODE", "--help", "--station", str(station)]).output
    assert "mode=standby | tracking" in one
    assert "SET_GAIN" not in one


def test_what_cannot_be_sent_is_refused_before_a_port_is_opened(station: Path) -> None:
    assert "did you mean SET_MODE?" in str(send(station, "SET_MOD", "mode=tracking").exception)
    assert "expected key=value" in send(station, "SET_MODE", "tracking").output
    assert not (station.parent / "out").exists()
