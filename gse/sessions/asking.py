"""Asks the sensor as the station file says: START, or REQUEST again and again.

START goes out at the beginning, when a lost port is back, and whenever no panorama has come for some periods: so a
sensor that boots late or resets is started again. STOP ends the session. REQUEST goes out each period, or as soon as
the answer to the one before is there or overdue.

A live port is asked on a thread of its own, so that a busy station does not delay a request; a simulated one between
two of its chunks, in its own time.
"""

import contextlib
import threading
from typing import Self

from drivers.errors import PortError
from drivers.link import SerialLink
from gse.config.station import PollOptions, Sensor, StartOptions
from gse.station.polling import STOP, asking_command
from gse.values.instant import NS_PER_S
from protocols import Command, Protocol

AGAIN_NS = 2 * NS_PER_S
"""START is repeated after this silence at the earliest; a sensor takes seconds to boot."""
_SILENT_PERIODS = 5
_WAIT_S = 0.2


class Asking:
    """Sends the commands of ``options`` over a link, as a context manager."""

    def __init__(self, link: SerialLink, protocol: Protocol, options: StartOptions | PollOptions) -> None:
        self._link, self._protocol, self._options = link, protocol, options
        self._sequence = 0
        self._is_start = isinstance(options, StartOptions)
        self._command = asking_command(protocol, options)
        self._lock = threading.Condition()
        self._is_over = False
        self._next_ns = 0
        self._reconnects = 0
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        if self._link.is_live:
            self._next_ns = self._now_ns()
            self._thread = threading.Thread(target=self._run, name="ask", daemon=True)
            self._thread.start()
        else:
            self._pass_time()
        return self

    def came(self, panoramas: int, reconnects: int) -> None:
        """Panoramas came since the last call; so many times the port was lost and is back."""
        with self._lock:
            now_ns, is_back = self._now_ns(), reconnects != self._reconnects
            self._reconnects = reconnects
            if is_back or (panoramas and not self._is_start and self._period_ns is None):
                self._next_ns = now_ns
            elif panoramas and self._is_start:
                self._next_ns = now_ns + self._silence_ns
            self._lock.notify()
        self._pass_time()

    def _pass_time(self) -> None:
        """Send what is due on a port with its own time."""
        if not self._link.is_live and self._now_ns() >= self._next_ns:
            self._next_ns = self._after(self._next_ns or self._now_ns())
            self._send(self._command)

    def wait_s(self) -> float:
        """How long the link may be read until something is due."""
        if self._link.is_live:
            return _WAIT_S
        return min(max((self._next_ns - self._now_ns()) / NS_PER_S, 0.001), _WAIT_S)

    def __exit__(self, *_: object) -> None:
        """Ask no more; a sensor that was started is stopped."""
        with self._lock:
            self._is_over = True
            self._lock.notify()
        if self._thread is not None:
            self._thread.join()
        if self._is_start and STOP in self._protocol.commands:
            self._send(Command(STOP))

    @property
    def _period_ns(self) -> int | None:
        options = self._options
        return None if options.period_ms == "asap" else round(float(options.period_ms) * 1e6)

    @property
    def _silence_ns(self) -> int:
        return max(_SILENT_PERIODS * (self._period_ns or 0), AGAIN_NS)

    def _after(self, due_ns: int) -> int:
        """When the next command is due, after one that was due then."""
        if self._is_start:
            return self._now_ns() + self._silence_ns
        if self._period_ns is not None:
            # A fixed grid: delays do not add up. What was missed is left out.
            missed = max(self._now_ns() - due_ns, 0) // self._period_ns
            return due_ns + (missed + 1) * self._period_ns
        assert isinstance(self._options, PollOptions)
        return self._now_ns() + round(self._options.timeout_ms * 1e6)

    def _now_ns(self) -> int:
        return self._link.mono_ns()

    def _run(self) -> None:
        while True:
            with self._lock:
                while not self._is_over and (left_s := (self._next_ns - self._now_ns()) / NS_PER_S) > 0:
                    self._lock.wait(left_s)
                if self._is_over:
                    return
                self._next_ns = self._after(self._next_ns)
            self._send(self._command)

    def _send(self, command: Command) -> None:
        """A port that is gone is asked again when it is back."""
        data = self._protocol.encode(command, self._sequence)
        self._sequence = (self._sequence + self._protocol.sequence_step) % (self._protocol.sequence_modulus or 1)
        with contextlib.suppress(PortError):
            self._link.send(data)


def asking_of(sensor: Sensor, link: SerialLink, protocol: Protocol) -> Asking | None:
    """What asks this sensor over a link; None where the station file has it asked nothing, or it is a recording."""
    options = sensor.start or sensor.poll
    return None if options is None or link.url.startswith("replay://") else Asking(link, protocol, options)
