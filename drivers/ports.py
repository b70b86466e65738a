"""Serial ports of this computer: list, processes that hold them, opening with clear errors."""

import errno
import getpass
import os
import re
import socket
import struct
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import serial
from serial.rs485 import RS485Settings
from serial.tools import list_ports

from drivers.errors import DriverError, PortError, UrlError
from drivers.urlhandlers.network_ports import Rfc2217Port, SocketPort

try:
    import termios

    ioctl_error: type[Exception] = termios.error  # no OSError
except ImportError:  # Windows
    ioctl_error = OSError
MOCKS = ("replay://", "sim://")
_ON_THE_NET = {"socket://": SocketPort, "rfc2217://": Rfc2217Port}
_BY_ID = Path("/dev/serial/by-id")
"""Where udev keeps a link for each USB adapter, named after its maker, product, serial number and interface."""
READ_TIMEOUT_S = 0.2
"""How long a read waits for the first byte: also how long closing takes where a read cannot be cancelled."""
WRITE_TIMEOUT_S = 1.0
_PROBES = {"TCP_KEEPIDLE": 10, "TCP_KEEPINTVL": 5, "TCP_KEEPCNT": 3, "TCP_USER_TIMEOUT": 20_000}
"""After 10 s of silence a probe every 5 s, three without an answer end it; 20 s (in ms) for what we send."""
serial.protocol_handler_packages.append("drivers.urlhandlers")


@dataclass(frozen=True, slots=True)
class Rs485:
    """How a driver switches a line of two wires: the level of RTS while it sends and receives, the pauses before."""

    rts_level_tx: bool = True
    rts_level_rx: bool = False
    delay_before_tx_ms: float = 0.0
    delay_before_rx_ms: float = 0.0


@dataclass(frozen=True, slots=True)
class LineSettings:
    """Settings of a serial line beside its rate; the defaults are 8N1 without flow control."""

    parity: str = "none"
    data_bits: int = 8
    stop_bits: float = 1
    rtscts: bool = False
    xonxoff: bool = False
    rs485: Rs485 | None = None

    @property
    def bits_per_byte(self) -> float:
        """With start, parity and stop bits."""
        return 1 + self.data_bits + (self.parity != "none") + self.stop_bits

    def __str__(self) -> str:
        flow = "".join(f", {name}" for name in ("rtscts", "xonxoff") if getattr(self, name))
        return f"{self.data_bits}{self.parity[0].upper()}{self.stop_bits:g}{flow}{', RS-485' if self.rs485 else ''}"

    def apply(self, port: Any) -> None:
        """Set up a port that is not open yet."""
        port.parity = _PARITIES[self.parity]
        port.bytesize, port.stopbits = self.data_bits, self.stop_bits
        port.rtscts, port.xonxoff = self.rtscts, self.xonxoff
        if self.rs485 is not None:
            port.rs485_mode = RS485Settings(
                rts_level_for_tx=self.rs485.rts_level_tx,
                rts_level_for_rx=self.rs485.rts_level_rx,
                delay_before_tx=self.rs485.delay_before_tx_ms / 1000 or None,
                delay_before_rx=self.rs485.delay_before_rx_ms / 1000 or None,
            )


PLAIN_LINE = LineSettings()
_PARITIES = {
    "none": serial.PARITY_NONE,
    "even": serial.PARITY_EVEN,
    "odd": serial.PARITY_ODD,
    "mark": serial.PARITY_MARK,
    "space": serial.PARITY_SPACE,
}
_TIOCGICOUNT = 0x545D
"""linux/serial.h: struct serial_icounter_struct, eleven counters and nine spare integers."""
_COUNTERS = {"framing": 6, "overrun": 7, "parity": 8, "buffer overrun": 10}


def line_errors(port: serial.Serial) -> dict[str, int] | None:
    """The errors that the driver of an open port has counted; None where it counts none."""
    try:
        import fcntl

        counts = struct.unpack("20i", fcntl.ioctl(port.fileno(), _TIOCGICOUNT, bytes(80)))
    except Exception:  # a port without a file, a driver without counters, another system
        return None
    return {name: counts[at] for name, at in _COUNTERS.items()}


