"""The emulator: the simulated sensor in real time, behind a real cable."""

import select
import socket
from collections import deque
from collections.abc import Callable
from typing import Protocol

import serial

from drivers.errors import PortError
from drivers.ports import LineSettings, open_port
from drivers.uart import BITS_PER_BYTE, received_at
from gse.errors import UsageError
from gse.simulator.firmware import SensorFirmware, Transmission
from gse.values.instant import NS_PER_S

# Endpoints of an emulated sensor: the interface, with a TCP port for one client.
#
# No endpoint waits for a reader: a sensor goes on sending without a station, and unread bytes are lost.

READ_BYTES = 4096


class Endpoint(Protocol):
    """The sensor's end of a cable."""

    address: str

    def wait(self, timeout_s: float) -> bytes:
        """Bytes from the station, none when none came within the time."""

    def send(self, data: bytes) -> None:
        """Bytes to the station; lost without one."""

    def is_heard(self) -> bool:
        """Whether somebody is at the other end, as far as the cable tells."""

    def listening_baud(self) -> int | None:
        """The baud rate of the station; None where the cable has none."""

    def close(self) -> None:
        """Unplug."""


class TcpEndpoint:
    """A TCP port, one client at a time; ``address`` is the pyserial URL that the station opens."""

    def __init__(self, host: str, port: int) -> None:
        """Listen; UsageError where that is not possible."""
        try:
            family = socket.AF_INET6 if ":" in host else socket.AF_INET
            self._listener = socket.create_server((host, port), family=family)
        except OSError as error:
            raise UsageError(f"cannot listen on {host} port {port}: {error}; port 0 takes any free one") from error
        self._client: socket.socket | None = None
        name = f"[{host}]" if ":" in host else host
        self.address = f"socket://{name}:{self._listener.getsockname()[1]}"

    def wait(self, timeout_s: float) -> bytes:
        """Bytes from the station, none when none came within the time."""
        ends = [self._listener, *([self._client] if self._client else [])]
        readable, _, _ = select.select(ends, [], [], timeout_s)
        if self._listener in readable:
            self._accept()
            return b""
        if not readable or self._client is None:
            return b""
        try:
            data = self._client.recv(READ_BYTES)
        except OSError:
            data = b""
        if not data:
            self._hang_up()
        return data

    def send(self, data: bytes) -> None:
        """Bytes to the client; a client that is too slow is disconnected, so that none gets half a frame unnoticed."""
        if self._client is None:
            return
        try:
            self._client.sendall(data)
        except OSError:
            self._hang_up()

    def is_heard(self) -> bool:
        """Whether a client is connected."""
        return self._client is not None

    def listening_baud(self) -> None:
        """TCP has no baud rate."""

    def close(self) -> None:
        """Hang up and listen no more."""
        self._hang_up()
        self._listener.close()

    def _accept(self) -> None:
        client, _ = self._listener.accept()
        if self._client is not None:
            client.close()
            return
        client.setblocking(False)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._client = client

    def _hang_up(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None


class PortEndpoint:
    """A serial port of this computer, at whose other end the station is: a second adapter, or any pyserial URL."""

    def __init__(self, url: str, baudrate: int, line: LineSettings) -> None:
        """Open the port; PortError where that is not possible."""
        self._port = open_port(url, baudrate, line)
        self.address = url

    def wait(self, timeout_s: float) -> bytes:
        """Bytes from the station, none when none came within the time."""
        self._port.timeout = timeout_s
        try:
            return self._port.read(1) + self._port.read(self._port.in_waiting)
        except OSError as error:
            raise PortError(f"{self.address} is gone ({error}); plug it in and start again") from error

    def send(self, data: bytes) -> None:
        """Bytes to the station; lost where it holds the line up."""
        try:
            self._port.write(data)
        except serial.SerialTimeoutException:
            return
        except OSError as error:
            raise PortError(f"{self.address} is gone ({error}); plug it in and start again") from error

    def is_heard(self) -> bool:
        """A serial line does not tell."""
        return True

    def listening_baud(self) -> None:
        """Nor the other end's baud rate: its UART reads what it reads."""

    def close(self) -> None:
        """Close the port."""
        self._port.close()


_LONGEST_WAIT_S = 0.1
_LATEST_NS = 50_000_000
"""An exposure that ended longer ago is missing: a slow computer sends fewer frames, none of them later than this."""
_PIECE_NS = 8_000_000
"""How often the line is served while bytes are on it."""


class Emulator:
    """Serves a firmware on an endpoint; ``now_ns`` gives the time of its sky."""

    def __init__(
        self, firmware: SensorFirmware, endpoint: Endpoint, now_ns: Callable[[], int], *, baudrate: int
    ) -> None:
        self._firmware, self._endpoint, self._now_ns = firmware, endpoint, now_ns
        self._baudrate = baudrate
        self._byte_ns = BITS_PER_BYTE * NS_PER_S // baudrate
        self._line: deque[tuple[int, bytes, int]] = deque()
        """When the piece has arrived, its bytes, and the baud rate at which the station was to read them."""

    def run(self, stop: Callable[[], bool]) -> None:
        """Serve until ``stop`` returns True."""
        while not stop():
            data = self._endpoint.wait(self._wait_s())
            if data:
                self._put(self._firmware.command(self._heard(data), self._now_ns()))
            self._firmware.miss(self._now_ns() - _LATEST_NS)
            if (due_ns := self._firmware.due_ns) is not None and due_ns <= self._now_ns():
                self._put(self._firmware.step())
            while self._line and self._line[0][0] <= self._now_ns():
                _, piece, baudrate = self._line.popleft()
                if baudrate == self._station_baud():  # a rate that is set in the middle of a frame spoils the frame
                    self._endpoint.send(piece)

    def _station_baud(self) -> int:
        return self._endpoint.listening_baud() or self._baudrate

    def _heard(self, data: bytes) -> bytes:
        """What the sensor reads of the station's bytes: something else where that has set another baud rate."""
        return received_at(data, self._station_baud(), self._baudrate)

    def _wait_s(self) -> float:
        dues = [self._line[0][0]] if self._line else []
        if self._firmware.due_ns is not None:
            dues.append(self._firmware.due_ns)
        if not dues:
            return _LONGEST_WAIT_S
        return min(max((min(dues) - self._now_ns()) / NS_PER_S, 0.0), _LONGEST_WAIT_S)

    def _put(self, transmissions: list[Transmission]) -> None:
        """Lay bytes on the line: the first when it is complete, the others in pieces as they follow."""
        for sent in transmissions:
            at, size = 0, 1
            listening = self._station_baud()
            data = received_at(sent.data, self._baudrate, listening)
            while at < len(data):
                piece = data[at : at + size]
                at += len(piece)
                self._line.append((sent.start_ns + at * self._byte_ns, piece, listening))
                size = max(_PIECE_NS // self._byte_ns, 1)
