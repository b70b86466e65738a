"""Web server of a view, on a thread of its own: the glance page, and rerun's viewer.

The server is tornado's. A page of ours starts rerun's viewer (rerun's own page loads fonts from afar and calls home),
and a Content-Security-Policy lets pages talk to this server and to rerun's data server only. It is read-only but for
notes: from this machine, or with the token that was printed at the start.

A browser asks for each document of the glance page after it has shown the one before. So a slow browser gets fewer of
them, the newest each time, and never stays behind.
"""

import asyncio
import json
import logging
import os
import secrets
import socket
import threading
import time
from contextlib import suppress
from types import TracebackType
from typing import Any, Self

from tornado.httpserver import HTTPServer
from tornado.iostream import IOStream, StreamClosedError
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from drivers.clock import read_clock
from gse.errors import GseError
from gse.view.host_names import reachable_name
from gse.view.pages import Content, application

_LOG = logging.getLogger(__name__)

USUAL_PORT = 8420
"""Of the live page, so that it can be bookmarked; another one where it is taken."""

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
        self._waiting: set[WebSocketHandler] = set()
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

    def join(self, browser: WebSocketHandler) -> bool:
        """Serve a browser; False where there are too many."""
        if len(self._browsers) >= MOST_BROWSERS:
            return False
        self._browsers[browser] = time.monotonic()
        return True

    def ask(self, browser: WebSocketHandler) -> None:
        """Take a browser's request for the next document; it has shown the one before."""
        self._browsers[browser] = time.monotonic()
        (self._done if browser in self._told else self._waiting).add(browser)

    def leave(self, browser: WebSocketHandler) -> None:
        """The browser has gone."""
        self._browsers.pop(browser, None)
        for browsers in (self._waiting, self._told, self._done):
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

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
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
            text = json.dumps(glance.document(now))
            for browser in self._waiting:
                self._send(browser, text)
            if ended:
                self._told |= self._waiting
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
        self._open = 0
        super().initialize(*args, **kwargs)

    def handle_stream(self, stream: IOStream, address: tuple[Any, ...]) -> None:
        if self._open >= MOST_CONNECTIONS:
            stream.close()
            return
        self._open += 1
        super().handle_stream(stream, address)

    def on_close(self, server_conn: object) -> None:
        self._open -= 1
        super().on_close(server_conn)
