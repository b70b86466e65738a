"""The pages of a view's web server, with the check of each request's origin."""

import asyncio
import base64
import functools
import hashlib
import hmac
import json
import re
from dataclasses import dataclass, field
from http import HTTPStatus
from importlib import resources
from pathlib import Path
from typing import Any, Protocol

import jinja2
from tornado.web import Application, RequestHandler
from tornado.websocket import WebSocketHandler

from gse.station.notes import Notes, note_text
from gse.view.glance import Glance
from gse.view.host_names import host_of
from gse.view.recent import Piece
from gse.view.viewer import rerun_version
from gse.view.viewer_files import MEDIA_TYPES, ViewerFiles

_FILES = {
    "glance.html.jinja": "text/html; charset=utf-8",
    "rerun.html": "text/html; charset=utf-8",
    "rerun.css": "text/css; charset=utf-8",
    "rerun.js.jinja": "text/javascript; charset=utf-8",
}
_LOOPBACK = ("127.0.0.1", "::1")
_MOST_MESSAGE_BYTES = 1 << 10
_PIECE_BYTES = 1 << 20
_PLACE = re.compile(r"([\w-]{1,64}\.\d{1,9})?", re.ASCII)
_WRONG_TOKEN_S = 1.0
"""The pause after a wrong token, for all senders together: four thousand million of them cannot be tried."""


class PieceAfter(Protocol):
    """As ``RerunFeed.piece_after``."""

    def __call__(self, place: str, *, last: bool) -> Piece: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Content:
    """What is served: a running session (``glance``), or a ``recording`` (.rrd).

    ``verdict`` is that of a recording: what the bar over it says, and its level. ``piece_after`` gives pages with
    rerun's viewer what they do not have yet of a running session (``RerunFeed.piece_after``); None without rerun.
    """

    glance: Glance | None = None
    notes: Notes | None = None
    recording: Path | None = None
    verdict: tuple[str, str] = ("", "")
    piece_after: PieceAfter | None = None
    files: ViewerFiles = field(default_factory=ViewerFiles)


class Serving(Protocol):
    """What the pages need of their server (gse.view.server)."""

    bind: str
    port: int
    token: str
    opened: bool
    content: Content

    def join(self, browser: WebSocketHandler) -> bool: ...

    def ask(self, browser: WebSocketHandler) -> None: ...

    def leave(self, browser: WebSocketHandler) -> None: ...


def application(server: Serving) -> Application:
    """The pages of a server."""
    to_server = {"server": server}
    front, rerun = ("glance.html.jinja", "rerun.html") if server.content.glance else ("rerun.html", "rerun.html")
    files = {"/": front, "/rerun": rerun, "/rerun.js": "rerun.js.jinja", "/rerun.css": "rerun.css"}
    return Application(
        [
            *((path, _OwnFile, {**to_server, "name": name}) for path, name in files.items()),
            *((path, _ViewerFile, to_server) for path in MEDIA_TYPES),
            ("/session.rrd", _Recording, to_server),
            ("/piece.rrd", _Piece, to_server),
            ("/live", _Live, to_server),
            ("/note", _Note, {**to_server, "wrong_token": asyncio.Lock()}),
            ("/.*", _Nothing, to_server),
        ],
        websocket_max_message_size=_MOST_MESSAGE_BYTES,
        log_function=lambda handler: None,
    )


class _Page(RequestHandler):
    """Any answer of the server: checks the Host, and lets pages talk to this server only."""

    server: Serving

    def initialize(self, server: Serving, **extra: Any) -> None:
        self.server = server
        self.extra = extra

    def host(self) -> str | None:
        """The name of this server, with the port, by which it was asked; None where it has no such name."""
        return host_of(self.request.headers.get("Host", ""), bind=self.server.bind)

    def prepare(self) -> None:
        host = self.host()
        if host is None:
            self.set_status(HTTPStatus.MISDIRECTED_REQUEST)
            self.finish("this server has another name\n")
            return
        content = self.server.content
        live = f" ws://{host}" if content.glance else ""
        self.set_header(
            "Content-Security-Policy",
            f"default-src 'none'; script-src 'self' '{_glance_script_hash()}' 'wasm-unsafe-eval'; "
            "style-src 'self' 'unsafe-inline'; "
            f"img-src 'self' data: blob:; worker-src 'self' blob:; connect-src 'self'{live}; "
            "base-uri 'none'; form-action 'self'; frame-ancestors 'none'",
        )

    def set_default_headers(self) -> None:
        self.set_header("Server", "gse")
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Cache-Control", "no-store")

    def compute_etag(self) -> None:
        """None: hashing the viewer's 43 MB for each request would cost more than it saves."""

    def write_error(self, status_code: int, **kwargs: Any) -> None:
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{status_code} {self._reason}\n")


class _Nothing(_Page):
    def get(self) -> None:
        self.send_error(HTTPStatus.NOT_FOUND)


