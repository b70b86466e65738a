"""The web page of a view: rerun's viewer, served so that no request leaves the machine.

rerun's own page loads fonts from afar and calls home. Here a page of our own starts the same viewer, and a
Content-Security-Policy lets it talk to this server and to rerun's data server only.
"""

import re
import shutil
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path
from types import TracebackType
from typing import ClassVar, Self

import jinja2

from gse.errors import GseError
from gse.view.viewer_files import MEDIA_TYPES, ViewerFiles

_OWN_FILES = {"/": ("page.html", "text/html; charset=utf-8"), "/start.js": ("start.js.jinja", "text/javascript")}
_RECORDING = "/session.rrd"
_HOST = re.compile(r"[A-Za-z0-9.-]+")


class ViewerPage:
    """A web server with the viewer; ``url`` is what a person opens. A context manager.

    The viewer shows what rerun's data server on ``grpc_port`` of the same address gives it, or a ``recording`` (.rrd).
    """

    def __init__(self, bind: str, port: int, *, grpc_port: int = 0, recording: Path | None = None) -> None:
        content = {"files": ViewerFiles(), "grpc_port": grpc_port, "recording": recording}
        self._handler: type[_Handler] = type("_BoundHandler", (_Handler,), content)
        try:
            self._server = ThreadingHTTPServer((bind, port), self._handler)
        except OSError as error:
            raise GseError(
                f"cannot serve the view on {bind} port {port}: {error.strerror}; choose another address or port"
            ) from error
        self._server.daemon_threads = True
        self.url = f"http://{bind}:{self._server.server_port}/"
        self._thread = threading.Thread(
            target=self._server.serve_forever, kwargs={"poll_interval": 0.05}, name="viewer page", daemon=True
        )
        self._thread.start()

    @property
    def opened(self) -> bool:
        """Whether anybody has asked for the page."""
        return self._handler.opened

    def close(self) -> None:
        """Stop serving."""
        self._server.shutdown()
        self._server.server_close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class _Handler(BaseHTTPRequestHandler):
    files: ClassVar[ViewerFiles]
    grpc_port: ClassVar[int]
    recording: ClassVar[Path | None]
    opened: ClassVar[bool] = False
    server_version = "gse"
    sys_version = ""

    def do_GET(self) -> None:
        path = self.path.split("?")[0]
        if path in _OWN_FILES:
            type(self).opened = True
            name, media_type = _OWN_FILES[path]
            text = resources.files("gse.view").joinpath(name).read_text(encoding="utf-8")
            self._answer(jinja2.Template(text).render(grpc_port=self.grpc_port).encode(), media_type)
        elif path in MEDIA_TYPES:
            self._answer(self.files[path], MEDIA_TYPES[path])
        elif path == _RECORDING and self.recording is not None:
            self._begin(self.recording.stat().st_size, "application/octet-stream")
            with self.recording.open("rb") as file:
                shutil.copyfileobj(file, self.wfile)
        else:
            self.send_error(404)

    def _answer(self, body: bytes, media_type: str) -> None:
        self._begin(len(body), media_type)
        self.wfile.write(body)

    def _begin(self, size: int, media_type: str) -> None:
        self.send_response(200)
        self.send_header("Content-Type", media_type)
        self.send_header("Content-Length", str(size))
        self.send_header("Content-Security-Policy", self._policy())
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Cache-Control", "no-store")
        self.end_headers()

    def _policy(self) -> str:
        host = _HOST.match(self.headers.get("Host", ""))
        data = f" http://{host[0] if host else '127.0.0.1'}:{self.grpc_port}" if self.grpc_port else ""
        return (
            "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'unsafe-inline'; "
            f"img-src 'self' data: blob:; worker-src 'self' blob:; connect-src 'self'{data}"
        )

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        """A page that is opened is no news."""


def wait_for_interrupt() -> None:
    """Wait until Ctrl-C."""
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        return
