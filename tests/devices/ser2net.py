"""Debian's ser2net on a pty: a serial line over the network, by rfc2217:// or socket://."""

import os
import shutil
import signal
import socket
import subprocess
import time
from pathlib import Path

from devices.patience import PATIENCE_S

PROGRAM = shutil.which("ser2net") or shutil.which("/usr/sbin/ser2net")
ACCEPTERS = {"rfc2217": "telnet(rfc2217),tcp", "socket": "tcp"}


class Ser2net:
    """A server for one serial device; ``url`` is what the driver opens. A context manager."""

    def __init__(self, scheme: str, device: Path, folder: Path, address: str = "127.0.0.1") -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self.url = f"{scheme}://{address}:{self.port}"
        self._config = folder / "ser2net.yaml"
        self._config.write_text(
            f"connection: &sensor\n  accepter: {ACCEPTERS[scheme]},{address},{self.port}\n"
            f"  connector: serialdev,{device},115200n81,local\n"
        )
        self.start()

    def start(self, *before: str) -> None:
        """Run it, or run it again."""
        assert PROGRAM is not None
        command = [*before, PROGRAM, "-n", "-d", "-u", "-c", str(self._config)]
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def kill(self) -> None:
        """End it as a power failure does."""
        self._process.send_signal(signal.SIGKILL)
        self._process.wait()

    def await_open(self, device: Path) -> None:
        """Wait until it has opened its serial device, which it does for each client."""
        target, until_s = os.path.realpath(device), time.monotonic() + PATIENCE_S
        fds = Path(f"/proc/{self._process.pid}/fd")
        while not any(os.path.realpath(fd) == target for fd in fds.iterdir()):
            assert time.monotonic() < until_s, "ser2net has not opened its device"
            time.sleep(0.01)

    def __enter__(self) -> "Ser2net":
        return self

    def __exit__(self, *error: object) -> None:
        self.kill()
