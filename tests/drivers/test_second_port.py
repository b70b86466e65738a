"""A session between sensor and flight computer: each end is a real terminal, the driver the real one."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from devices.patience import PATIENCE_S

from drivers.chunk import Chunk, LinkEvent, LinkKind
from drivers.clock import read_clock
from drivers.errors import PortError
from drivers.link import SerialLink
from drivers.playback import session_items
from drivers.second_port import passing_bound_s
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.errors import ConfigError
from gse.recording.recorder import Recorder
from gse.simulator.pty_endpoint import PtyEndpoint

SENSOR = bytes(range(256)) * 4
COMPUTER = b"\x55REQUEST\x00\xff"


@contextmanager
def two_cables() -> Iterator[tuple[PtyEndpoint, PtyEndpoint]]:
    sensor, computer = PtyEndpoint(), PtyEndpoint()
    try:
        yield sensor, computer
    finally:
        sensor.close()
        computer.close()


def heard(endpoint: PtyEndpoint, size: int) -> bytes:
    data, until_ns = b"", read_clock().mono_ns + PATIENCE_S * 1e9
    while len(data) < size and read_clock().mono_ns < until_ns:
        data += endpoint.wait(0.1)
    return data


def recorded(path: Path) -> tuple[bytes, bytes, list[LinkEvent]]:
    """What the sensor sent, what it was sent, and the events of a session."""
    items = list(session_items(path))
    events = [item for item in items if isinstance(item, LinkEvent)]
    sent = b"".join(bytes.fromhex(event.text) for event in events if event.kind == LinkKind.SENT)
    return b"".join(item.data for item in items if isinstance(item, Chunk)), sent, events


def test_all_bytes_pass_both_ways_and_are_recorded(tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    with (
        two_cables() as (sensor, computer),
        Recorder(path, live=True) as recorder,
        SerialLink(sensor.address, 115200, recorder=recorder, pass_to=computer.address),
    ):
        sensor.send(SENSOR)
        assert heard(computer, len(SENSOR)) == SENSOR
        computer.send(COMPUTER)
        assert heard(sensor, len(COMPUTER)) == COMPUTER
    received, sent, events = recorded(path)
    assert (received, sent) == (SENSOR, COMPUTER)
    assert 0 < passing_bound_s(events) < PATIENCE_S


def test_a_tap_on_each_wire_hears_both_and_sends_nothing(tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    with (
        two_cables() as (sensor, computer),
        Recorder(path, live=True) as recorder,
        SerialLink(sensor.address, 115200, recorder=recorder, tx_url=computer.address) as link,
    ):
        sensor.send(SENSOR)
        computer.send(COMPUTER)
        got, until_ns = 0, read_clock().mono_ns + PATIENCE_S * 1e9
        while got < len(SENSOR) + len(COMPUTER) and read_clock().mono_ns < until_ns:
            items = link.receive(0.1)
            got += sum(len(item.data) for item in items if isinstance(item, Chunk))
            got += sum(len(item.text) // 2 for item in items if getattr(item, "kind", "") == LinkKind.SENT)
        assert sensor.wait(0.2) == computer.wait(0.2) == b""
    received, sent, events = recorded(path)
    assert (received, sent) == (SENSOR, COMPUTER)
    assert passing_bound_s(events) == 0


def test_a_computer_that_reads_nothing_costs_no_byte_of_the_recording(tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    master, slave = os.openpty()
    sensor = PtyEndpoint()
    size = 0
    try:
        with (
            Recorder(path, live=True) as recorder,
            SerialLink(sensor.address, 921600, recorder=recorder, pass_to=os.ttyname(slave)) as link,
        ):
            until_ns = read_clock().mono_ns + PATIENCE_S * 1e9
            for _ in range(40):
                sensor.send(SENSOR)
                got = 0
                while got < len(SENSOR) and read_clock().mono_ns < until_ns:
                    got += sum(len(item.data) for item in link.receive(0.1) if isinstance(item, Chunk))
                size += got
    finally:
        sensor.close()
        os.close(master)
        os.close(slave)
    received, _, events = recorded(path)
    assert received == SENSOR * 40
    assert size == len(received)
    assert [event.kind for event in events if "takes no bytes" in event.text] == [LinkKind.OTHER_END]


def test_a_computer_that_goes_and_comes_back_is_told_and_served_again(tmp_path: Path) -> None:
    cable = tmp_path / "computer"
    sensor, first = PtyEndpoint(), PtyEndpoint()
    cable.symlink_to(first.address)
    told: list[str] = []
    with SerialLink(sensor.address, 115200, pass_to=str(cable)) as link:
        cable.unlink()
        first.close()
        second = PtyEndpoint()
        cable.symlink_to(second.address)
        until_s = time.monotonic() + PATIENCE_S
        while len(told) < 2 and time.monotonic() < until_s:
            events = [item for item in link.receive(0.1) if isinstance(item, LinkEvent)]
            told += [event.text for event in events if event.kind == LinkKind.OTHER_END]
        sensor.send(SENSOR)
        assert heard(second, len(SENSOR)) == SENSOR
    sensor.close()
    second.close()
    assert "is gone" in told[0]
    assert told[-1].endswith("is open again")


def test_a_port_of_the_computer_that_does_not_open_is_told_at_once(tmp_path: Path) -> None:
    sensor = PtyEndpoint()
    try:
        with pytest.raises(PortError, match="there is no port"):
            SerialLink(sensor.address, 115200, pass_to=str(tmp_path / "nothing"))
    finally:
        sensor.close()


@pytest.mark.parametrize(
    ("port", "sensor", "words"),
    [
        ("pass_to: /dev/b\n  tx_url: /dev/c", "", "expected one of the two"),
        ("pass_to: sim://", "", "expected another port"),
        ("pass_to: /dev/b", "poll: {period_ms: 200}", "the flight computer commands"),
    ],
)
def test_a_station_file_with_two_masters_or_none_is_refused(port: str, sensor: str, words: str) -> None:
    text = BUILT_IN_TEXT.replace("url: sim://", f"url: /dev/a\n  {port}")
    text = text.replace("sensor:\n", f"sensor:\n  {sensor}\n", 1)
    with pytest.raises(ConfigError, match=words):
        parse_station(text)
