"""Link to the sensor: any pyserial URL in, time-stamped chunks out.

Here, and only here, received bytes meet the host clock. A separate thread reads a live port and passes every chunk to
the recorder first; when the port disappears, the thread waits for it until the session ends. Ports with recorded time
(drivers/mock_ports.py) are read synchronously and supply the time stamps.
"""

import contextlib
import os
import queue
import threading
import time
from collections.abc import Callable

import serial

from drivers.chunk import Chunk, LinkEvent, LinkKind
from drivers.clock import now
from drivers.errors import PortError
from drivers.mock_ports import Item, TimestampedPort, TimestampedSerial
from drivers.ports import (
    PLAIN_LINE,
    READ_TIMEOUT_S,
    LineSettings,
    PortInfo,
    ioctl_error,
    is_awaitable,
    is_device,
    is_of_an_adapter,
    line_errors,
    open_port,
    ports_here,
)
from drivers.second_port import SecondPort
from drivers.session_file.records import MessageWriter, RecordedMessage

# Reopening of a lost port: under its name, or its USB adapter under another name. Never another adapter that has got
# its name meanwhile: that is another sensor.

FIRST_PAUSE_S = 0.1
LONGEST_PAUSE_S = 5.0
LONGEST_BLIND_PAUSE_S = 0.8
"""For ports that can only be tried, not watched (sockets): back within a second of the port."""
WATCH_S = 0.1


class PortFinder:
    """Tries to open one port until it succeeds, with growing pauses that end at once when the port appears."""

    def __init__(
        self, url: str, baudrate: int, list_ports: Callable[[], list[PortInfo]], line: LineSettings = PLAIN_LINE
    ) -> None:
        self._url, self._baudrate, self._list_ports, self._line = url, baudrate, list_ports, line
        self._adapter: PortInfo | None = None
        self._tell: Callable[[PortInfo, PortInfo], None] = lambda here, expected: None
        self._told: set[object] = set()

    def remember(self, port: serial.Serial) -> None:
        """Note the USB identity of the port, if it has one."""
        self._adapter = self._at(str(port.port)) or self._adapter

    def open_now(self) -> serial.Serial:
        """The port, opened at once; PortError where that fails."""
        return open_port(self._url, self._baudrate, self._line)

    @property
    def adapter(self) -> PortInfo | None:
        """The adapter of the port that was open, where it is known."""
        return self._adapter

    def open_again(
        self, stop: threading.Event, tell: Callable[[PortInfo, PortInfo], None]
    ) -> tuple[str, serial.Serial] | None:
        """Wait for the port: its name now and the open port; None when ``stop`` is set first.

        ``tell`` gets each adapter that has the port's name and is another one, and the one that is waited for.
        """
        pause_s = FIRST_PAUSE_S
        self._tell, self._told = tell, set()
        while not stop.is_set():
            url = self._where()
            if url is not None:
                try:
                    port = open_port(url, self._baudrate, self._line)
                except PortError:
                    # Missing, not ready, or busy: try again.
                    pass
                else:
                    if not self._is_other(str(port.port)):
                        return url, port
                    _close(port)
            self._pause(pause_s, stop, is_absent=url is None)
            pause_s = min(2 * pause_s, LONGEST_PAUSE_S if is_device(self._url) else LONGEST_BLIND_PAUSE_S)
        return None

    def _where(self) -> str | None:
        """The URL to try: the present one of the adapter, else the original one; None while the port is missing."""
        if not is_of_an_adapter(self._url):
            return self._url
        if self._adapter is not None and self._adapter.serial_number:
            for port in self._list_ports():
                if port.is_same_adapter(self._adapter):
                    return port.device
        if not is_device(self._url):
            return self._url if self._adapter is None or not self._adapter.serial_number else None
        return self._url if os.path.exists(self._url) and not self._is_other(self._url) else None

    def _at(self, device: str) -> PortInfo | None:
        """The port of a device name, if it is listed and has a USB identity."""
        real = os.path.realpath(device)
        known = (port for port in self._list_ports() if port.vid is not None)
        return next((port for port in known if os.path.realpath(port.device) == real), None)

    def _is_other(self, device: str) -> bool:
        """Whether a device is certainly not the adapter that is waited for; each such is told once."""
        here = self._at(device) if self._adapter is not None else None
        if self._adapter is None or here is None or not here.is_other_adapter(self._adapter):
            return False
        if here.identity not in self._told:
            self._told.add(here.identity)
            self._tell(here, self._adapter)
        return True

    def _pause(self, pause_s: float, stop: threading.Event, *, is_absent: bool) -> None:
        until_s = time.monotonic() + pause_s
        while (left_s := until_s - time.monotonic()) > 0 and not stop.wait(min(left_s, WATCH_S)):
            if is_absent and self._where() is not None:
                return


