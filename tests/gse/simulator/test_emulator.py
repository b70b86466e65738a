"""The emulated sensor behind a real terminal and a real socket, spoken to through the real driver."""

import contextlib
import itertools
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import serial
from click.testing import CliRunner
from devices.patience import PATIENCE_S

from drivers.chunk import Chunk, LinkEvent, LinkKind
from drivers.clock import read_clock
from drivers.link import SerialLink
from gse.cli.emulate import command
from gse.config.station import BUILT_IN_TEXT, Station, parse_station
from gse.errors import UsageError
from gse.inspection.plausibility import CheckOutcome
from gse.inspection.preflight import checks
from gse.sessions.live import Ending, Operator, run_live
from gse.sessions.replay import replay_session
from gse.simulator.device import detector_of, firmware_of, scenario_of
from gse.simulator.emulator import READ_BYTES, Emulator, Endpoint, TcpEndpoint
from gse.simulator.firmware import Detector
from gse.simulator.pty_endpoint import PtyEndpoint
from gse.station.frame_results import FrameResults
from gse.station.session_data import SessionData
from gse.values.instant import NS_PER_S
from protocols import (
    Ack,
    Command,
    Frame,
    FrameDecoder,
    Message,
    PanoramaMessage,
    StatusMessage,
    load_protocol,
)

STATION = parse_station(BUILT_IN_TEXT)
PROTOCOL = load_protocol("panorama-v1")
OPTIONS = {"rate_hz": "20"}
BAUDRATE = 921600


@pytest.fixture(scope="module")
def detector() -> Detector:
    scenario = scenario_of(OPTIONS, STATION)
    made = detector_of(STATION, scenario, OPTIONS)
    made.expose(scenario.start_utc_ns, 0.05, 20.0)
    return made


@contextlib.contextmanager
def emulated(
    endpoint: Endpoint, detector: Detector, standby: str = "no", *, station: Station = STATION, baudrate: int = BAUDRATE
) -> Iterator[str]:
    """A sensor at work on an endpoint; gives the address to open."""
    scenario = scenario_of(OPTIONS, station)
    offset_ns = scenario.start_utc_ns - read_clock().utc_ns
    firmware = firmware_of(station, scenario, OPTIONS | {"standby": standby}, detector, scenario.start_utc_ns)
    stopped = threading.Event()
    emulator = Emulator(firmware, endpoint, lambda: read_clock().utc_ns + offset_ns, baudrate=baudrate)
    thread = threading.Thread(target=emulator.run, args=[stopped.is_set])
    thread.start()
    try:
        yield endpoint.address
    finally:
        stopped.set()
        thread.join(PATIENCE_S)
        endpoint.close()


class Listener:
    """Messages that come through a link."""

    def __init__(self, link: SerialLink) -> None:
        self._link = link
        self._decoder = FrameDecoder(PROTOCOL)
        self.heard: list[Message] = []

    def until(self, enough: Callable[[list[Message]], bool]) -> list[Message]:
        began_ns = read_clock().mono_ns
        while not enough(self.heard):
            assert read_clock().mono_ns < began_ns + PATIENCE_S * 1e9, f"only heard {self.heard}"
            for item in self._link.receive(0.2):
                if isinstance(item, Chunk):
                    pieces = self._decoder.feed(item.data)
                    self.heard += [PROTOCOL.decode(piece) for piece in pieces if isinstance(piece, Frame)]
        return self.heard


def panoramas(heard: list[Message]) -> list[PanoramaMessage]:
    return [message for message in heard if isinstance(message, PanoramaMessage)]


@pytest.mark.parametrize("make", [PtyEndpoint, lambda: TcpEndpoint("127.0.0.1", 0)], ids=["pty", "tcp"])
def test_commands_are_obeyed_as_the_interface_says(make: Callable[[], Endpoint], detector: Detector) -> None:
    with emulated(make(), detector, standby="yes") as address, SerialLink(address, BAUDRATE) as link:
        listener = Listener(link)
        link.send(PROTOCOL.encode(Command("PING"), 0))
        status = listener.until(lambda heard: len(heard) == 1)[0]
        assert isinstance(status, StatusMessage)
        assert status.mode == "standby"
        link.send(PROTOCOL.encode(Command("START", {"period": 50}), 1))
        heard = listener.until(lambda heard: len(panoramas(heard)) == 10)
        assert heard[1] == Ack("START", 1)
        assert [message.frame_no for message in panoramas(heard)] == list(range(10))
        tags_us = [message.time_us for message in panoramas(heard)]
        assert {later - earlier for earlier, later in itertools.pairwise(tags_us)} <= {50_000, 50_001}
        link.send(PROTOCOL.encode(Command("STOP"), 2))
        listener.until(lambda heard: Ack("STOP", 2) in heard)


