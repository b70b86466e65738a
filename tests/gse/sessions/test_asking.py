"""A sensor that must be asked: from standby to the verdict by ``gse run`` alone, and what its replay shows."""

import json
import time
from pathlib import Path

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