BACKLOG_BYTES = 4 << 20
"""Received and not yet fetched, more than 40 s at 921600 baud: the station is too slow."""
ITEMS_AT_ONCE = 3072
"""A sensor's frame comes in three or four chunks, and what is done once for all frames that wait is a twentieth of the
work where it is done for 300 of them."""
MOST_ITEMS = 500_000
MOST_BACKLOG_BYTES = 128 << 20
"""Received and not yet fetched, more than an hour at 115200 baud: further bytes are only recorded."""
SOCKET_BYTES = 65536
NOT_RUN_NS = 1_000_000_000
"""From one read to the next: their own timeout is READ_TIMEOUT_S. Ports hold 4 KiB at least, 0.4 s at 115200 baud."""
_LINE_LOOK_NS = 10_000_000_000
"""How often the driver's counters of errors are read."""
_AT_ONCE_NS = 1_000_000_000
"""A network port that closes sooner refuses: most servers give a serial line to one client."""

# What pyserial raises on a port that goes away: close() from another thread gives TypeError, ioctls termios.error.
_HANG_UPS = (OSError, TypeError, ioctl_error)


class _NoRecording(MessageWriter):
    def write(self, message: RecordedMessage) -> None:
        """Does nothing."""

    def rx(self, chunk: Chunk) -> None:
        """Does nothing, without making a message."""


