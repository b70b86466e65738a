"""A sensor that must be asked: from standby to the verdict by ``gse run`` alone, and what its replay shows."""

import json
import time
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from devices.command_line import runner
from devices.patience import PATIENCE_S
from devices.terminal import Terminal

from drivers.chunk import LinkEvent, LinkKind
from drivers.link import SerialLink
from drivers.session_file.reader import read_capture
from drivers.session_file.records import TX, RecordedMessage
from gse.config.choice import change_to
from gse.config.station import BUILT_IN_TEXT, PollOptions, parse_station
from gse.errors import ConfigError, UsageError
from gse.inspection.plausibility import CheckOutcome
from gse.inspection.preflight import checks
from gse.sessions.asking import Asking
from gse.sessions.replay import replay_session
from gse.station.events import StationKind
from gse.station.polling import Polling, check_asking
from gse.station.results import LinkCounters
from gse.values.instant import from_text
from protocols import Command, FrameDecoder, load_protocol

NSP = load_protocol("nsp-polled")


def station_file(folder: Path, **changes: object) -> Path:
    """The built-in station with other sections, ``sensor`` and ``port`` added to."""
    document = yaml.safe_load(BUILT_IN_TEXT)
    for key, value in changes.items():
        document[key] = document[key] | value if isinstance(value, dict) and key in document else value
    path = folder / "station.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return path


def scenario(folder: Path, **answers: object) -> Path:
    path = folder / "scenario.yaml"
    document = {"text": "spoiled answers", "seconds": 12, "rate_hz": 10, "firmware": {"answers": answers}}
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return path


def ran(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], station: Path, *, code: int = 5
) -> tuple[dict[str, dict[str, int]], Path]:
    """The report of a run, and its session; the replay gives the same report. Most are too short for a verdict."""
    gse = runner(capsys)
    done = gse("run", "--station", station, "--out", tmp_path / "runs", "--view", "none")
    assert done.code == code, done.err
    [session] = (tmp_path / "runs").glob("*/session.mcap")
    gse("replay", session, "--out", tmp_path / "replays")
    [replayed] = (tmp_path / "replays").glob("*/report.json")
    report = session.with_name("report.json").read_text()
    assert replayed.read_text() == report
    return json.loads(report), session


@pytest.mark.parametrize(
    ("protocol", "sensor"),
    [
        ("nsp-polled", {"poll": {"period_ms": 200, "timeout_ms": 100}}),
        ("panorama-slip-xxhash", {"poll": {"period_ms": "asap", "timeout_ms": 300}}),
        ("ccsds-packets", {"start": {"period_ms": 100}}),
    ],
)
def test_a_sensor_in_standby_is_asked_and_its_replay_sends_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], protocol: str, sensor: dict[str, object]
) -> None:
    station = station_file(
        tmp_path, protocol=protocol, sensor=sensor, port={"url": "sim://?standby=yes&frames=60&rate_hz=10"}
    )
    report, session = ran(tmp_path, capsys, station)
    assert report["link"]["frames"] >= 28
    assert report["link"]["unanswered"] == report["link"]["unasked"] == 0
    sent = [
        record.data for record in read_capture(session) if isinstance(record, RecordedMessage) and record.topic == TX
    ]
    assert len(sent) == (report["link"]["requests"] or 2)  # START and STOP


def test_answers_that_are_late_doubled_missing_or_of_others_are_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spoiled = scenario(tmp_path, never=0.2, twice=0.2, late=0.2, late_ms=60, foreign=0.2, echoes=True)
    station = station_file(
        tmp_path,
        protocol="nsp-polled",
        sensor={"poll": {"period_ms": 200, "timeout_ms": 100}},
        port={"url": f"sim://?standby=yes&scenario={spoiled}"},
    )
    report, _ = ran(tmp_path, capsys, station, code=1)
    link = report["link"]
    assert link["requests"] == pytest.approx(60, abs=1)
    for key in ("unanswered", "late_answers"):
        assert 4 <= link[key] <= 25, key
    discarded = link["discarded_bytes_by_reason"]
    assert set(discarded) == {"echo", "not for us"}
    assert discarded["echo"] == link["requests"] * len(NSP.encode(Command("REQUEST"), 0))


