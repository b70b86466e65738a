"""A network of its own whose only link can be cut: connections over it become half-open, as behind a dead switch.

    python tests/devices/own_network.py SCHEME [SECONDS_UNTIL_A_PROBE]

runs inside ``unshare``: Debian's ser2net on a pty, the driver on its port, frames before and after the cut; it prints
what came of it as JSON. Without the number the probes of the connection are those of the driver.
"""

import fcntl
import json
import random
import shutil
import socket
import struct
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

UNSHARE = shutil.which("unshare")
ADDRESS = "10.9.8.7"
"""ser2net's name server finds no address on a host that has loopback ones alone."""

_GET_FLAGS, _SET_FLAGS, _SET_ADDRESS, _UP = 0x8913, 0x8914, 0x8916, 1
"""SIOCGIFFLAGS, SIOCSIFFLAGS, SIOCSIFADDR and IFF_UP of linux/sockios.h and linux/if.h."""

PATIENCE_S = 60.0


def can_be_made() -> bool:
    """Whether this system gives a process a network of its own."""
    return UNSHARE is not None and subprocess.run([UNSHARE, "-rn", "true"], capture_output=True).returncode == 0


def half_open(scheme: str, probe_s: int | None = None) -> dict[str, Any]:
    """What the driver does where its connection gets no packet any more, and later again."""
    assert UNSHARE is not None
    command = [UNSHARE, "-rn", sys.executable, __file__, scheme, *([] if probe_s is None else [str(probe_s)])]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout))


def set_link(*, up: bool) -> None:
    """Bring the loopback link up, or cut it: nothing is refused, it only does not arrive."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        request = struct.pack("16sh", b"lo", 0).ljust(40, b"\0")
        flags = struct.unpack_from("16sh", fcntl.ioctl(any_socket, _GET_FLAGS, request))[1]
        flags = flags | _UP if up else flags & ~_UP
        fcntl.ioctl(any_socket, _SET_FLAGS, struct.pack("16sh", b"lo", flags).ljust(40, b"\0"))
        if up:
            address = struct.pack("16sHH4s", b"lo:1", socket.AF_INET, 0, socket.inet_aton(ADDRESS))
            fcntl.ioctl(any_socket, _SET_ADDRESS, address.ljust(40, b"\0"))


def _run(scheme: str, probe_s: int | None) -> dict[str, Any]:
    from devices.ser2net import Ser2net
    from devices.terminal import Terminal

    from drivers.chunk import Chunk, LinkEvent
    from drivers.link import SerialLink

    set_link(up=True)
    rng = random.Random(1)
    with tempfile.TemporaryDirectory() as folder:
        terminal = Terminal(Path(folder) / "tty")
        with (
            Ser2net(scheme, terminal.path, Path(folder), ADDRESS) as server,
            SerialLink(server.url, 115200, wait_port=True) as link,
        ):

            def await_event(kind: str) -> str:
                until_s = time.monotonic() + PATIENCE_S
                while True:
                    for item in link.receive(0.5):
                        if isinstance(item, LinkEvent) and item.kind == kind:
                            return item.text
                    assert time.monotonic() < until_s, f"no {kind}"

            def exchange() -> bool:
                sent, received = rng.randbytes(5000), b""
                terminal.write(sent[:2500])
                terminal.write(sent[2500:])
                until_s = time.monotonic() + PATIENCE_S
                while len(received) < len(sent) and time.monotonic() < until_s:
                    received += b"".join(item.data for item in link.receive(0.5) if isinstance(item, Chunk))
                return received == sent

            await_event("OPENED")
            server.await_open(terminal.path)
            before = exchange()
            if probe_s is not None:
                _probe_every(link, probe_s)
            set_link(up=False)
            cut_s = time.monotonic()
            told = await_event("LOST")
            lost_s = time.monotonic() - cut_s
            server.kill()
            set_link(up=True)
            server.start()
            await_event("REOPENED")
            server.await_open(terminal.path)
            return {"identical": before and exchange(), "lost_s": lost_s, "told": told}


def _probe_every(link: Any, seconds: int) -> None:
    """Let the kernel look after the connection sooner than the driver asks it to."""
    connection = link._live._port._socket
    for name, value in {"KEEPIDLE": 1, "KEEPINTVL": 1, "KEEPCNT": 1, "USER_TIMEOUT": 1000}.items():
        connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, f"TCP_{name}"), value * seconds)


if __name__ == "__main__":
    warnings.simplefilter("ignore", DeprecationWarning)  # pyserial 3.5
    tests = Path(__file__).parents[1]
    sys.path[:0] = [str(tests.parent), str(tests)]  # ``drivers`` is that of the station, and not tests/drivers
    print(json.dumps(_run(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else None)))
