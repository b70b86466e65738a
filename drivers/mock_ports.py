"""The mock ports behind replay://PATH?option=value&... and sim://?option=value&...: their bytes carry their own time.

They are pyserial ports like any other (read, write, in_waiting, timeout), and besides give whole chunks with the
stamps of the data, so that time need not come from the host.
"""

import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Protocol
from urllib.parse import parse_qsl, quote, unquote, urlencode

from serial import PortNotOpenError, SerialBase, SerialException

from drivers.chunk import Chunk, LinkEvent
from drivers.errors import DriverError, UrlError


@dataclass(frozen=True, slots=True)
class MockUrl:
    """A mock port's URL, taken apart: the path is unquoted, the options are in ``options``."""

    scheme: str
    path: str
    options: dict[str, str] = field(default_factory=dict)

    def number(self, name: str, default: int, least: int) -> int:
        """A whole-number option; UrlError says what was expected."""
        text = self.options.get(name, "")
        if not text:
            return default
        try:
            value = int(text)
        except ValueError:
            value = least - 1
        if value < least:
            raise UrlError(f"{self.scheme}://: {name}={text} does not work: expected a whole number from {least} on")
        return value

    def speed(self) -> float:
        """The pace against the recorded or simulated time; infinite for ``max``, which is the default."""
        text = self.options.get("speed", "max")
        try:
            speed = float("inf") if text == "max" else float(text)
        except ValueError:
            speed = 0.0
        if not speed > 0:
            raise UrlError(f"{self.scheme}://: speed={text} does not work: expected max, 1, or a factor such as 20")
        return speed


def parse_mock_url(url: str) -> MockUrl:
    """The parts of a mock port's URL; an option given twice is refused."""
    scheme, _, rest = url.partition("://")
    path, _, query = rest.partition("?")
    pairs = parse_qsl(query, keep_blank_values=True)
    options = dict(pairs)
    if len(options) != len(pairs):
        raise UrlError(f"{url}: an option is given twice")
    return MockUrl(scheme.lower(), unquote(path, errors="surrogateescape"), options)


def replay_url(path: Path | str, **options: object) -> str:
    """The URL that replays a recording; any path works, also with spaces, question marks or bytes that are not UTF-8.

    Options: speed, from and to (RFC 3339 UTC; write ``from_`` in Python), loop, cut, start_utc, faults, seed.
    """
    query = urlencode(
        {name.rstrip("_"): value for name, value in options.items() if value is not None}, quote_via=quote
    )
    return "replay://" + quote(str(path), safe="/:\\", errors="surrogateescape") + ("?" + query if query else "")


def sim_url(**options: object) -> str:
    """The URL of a simulated sensor with options."""
    query = urlencode(
        {name.rstrip("_"): value for name, value in options.items() if value is not None}, quote_via=quote
    )
    return "sim://" + ("?" + query if query else "")


if TYPE_CHECKING:
    from typing_extensions import Buffer

Item = Chunk | LinkEvent


class TimestampedPort(Protocol):
    """What SerialLink asks of a port that carries its own time."""

    timeout: float | None

    @property
    def at_end(self) -> bool:
        """Whether everything has been given."""

    def due(self) -> Iterator[Item]:
        """Chunks and events for as long as the next one is due within ``timeout`` of when it is asked for."""

    def stamp(self) -> tuple[int, int]:
        """UTC and monotonic nanoseconds of the port's own now."""

    def write(self, data: bytes, /) -> int:
        """Send a command."""


class Pace:
    """When recorded instants are due: an absolute schedule, so that delays do not add up.

    The host's monotonic clock is used to wait, never to stamp.
    """

    def __init__(self, speed: float) -> None:
        self.is_endless = speed == float("inf")
        self._speed = speed
        self._started: tuple[float, int] | None = None
        self._last_ns = 0
        self._stop = threading.Event()

    def wait(self, mono_ns: int, timeout_s: float | None) -> bool:
        """Wait until the instant is due, at most ``timeout_s``; whether it is."""
        if self.is_endless:
            return True
        if self._started is None or mono_ns < self._last_ns:
            # The monotonic clock begins anew with each boot of the recording host, and with each pass of a loop.
            self._started = (time.monotonic(), mono_ns)
        self._last_ns = mono_ns
        started_s, started_ns = self._started
        left_s = started_s + (mono_ns - started_ns) * 1e-9 / self._speed - time.monotonic()
        if left_s > 0:
            self._stop.wait(left_s if timeout_s is None else min(left_s, timeout_s))
        return timeout_s is None or left_s <= timeout_s

    def stop(self) -> None:
        """Wake a waiting read."""
        self._stop.set()