def sent(mono_ns: int) -> LinkEvent:
    return LinkEvent(mono_ns, mono_ns, LinkKind.SENT, NSP.encode(Command("REQUEST"), 0).hex())


def test_three_requests_without_an_answer_are_one_event() -> None:
    counters = LinkCounters()
    polling = Polling(NSP, counters, timeout_ns=50)
    events = [event.kind for n in range(6) for event in polling.sent(sent(100 * n))]
    assert events == [StationKind.UNANSWERED]
    assert (counters.requests, counters.unanswered) == (6, 5)
    polling.answered(560)
    polling.answered(565)  # the late answer to the one before
    assert (counters.unanswered, counters.late_answers, counters.unasked) == (4, 2, 0)


def test_a_command_of_another_master_is_an_event_and_an_echo_is_none() -> None:
    polling = Polling(NSP, LinkCounters(), timeout_ns=50)
    polling.sent(sent(0))
    assert polling.echoed(NSP.encode(Command("REQUEST"), 0), 1, 1) == []
    [event] = polling.echoed(bytes.fromhex("C00E118012AB") + b"\xc0", 1, 1)
    assert event.kind == StationKind.SECOND_MASTER
    assert polling.echoed(b"\xc0other\xc0", 2, 2) == []


def test_a_live_port_is_asked_in_time_while_the_station_is_busy(tmp_path: Path) -> None:
    """Nothing fetches for a while: requests go out all the same, on their grid."""
    terminal = Terminal(tmp_path / "tty")
    with SerialLink(str(terminal.path)) as link:
        with Asking(link, NSP, PollOptions(period_ms=20, timeout_ms=10)):
            got = b""
            until_s = time.monotonic() + PATIENCE_S
            while got.count(b"\xc0") < 40 and time.monotonic() < until_s:
                got += terminal.read(64)
        decoder = FrameDecoder(NSP, from_sensor=False)
        assert sum(type(item).__name__ == "Frame" for item in decoder.feed(got)) >= 19
        stamps = [
            item.mono_ns for item in link.receive(0.1) if isinstance(item, LinkEvent) and item.kind == LinkKind.SENT
        ]
    assert len(stamps) >= 19
    terminal.unplug()


def test_start_and_poll_together_are_refused() -> None:
    text = BUILT_IN_TEXT.replace("  rows:", "  start: {period_ms: 100}\n  poll: {period_ms: 200}\n  rows:")
    with pytest.raises(ConfigError, match="start and poll: expected one of the two"):
        parse_station(text)


@pytest.mark.parametrize(
    ("protocol", "sensor", "advice"),
    [
        ("attitude-quaternion", {"poll": {}}, "has no REQUEST"),
        ("panorama-v1", {"start": {"period_ms": 2}}, "one answer takes 18.8 ms on the line at 115200 baud"),
    ],
)
def test_what_the_protocol_or_the_line_cannot_do_is_refused_before_the_port_opens(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], protocol: str, sensor: dict[str, object], advice: str
) -> None:
    station = station_file(tmp_path, protocol=protocol, sensor=sensor)
    done = runner(capsys)("run", "--station", station, "--out", tmp_path / "runs")
    assert (done.code, advice in done.err) == (2, True)
    assert not (tmp_path / "runs").exists()
    checked = runner(capsys)("config", "check", station)
    assert (checked.code, advice in checked.err) == (2, True)
    found = next(
        check for check in checks(parse_station(station.read_text()), tmp_path, 1.0) if check.name == "protocol"
    )
    assert (found.outcome, advice in found.text) == (CheckOutcome.FAIL, True)


