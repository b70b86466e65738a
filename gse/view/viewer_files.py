"""The files of rerun's web viewer, as the rerun program carries them."""

import subprocess
import threading
import urllib.error
import urllib.request
from functools import cached_property

from gse.errors import GseError
from gse.view.viewer import free_port, quiet_environment, rerun_program

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