class TimestampedSerial(SerialBase):
    """A pyserial port over an iterator of timestamped chunks and events; subclasses open the iterator."""

    def _open_items(self) -> tuple[Iterator[Item], float]:
        """The items and the speed to give them at; DriverError where the URL or what it names is wrong."""
        raise NotImplementedError

    def _take(self, data: bytes) -> None:
        """A command that was written to the port."""
        raise NotImplementedError

    def open(self) -> None:
        """Open the recording or the simulation; SerialException, caused by a DriverError that says why not."""
        if self.is_open:
            raise SerialException("Port is already open.")
        try:
            self._items, speed = self._open_items()
        except DriverError as error:
            raise SerialException(str(error)) from error
        self._pace = Pace(speed)
        self._next: Item | None = None
        self._rest = b""
        self._latest: Item = Chunk(0, 0, b"")
        self._ended = False
        self.is_open = True

    def close(self) -> None:
        """Close the port and wake a read that waits."""
        if self.is_open:
            self.is_open = False
            self._pace.stop()

    @property
    def at_end(self) -> bool:
        """Whether everything has been given."""
        return not self._rest and self._peek() is None

    def due(self) -> Iterator[Item]:
        """Chunks and events for as long as the next one is due within ``timeout`` of when it is asked for.

        A generator, because a night has a million of them.
        """
        if not self.is_open:
            raise PortNotOpenError()
        if self._rest:
            rest, self._rest = self._rest, b""
            yield Chunk(*self.stamp(), rest)
        pace, items = self._pace, self._items
        if self._next is not None:
            items, self._next = chain([self._next], items), None
        for item in items:
            if not (pace.is_endless or pace.wait(item.mono_ns, self.timeout)):
                self._next = item
                return
            self._latest = item
            yield item
        self._ended = True

    def read_timestamped(self) -> Item | None:
        """The next chunk or event, or None when none is due within ``timeout`` or there are no more."""
        return next(self.due(), None)

    def read(self, size: int = 1) -> bytes:
        """At most ``size`` bytes, as pyserial gives them; fewer on a time-out and at the end."""
        data = bytearray()
        while len(data) < size:
            item = self.read_timestamped()
            if item is None:
                break
            if isinstance(item, Chunk):
                wanted = size - len(data)
                data += item.data[:wanted]
                self._rest = item.data[wanted:]
        return bytes(data)

    @property
    def in_waiting(self) -> int:
        """Bytes that a read would give at once."""
        if not self.is_open:
            raise PortNotOpenError()
        if self._rest:
            return len(self._rest)
        item = self._peek()
        return len(item.data) if isinstance(item, Chunk) and self._pace.wait(item.mono_ns, 0) else 0

    def write(self, data: "Buffer", /) -> int:
        """Send a command to what stands behind the port."""
        if not self.is_open:
            raise PortNotOpenError()
        command = bytes(data)
        self._take(command)
        return len(command)

    def stamp(self) -> tuple[int, int]:
        """UTC and monotonic nanoseconds of the last chunk given: the port's own now."""
        return self._latest.utc_ns, self._latest.mono_ns

    def reset_input_buffer(self) -> None:
        """Nothing: a recording is never thrown away."""

    def reset_output_buffer(self) -> None:
        """Nothing waits to be sent."""

    def flush(self) -> None:
        """Nothing waits to be sent."""

    def _peek(self) -> Item | None:
        if self._next is None and not self._ended:
            self._next = next(self._items, None)
            self._ended = self._next is None
        return self._next

    def _reconfigure_port(self) -> None:
        """There is no line to configure."""

    def _update_break_state(self) -> None:
        """There is no line to break."""

    def _update_rts_state(self) -> None:
        """There are no modem lines."""

    def _update_dtr_state(self) -> None:
        """There are no modem lines."""