class SerialLink:
    """A port by its pyserial URL, as a context manager.

    ``receive`` gives chunks and events in the order in which they happened; bytes that were sent are events SENT among
    them. Everything received and sent is recorded. The event BACKLOG means that the station falls behind, BACKLOG_FULL
    that further bytes go to the recording only, until the station has caught up.
    """

    def __init__(
        self,
        url: str,
        baudrate: int = 115200,
        *,
        recorder: MessageWriter | None = None,
        wait_port: bool = False,
        stamped_s: float | None = None,
        list_ports: Callable[[], list[PortInfo]] = ports_here,
        line: LineSettings = PLAIN_LINE,
        pass_to: str | None = None,
        tx_url: str | None = None,
    ) -> None:
        """Open the port; PortError with the reason if that fails. With ``wait_port`` a missing port is waited for.

        ``pass_to`` is the port of a flight computer, to which all is passed, ``tx_url`` that of a tap on what it sends.
        ``stamped_s``: a port with its own time is at its end when so much of it has passed since its first item.
        """
        self.url = url
        self._recorder = recorder or _NoRecording()
        self._stamped: TimestampedPort | None = None
        self._stamped_ns = None if stamped_s is None else round(stamped_s * 1e9)
        self._end_ns: int | None = None
        self._is_over = False
        self._live: _Receiver | None = None
        self._sent: list[Item] = []
        finder = PortFinder(url, baudrate, list_ports, line)
        try:
            port = open_port(url, baudrate, line)
        except PortError as error:
            if not wait_port or not is_awaitable(url, error):
                raise
            second = _second_port(pass_to, tx_url, PortFinder(pass_to or tx_url or "", baudrate, list_ports, line))
            self._live = _Receiver(url, finder, self._recorder, None, str(error), second=second)
        else:
            if isinstance(port, TimestampedSerial):
                self._stamped = port
                return
            try:
                second = _second_port(pass_to, tx_url, PortFinder(pass_to or tx_url or "", baudrate, list_ports, line))
            except PortError:
                port.close()
                raise
            self._live = _Receiver(url, finder, self._recorder, port, second=second)

    @property
    def is_live(self) -> bool:
        """Whether the bytes come now, from a port, timestamped by the host clock."""
        return self._live is not None

    @property
    def at_end(self) -> bool:
        """Whether a recording or simulation was received completely; always False for a live port."""
        return self._stamped is not None and (self._is_over or self._stamped.at_end)

    @property
    def backlog_bytes(self) -> int:
        """Bytes received from a live port and not yet fetched."""
        return self._live.backlog_bytes if self._live else 0

    @property
    def has_news(self) -> bool:
        """Whether chunks or events of a live port have not been fetched yet."""
        return self._live is not None and self._live.has_news

    def utc_ns(self) -> int:
        """UTC nanoseconds now: the host's for a live port, else those of the data, 0 before the first."""
        return now()[0] if self._stamped is None else self._stamped.stamp()[0]

    def mono_ns(self) -> int:
        """Monotonic nanoseconds now: the host's for a live port, else those of the data."""
        return now()[1] if self._stamped is None else self._stamped.stamp()[1]

    def receive(self, timeout_s: float, most: int = ITEMS_AT_ONCE) -> list[Item]:
        """Received chunks and events, at most ``most``; waits at most ``timeout_s`` for the first."""
        if self._live:
            return self._live.fetch(timeout_s, most)
        assert self._stamped is not None
        items, self._sent = self._sent, []
        sent = len(items)
        until_ns = self._stamped.stamp()[1] + round(timeout_s * 1e9)
        self._stamped.timeout = timeout_s
        for item in self._stamped.due():
            if self._is_beyond(item):
                break
            if len(items) == sent:
                self._stamped.timeout = 0
            if isinstance(item, LinkEvent):
                self._record(item)
            elif item.data:
                self._recorder.rx(item)
            elif item.mono_ns < until_ns:
                # A silent simulated sensor sends empty chunks to let its time pass.
                continue
            else:
                break
            items.append(item)
            if len(items) - sent == most:
                break
        return items

    def _is_beyond(self, item: Item) -> bool:
        """Whether an item lies beyond the end that was asked for; none comes after it."""
        if self._stamped_ns is not None and self._end_ns is None:
            self._end_ns = item.mono_ns + self._stamped_ns
        self._is_over = self._end_ns is not None and item.mono_ns >= self._end_ns
        return self._is_over

    def send(self, data: bytes) -> Chunk:
        """Send a command; returns the chunk as recorded. PortError if it cannot be sent."""
        if self._live:
            return self._live.send(data)
        assert self._stamped is not None
        chunk = Chunk(*self._stamped.stamp(), data)
        self._recorder.tx(chunk)
        self._sent.append(_sent(chunk))
        self._stamped.write(data)
        return chunk

    def report(self, event: LinkEvent) -> None:
        """Record an event of this host, and give it in its place among what is received."""
        assert self._live is not None  # a port with its own time has none of this host's
        self._live.put(event)

    def switch_simulated(self, *, on: bool) -> bool:
        """Switch the supply of a simulated sensor; False where the port is none."""
        switch = getattr(self._stamped, "switch", None)
        if switch is not None:
            switch(on=on)
        return switch is not None

    def _record(self, event: LinkEvent) -> None:
        if event.kind == LinkKind.SENT:
            self._recorder.tx(Chunk(event.utc_ns, event.mono_ns, bytes.fromhex(event.text)))
        else:
            self._recorder.event(event)

    def close(self) -> None:
        """Stop receiving; received items can still be fetched."""
        if self._live:
            self._live.close()
        elif isinstance(self._stamped, TimestampedSerial):
            self._stamped.close()

    def __enter__(self) -> "SerialLink":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class _Receiver:
    """Thread that reads a live port and reopens it after a loss."""

    def __init__(
        self,
        url: str,
        finder: PortFinder,
        recorder: MessageWriter,
        port: serial.Serial | None,
        absent: str = "",
        *,
        second: SecondPort | None = None,
    ) -> None:
        self._second = second
        self._url, self._finder, self._recorder, self._port = url, finder, recorder, port
        if port is not None:
            finder.remember(port)
        # No SimpleQueue: its timeout becomes endless where a signal handler takes longer than what is left of it
        # (CPython 3.11, 3.12), and a session that waits for a silent port would never see that it is to end.
        self._items: queue.Queue[Item] = queue.Queue()
        self._order = threading.Lock()
        """Held from recording an item to its place in the queue: a replay gives them in the order of the recording."""
        self._received_bytes = self._fetched_bytes = 0
        self._backlog_reported = self._full_reported = False
        self._line_errors: dict[str, int] | None = None
        self._line_look_ns = 0
        self._opened_before = port is not None
        self._opened_ns = self._read_ns = time.monotonic_ns()
        self._stop = threading.Event()
        self._report(
            *((LinkKind.OPENED, f"{url} is open") if port else (LinkKind.NO_PORT, f"waiting for the port: {absent}"))
        )
        self._thread = threading.Thread(target=self._run, name="receive", daemon=True)
        if second is not None:
            second.start(_read, self._hear, self._report)
        self._thread.start()

    @property
    def backlog_bytes(self) -> int:
        return self._received_bytes - self._fetched_bytes

    @property
    def has_news(self) -> bool:
        return not self._items.empty()

    def fetch(self, timeout_s: float, most: int) -> list[Item]:
        items: list[Item] = []
        try:
            items.append(self._items.get(timeout=timeout_s) if timeout_s > 0 else self._items.get_nowait())
            while len(items) < most:
                items.append(self._items.get_nowait())
        except queue.Empty:
            pass
        self._fetched_bytes += sum(len(item.data) for item in items if isinstance(item, Chunk))
        return items

    def send(self, data: bytes) -> Chunk:
        port = self._port
        if port is None:
            raise PortError(
                f"cannot send: {self._url} is not connected; plug it in again, it is reopened automatically"
            )
        with self._order:
            chunk = Chunk(*now(), data)
            self._recorder.tx(chunk)
            self._items.put(_sent(chunk))
        try:
            port.write(data)
        except _HANG_UPS as error:
            raise PortError(f"cannot send to {self._url}: {error}") from error
        return chunk

    def _hear(self, data: bytes) -> None:
        """Bytes of the flight computer: on to the sensor, where they pass through here, and recorded as sent."""
        chunk = Chunk(*now(), data)
        port = self._port
        if self._second is not None and self._second.passes and port is not None:
            with contextlib.suppress(*_HANG_UPS):  # the reading thread tells that the port is gone
                port.write(data)
            self._second.took((time.monotonic_ns() - chunk.mono_ns) / 1e6)
        self._recorder.tx(chunk)
        self._items.put(_sent(chunk))

    def close(self) -> None:
        self._stop.set()
        if self._second is not None:
            self._second.close()
        port = self._port
        if port is not None and hasattr(port, "cancel_read"):
            with contextlib.suppress(*_HANG_UPS):
                port.cancel_read()
        self._thread.join(timeout=3.0)
        if self._port is not None:
            _close(self._port)

    def _run(self) -> None:
        while not self._stop.is_set():
            if self._port is None:
                self._reopen()
                continue
            try:
                data = _read(self._port)
            except Exception as error:
                # pyserial raises OSError, TypeError, termios.error, and each handler its own errors: after any of them
                # the port is closed and reopened.
                if not self._stop.is_set():
                    self._lose(error)
            else:
                read_ns = time.monotonic_ns()
                self._report_pause(read_ns - self._read_ns)
                self._read_ns = read_ns
                if data:
                    self._take(data)
                self._report_line_errors()
        self._take_rest()

    def _take_rest(self) -> None:
        """Read the bytes that came until the end."""
        with contextlib.suppress(*_HANG_UPS):
            if self._port is not None and self._port.in_waiting:
                self._take(_read(self._port))

    def _take(self, data: bytes) -> None:
        chunk = Chunk(*now(), data)
        if self._second is not None:
            self._second.pass_on(data, chunk.mono_ns)
        with self._order:
            self._recorder.rx(chunk)
            is_full = self.backlog_bytes > MOST_BACKLOG_BYTES or self._items.qsize() > MOST_ITEMS
            if not is_full:
                self._received_bytes += len(data)
                self._items.put(chunk)
        if is_full:
            self._report_full()
            return
        if not self._backlog_reported and self.backlog_bytes > BACKLOG_BYTES:
            self._backlog_reported = True
            self._report(
                LinkKind.BACKLOG,
                f"the station is {self.backlog_bytes} bytes behind; they are recorded and processed later",
            )

    def _report_pause(self, pause_ns: int) -> None:
        if pause_ns > NOT_RUN_NS:
            self._report(
                LinkKind.NOT_RUN,
                f"this computer did not run the station for {pause_ns * 1e-9:.1f} s: it was stopped, or too busy; what "
                "the port cannot hold so long is lost here, not by the sensor",
            )

    def _report_line_errors(self) -> None:
        """What the driver of the port has counted since the last look, where it counts."""
        now_ns = time.monotonic_ns()
        if self._port is None or now_ns < self._line_look_ns:
            return
        self._line_look_ns = now_ns + _LINE_LOOK_NS
        errors = line_errors(self._port)
        if errors is None or self._line_errors is None:
            self._line_errors = errors
            return
        new = {name: count - self._line_errors[name] for name, count in errors.items()}
        self._line_errors = errors
        if found := [f"{count} {name}" for name, count in new.items() if count > 0]:
            text = f"the driver of the port counts {', '.join(found)} errors: check baud rate, parity and cable"
            self._report(LinkKind.LINE_ERRORS, text)

    def _report_full(self) -> None:
        if not self._full_reported:
            self._full_reported = True
            self._report(
                LinkKind.BACKLOG_FULL,
                "the station is too far behind: further bytes are in the recording only; replay the session",
            )

    def _report(self, kind: str, text: str) -> None:
        self.put(LinkEvent(*now(), kind, text))

    def put(self, event: LinkEvent) -> None:
        """Record an event, and queue it in the same place."""
        with self._order:
            self._recorder.event(event)
            self._items.put(event)

    def _lose(self, error: BaseException) -> None:
        port, self._port = self._port, None
        self._line_errors = None
        if port is not None:
            _close(port)
        is_refused = not is_device(self._url) and time.monotonic_ns() - self._opened_ns < _AT_ONCE_NS
        why = f"{_brief(error)}{'; it closed at once: another client may have the line' if is_refused else ''}"
        self._report(LinkKind.LOST, f"{self._url} is gone ({why}); waiting for it to come back")

    def _reopen(self) -> None:
        found = self._finder.open_again(self._stop, self._report_other)
        if found is None:
            return
        url, self._port = found
        self._finder.remember(self._port)
        name = self._url if url == self._url else f"{self._url}, now named {url},"
        adapter = self._finder.adapter
        unknown = self._opened_before and adapter is not None and not adapter.serial_number
        also = "; its adapter has no serial number: make sure that it is the same sensor" if unknown else ""
        self._report(LinkKind.REOPENED if self._opened_before else LinkKind.OPENED, f"{name} is open{also}")
        self._opened_before = True
        self._opened_ns = self._read_ns = time.monotonic_ns()

    def _report_other(self, here: PortInfo, expected: PortInfo) -> None:
        self._report(
            LinkKind.OTHER_ADAPTER,
            f"{here.device} is another adapter now ({here}): waiting for that of this session ({expected}); for "
            "another sensor start another session",
        )


