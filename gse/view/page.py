"""The web page of the live view: rerun's viewer, served so that no request leaves the machine.

rerun's own page loads fonts from afar and calls home. Here a page of our own starts the same viewer, and a
Content-Security-Policy lets it talk to this server and to rerun's data server only.
"""

import re
import socket
import subprocess
import threading
import urllib.error
import urllib.request
from functools import cached_property
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from typing import ClassVar

import jinja2

from gse.errors import GseError
from gse.view.viewer import quiet_environment, rerun_program

_VIEWER_FILES = {"/re_viewer.js": "text/javascript", "/re_viewer_bg.wasm": "application/wasm"}
_OWN_FILES = {"/": ("page.html", "text/html; charset=utf-8"), "/start.js": ("start.js.jinja", "text/javascript")}
_MAX_FILE_BYTES = 200_000_000
_TRIES = 100
_NO_DATA = "rerun+http://127.0.0.1:9/proxy"
"""Told where to find data, the program starts no data server of its own."""

_HOST = re.compile(r"[A-Za-z0-9.-]+|\[[0-9A-Fa-f:]+\]")


class ViewerPage:
    """A web server with the viewer; ``url`` is what a person opens."""

    def __init__(self, bind: str, port: int, grpc_port: int) -> None:
        handler = type("_BoundHandler", (_Handler,), {"assets": _Assets(), "grpc_port": grpc_port})
        try:
            self._server = ThreadingHTTPServer((bind, port), handler)
        except OSError as error:
            raise GseError(
                f"cannot serve the view on {bind} port {port}: {error.strerror}; choose another port or address"
            ) from error
        self._server.daemon_threads = True
        self.url = f"http://{bind}:{self._server.server_port}/"
        self._thread = threading.Thread(target=self._server.serve_forever, name="viewer page", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop serving."""
        self._server.shutdown()
        self._server.server_close()


class _Assets:
    """The viewer's files, taken from the rerun program when the page is first opened."""

    def __init__(self) -> None:
        self._lock = threading.Lock()

    def __getitem__(self, path: str) -> bytes:
        with self._lock:
            return self._all[path]

    @cached_property
    def _all(self) -> dict[str, bytes]:
        port = _free_port()
        options = ["--serve-web", "--bind", "127.0.0.1", "--web-viewer-port", str(port), "--port", "auto", _NO_DATA]
        program = subprocess.Popen(
            [str(rerun_program()), *options],
            env=quiet_environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            return {path: _fetch(f"http://127.0.0.1:{port}{path}") for path in _VIEWER_FILES}
        finally:
            program.kill()
            program.wait()


class _Handler(BaseHTTPRequestHandler):
    assets: ClassVar[_Assets]
    grpc_port: ClassVar[int]
    server_version = "gse"
    sys_version = ""

    def do_GET(self) -> None:
        path = self.path.split("?")[0]
        if path in _OWN_FILES:
            name, media_type = _OWN_FILES[path]
            text = resources.files("gse.view").joinpath(name).read_text(encoding="utf-8")
            self._answer(jinja2.Template(text).render(grpc_port=self.grpc_port).encode(), media_type)
        elif path in _VIEWER_FILES:
            self._answer(self.assets[path], _VIEWER_FILES[path])
        else:
            self.send_error(404)

    def _answer(self, body: bytes, media_type: str) -> None:
        self.send_response(200)
        self.send_header("Content-Type", media_type)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Content-Security-Policy", self._policy())
        self.send_header("X-Content-Type-Options", "nosniff")
        self.end_headers()
        self.wfile.write(body)

    def _policy(self) -> str:
        host = _HOST.match(self.headers.get("Host", ""))
        data = f"http://{host[0] if host else '127.0.0.1'}:{self.grpc_port}"
        return (
            "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'unsafe-inline'; "
            f"img-src 'self' data: blob:; worker-src 'self' blob:; connect-src 'self' {data}"
        )

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        """A page that is opened is no news."""


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def _fetch(url: str) -> bytes:
    """The file, once the program listens."""
    pause = threading.Event()
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    for _ in range(_TRIES):
        try:
            with opener.open(url, timeout=10) as answer:
                return bytes(answer.read(_MAX_FILE_BYTES))
        except urllib.error.URLError:
            pause.wait(0.1)
    raise GseError(f"the rerun program serves no viewer at {url}; try --view native")