def sent(station: Station, *, is_test: bool) -> list[Frame]:
    """The frames of the first exposures."""
    scenario = scenario_of(OPTIONS, STATION)
    made = detector_of(station, scenario, OPTIONS)
    firmware = firmware_of(station, scenario, OPTIONS, made, scenario.start_utc_ns, is_test=is_test)
    decoder = FrameDecoder(load_protocol(station.protocol))
    pieces = [piece for _ in range(3) for item in firmware.step() for piece in decoder.feed(item.data)]
    return [piece for piece in (*pieces, *decoder.finish()) if isinstance(piece, Frame)]


@pytest.mark.parametrize("is_test", [False, True])
def test_an_emulator_marks_each_frame_as_of_no_detector_and_a_simulated_port_none(is_test: bool) -> None:
    frames = sent(STATION, is_test=is_test)
    assert len(frames) == 3
    assert [PROTOCOL.is_test(frame) for frame in frames] == [is_test] * 3


@pytest.mark.parametrize("is_test", [False, True])
def test_without_room_for_the_mark_its_status_says_so_with_the_first_panorama(is_test: bool, tmp_path: Path) -> None:
    path = tmp_path / "unmarked.yaml"
    path.write_text(PROTOCOL.text.replace("{0: stored, 1: test}", "{0: stored}"))
    frames = sent(STATION.model_copy(update={"protocol": str(path)}), is_test=is_test)
    protocol = load_protocol(str(path))
    assert [frame.type for frame in frames] == ["PANORAMA", *["STATUS"] * is_test, "PANORAMA", "PANORAMA"]
    assert [protocol.is_test(frame) for frame in frames] == [frame.type == "STATUS" for frame in frames]


TRIES = 30
"""A busy machine holds frames up, and then they come together; it does not do so each time."""


def test_frames_come_in_real_time(detector: Detector) -> None:
    with emulated(PtyEndpoint(), detector) as address, SerialLink(address, BAUDRATE) as link:
        listener = Listener(link)
        listener.until(lambda heard: len(panoramas(heard)) >= 1)
        for _ in range(TRIES):
            began_ns, first = read_clock().mono_ns, panoramas(listener.heard)[-1].frame_no
            heard = listener.until(lambda heard, first=first: panoramas(heard)[-1].frame_no >= first + 20)
            took_ns, frames = read_clock().mono_ns - began_ns, panoramas(heard)[-1].frame_no - first
            if took_ns == pytest.approx(frames * 5e7, rel=0.5):
                return
    pytest.fail("never did 20 frames take a second")


class Wire:
    """An endpoint without a station, on a computer so slow that each look at its clock takes more than a period."""

    address = "nowhere"

    def __init__(self, start_ns: int) -> None:
        self._ns = start_ns
        self._decoder = FrameDecoder(PROTOCOL)
        self.heard: list[tuple[float, PanoramaMessage]] = []
        """Panoramas, and when they were whole, in seconds from the start."""
        self._start_ns = start_ns

    def now_ns(self) -> int:
        self._ns += 60_000_000
        return self._ns

    def wait(self, timeout_s: float) -> bytes:
        return b""

    def send(self, data: bytes) -> None:
        found = [PROTOCOL.decode(piece) for piece in self._decoder.feed(data) if isinstance(piece, Frame)]
        self.heard += [((self._ns - self._start_ns) / NS_PER_S, one) for one in panoramas(found)]

    def is_heard(self) -> bool:
        return False

    def listening_baud(self) -> None:
        return None

    def close(self) -> None:
        pass


def test_a_computer_that_is_too_slow_sends_fewer_frames_and_none_of_them_late(detector: Detector) -> None:
    scenario = scenario_of(OPTIONS, STATION)
    firmware = firmware_of(STATION, scenario, OPTIONS | {"standby": "no"}, detector, scenario.start_utc_ns)
    wire = Wire(scenario.start_utc_ns)
    Emulator(firmware, wire, wire.now_ns, baudrate=BAUDRATE).run(lambda: wire.now_ns() > scenario.start_utc_ns + 30e9)
    numbers = [panorama.frame_no for _, panorama in wire.heard]
    assert len(numbers) > 20
    assert np.diff(numbers).min() > 1
    late_s = [at_s - panorama.time_us / 1e6 for at_s, panorama in wire.heard]
    assert np.ptp(late_s) < 0.25


