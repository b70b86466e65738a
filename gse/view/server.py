"""Web server of a view, on a thread of its own: the glance page, and rerun's viewer.

The server is tornado's. A page of ours starts rerun's viewer (rerun's own page loads fonts from afar and calls home),
and a Content-Security-Policy lets pages talk to this server and to rerun's data server only. It is read-only but for
notes: from this machine, or with the token that was printed at the start.

A browser asks for each document of the glance page after it has shown the one before. So a slow browser gets fewer of
them, the newest each time, and never stays behind.
"""

import asyncio
import base64
import functools
import hashlib
import hmac
import json
import logging
import os
import re
import secrets
import socket
import threading
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from http import HTTPStatus
from importlib import resources
from pathlib import Path
from typing import Any, Protocol, Self

import jinja2
from tornado.httpserver import HTTPServer
from tornado.iostream import IOStream, StreamClosedError
from tornado.web import Application, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from drivers.clock import read_clock
from gse.errors import GseError
from gse.station.events import Notes, note_text
from gse.view.glance import Glance
from gse.view.viewer import MEDIA_TYPES, NextPiece, ViewerFiles, rerun_version

# The names by which a web server of this machine may be asked.
#
# A request whose Host is not a name of the server is refused: a foreign page whose name was made to point here (DNS
# rebinding) reads nothing, and no foreign text enters a header. The port is not compared: behind a tunnel
# (ssh -L 9000:localhost:8420) it is another one, and a foreign page has a foreign name at every port.

_HOST = re.compile(r"([A-Za-z0-9.-]+|\[[0-9a-fA-F:]+\])(?::[0-9]{1,5})?")
_LOCAL = ("127.0.0.1", "localhost", "[::1]")
_LOOPBACK = ("127.0.0.1", "localhost", "::1")
_ANY = ("0.0.0.0", "::")
_ADDRESS = re.compile(r"\d{1,3}(\.\d{1,3}){3}|\[[0-9a-fA-F:]+\]")
_HOSTS_FILE = Path("/etc/hosts")
_SOMEWHERE = ("192.0.2.1", 9)
"""Reserved for documentation (RFC 5737): nothing is sent there."""


def host_of(asked: str, *, bind: str) -> str | None:
    """A Host header, in small letters, if it is a name of this server with any port; else None."""
    found = _HOST.fullmatch(asked)
    if found is None:
        return None
    name = found[1].lower()
    names = {*_LOCAL, bind.lower(), f"[{bind}]".lower(), socket.gethostname().lower()}
    # No other machine asks a server on loopback, and any machine of the network can call itself by a .local name.
    if bind not in _LOOPBACK:
        names |= _names_of_this_machine()
    # A server on all addresses accepts each address as its name, but no host name, which an attacker could choose.
    is_address = bind in _ANY and _ADDRESS.fullmatch(name) is not None
    return asked.lower() if name in names or is_address else None


def names_of_machine(host_name: str, hosts_lines: Iterable[str]) -> frozenset[str]:
    """The names of a machine in small letters: its host name, with .local (mDNS), with the domain of its hosts file.

    A name server is not asked: it may be somebody else's, and nothing leaves the machine unasked.
    """
    host_name = host_name.lower()
    first = host_name.partition(".")[0]
    listed = (name.lower() for line in hosts_lines for name in line.partition("#")[0].split()[1:])
    return frozenset({host_name, first, f"{first}.local", *(name for name in listed if name.startswith(f"{first}."))})


@functools.cache
def _names_of_this_machine() -> frozenset[str]:
    lines: list[str] = []
    with suppress(OSError, UnicodeDecodeError):
        lines = _HOSTS_FILE.read_text(encoding="utf-8").splitlines()
    return names_of_machine(socket.gethostname(), lines)


def reachable_name(bind: str) -> str:
    """The name that a person can open: that of ``bind``, or this machine's address in its network for all addresses."""
    if bind not in _ANY:
        return bind
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(_SOMEWHERE)  # of UDP: chooses an address and sends nothing
        except OSError:
            return "127.0.0.1"
        address: str = probe.getsockname()[0]
        return address


# The pages of a view's web server, with the check of each request's origin.

_FILES = {
    "glance.html.jinja": "text/html; charset=utf-8",
    "rerun.html": "text/html; charset=utf-8",
    "rerun.css": "text/css; charset=utf-8",
    "rerun.js.jinja": "text/javascript; charset=utf-8",
}
_OWN_ADDRESSES = ("127.0.0.1", "::1")
_MOST_MESSAGE_BYTES = 1 << 10
_PART_BYTES = 64 << 10
"""What of a large answer is in memory for a connection: the next part is written when the socket has taken this one."""
_STUCK_S = 20.0
"""A connection that does not take one part in this time is closed; 3 kB/s carries no viewer of 43 MB."""
MOST_PIECES = 8
"""Pieces of a running session on their way at once; each is a copy of some MB."""
_PLACE = re.compile(r"([\w-]{1,64}\.\d{1,9})?", re.ASCII)
_WRONG_TOKEN_S = 1.0
"""The pause after a wrong token, for all requests of an address: four thousand million of them cannot be tried."""