def _second_port(pass_to: str | None, tx_url: str | None, finder: PortFinder) -> SecondPort | None:
    """The open port of the flight computer, or of the tap on its wire; PortError where it does not open."""
    url = pass_to or tx_url
    if url is None:
        return None
    port = finder.open_now()
    finder.remember(port)

    def reopen(stop: threading.Event) -> serial.Serial | None:
        found = finder.open_again(stop, lambda here, expected: None)
        return found[1] if found else None

    return SecondPort(url, port, reopen, passes=pass_to is not None)


def _sent(chunk: Chunk) -> LinkEvent:
    return LinkEvent(chunk.utc_ns, chunk.mono_ns, LinkKind.SENT, chunk.data.hex())


def _read(port: serial.Serial) -> bytes:
    """The waiting bytes, or the first one within the port's timeout and those that came with it.

    A request for more than is waiting would lose all at a hang-up.
    """
    if str(port.port).startswith("socket://"):
        return _read_socket(port)
    first = port.read(port.in_waiting or 1)
    if first:
        # A sensor's frame comes at once: without this its first byte would be a chunk of its own, and the station would
        # be busy with it while the others wait. Whatever goes wrong here, the next read meets again.
        with contextlib.suppress(Exception):
            return first + port.read(port.in_waiting)
    return first


def _read_socket(port: serial.Serial) -> bytes:
    """The same of a socket, which does not know the number of waiting bytes."""
    first = port.read(1)
    if not first:
        return first
    port.timeout = 0
    try:
        return first + port.read(SOCKET_BYTES)
    finally:
        port.timeout = READ_TIMEOUT_S


def _close(port: serial.Serial) -> None:
    # Closing a device that is gone may fail.
    with contextlib.suppress(*_HANG_UPS):
        port.close()


def _brief(error: BaseException) -> str:
    return (str(error) or type(error).__name__).split("\n")[0][:120]
