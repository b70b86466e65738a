"""Endpoints of an emulated sensor: the interface, with a TCP port for one client.

No endpoint waits for a reader: a sensor goes on sending without a station, and unread bytes are lost.
"""

import select
import socket
from typing import Protocol

from gse.errors import UsageError

READ_BYTES = 4096


class Endpoint(Protocol):
    """The sensor's end of a cable."""

    address: str

    def wait(self, timeout_s: float) -> bytes:
        """Bytes from the station, none when none came within the time."""

    def send(self, data: bytes) -> None:
        """Bytes to the station; lost without one."""

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
