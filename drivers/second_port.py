"""The second port of a line that belongs to a flight computer: bytes pass through, or a tap listens to its wire.

    sensor ──> A  this computer  B ──> flight computer      passes: what B hears goes out of A, and the other way round
           <──                     <──

    sensor ──┬───────────────────────> flight computer      a tap on each wire: A hears the sensor, the second port what
             A            second <─┴──                       the flight computer sends; nothing is ever sent

What takes long on this side is dropped and told: the recording of the sensor never waits for the flight computer.
"""

import re
import threading
import time
from collections.abc import Callable, Iterable

import serial

from drivers.chunk import LinkEvent, LinkKind

_WRITE_TIMEOUT_S = 0.05
"""A flight computer that takes nothing so long loses the bytes: those of the sensor are waiting to be read."""
_LEAST_BOUND_MS = 0.125
_TOLD = re.compile(r"passing bytes on takes up to ([0-9.]+) ms")


class SecondPort:
    """Reads the second port on a thread of its own; ``passes`` where the sensor's bytes go out of it.

    ``heard`` gets what comes, ``report`` the events.
    """

    def __init__(
        self,
        url: str,
        port: serial.Serial,
        reopen: Callable[[threading.Event], serial.Serial | None],
        *,
        passes: bool,
    ) -> None:
        self._url, self._port, self._reopen, self.passes = url, port, reopen, passes
        self._set_up(port)
        self._stop = threading.Event()
        self._is_gone = self._is_full = False
        self._bound_ms = 0.0
        self._report: Callable[[str, str], None] = lambda kind, text: None
        self._thread: threading.Thread | None = None

    def start(
        self,
        read: Callable[[serial.Serial], bytes],
        heard: Callable[[bytes], None],
        report: Callable[[str, str], None],
    ) -> None:
        """Begin to read."""
        self._report = report
        self._thread = threading.Thread(target=self._run, args=[read, heard], name="second port", daemon=True)
        self._thread.start()

    def pass_on(self, data: bytes, read_ns: int) -> None:
        """Send the sensor's bytes, which were read at this monotonic instant; never waits long, never fails."""
        if not self.passes or self._is_gone:
            return
        try:
            self._port.write(data)
            self._is_full = False
        except Exception as error:  # pyserial's handlers have errors of their own
            if not self._is_full:
                self._is_full = True
                self._report(LinkKind.OTHER_END, f"{self._url} takes no bytes ({error}): they are recorded, not passed")
        self.took((time.monotonic_ns() - read_ns) / 1e6)

    def took(self, delay_ms: float) -> None:
        """Passing took so long: told where that is beyond what was told before."""
        if delay_ms <= self._bound_ms:
            return
        self._bound_ms = self._bound_ms or _LEAST_BOUND_MS
        while self._bound_ms < delay_ms:
            self._bound_ms *= 2
        self._report(LinkKind.PASSING, f"passing bytes on takes up to {self._bound_ms:g} ms; it is in the budget")

    def close(self) -> None:
        """Stop reading and close the port."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(timeout=3.0)
        self._port.close()

    def _set_up(self, port: serial.Serial) -> None:
        if isinstance(port, serial.Serial):
            port.write_timeout = _WRITE_TIMEOUT_S

    def _run(self, read: Callable[[serial.Serial], bytes], heard: Callable[[bytes], None]) -> None:
        while not self._stop.is_set():
            try:
                data = read(self._port)
            except Exception as error:  # as in drivers/link.py: whatever it is, the port is opened again
                if not self._stop.is_set():
                    self._open_again(error)
                continue
            if data:
                heard(data)

    def _open_again(self, error: BaseException) -> None:
        self._is_gone = True
        why = str(error).split("\n")[0][:120] or type(error).__name__
        self._report(LinkKind.OTHER_END, f"{self._url} is gone ({why}); waiting for it to come back")
        self._port.close()
        port = self._reopen(self._stop)
        if port is not None:
            self._set_up(port)
            self._port, self._is_gone = port, False
            self._report(LinkKind.OTHER_END, f"{self._url} is open again")


def passing_bound_s(events: Iterable[LinkEvent]) -> float:
    """How long passing bytes on took at most in a session, by its events; 0 where none were passed."""
    told = (_TOLD.match(event.text) for event in events if event.kind == LinkKind.PASSING)
    return max((float(found[1]) for found in told if found), default=0.0) / 1000