def line_in_use(device: str) -> str | None:
    """Rate and settings of the line of a device that is open, such as ``115200 8N1``; None where they cannot be read.

    To open a device that nobody has open may reset what is on the other end: ask only where there are ``holders``.
    """
    try:
        import termios

        opened = os.open(device, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            iflag, _, cflag, _, speed, *_ = termios.tcgetattr(opened)
        finally:
            os.close(opened)
        return line_of_flags(iflag, cflag, speed)
    except Exception:  # another system, no right to read it, not a terminal
        return None


_CMSPAR = 0o10000000000
"""asm-generic/termbits.h: the parity bit is always 1 (with PARODD) or 0."""


def line_of_flags(iflag: int, cflag: int, speed: int) -> str:
    """Rate and settings of a line by the flags of its termios."""
    import termios

    rates = {getattr(termios, name): name[1:] for name in dir(termios) if re.fullmatch(r"B[1-9]\d*", name)}
    odd = bool(cflag & termios.PARODD)
    parity = ("space", "mark")[odd] if cflag & _CMSPAR else ("even", "odd")[odd]
    line = LineSettings(
        parity if cflag & termios.PARENB else "none",
        {termios.CS5: 5, termios.CS6: 6, termios.CS7: 7}.get(cflag & termios.CSIZE, 8),
        2 if cflag & termios.CSTOPB else 1,
        bool(cflag & termios.CRTSCTS),
        bool(iflag & (termios.IXON | termios.IXOFF)),
    )
    return f"{rates.get(speed, 'another rate')} {line}"


@dataclass(frozen=True, slots=True)
class PortInfo:
    """One serial port: its device, its description, and its USB identity if it has one.

    ``interface`` tells the ports of one adapter apart, ``by_id`` is the name that udev gives it, whatever its number.
    """

    device: str
    description: str
    vid: int | None = None
    pid: int | None = None
    serial_number: str | None = None
    interface: str | None = None
    by_id: str | None = None

    @property
    def identity(self) -> tuple[int | None, int | None, str | None, str | None]:
        """What is the same under any device name."""
        return self.vid, self.pid, self.serial_number, self.interface

    def is_same_adapter(self, other: "PortInfo") -> bool:
        """Whether both are the same port of one USB adapter, under whatever name; False where that cannot be known."""
        return bool(self.serial_number) and self.identity == other.identity

    def is_other_adapter(self, other: "PortInfo") -> bool:
        """Whether both are certainly different ones; two of a kind without serial numbers cannot be told apart."""
        return self.vid is not None and other.vid is not None and self.identity != other.identity

    @property
    def url_that_stays(self) -> str | None:
        """A URL of this very adapter, whatever its device is called after it was plugged in again; None without one."""
        if self.by_id is not None:
            return self.by_id
        return f"hwgrep://{self.serial_number}" if self.serial_number and self.serial_number.isalnum() else None

    def __str__(self) -> str:
        number = f"serial number {self.serial_number}" if self.serial_number else "without a serial number"
        return f"{self.description or 'no description'}, {number}"


def ports_here() -> list[PortInfo]:
    """The serial ports that the system knows, sorted by device."""
    stable = names_by_id(_BY_ID)
    found = (
        PortInfo(
            port.device,
            _described(port.description),
            port.vid,
            port.pid,
            port.serial_number,
            (port.location or "").partition(":")[2] or None,
            stable.get(os.path.realpath(port.device)),
        )
        for port in list_ports.comports()
    )
    return sorted(found, key=lambda port: port.device)


def names_by_id(folder: Path) -> dict[str, str]:
    """The links of a folder by the devices that they name; empty where there is no such folder."""
    try:
        return {os.path.realpath(link): str(link) for link in sorted(folder.iterdir())}
    except OSError:
        return {}


def holders(device: str) -> list[str]:
    """Other processes that have a device open, as ``name (pid N)``; only those visible in /proc."""
    target = os.path.realpath(device)
    found = []
    for process in sorted(Path("/proc").glob("[0-9]*"), key=lambda path: int(path.name)):
        if process.name != str(os.getpid()) and _has_open(process, target):
            found.append(f"{_name(process)} (pid {process.name})")
    return found


def _has_open(process: Path, target: str) -> bool:
    try:
        return any(os.readlink(fd) == target for fd in (process / "fd").iterdir())
    except OSError:
        # Another user's process, or one that ended meanwhile.
        return False


def _name(process: Path) -> str:
    try:
        return (process / "comm").read_text().strip()
    except OSError:
        return "a process"


def is_mock(url: str) -> bool:
    """Whether a URL names a recording or a simulation."""
    return url.lower().startswith(MOCKS)


def is_awaitable(url: str, error: PortError) -> bool:
    """Whether a port that did not open may open later: not a mock, and not an invalid URL."""
    return not is_mock(url) and not isinstance(error, UrlError)


def is_accessible(device: str) -> bool:
    """Whether we may read and write a device."""
    return os.access(device, os.R_OK | os.W_OK)


def is_device(url: str) -> bool:
    """Whether a URL is the plain name of a device."""
    return "://" not in url


def is_of_an_adapter(url: str) -> bool:
    """Whether a URL stands for one of this computer's ports, which an adapter may have."""
    return is_device(url) or url.lower().startswith("hwgrep://")


def has_baud_rate(url: str) -> bool:
    """Whether bytes from a URL came over a line with the stated baud rate."""
    return is_of_an_adapter(url) or url.lower().startswith("rfc2217://")


def open_port(url: str, baudrate: int, line: LineSettings = PLAIN_LINE) -> serial.Serial:
    """Open a port by its pyserial URL; PortError with reason and advice if that fails."""
    _check(url)
    try:
        port: serial.Serial = _made(url, baudrate)
        if line != PLAIN_LINE:
            line.apply(port)
        port.open()
    except (OSError, ValueError, NotImplementedError) as error:
        if isinstance(error.__cause__, DriverError):
            raise error.__cause__ from None
        kind = UrlError if isinstance(error, ValueError) else PortError
        raise kind(explain(url, error)) from error
    except ioctl_error as error:
        raise PortError(
            f"{url} refuses {baudrate} baud with {line.data_bits} data bits, parity {line.parity} and "
            f"{line.stop_bits:g} stop bits: {error.args[-1]}; give what its driver has as "
            "port.baudrate, port.parity and so on; a pseudo-terminal has 8 bits and no parity"
        ) from error
    _keep_alive(getattr(port, "_socket", None))
    if isinstance(port, serial.Serial) and (names := _intruders(str(port.port))):
        port.close()
        raise PortError(_busy(url, names))
    return port


def _made(url: str, baudrate: int) -> Any:
    """The port of a URL, not open yet."""
    for scheme, network_port in _ON_THE_NET.items():
        if url.lower().startswith(scheme):
            connection: Any = network_port(None, baudrate=baudrate, timeout=READ_TIMEOUT_S)
            connection.port = _asked(url)
            return connection
    port = serial.serial_for_url(url, baudrate=baudrate, timeout=READ_TIMEOUT_S, do_not_open=True)
    # pyserial empties the input on opening: bytes that have already been received are part of the record.
    for name in ("reset_input_buffer", "_reset_input_buffer"):
        setattr(port, name, lambda: None)
    if isinstance(port, serial.Serial):
        port.exclusive = True
        port.write_timeout = WRITE_TIMEOUT_S
    return port


def _keep_alive(connection: object) -> None:
    """Enable TCP keep-alive, so that a dead network port is noticed within half a minute."""
    if not isinstance(connection, socket.socket):
        return
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in _PROBES.items():
        # Linux has them all, other systems some.
        if hasattr(socket, name):
            connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


def _asked(url: str) -> str:
    """The URL as pyserial needs it."""
    if not url.lower().startswith("rfc2217://") or "ign_set_control" in url:
        return url
    # Servers without modem lines never answer pyserial's request about them, and it would wait.
    return url + ("&" if "?" in url else "?") + "ign_set_control"


def _check(url: str) -> None:
    """Refuse URLs for which pyserial has no clear error."""
    if not url:
        raise UrlError("the port has no name; expected for example /dev/ttyUSB0, hwgrep://FT232 or sim://")
    if url.lower().startswith(tuple(_ON_THE_NET)):
        try:
            port = urlsplit(url).port
        except ValueError:
            port = None
        if not port:
            raise UrlError(f"{url} has no port number from 1 to 65535; expected for example socket://127.0.0.1:4000")


def _intruders(device: str) -> list[str]:
    # Our lock does not prevent a plain open, which would take bytes away. A pty is held by its maker.
    return [] if os.path.realpath(device).startswith("/dev/pts/") else holders(device)


def explain(url: str, error: Exception) -> str:
    """Reason and advice for a port that did not open, in one or two lines."""
    number = getattr(error, "errno", None)
    if is_device(url) and not os.path.exists(url):
        return f"there is no port {url}; {_known(ports_here())}"
    if number in (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK):
        return _busy(url, holders(url))
    if number in (errno.EACCES, errno.EPERM) and is_device(url) and not os.path.isfile(url):  # its group may be root
        return (
            f"no permission for {url}: add yourself to its group and log in again:\n"
            f"sudo usermod -aG {_group(url)} {getpass.getuser()}"
        )
    if url.lower().startswith("hwgrep://"):
        return f"no port matches {url}; {_known(ports_here())}"
    if isinstance(error, ValueError):
        hint = f"; TCP is written socket://{url[6:]}" if url.lower().startswith("tcp://") else ""
        return f"{url} is not a port that can be opened: {error}{hint}"
    if is_device(url) and not number:
        return f"{url} is not a serial port: {error}"
    hint = "; is the server that shall send the bytes running there?" if "refused" in str(error) else ""
    return f"cannot open {url}: {error}{hint}"


def _busy(url: str, names: list[str]) -> str:
    by = ", ".join(names) or "another program"
    return f"{url} is busy: held by {by}; close it and try again"


def _described(text: str | None) -> str:
    """pyserial says n/a where the system has no description."""
    return "" if text in (None, "n/a") else str(text)


def _known(ports: Iterable[PortInfo]) -> str:
    text = ", ".join(f"{port.device} ({port.description or 'no description'})" for port in ports)
    return f"ports here: {text}" if text else "there are no serial ports here: plug in the adapter"


def _group(device: str) -> str:
    try:
        return Path(device).group()
    except (OSError, KeyError, NotImplementedError):  # the last without groups, as on Windows
        return "dialout"