class _OwnFile(_Page):
    def get(self) -> None:
        self.server.opened = True
        name = self.extra["name"]
        text = _own_text(name)
        if name.endswith(".jinja"):
            text = jinja2.Template(text).render(
                # In the page itself: a phone waits for one answer of the server instead of three.
                style=_own_text("glance.css"),
                script=_own_text("glance.js"),
                fed=json.dumps(self.server.content.piece_after is not None),
                live=json.dumps(self.server.content.glance is not None),
                verdict=json.dumps(self.server.content.verdict),
                version=rerun_version(),
            )
        self.set_header("Content-Type", _FILES[name])
        self.finish(text)


def _own_text(name: str) -> str:
    return resources.files("gse.view").joinpath(name).read_text(encoding="utf-8")


@functools.cache
def _glance_script_hash() -> str:
    """What a Content-Security-Policy calls the script in the glance page: no other script in a page runs."""
    script = "\n" + _own_text("glance.js")  # the template begins a line after the tag
    return "sha256-" + base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()


class _ViewerFile(_Page):
    """A file of rerun's viewer; the browser keeps it, its address names the version."""

    async def get(self) -> None:
        path = self.request.path
        files = self.server.content.files
        body = await asyncio.to_thread(lambda: files[path])
        self.set_header("Content-Type", MEDIA_TYPES[path])
        self.set_header("Cache-Control", "private, max-age=31536000, immutable")
        self.finish(body)


class _Recording(_Page):
    async def get(self) -> None:
        recording = self.server.content.recording
        if recording is None:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        self.set_header("Content-Type", "application/octet-stream")
        self.set_header("Content-Length", str(recording.stat().st_size))
        with recording.open("rb") as file:
            while piece := file.read(_PIECE_BYTES):
                self.write(piece)
                await self.flush()


class _Piece(_Page):
    """What a page with rerun's viewer does not have yet of a running session."""

    async def get(self) -> None:
        place = self.get_query_argument("after", "")
        piece_after = self.server.content.piece_after
        if piece_after is None or not _PLACE.fullmatch(place):
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        last = bool(self.get_query_argument("last", ""))
        piece = await asyncio.to_thread(piece_after, place, last=last)
        self.set_header("Content-Type", "application/octet-stream")
        self.set_header("X-Place", piece.place)
        self.set_header("X-Utc-Ns", str(piece.utc_ns))
        self.finish(piece.rrd)


class _Live(_Page, WebSocketHandler):
    """The documents of a running session: one for each time that the browser asks."""

    def open(self, *args: str, **kwargs: str) -> None:
        if self.server.content.glance is None or not self.server.join(self):
            self.close(1013, "too many browsers")
            return
        self.set_nodelay(True)
        self.server.ask(self)

    def on_message(self, message: str | bytes) -> None:
        self.server.ask(self)

    def on_close(self) -> None:
        self.server.leave(self)


class _Note(_Page):
    """Takes a note: from a page of this server, on this machine or with the token."""

    async def post(self) -> None:
        notes = self.server.content.notes
        if notes is None:
            self._refuse(HTTPStatus.NOT_FOUND, "this session takes no notes")
        elif not self._from_own_page():
            self._refuse(HTTPStatus.FORBIDDEN, "a note must come from a page of this server")
        elif not await self._allowed():
            self._refuse(HTTPStatus.FORBIDDEN, "wrong token: gse run printed it at the start")
        else:
            try:
                text = note_text(_text_of(self.request.body))
            except ValueError as error:
                self._refuse(HTTPStatus.BAD_REQUEST, str(error))
                return
            if notes.put(text):
                self.finish({"note": text})
            else:
                self._refuse(HTTPStatus.TOO_MANY_REQUESTS, "too many notes wait; try again in a second")

    def _from_own_page(self) -> bool:
        """Whether script of a page of ours sent it: other pages may send neither JSON nor this Origin."""
        own = f"http://{self.request.headers.get('Host')}"
        is_json = self.request.headers.get("Content-Type", "").partition(";")[0].strip() == "application/json"
        return is_json and self.request.headers.get("Origin", own) == own

    async def _allowed(self) -> bool:
        if self.request.remote_ip in _LOOPBACK:
            return True
        given = self.request.headers.get("X-Gse-Token", "")
        if hmac.compare_digest(given.encode(), self.server.token.encode()):
            return True
        async with self.extra["wrong_token"]:
            await asyncio.sleep(_WRONG_TOKEN_S)
        return False

    def _refuse(self, status: HTTPStatus, reason: str) -> None:
        self.set_status(status)
        self.finish({"error": reason})


def _text_of(body: bytes) -> str:
    """The text of a note; ValueError for another document."""
    try:
        document = json.loads(body)
    except (ValueError, RecursionError):
        document = None
    text = document.get("text") if isinstance(document, dict) else None
    if not isinstance(text, str):
        raise ValueError('expected {"text": "..."}')
    return text
