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
from collections.abc import Iterator
from typing import Any, NamedTuple

from serial import rfc2217
from serial.urlhandler import protocol_socket

# Bytes of a telnet connection (RFC 854) taken apart, for an rfc2217:// port.

IAC, DONT, DO, WONT, WILL, SB, SE = (bytes([number]) for number in (255, 254, 253, 252, 251, 250, 240))
LONGEST_SUBOPTION = 1024
"""RFC 2217 has 5 bytes, and a signature in words."""


class Data(NamedTuple):
    """Bytes of the line."""

    data: bytes


class Option(NamedTuple):
    """DO, DONT, WILL or WONT, and the option."""

    command: bytes
    option: bytes


class Suboption(NamedTuple):
    """What stood between IAC SB and IAC SE."""

    data: bytes


class TelnetCommand(NamedTuple):
    """Any other command."""

    command: bytes


class TelnetParser:
    """Takes a stream apart; ValueError where a suboption does not end."""

    def __init__(self) -> None:
        self._begun = b""
        self._suboption: bytearray | None = None

    def feed(self, received: bytes) -> Iterator[Data | Option | Suboption | TelnetCommand]:
        """The parts that are complete, in their order."""
        data, self._begun = self._begun + received, b""
        place = 0
        while place < len(data):
            mark = data.find(IAC, place)
            plain = data[place : len(data) if mark < 0 else mark]
            if plain:
                yield from self._plain(plain)
            if mark < 0:
                return
            size = 3 if data[mark + 1 : mark + 2] in (DO, DONT, WILL, WONT) else 2
            if mark + size > len(data):
                self._begun = data[mark:]
                return
            yield from self._command(data[mark + 1 : mark + 2], data[mark + 2 : mark + size])
            place = mark + size

    def _plain(self, data: bytes) -> Iterator[Data]:
        if self._suboption is None:
            yield Data(data)
            return
        self._suboption += data
        if len(self._suboption) > LONGEST_SUBOPTION:
            raise ValueError(f"a telnet suboption of more than {LONGEST_SUBOPTION} bytes")

    def _command(self, command: bytes, option: bytes) -> Iterator[Data | Option | Suboption | TelnetCommand]:
        if command == IAC:
            yield from self._plain(IAC)
        elif command == SB:
            self._suboption = bytearray()
        elif command == SE:
            if self._suboption is not None:
                yield Suboption(bytes(self._suboption))
            self._suboption = None
        elif option:
            yield Option(command, option)
        else:
            yield TelnetCommand(command)


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

    def _take(self, part: Data | Option | Suboption | TelnetCommand) -> None:
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