class PieceAfter(Protocol):
    """As ``RerunFeed.piece_after``."""

    def __call__(self, place: str, *, last: bool) -> NextPiece: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Content:
    """What is served: a running session (``glance``), or a ``recording`` (.rrd).

    ``pages`` are further pages, each with what it is made with.
    ``verdict`` is that of a recording: what the bar over it says, and its level. ``piece_after`` gives pages with
    rerun's viewer what they do not have yet of a running session (``RerunFeed.piece_after``); None without rerun.
    """

    glance: Glance | None = None
    notes: Notes | None = None
    recording: Path | None = None
    verdict: tuple[str, str] = ("", "")
    piece_after: PieceAfter | None = None
    files: ViewerFiles = field(default_factory=ViewerFiles)
    pages: tuple[tuple[str, type[RequestHandler], dict[str, Any]], ...] = ()


class Guests:
    """The connections that are served, at most ``most``.

    One more is always taken: for it the oldest of the address with the most of them is closed. So no address can lock
    out another, and a connection that stays locks out none.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._addresses: dict[IOStream, str] = {}

    def add(self, stream: IOStream, address: str) -> None:
        """Take a connection."""
        if len(self._addresses) >= self._most:
            ((crowded, _),) = Counter(self._addresses.values()).most_common(1)
            oldest = next(one for one, its_address in self._addresses.items() if its_address == crowded)
            self.remove(oldest)
            oldest.close()
        self._addresses[stream] = address

    def remove(self, stream: IOStream) -> None:
        """A connection has ended, or is no longer counted."""
        self._addresses.pop(stream, None)


def application(server: "ViewServer") -> Application:
    """The pages of a server."""
    to_server = {"server": server}
    front = "glance.html.jinja" if server.content.glance else "rerun.html"
    files = {"/": front, "/rerun": "rerun.html", "/rerun.js": "rerun.js.jinja", "/rerun.css": "rerun.css"}
    return Application(
        [
            # Further pages first: one of them may stand in the place of the front page.
            *((path, page, {**to_server, **more}) for path, page, more in server.content.pages),
            *((path, _OwnFile, {**to_server, "name": name}) for path, name in files.items()),
            *((path, _ViewerFile, to_server) for path in MEDIA_TYPES),
            ("/session.rrd", _Recording, to_server),
            ("/piece.rrd", _Piece, {**to_server, "guests": Guests(MOST_PIECES)}),
            ("/live", _Live, to_server),
            ("/note", _Note, {**to_server, "pausing": set()}),
            ("/.*", _Nothing, to_server),
        ],
        websocket_max_message_size=_MOST_MESSAGE_BYTES,
        log_function=lambda handler: None,
    )


class Page(RequestHandler):
    """Any answer of the server: checks the Host, and lets pages talk to this server only."""

    server: "ViewServer"

    def initialize(self, server: "ViewServer", **extra: Any) -> None:
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
        live = f" ws://{host}" if content.glance or content.pages else ""
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

    async def send(self, parts: Iterable[bytes]) -> None:
        """Send a large answer in parts, each when the connection has taken the one before; close one that is stuck."""
        try:
            for part in parts:
                self.write(part)
                await asyncio.wait_for(self.flush(), _STUCK_S)
        except (TimeoutError, StreamClosedError):
            self.stream.close()

    @property
    def stream(self) -> IOStream:
        """The connection."""
        stream: IOStream = self.request.connection.stream  # type: ignore[union-attr]
        return stream

    def write_error(self, status_code: int, **kwargs: Any) -> None:
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{status_code} {self._reason}\n")


class _Nothing(Page):
    def get(self) -> None:
        self.send_error(HTTPStatus.NOT_FOUND)


class _OwnFile(Page):
    def get(self) -> None:
        self.server.opened = True
        name = self.extra["name"]
        text = _own_text(name)
        if name.endswith(".jinja"):
            text = jinja2.Template(text).render(
                # In the page itself: a phone waits for one answer of the server instead of three.
                style=_own_text("glance.css"),
                script=_glance_script(),
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
def _glance_script() -> str:
    """The script of the glance page, after the library that draws its plots."""
    return _own_text("uplot.js") + _own_text("glance.js")


@functools.cache
def _glance_script_hash() -> str:
    """What a Content-Security-Policy calls the script in the glance page: no other script in a page runs."""
    script = "\n" + _glance_script()  # the template begins a line after the tag
    return "sha256-" + base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()


class _ViewerFile(Page):
    """A file of rerun's viewer; the browser keeps it, its address names the version."""

    async def get(self) -> None:
        path = self.request.path
        files = self.server.content.files
        body = await asyncio.to_thread(lambda: files[path])
        self.set_header("Content-Type", MEDIA_TYPES[path])
        self.set_header("Cache-Control", "private, max-age=31536000, immutable")
        self.set_header("Content-Length", str(len(body)))
        await self.send(_parts(body))


