"""Web page of a view: rerun's viewer, without requests to other machines.

rerun's own page loads fonts from afar and calls home. Here a page of our own starts the same viewer, and a
Content-Security-Policy lets it talk to this server and to rerun's data server only. A request whose Host is no name of
this server is refused: a page of somebody else's whose name was made to point here (DNS rebinding) reads nothing.
"""

import re
import shutil
import socket
import threading
from http import HTTPStatus
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
_HOST = re.compile(r"([A-Za-z0-9.-]+|\[[0-9a-fA-F:]+\])(?::([0-9]{1,5}))?")
_LOCAL = ("127.0.0.1", "localhost", "[::1]")
_ANY = ("0.0.0.0", "::")
_ADDRESS = re.compile(r"\d{1,3}(\.\d{1,3}){3}|\[[0-9a-fA-F:]+\]")


class ViewerPage:
    """A web server with the viewer; ``url`` is what a person opens. A context manager.

    The viewer shows what rerun's data server on ``grpc_port`` of the same address gives it, or a ``recording`` (.rrd).
    """

    def __init__(self, bind: str, port: int, *, grpc_port: int = 0, recording: Path | None = None) -> None:
        content = {"bind": bind, "files": ViewerFiles(), "grpc_port": grpc_port, "recording": recording}
        self._handler: type[_Handler] = type("_BoundHandler", (_Handler,), content)
        try:
            self._server = ThreadingHTTPServer((bind, port), self._handler)
        except OSError as error:
            raise GseError(
                f"cannot serve the view on {bind} port {port}: {error.strerror}; choose another address or port"
            ) from error
        self._server.daemon_threads = True
        self._handler.port = self._server.server_port
        self.url = f"http://{bind}:{self._server.server_port}/"
        self._thread = threading.Thread(
            target=self._server.serve_forever, kwargs={"poll_interval": 0.05}, name="viewer page", daemon=True
        )
        self._thread.start()

    @property
    def opened(self) -> bool:
        """Whether the page was requested."""
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
    bind: ClassVar[str]
    port: ClassVar[int]
    files: ClassVar[ViewerFiles]
    grpc_port: ClassVar[int]
    recording: ClassVar[Path | None]
    opened: ClassVar[bool] = False
    server_version = "gse"
    sys_version = ""

    def do_GET(self) -> None:
        if self._host() is None:
            self.send_error(HTTPStatus.MISDIRECTED_REQUEST, "this server has another name")
            return
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

    def _host(self) -> str | None:
        """The name of this server by which it was asked, without its port; None where it has no such name."""
        asked = self.headers.get_all("Host", [])
        found = _HOST.fullmatch(asked[0]) if len(asked) == 1 else None
        if found is None or int(found[2] or 80) != self.port:
            return None
        host = found[1]
        names = {*_LOCAL, self.bind, f"[{self.bind}]", socket.gethostname()}
        # A server on all addresses accepts each address as its name, but no host name, which an attacker could choose.
        is_address = self.bind in _ANY and _ADDRESS.fullmatch(host) is not None
        return host if host in names or is_address else None

    def _policy(self) -> str:
        data = f" http://{self._host()}:{self.grpc_port}" if self.grpc_port else ""
        return (
            "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'unsafe-inline'; "
            f"img-src 'self' data: blob:; worker-src 'self' blob:; connect-src 'self'{data}"
        )

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        """Requests are not logged."""


def wait_for_interrupt() -> None:
    """Wait until Ctrl-C."""
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        return
