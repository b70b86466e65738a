"""A TCP proxy that says something of its own to the client, as a faulty server does, or that refuses something."""

import contextlib
import socket
import ssl
import threading

from devices.patience import PATIENCE_S


class Proxy:
    """Between a client and a server on this computer; a context manager.

    It ends the connection of a client that says what it ``refuses``. With ``tls`` its clients speak TLS with it.
    """

    def __init__(self, port: int, refuses: bytes | None = None, tls: ssl.SSLContext | None = None) -> None:
        self.refused = 0
        self._refuses = refuses
        self._tls = tls
        self._server = ("127.0.0.1", port)
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = self._listening.getsockname()[1]
        self._clients: list[socket.socket] = []
        self._servers: list[socket.socket] = []
        self._accepting = threading.Thread(target=self._accept, daemon=True)
        self._accepting.start()

    def say(self, data: bytes, timeout_s: float | None = None) -> int:
        """Send bytes to the latest client; how many it took within this time."""
        sent = 0
        self._clients[-1].settimeout(timeout_s)
        with contextlib.suppress(OSError):
            while sent < len(data):
                sent += self._clients[-1].send(data[sent : sent + 65536])
        return sent

    def hang_up(self) -> None:
        """End the latest client's connection, after what was said to it."""
        self._clients[-1].shutdown(socket.SHUT_WR)

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._listening.accept()
                try:
                    if self._tls is not None:
                        client = self._tls.wrap_socket(client, server_side=True)
                    server = socket.create_connection(self._server)
                except OSError:  # it does not listen yet, or its client does not trust it
                    client.close()
                    continue
                self._clients.append(client)
                self._servers.append(server)
                for pair in ((client, server), (server, client)):
                    threading.Thread(target=self._hand_on, args=pair, daemon=True).start()

    def _hand_on(self, source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                if self._refuses is not None and self._refuses in data:
                    self.refused += 1
                    break
                sink.sendall(data)
        for connection in (source, sink):
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)

    def __enter__(self) -> "Proxy":
        return self

    def __exit__(self, *error: object) -> None:
        with contextlib.suppress(OSError):
            self._listening.shutdown(socket.SHUT_RDWR)  # ends the wait for a client: none may come once all are closed
        self._accepting.join(PATIENCE_S)
        for connection in (self._listening, *self._clients, *self._servers):
            connection.close()