def _parts(body: bytes) -> Iterator[bytes]:
    return (body[start : start + _PART_BYTES] for start in range(0, len(body), _PART_BYTES))


class _Recording(Page):
    async def get(self) -> None:
        recording = self.server.content.recording
        if recording is None:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        self.set_header("Content-Type", "application/octet-stream")
        self.set_header("Content-Length", str(recording.stat().st_size))
        with recording.open("rb") as file:
            await self.send(iter(functools.partial(file.read, _PART_BYTES), b""))


class _Piece(Page):
    """What a page with rerun's viewer does not have yet of a running session."""

    async def get(self) -> None:
        place = self.get_query_argument("after", "")
        piece_after = self.server.content.piece_after
        if piece_after is None or not _PLACE.fullmatch(place):
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        last = bool(self.get_query_argument("last", ""))
        guests: Guests = self.extra["guests"]
        guests.add(self.stream, self.request.remote_ip or "")
        try:
            piece = await asyncio.to_thread(piece_after, place, last=last)
            self.set_header("Content-Type", "application/octet-stream")
            self.set_header("Content-Length", str(len(piece.layout) + len(piece.rrd)))
            self.set_header("X-Layout-Bytes", str(len(piece.layout)))
            self.set_header("X-Place", piece.place)
            self.set_header("X-Utc-Ns", str(piece.utc_ns))
            await self.send(_parts(piece.layout + piece.rrd))
        finally:
            guests.remove(self.stream)


class _Live(Page, WebSocketHandler):
    """The documents of a running session: one for each time that the browser asks."""

    def open(self, *args: str, **kwargs: str) -> None:
        if self.server.content.glance is None:
            self.close(1013, "no session is running")
            return
        self.server.join(self)
        self.set_nodelay(True)
        self.server.ask(self, ())

    def on_message(self, message: str | bytes) -> None:
        self.server.ask(self, str(message).split()[1:])

    def on_close(self) -> None:
        self.server.leave(self)


class _Note(Page):
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
        address = self.request.remote_ip or ""
        if address in _OWN_ADDRESSES:
            return True
        pausing: set[str] = self.extra["pausing"]
        if address in pausing:
            return False
        given = self.request.headers.get("X-Gse-Token", "")
        if hmac.compare_digest(given.encode(), self.server.token.encode()):
            return True
        pausing.add(address)
        try:
            await asyncio.sleep(_WRONG_TOKEN_S)
        finally:
            pausing.discard(address)
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


_LOG = logging.getLogger(__name__)

USUAL_PORT = 8420
"""Port of the live page, so that it can be bookmarked; another one is taken where it is in use."""

EVERY_S = 0.2
"""Between two documents."""

MOST_CONNECTIONS = 64
"""The files that a process may open are also those of the recording."""

MOST_BROWSERS = 32
_IDLE_S = 60.0
_HEADER_BYTES = 16 << 10
_BODY_BYTES = 4 << 10
_SHOW_VERDICT_S = 15.0
"""Time for open pages to fetch the verdict, which they show from then on: one that draws rerun's view may be busy."""
ASLEEP_S = 8.0
"""Silence of a page that is not waited for: a phone in a pocket."""
_CLOSE_WITHIN_S = 2.0


