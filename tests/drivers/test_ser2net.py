"""A serial line over the network, against a real server: Debian's ser2net on a pty."""

import contextlib
import random
import socket
import termios
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import serial
from devices import own_network
from devices.patience import PATIENCE_S
from devices.proxy import Proxy
from devices.ser2net import PROGRAM, Ser2net
from devices.terminal import Terminal

from drivers.chunk import Chunk, LinkEvent
from drivers.errors import PortError
from drivers.link import SerialLink
from drivers.ports import open_port

pytestmark = [
    pytest.mark.skipif(PROGRAM is None, reason="ser2net is not installed"),
    pytest.mark.filterwarnings("ignore:set(Daemon|Name):DeprecationWarning"),  # pyserial 3.5
]
EVERY_BYTE = bytes(range(256)) * 4 + b"\xff\xff\xfd\x00\r\n\r\x00" * 20


@pytest.fixture
def terminal(tmp_path: Path) -> Iterator[Terminal]:
    terminal = Terminal(tmp_path / "tty")
    yield terminal
    terminal.unplug()


@pytest.fixture(params=["rfc2217", "socket"])
def server(request: pytest.FixtureRequest, terminal: Terminal, tmp_path: Path) -> Iterator[Ser2net]:
    with Ser2net(request.param, terminal.path, tmp_path) as server:
        yield server


def await_event(link: SerialLink, kind: str) -> None:
    until_s = time.monotonic() + PATIENCE_S
    while not any(isinstance(item, LinkEvent) and item.kind == kind for item in link.receive(1.0)):
        assert time.monotonic() < until_s, f"no {kind}"


def receive(link: SerialLink, size: int) -> bytes:
    data, until_s = b"", time.monotonic() + PATIENCE_S
    while len(data) < size and time.monotonic() < until_s:
        data += b"".join(item.data for item in link.receive(0.5) if isinstance(item, Chunk))
    return data


def test_every_byte_comes_through_in_both_directions(server: Ser2net, terminal: Terminal) -> None:
    with SerialLink(server.url, 115200, wait_port=True) as link:
        await_event(link, "OPENED")
        server.await_open(terminal.path)
        terminal.write(EVERY_BYTE)
        assert receive(link, len(EVERY_BYTE)) == EVERY_BYTE
        link.send(EVERY_BYTE)
        sent = b""
        while len(sent) < len(EVERY_BYTE):
            sent += terminal.read(4096)
        assert sent == EVERY_BYTE


def test_a_server_that_is_killed_and_comes_back_is_told_and_no_byte_is_another(
    server: Ser2net, terminal: Terminal
) -> None:
    rng = random.Random(1)
    with SerialLink(server.url, 115200, wait_port=True) as link:
        await_event(link, "OPENED")
        for number in range(2):
            data = rng.randbytes(5000)
            server.await_open(terminal.path)
            for start in range(0, len(data), 500):
                terminal.write(data[start : start + 500])
            assert receive(link, len(data)) == data
            if number == 0:
                server.kill()
                await_event(link, "LOST")
                server.start()
                await_event(link, "REOPENED")


@pytest.mark.parametrize("server", ["rfc2217"], indirect=True)
def test_the_baud_rate_reaches_the_line(server: Ser2net, terminal: Terminal) -> None:
    for baudrate, speed in ((9600, termios.B9600), (115200, termios.B115200)):
        with SerialLink(server.url, baudrate, wait_port=True) as link:
            await_event(link, "OPENED")
            server.await_open(terminal.path)
            assert terminal._slave is not None
            assert termios.tcgetattr(terminal._slave)[4] == speed


@pytest.mark.parametrize("server", ["rfc2217"], indirect=True)
def test_a_second_client_is_refused_in_words_and_the_first_loses_nothing(server: Ser2net, terminal: Terminal) -> None:
    with SerialLink(server.url, 115200, wait_port=True) as link:
        await_event(link, "OPENED")
        server.await_open(terminal.path)
        with pytest.raises(PortError, match="cannot open rfc2217"):
            SerialLink(server.url, 115200)
        terminal.write(EVERY_BYTE)
        assert receive(link, len(EVERY_BYTE)) == EVERY_BYTE


@pytest.mark.parametrize("server", ["socket"], indirect=True)
def test_a_second_client_of_a_raw_socket_is_told_why_it_is_hung_up_on(server: Ser2net, terminal: Terminal) -> None:
    with SerialLink(server.url, 115200, wait_port=True) as link:
        await_event(link, "OPENED")
        server.await_open(terminal.path)
        with SerialLink(server.url, 115200) as second:
            told: list[str] = []
            while not told:
                told = [
                    item.text
                    for item in second.receive(PATIENCE_S)
                    if isinstance(item, LinkEvent) and item.kind == "LOST"
                ]
        assert "another client may have the line" in told[0]
        terminal.write(EVERY_BYTE)
        assert receive(link, len(EVERY_BYTE)) == EVERY_BYTE


@pytest.mark.skipif(not own_network.can_be_made(), reason="this system gives no process a network of its own")
@pytest.mark.parametrize("scheme", ["rfc2217", "socket"])
def test_a_connection_without_any_packet_is_told_and_opened_again(scheme: str) -> None:
    found = own_network.half_open(scheme, probe_s=1)
    assert "is gone" in found["told"]
    assert found["lost_s"] < 20
    assert found["identical"]


def test_the_kernel_looks_after_a_silent_connection(server: Ser2net) -> None:
    with SerialLink(server.url, 115200, wait_port=True) as link:
        await_event(link, "OPENED")
        assert link._live is not None
        assert link._live._port is not None
        connection = link._live._port._socket  # type: ignore[attr-defined]
        assert connection.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
        idle = connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE)
        probes = connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT)
        assert idle + probes * connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL) <= 30


@pytest.mark.parametrize("server", ["rfc2217"], indirect=True)
def test_a_server_that_does_not_double_the_byte_255_loses_the_connection_and_not_the_memory(
    server: Ser2net, terminal: Terminal
) -> None:
    with Proxy(server.port) as proxy, SerialLink(f"rfc2217://127.0.0.1:{proxy.port}", 115200, wait_port=True) as link:
        await_event(link, "OPENED")
        server.await_open(terminal.path)
        proxy.say(b"before \xff\xf0")
        assert receive(link, 7) == b"before "
        proxy.say(b"\xff\xfa" + b"A" * 5000)
        await_event(link, "LOST")
        await_event(link, "REOPENED")


@pytest.mark.parametrize("server", ["rfc2217"], indirect=True)
def test_what_came_before_a_hang_up_is_not_lost(server: Ser2net, terminal: Terminal) -> None:
    with Proxy(server.port) as proxy, SerialLink(f"rfc2217://127.0.0.1:{proxy.port}", 115200, wait_port=True) as link:
        await_event(link, "OPENED")
        server.await_open(terminal.path)
        proxy.say(b"the end" * 30_000)
        proxy.hang_up()
        assert receive(link, 210_000) == b"the end" * 30_000


@pytest.mark.parametrize("server", ["rfc2217"], indirect=True)
def test_a_server_has_to_wait_for_a_station_that_does_not_fetch(server: Ser2net) -> None:
    with Proxy(server.port) as proxy, contextlib.closing(opened(f"rfc2217://127.0.0.1:{proxy.port}")):
        assert proxy.say(bytes(100 << 20), timeout_s=2.0) < 50 << 20


def opened(url: str) -> serial.Serial:
    """A port whose server may not listen yet."""
    until_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            return open_port(url, 115200)
        except PortError:
            assert time.monotonic() < until_s
            time.sleep(0.1)
