"""The rerun program: found, started without its telemetry, and the files of the web viewer that it carries."""

import importlib.metadata
import importlib.util
import os
import socket
import subprocess
import sys
import threading
import urllib.error
import urllib.request
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from gse.errors import GseError, UsageError

# Ports of this machine to serve on.


def free_port(bind: str) -> int:
    """A free TCP port on an IPv4 address of this machine; UsageError for another address.

    rerun only prints an error when its port is taken.
    """
    with socket.socket() as probe:
        try:
            probe.bind((bind, 0))
        except OSError as error:
            raise UsageError(
                f"cannot serve on {bind}: {error.strerror}; expected an IPv4 address of this machine"
            ) from error
        port: int = probe.getsockname()[1]
        return port


_MISSING = (
    "rerun-sdk is not installed, which draws this view; install it with: pip install 'rerun-sdk>=0.41,<0.42'\n"
    "there is none for Macs with Intel processors: '--view web' has the page at a glance, 'gse report' the plots"
)


def check_rerun() -> None:
    """UsageError where rerun is not installed; everything but a view in rerun works without it."""
    if importlib.util.find_spec("rerun") is None:
        raise UsageError(_MISSING)


def rerun_version() -> str:
    """Of the installed rerun, empty without one."""
    try:
        return importlib.metadata.version("rerun-sdk")
    except importlib.metadata.PackageNotFoundError:
        return ""


def rerun_program() -> Path:
    """The rerun binary itself; ``bin/rerun`` is a wrapper, and killing it would orphan the binary."""
    check_rerun()
    import rerun_cli  # type: ignore[import-untyped]

    folder = Path(rerun_cli.__file__).parent
    for name in ("rerun", "rerun.exe", "Rerun.app/Contents/MacOS/Rerun"):
        if (folder / name).is_file():
            return folder / name
    raise GseError(f"no rerun program in {folder}: reinstall rerun-sdk")


def quiet_environment() -> dict[str, str]:
    """An environment without usage data from rerun: it sends none where CI is set."""
    return {**os.environ, "CI": "1", "RUST_LOG": "error"}


def open_native_viewer(url: str) -> subprocess.Popen[bytes]:
    """Open rerun's own window on a server or a recording; it outlives this process. UsageError without a screen."""
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise UsageError("there is no screen for a window here (no DISPLAY, no WAYLAND_DISPLAY); use --view web")
    return subprocess.Popen(
        [str(rerun_program()), "--connect", url, "--port", "auto", "--hide-welcome-screen"],
        env=quiet_environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


MEDIA_TYPES = {"/re_viewer.js": "text/javascript", "/re_viewer_bg.wasm": "application/wasm"}

_MAX_FILE_BYTES = 200_000_000
_TRIES = 100
_TRY_EVERY_S = 0.1
_NO_DATA = "rerun+http://127.0.0.1:9/proxy"
"""With this address the program starts no data server of its own."""


class ViewerFiles:
    """The files by path (43 MB); taken from the rerun program when the first one is asked for."""

    def __init__(self) -> None:
        self._lock = threading.Lock()

    def __getitem__(self, path: str) -> bytes:
        with self._lock:
            return self._all[path]

    @cached_property
    def _all(self) -> dict[str, bytes]:
        port = free_port("127.0.0.1")
        options = ["--serve-web", "--bind", "127.0.0.1", "--web-viewer-port", str(port), "--port", "auto", _NO_DATA]
        program = subprocess.Popen(
            [str(rerun_program()), *options],
            env=quiet_environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            return {path: _fetch(f"http://127.0.0.1:{port}{path}") for path in MEDIA_TYPES}
        finally:
            program.kill()
            program.wait()


def _fetch(url: str) -> bytes:
    """The file, once the program listens."""
    pause = threading.Event()
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    for _ in range(_TRIES):
        try:
            with opener.open(url, timeout=10) as answer:
                return bytes(answer.read(_MAX_FILE_BYTES))
        except urllib.error.URLError:
            pause.wait(_TRY_EVERY_S)
    raise GseError(f"the rerun program serves no viewer at {url}; look at the session in a window of its own instead")


@dataclass(frozen=True, slots=True)
class NextPiece:
    """What a viewer does not have yet: a recording (.rrd), the place to go on from, and its last instant (UTC, ns).

    A new ``layout`` is a recording of its own, for before it.
    """

    rrd: bytes = b""
    place: str = ""
    utc_ns: int = 0
    layout: bytes = b""
