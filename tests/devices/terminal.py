"""A serial port for tests that can be unplugged: a pty under a name that stays."""

import array
import fcntl
import os
import termios
import tty
from pathlib import Path


class Terminal:
    """A pty whose far end is ours; ``path`` is what the driver opens."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.plug()

    def plug(self, before: bytes = b"") -> None:
        """Make the port appear, with bytes that arrived before anybody opened it."""
        self.master, slave = os.openpty()
        tty.setraw(slave)
        os.write(self.master, before)
        # The driver must see the name only when the port behind it is ready.
        temporary = self.path.with_suffix(".new")
        os.symlink(os.ttyname(slave), temporary)
        self._slave: int | None = slave
        os.rename(temporary, self.path)

    def write(self, data: bytes) -> None:
        """Send bytes as the sensor does."""
        while data:
            data = data[os.write(self.master, data) :]

    def read(self, size: int) -> bytes:
        """Bytes that the station sent."""
        return os.read(self.master, size)

    def unread(self) -> int:
        """Bytes that the driver has not read yet."""
        assert self._slave is not None
        count = array.array("i", [0])
        fcntl.ioctl(self._slave, termios.FIONREAD, count)
        return count[0]

    def unplug(self) -> None:
        """Make the port disappear."""
        self.path.unlink()
        os.close(self.master)
        if self._slave is not None:
            os.close(self._slave)