def test_a_sensor_that_nobody_listens_to_goes_on_and_sends_fresh_frames_later(detector: Detector) -> None:
    endpoint = PtyEndpoint()
    for number in range(100):
        endpoint.send(bytes([number]) * 216)
    with emulated(endpoint, detector) as address, SerialLink(address, BAUDRATE) as link:
        listener = Listener(link)
        heard = listener.until(lambda heard: len(panoramas(heard)) >= 3)
        assert panoramas(heard)[0].frame_no < 40


def test_a_station_at_half_the_baud_rate_reads_what_a_uart_would(detector: Detector) -> None:
    with emulated(PtyEndpoint(), detector) as address, SerialLink(address, 460800) as link:
        received = b""
        while len(received) < 2000:
            received += b"".join(item.data for item in link.receive(0.2) if isinstance(item, Chunk))
    decoder = FrameDecoder(PROTOCOL)
    frames = [piece for piece in decoder.feed(received) if isinstance(piece, Frame)]
    assert frames == []


def test_preflight_finds_the_baud_rate_of_a_faster_sensor(detector: Detector, tmp_path: Path) -> None:
    with emulated(PtyEndpoint(), detector) as address:
        text = BUILT_IN_TEXT.replace("url: sim://", f"url: {address}\n  baudrate: {BAUDRATE // 2}")
        check = next(check for check in checks(parse_station(text), tmp_path, 1.0) if check.name == "port")
    assert check.outcome is CheckOutcome.FAIL
    assert f"valid frames come with port.baudrate: {BAUDRATE}" in check.advice


class RateSetInMidFrame:
    """A station that sets half the sensor's baud rate after the first piece of each frame."""

    address = "nowhere"

    def __init__(self) -> None:
        self.received = b""
        self.enough = threading.Event()

    def wait(self, timeout_s: float) -> bytes:
        threading.Event().wait(timeout_s)
        return b""

    def send(self, data: bytes) -> None:
        self.received += data
        if len(self.received) > 1000:
            self.enough.set()

    def is_heard(self) -> bool:
        return True

    def listening_baud(self) -> int:
        return BAUDRATE // 2 if self.received else BAUDRATE

    def close(self) -> None:
        """There is nothing to close."""


def test_a_frame_in_whose_middle_the_rate_is_set_does_not_come_whole(detector: Detector) -> None:
    endpoint, decoder = RateSetInMidFrame(), FrameDecoder(PROTOCOL)
    with emulated(endpoint, detector):
        assert endpoint.enough.wait(PATIENCE_S)
    assert [item for item in decoder.feed(endpoint.received) if isinstance(item, Frame)] == []


def test_a_client_may_leave_and_another_come(detector: Detector) -> None:
    with emulated(TcpEndpoint("127.0.0.1", 0), detector) as address:
        for _ in range(2):
            with SerialLink(address) as link:
                Listener(link).until(lambda heard: len(panoramas(heard)) >= 2)


def test_a_second_client_is_turned_away_while_the_first_listens(detector: Detector) -> None:
    with emulated(TcpEndpoint("127.0.0.1", 0), detector) as address, SerialLink(address) as link:
        listener = Listener(link)
        listener.until(lambda heard: len(panoramas(heard)) >= 1)
        port = int(address.rpartition(":")[2])
        with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S) as second:
            assert second.recv(1) == b""
        listener.until(lambda heard: len(panoramas(heard)) >= 4)


def test_a_port_that_is_taken_is_told_with_what_to_do() -> None:
    endpoint = TcpEndpoint("127.0.0.1", 0)
    try:
        with pytest.raises(UsageError, match="port 0 takes any free one"):
            TcpEndpoint("127.0.0.1", int(endpoint.address.rpartition(":")[2]))
    finally:
        endpoint.close()


SLOW_BAUD = 4800
"""Two frames a second: a computer that is busy for a moment leaves no gap on such a line."""


class EndsWhenFull:
    """Ends a session when its line is full."""

    def __init__(self, ending: Ending) -> None:
        self._ending = ending

    def on_results(self, results: FrameResults, session: SessionData) -> None:
        pass

    def on_event(self, event: LinkEvent) -> None:
        if event.kind == LinkKind.LINE_FULL:
            self._ending.reason = "the line is full"


def full_lines(session: SessionData) -> list[LinkEvent]:
    return [event for event in session.events if event.kind == LinkKind.LINE_FULL]


