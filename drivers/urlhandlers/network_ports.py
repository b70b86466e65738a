"""The ports socket:// and rfc2217:// of pyserial, without the faults that a station meets.

Both empty the input when they open, though what has been received is part of the record, and leave a connection behind
that the other end has reset. The read loop of rfc2217:// has four more: it keeps a suboption without an end, and unread
bytes, without a bound; it stops at an end without a beginning; it loses the bytes before a hang-up. A server that does
not double the byte 255 of its line sends any of these: with pyserial, the station then receives nothing more.

They are made by ``drivers.ports``, not registered with pyserial: other programs in this process keep pyserial's own.
"""

import contextlib
import queue
import time
from typing import Any

from serial import rfc2217
from serial.urlhandler import protocol_socket

from drivers.telnet import Command, Data, Option, Suboption, TelnetParser

MOST_PIECES = 4096
"""Received and not yet fetched, 4 MiB; then the server has to wait."""
_PIECE_BYTES = 1024
_LOOK_S = 0.2
_PyserialSocket: Any = protocol_socket.Serial
_PyserialRfc2217: Any = rfc2217.Serial
"""Their types do not name what is theirs alone."""


class _Connection:
    """What both do alike; the first base, so that pyserial finds its methods first."""

    _socket: Any = None

    def reset_input_buffer(self) -> None:
        """Does nothing: bytes that have already been received are part of the record."""

    def close(self) -> None:
        """Close the port and its connection."""
        connection = self._socket
        super().close()  # type: ignore[misc]
        if connection is not None:
            connection.close()


class SocketPort(_Connection, _PyserialSocket):  # type: ignore[misc]
    """A TCP connection as a port."""


class Rfc2217Port(_Connection, _PyserialRfc2217):  # type: ignore[misc]
    """A serial port behind a telnet server, as ser2net has it."""

    def _telnet_read_loop(self) -> None:
        """What pyserial starts as the reading thread; it ends with the connection, as a lost port."""
        parser = TelnetParser()
        self._read_buffer.maxsize = MOST_PIECES
        with contextlib.suppress(OSError, ValueError):
            while data := self._received():
                for part in parser.feed(data):
                    self._take(part)
        self._put(None)
        # pyserial refuses to hand out what still waits once this thread has ended.
        while self.is_open and self._read_buffer.qsize():
            time.sleep(_LOOK_S / 10)

    def _received(self) -> bytes:
        """The next bytes; none at the end of the connection."""
        while self.is_open:
            with contextlib.suppress(TimeoutError):
                return bytes(self._socket.recv(_PIECE_BYTES))
        return b""

    def _take(self, part: Data | Option | Suboption | Command) -> None:
        if isinstance(part, Data):
            self._put(part.data)
        elif isinstance(part, Option):
            self._telnet_negotiate_option(part.command, part.option)
        elif isinstance(part, Suboption):
            self._telnet_process_subnegotiation(part.data)
        else:
            self._telnet_process_command(part.command)

    def _put(self, data: bytes | None) -> None:
        """Hand bytes over; a full queue is waited for while the port is open."""
        while self.is_open:
            with contextlib.suppress(queue.Full):
                self._read_buffer.put(data, timeout=_LOOK_S)
                return
