"""Reopening of a lost port: under its name, or its USB adapter under another name."""

import os
import threading
import time
from collections.abc import Callable

import serial

from drivers.errors import PortError
from drivers.ports import PortInfo, is_device, open_port

FIRST_PAUSE_S = 0.1
LONGEST_PAUSE_S = 5.0
LONGEST_BLIND_PAUSE_S = 0.8
"""For ports that can only be tried, not watched (sockets): back within a second of the port."""
WATCH_S = 0.1


class PortFinder:
    """Tries to open one port until it succeeds, with growing pauses that end at once when the port appears."""

    def __init__(self, url: str, baudrate: int, list_ports: Callable[[], list[PortInfo]]) -> None:
        self._url, self._baudrate, self._list_ports = url, baudrate, list_ports
        self._adapter: PortInfo | None = None

    def remember(self, port: serial.Serial) -> None:
        """Note the USB identity of the port, if it has one."""
        device = os.path.realpath(str(port.port))
        known = (info for info in self._list_ports() if os.path.realpath(info.device) == device)
        self._adapter = next((info for info in known if info.serial_number), self._adapter)

    def open_again(self, stop: threading.Event) -> tuple[str, serial.Serial] | None:
        """Wait for the port: its name now and the open port; None when ``stop`` is set first."""
        pause_s = FIRST_PAUSE_S
        while not stop.is_set():
            url = self._where()
            if url is not None:
                try:
                    return url, open_port(url, self._baudrate)
                except PortError:
                    # Missing, not ready, or busy: try again.
                    pass
            self._pause(pause_s, stop, is_absent=url is None)
            pause_s = min(2 * pause_s, LONGEST_PAUSE_S if is_device(self._url) else LONGEST_BLIND_PAUSE_S)
        return None

    def _where(self) -> str | None:
        """The URL to try: the present one of the adapter, else the original one; None while the port is missing."""
        if not is_device(self._url):
            return self._url
        if self._adapter is not None:
            for port in self._list_ports():
                if port.is_same_adapter(self._adapter):
                    return port.device
        return self._url if os.path.exists(self._url) else None

    def _pause(self, pause_s: float, stop: threading.Event, *, is_absent: bool) -> None:
        until_s = time.monotonic() + pause_s
        while (left_s := until_s - time.monotonic()) > 0 and not stop.wait(min(left_s, WATCH_S)):
            if is_absent and self._where() is not None:
                return