def test_a_line_that_cannot_carry_the_rate_is_called_full_live_and_in_the_replay(
    detector: Detector, tmp_path: Path
) -> None:
    port = STATION.port.model_copy(update={"baudrate": SLOW_BAUD})
    slow = STATION.model_copy(update={"port": port})
    with Ending() as ending, emulated(PtyEndpoint(), detector, station=slow, baudrate=SLOW_BAUD) as address:
        text = BUILT_IN_TEXT.replace("url: sim://", f"url: {address}\n  baudrate: {SLOW_BAUD}")
        live = run_live(
            parse_station(text),
            text,
            tmp_path,
            Operator(ending),
            make_listeners=lambda loop, folder, live: [EndsWhenFull(ending)],
            duration_s=PATIENCE_S,
        )
    recording = live.folder / "session.mcap"
    (full,) = full_lines(live.session)
    assert full.text.startswith("the line carries 480 bytes/s at 4800 baud and 4")
    assert replay_session(recording).session.events == live.session.events
    for url in ("socket://127.0.0.1:4000", "sim://"):
        other = text.replace(f"url: {address}", f"url: {url}")
        given = parse_station(other), other
        assert full_lines(replay_session(recording, station=lambda _, given=given: given).session) == []


@pytest.mark.parametrize(("rate_hz", "is_told"), [("100", True), ("50", False)])
def test_the_command_says_at_its_start_where_the_line_cannot_carry_its_rate(rate_hz: str, is_told: bool) -> None:
    words = ["--tcp", "127.0.0.1:0", "--duration", "0.2", "--rate-hz", rate_hz]
    result = CliRunner().invoke(command, words, catch_exceptions=False)
    told = " ".join(result.stderr.split())
    assert ("the line carries 11,520 bytes/s at 115200 baud, and this sensor has 21,600 to send" in told) == is_told


def test_the_command_prints_the_address_and_ends_after_its_time() -> None:
    result = CliRunner().invoke(command, ["--tcp", "127.0.0.1:0", "--duration", "0.2"], catch_exceptions=False)
    assert result.exit_code == 0
    assert result.stdout.startswith("socket://127.0.0.1:")
    assert "SIMULATED" not in result.stderr


def test_the_command_says_where_the_format_has_no_room_for_the_mark_of_a_simulation(tmp_path: Path) -> None:
    station = tmp_path / "station.yaml"
    station.write_text(BUILT_IN_TEXT + "protocol: ccsds-packets\n")
    arguments = ["--tcp", "127.0.0.1:0", "--duration", "0.2", "--station", str(station)]
    result = CliRunner().invoke(command, arguments, catch_exceptions=False)
    assert "not marked SIMULATED" in " ".join(result.stderr.split())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "either --pty or --tcp"),
        (["--pty", "--tcp", "127.0.0.1:0"], "either --pty or --tcp"),
        (["--tcp", "4000"], "127.0.0.1:4000"),
        (["--tcp", "127.0.0.1:99999"], "127.0.0.1:4000"),
        (["--tcp", "192.0.2.1:4000"], "cannot listen"),
    ],
)
def test_an_impossible_address_is_told_with_what_was_expected(arguments: list[str], words: str) -> None:
    result = CliRunner().invoke(command, arguments)
    assert isinstance(result.exception, UsageError)
    assert words in str(result.exception)


@contextlib.contextmanager
def terminal() -> Iterator[tuple[PtyEndpoint, serial.Serial]]:
    endpoint = PtyEndpoint()
    try:
        with serial.Serial(endpoint.address, BAUDRATE, timeout=0) as port:
            yield endpoint, port
    finally:
        endpoint.close()


def test_a_station_that_is_busy_for_a_moment_reads_all_bytes_afterwards() -> None:
    sent, received = bytes(range(250)) * 200, b""
    with terminal() as (endpoint, port):
        for begin in range(0, len(sent), 250):
            endpoint.send(sent[begin : begin + 250])
        until_s = time.monotonic() + PATIENCE_S
        while len(received) < len(sent) and time.monotonic() < until_s:
            endpoint.wait(0.0)
            received += port.read(READ_BYTES)
    assert received == sent


def test_a_station_that_comes_back_after_long_reads_new_bytes_first() -> None:
    with terminal() as (endpoint, port):
        for _ in range(30):
            endpoint.send(b"old" * 100)
        endpoint.wait(1.1)
        endpoint.send(b"new")
        assert port.read(READ_BYTES) == b"new"