class ViewServer:
    """The server; ``url`` is what a person opens, ``token`` what a note from another machine needs.

    A context manager. GseError where it cannot listen; ``usual_port`` is tried first where ``port`` is 0.
    A page that was silent for ``asleep_s`` at the end of the session is not waited for.
    """

    def __init__(
        self, bind: str, port: int, content: Content, *, usual_port: int = 0, asleep_s: float = ASLEEP_S
    ) -> None:
        self._asleep_s = asleep_s
        self.bind, self.content = bind, content
        self.token = secrets.token_hex(4)
        self.opened = False
        self._sockets = _listen(bind, port, usual_port)
        self.port: int = self._sockets[0].getsockname()[1]
        self.url = f"http://{reachable_name(bind)}:{self.port}/"
        self._waiting: dict[WebSocketHandler, Sequence[str]] = {}
        self._browsers: dict[WebSocketHandler, float] = {}
        """With the time (monotonic) at which each was last heard."""
        self._told: set[WebSocketHandler] = set()
        """Browsers that were sent the end."""
        self._done: set[WebSocketHandler] = set()
        """Browsers that have shown the end."""
        self._sending: set[asyncio.Task[None]] = set()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._started = threading.Event()
        self._stopping = asyncio.Event()
        self._shown = threading.Event()
        self._thread = threading.Thread(target=self._run, name="view server", daemon=True)
        self._thread.start()
        self._started.wait()

    def join(self, browser: WebSocketHandler) -> None:
        """Serve a browser; where there are too many, the one that was silent longest is left for it."""
        if len(self._browsers) >= MOST_BROWSERS:
            silent = min(self._browsers, key=lambda one: self._browsers[one])
            self.leave(silent)
            silent.close(1013, "too many browsers")
        self._browsers[browser] = time.monotonic()

    def ask(self, browser: WebSocketHandler, errors: Sequence[str]) -> None:
        """Take a browser's request for the next document, with some of the ``errors`` over time; it has shown the one
        before.
        """
        if browser not in self._browsers:  # left for another one
            return
        self._browsers[browser] = time.monotonic()
        if browser in self._told:
            self._done.add(browser)
        else:
            self._waiting[browser] = errors

    def leave(self, browser: WebSocketHandler) -> None:
        """The browser has gone."""
        self._browsers.pop(browser, None)
        self._waiting.pop(browser, None)
        for browsers in (self._told, self._done):
            browsers.discard(browser)

    def close(self) -> None:
        """Give open pages some seconds to fetch the end of the session, and stop serving."""
        glance = self.content.glance
        if self._browsers and glance is not None and glance.has_ended:
            self._shown.wait(_SHOW_VERDICT_S)
        if self._loop is not None:
            with suppress(RuntimeError):  # the loop has ended
                self._loop.call_soon_threadsafe(self._stopping.set)
        self._thread.join(_CLOSE_WITHIN_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except Exception as error:
            # An error in the view must not end the session.
            _LOG.warning("the live page has ended (%s: %s); the session goes on", type(error).__name__, error)
        finally:
            self._started.set()
            self._shown.set()

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        server = _Server(
            application(self),
            idle_connection_timeout=_IDLE_S,
            body_timeout=_STUCK_S,
            max_header_size=_HEADER_BYTES,
            max_body_size=_BODY_BYTES,
            max_buffer_size=_HEADER_BYTES + _BODY_BYTES,
        )
        server.add_sockets(self._sockets)
        self._started.set()
        try:
            while not self._stopping.is_set():
                self._tick()
                with suppress(TimeoutError):
                    await asyncio.wait_for(self._stopping.wait(), EVERY_S)
        finally:
            server.stop()
            await server.close_all_connections()

    def _tick(self) -> None:
        """Send the present document to the browsers that wait for one."""
        glance = self.content.glance
        if glance is None:
            return
        now = read_clock()
        ended = glance.has_ended
        glance.absorb(now)
        if self._waiting:
            document = glance.document(now)
            text = json.dumps(document)
            for browser, request in self._waiting.items():
                errors = glance.errors(request) if request else None
                self._send(browser, json.dumps({**document, "errors": errors}) if errors else text)
            if ended:
                self._told |= set(self._waiting)
            self._waiting.clear()
        if ended and not self._show_it_soon():
            self._shown.set()

    def _show_it_soon(self) -> bool:
        """Whether a browser that is awake has not shown the end."""
        awake_s = time.monotonic() - self._asleep_s
        return any(heard_s > awake_s and browser not in self._done for browser, heard_s in self._browsers.items())

    def _send(self, browser: WebSocketHandler, text: str) -> None:
        task = asyncio.create_task(_sent(browser, text))
        self._sending.add(task)
        task.add_done_callback(self._sending.discard)


async def _sent(browser: WebSocketHandler, text: str) -> None:
    with suppress(WebSocketClosedError, StreamClosedError):
        await browser.write_message(text)


def _listen(bind: str, port: int, usual_port: int) -> list[socket.socket]:
    ports = (port,) if port or not usual_port else (usual_port, 0)
    for number in ports:
        try:
            listening = socket.create_server((bind, number))
        except OSError as error:
            if number == ports[-1]:
                why = os.strerror(error.errno or 0)
                raise GseError(
                    f"cannot serve the view on {bind} port {port}: {why}; choose another address or port"
                ) from error
        else:
            listening.setblocking(False)
            return [listening]
    return []


class _Server(HTTPServer):
    """tornado's server, with at most MOST_CONNECTIONS."""

    def initialize(self, *args: Any, **kwargs: Any) -> None:
        self._guests = Guests(MOST_CONNECTIONS)
        super().initialize(*args, **kwargs)

    def handle_stream(self, stream: IOStream, address: tuple[Any, ...]) -> None:
        self._guests.add(stream, str(address[0]))
        super().handle_stream(stream, address)

    def on_close(self, server_conn: object) -> None:
        self._guests.remove(server_conn.stream)  # type: ignore[attr-defined]
        super().on_close(server_conn)