def test_parity_and_stop_bits_count_in_what_the_line_can_carry() -> None:
    text = BUILT_IN_TEXT.replace("  rows:", "  start: {period_ms: 19}\n  rows:")
    plain = parse_station(text)
    slower = parse_station(text.replace("url: sim://", "url: sim://\n  parity: even\n  stop_bits: 2"))
    check_asking(plain.sensor, plain.port, load_protocol(plain.protocol))
    with pytest.raises(UsageError, match=r"one answer takes 22\.5 ms"):
        check_asking(slower.sensor, slower.port, load_protocol(slower.protocol))


def test_a_replay_with_another_address_judges_another_sensor_of_the_line() -> None:
    golden = Path(__file__).parents[3] / "replays" / "golden" / "nsp-polled.mcap"
    own = replay_session(golden).session
    others = replay_session(golden, station=change_to(None, address=0x0F)).session
    assert 0 < len(others.frames) < 20 < len(own.frames)
    assert others.link.bytes_in == own.link.bytes_in


# A sweep over exposures.

SWEEP = {"exposures_s": [0.05, 0.2], "frames_each": 30}


def swept(report: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """The steps of a sweep, by their numbers."""
    return {step["number"]: step for step in report["procedure"]["steps"]}


def test_each_exposure_is_commanded_and_judged_by_frames_of_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # It thinks for long: frames that come when a watch begins were exposed before it.
    document = {"text": "slow", "seconds": 60, "rate_hz": 10, "firmware": {"delay_ms": 400}}
    (tmp_path / "scenario.yaml").write_text(yaml.safe_dump(document), encoding="utf-8")
    sensor = SWEEP | {"time": {"delay_ms": {"value": 400, "uncertainty": 1}}}
    port = {"url": f"sim://?scenario={tmp_path / 'scenario.yaml'}"}
    report, session = ran(tmp_path, capsys, station_file(tmp_path, sensor=sensor, port=port))
    steps = swept(report)
    frames = replay_session(session).session.frames.columns
    for group, exposure in (("1", "0.05 s"), ("2", "0.2 s")):
        sent, seen, watched = (steps[f"{group}.1.{n}"] for n in (1, 2, 3))
        assert (sent["outcome"], sent["planned"]) == ("PASS", f"send: {{command: SET_EXPOSURE, exposure: {exposure}}}")
        assert (seen["outcome"], seen["seen"][:8]) == ("PASS", "it came ")
        assert watched["seen"].startswith(f"30 of 30 frames of {exposure}: ")
        judged = (frames["utc_ns"] > from_text(watched["from"])) & (frames["utc_ns"] < from_text(watched["until"]))
        assert (np.isclose(frames["exposure_s"], float(exposure[:-2])) & judged).sum() >= 30
        rows = {row["name"]: row for row in watched["rows"]}
        assert rows["availability"]["value"] == 1.0
        assert rows["mean |dRA*|"]["value"] < 60
    left_out = [item for item in report["exclusions"] if item["frames"] and item["reason"].startswith("no step")]
    waits = ["1.1.2, wait: {until: {exposure_s: [0.0495, 0.0505]}", "2.1.2, wait: {until: {exposure_s: [0.198, 0.202]}"]
    for item, wait in zip(left_out, waits, strict=True):
        assert f"the last one in it is {wait}" in item["reason"]
    assert report["verdict"] == "INCONCLUSIVE"  # 30 frames show no 1 % of false answers


def test_a_sensor_that_forgets_its_exposure_has_no_other_one_judged_with_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    url = "sim://?standby=yes&scenario=" + str(tmp_path / "scenario.yaml")
    document = {"text": "a restart", "seconds": 60, "rate_hz": 10, "firmware": {"resets_s": [3], "boot_s": 0.5}}
    (tmp_path / "scenario.yaml").write_text(yaml.safe_dump(document), encoding="utf-8")
    sensor = {"exposures_s": [0.1], "frames_each": 60, "start": {"period_ms": 100}}
    report, _ = ran(tmp_path, capsys, station_file(tmp_path, sensor=sensor, port={"url": url}))
    watched = swept(report)["1.1.3"]
    came = int(watched["seen"].partition(" of 60 frames of 0.1 s: ")[0])
    assert 10 <= came < 40
    [other] = [item for item in report["exclusions"] if item["reason"] == "the exposure was 0.05 s, expected 0.1 s"]
    assert other["frames"] > came


def test_an_exposure_that_is_refused_leaves_the_others_tested(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    firmware = {"commands": {"SET_EXPOSURE": {"fault": "nak", "times": 1}}}
    document = {"text": "a refusal", "seconds": 60, "rate_hz": 10, "firmware": firmware}
    (tmp_path / "scenario.yaml").write_text(yaml.safe_dump(document), encoding="utf-8")
    port = {"url": f"sim://?scenario={tmp_path / 'scenario.yaml'}"}
    report, _ = ran(tmp_path, capsys, station_file(tmp_path, sensor=SWEEP, port=port), code=1)
    steps = swept(report)
    assert [steps[number]["outcome"] for number in ("1", "1.1.1", "2.1.1", "2.1.2")] == ["FAIL", "FAIL", "PASS", "PASS"]
    assert steps["2.1.3"]["seen"].startswith("30 of 30 frames of 0.2 s: ")
    assert any("refuses SET_EXPOSURE" in reason and "exposure 0.05 s" in reason for reason in report["reasons"])


@pytest.mark.parametrize(
    ("sensor", "message"),
    [
        ({"poll": {"period_ms": "fast"}}, "sensor.poll.period_ms is 'fast': expected a number"),
        ({"exposures_s": []}, "expected a list of 1 to 100 exposures, such as [0.05, 0.1, 0.2], came none"),
        ({"exposures_s": 0.1}, "came 0.1"),
        ({"exposures_s": [n + 1 for n in range(101)]}, "came 101 of them"),
        ({"exposures_s": ["fast"]}, "sensor.exposures_s is 'fast': expected a number"),
        ({"exposures_s": [0.1, -1]}, "expected more than 0"),
        ({"exposures_s": [0.2, 0.1, 0.201]}, "two exposures differ by less than 2 %"),
        ({"exposures_s": [0.1], "frames_each": 0}, "sensor.frames_each is 0: expected at least 1"),
        ({"exposures_s": [0.1, 30]}, "sensor.exposures_s: 30 s does not work: exposure is 3e+07 us"),
    ],
)
def test_what_cannot_be_asked_or_commanded_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sensor: dict[str, object], message: str
) -> None:
    station = station_file(tmp_path, sensor=sensor)
    for command in (("config", "check", station), ("run", station, "--out", tmp_path / "runs")):
        done = runner(capsys)(*command)
        assert done.code == 2
        assert message in done.err
    assert not (tmp_path / "runs").exists()


def test_a_sweep_needs_a_command_an_exposure_on_the_wire_and_a_session_of_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    gse, exposures = runner(capsys), {"exposures_s": [0.1, 0.2]}
    done = gse("config", "check", station_file(tmp_path, sensor=exposures, protocol="nsp-polled"))
    assert (done.code, "nsp-polled has no command SET_EXPOSURE" in done.err) == (2, True)
    text = resources.files("protocols").joinpath("panorama-v1.yaml").read_text(encoding="utf-8")
    field = "      - {name: exposure, type: u32, unit: us}\n"
    assert field in text
    (tmp_path / "mute.yaml").write_text(text.replace(field, "      - {name: spare, type: u32}\n", 1), encoding="utf-8")
    done = gse("config", "check", station_file(tmp_path, sensor=exposures, protocol=str(tmp_path / "mute.yaml")))
    assert (done.code, "nothing shows when a new one is in force" in done.err) == (2, True)
    done = gse("run", station_file(tmp_path, sensor=exposures), "--duration", "5m")
    assert (done.code, "leave out --duration" in done.err) == (2, True)
    with pytest.raises(ConfigError, match=r"sensor\.exposures_s beside port\.pass_to"):
        parse_station(station_file(tmp_path, sensor=exposures, port={"url": "/dev/a", "pass_to": "/dev/b"}).read_text())
