"""Bytes of a telnet connection (RFC 854) taken apart, for an rfc2217:// port."""

from collections.abc import Iterator
from typing import NamedTuple

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


class Command(NamedTuple):
    """Any other command."""

    command: bytes


class TelnetParser:
    """Takes a stream apart; ValueError where a suboption does not end."""

    def __init__(self) -> None:
        self._begun = b""
        self._suboption: bytearray | None = None

    def feed(self, received: bytes) -> Iterator[Data | Option | Suboption | Command]:
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

    def _command(self, command: bytes, option: bytes) -> Iterator[Data | Option | Suboption | Command]:
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
            yield Command(command)
