"""A Dask cluster, an SFTP server and an S3 server as devices under test: real processes on loopback."""

import ctypes
import getpass
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import psutil
import pytest
from devices.patience import PATIENCE_S
from devices.s3_server import S3Server, s3_server

WORKER_TTL_S = 6


@dataclass
class Started:
    """A process, ended with all it started."""

    process: subprocess.Popen[bytes]

    def end(self, number: int = signal.SIGKILL) -> None:
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, number)
        self.process.wait(PATIENCE_S)


def start(
    *command: object, env: dict[str, str] | None = None, log: Path | None = None, before: Callable[[], object] = tuple
) -> Started:
    """Start a program as the leader of a process group."""
    ends_with_us = _end_with_us if threading.current_thread() is threading.main_thread() else tuple
    with open(log or os.devnull, "ab") as out:
        process = subprocess.Popen(
            [str(part) for part in command],
            env=env,
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=out,
            start_new_session=True,
            preexec_fn=lambda: (ends_with_us(), before()),
        )
    return Started(process)


def _end_with_us() -> None:
    """Linux ends this process when the test run is gone, however it was ended: prctl(PR_SET_PDEATHSIG).

    It means the thread that started the process: one that a test's own thread starts must outlive that thread.
    """
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@dataclass
class Sshd:
    """Debian's sshd with a key and a host key of its own."""

    folder: Path
    port: int = field(default_factory=free_port)
    _server: Started | None = None

    def __post_init__(self) -> None:
        if not Path("/usr/sbin/sshd").exists() or shutil.which("ssh-keygen") is None:
            pytest.skip("no sshd on this machine (Debian: apt install openssh-server)")
        for name in ("host", "own", "other"):
            command = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(self.folder / name)]
            subprocess.run(command, check=True, stdin=subprocess.DEVNULL)
        host_key = (self.folder / "host.pub").read_text()
        (self.folder / "known_hosts").write_text(f"[127.0.0.1]:{self.port} {host_key}")
        shutil.copy(self.folder / "own.pub", self.folder / "authorized")
        (self.folder / "config").write_text(
            f"Port {self.port}\nListenAddress 127.0.0.1\nHostKey {self.folder / 'host'}\nUsePAM no\nStrictModes no\n"
            f"PidFile none\nAuthorizedKeysFile {self.folder / 'authorized'}\nPermitRootLogin yes\n"
            "PasswordAuthentication no\nSubsystem sftp internal-sftp\n"
        )

    def options(self, key: str = "own") -> dict[str, object]:
        """What fsspec needs to know of it."""
        return {
            "username": getpass.getuser(),
            "key_filename": str(self.folder / key),
            "known_hosts": str(self.folder / "known_hosts"),
            "allow_agent": False,
            "look_for_keys": False,
        }

    def url(self, path: Path) -> str:
        return f"sftp://127.0.0.1:{self.port}{path}"

    def start(self) -> None:
        Path("/run/sshd").mkdir(exist_ok=True)
        log = self.folder / "log"
        self._server = start("/usr/sbin/sshd", "-D", "-e", "-f", self.folder / "config", log=log)
        wait_for_port(self.port)

    def stop(self) -> None:
        """Its connections end with it: each is served by a process of its own, which would go on alone."""
        if self._server is None:
            return
        served = psutil.Process(self._server.process.pid).children(recursive=True)
        self._server.end()
        self._server = None
        for one in served:
            with suppress(psutil.NoSuchProcess):
                one.kill()
        psutil.wait_procs(served)


def wait_for_port(port: int) -> None:
    """Until something listens; each try waits for an answer of the system, not for a time."""
    until_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < until_s:
        with socket.socket() as probe:
            probe.settimeout(1)
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        subprocess.run(["true"], check=True)
    raise TimeoutError(f"nothing listens on port {port}")


@dataclass
class Cluster:
    """A scheduler and its workers, each with one thread, in processes of their own."""

    address: str
    sshd: Sshd
    scheduler: Started
    s3: S3Server


@contextmanager
def cluster(folder: Path, workers: int = 2):
    """A scheduler, workers with credentials of an SFTP server and an S3 server, and these servers.

    The workers are those of an old processor, as far as OpenBLAS is concerned.
    """
    with ExitStack() as stack:
        sshd = Sshd(folder)
        sshd.start()
        stack.callback(sshd.stop)
        s3 = stack.enter_context(s3_server())
        env = (
            os.environ
            | s3.environment
            | {
                "FSSPEC_SFTP": json.dumps(sshd.options()),
                "DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": f"{WORKER_TTL_S}s",
                "DASK_TEMPORARY_DIRECTORY": str(folder),
                "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False",
                "OPENBLAS_CORETYPE": "Nehalem",  # as on a processor that has no newer kernel
            }
        )
        address = f"tcp://127.0.0.1:{free_port()}"
        common = ("--no-dashboard", "--dashboard-address", "127.0.0.1:0", "--protocol", "tcp")
        dask = (sys.executable, "-m", "dask")
        scheduler = start(*dask, "scheduler", "--host", address, *common, env=env, log=folder / "scheduler.log")
        stack.callback(scheduler.end)
        wait_for_port(int(address.rsplit(":", 1)[1]))
        options = ("--nthreads", 1, "--nworkers", workers, "--host", "127.0.0.1", *common)
        pool = start(*dask, "worker", address, *options, env=env, log=folder / "workers.log")
        stack.callback(pool.end)
        yield Cluster(address, sshd, scheduler, s3)
