"""Pseudo-terminal of an emulated sensor; POSIX systems only."""

import contextlib
import fcntl
import os
import pty
import select
import struct
import termios
import time
import tty

from drivers.uart import USUAL_BAUDS
from gse.simulator.emulator import READ_BYTES

_UNREAD_LIMIT_BYTES, _UNREAD_LIMIT_S = 3072, 1.0
"""So much, unread for so long, means that nothing reads the terminal; the limit of the kernel is 4095 bytes."""
_NOT_SET = termios.B50
_BAUDS = {getattr(termios, f"B{baud}"): baud for baud in USUAL_BAUDS if hasattr(termios, f"B{baud}")}


class PtyEndpoint:
    """A pseudo-terminal; ``address`` is the device that the station opens. Bytes are lost until it sets a baud rate."""

    def __init__(self) -> None:
        self._sensor, self._station = pty.openpty()
        tty.setraw(self._station)
        settings = termios.tcgetattr(self._station)
        settings[4] = settings[5] = _NOT_SET
        termios.tcsetattr(self._station, termios.TCSANOW, settings)
        os.set_blocking(self._sensor, False)
        self.address = os.ttyname(self._station)
        self._waiting, self._read_s = bytearray(), time.monotonic()

    def wait(self, timeout_s: float) -> bytes:
        """Bytes from the station, none when none came within the time."""
        self._write()
        readable, _, _ = select.select([self._sensor], [], [], timeout_s)
        return os.read(self._sensor, READ_BYTES) if readable else b""

    def send(self, data: bytes) -> None:
        """Bytes to the station, lost before it is open; what is unread for long is dropped: it reads new ones later."""
        if not self.is_heard():
            return
        unread = struct.unpack("i", fcntl.ioctl(self._station, termios.FIONREAD, b"\0\0\0\0"))[0]
        if unread + len(self._waiting) + len(data) <= _UNREAD_LIMIT_BYTES:
            self._read_s = time.monotonic()
        elif time.monotonic() - self._read_s > _UNREAD_LIMIT_S:
            termios.tcflush(self._station, termios.TCIFLUSH)
            self._waiting.clear()
        self._waiting += data
        self._write()

    def _write(self) -> None:
        """Give the kernel what it takes; a station that is busy for a moment reads the rest later."""
        with contextlib.suppress(BlockingIOError):
            while self._waiting:
                del self._waiting[: os.write(self._sensor, self._waiting)]

    def is_heard(self) -> bool:
        """Whether a program has set a baud rate since the terminal was made."""
        return bool(termios.tcgetattr(self._station)[5] != _NOT_SET)

    def listening_baud(self) -> int | None:
        """The baud rate that the station has set; None for an unusual one."""
        return _BAUDS.get(termios.tcgetattr(self._station)[5])

    def close(self) -> None:
        """Remove the device."""
        os.close(self._sensor)
        os.close(self._station)
