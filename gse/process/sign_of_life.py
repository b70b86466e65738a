"""A sign of life on the terminal: a line that counts seconds whenever a command prints nothing.

A process has one terminal, so there is one sign. ``start`` replaces stdout and stderr by streams that tell it of each
text; the line is erased before the next text. It is shown only where both are terminals, and only at the start of a
line: a prompt, a progress bar or a status line is a sign of its own. A terminal that takes no text (Ctrl-S) ends it:
the sign never blocks.

This module is imported before all others, so it imports little.
"""

import os
import select
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TextIO, cast

SILENT_S = 0.6
"""The line comes after this silence; with the time that Python takes to start, within a second."""
EVERY_S = 0.5
_PATIENCE_S = 0.5
_ENDS_OF_LINE = ("\n", "\r", "\x1b[2K")
"""What a text ends with that leaves the cursor on an empty line; the last is how rich removes a progress bar."""


class SignOfLife:
    """One line on ``stream`` that counts the seconds since the start; ``now_s`` is a monotonic clock."""

    def __init__(self, stream: TextIO, words: str, now_s: Callable[[], float] = time.monotonic) -> None:
        self.words = words
        self._stream, self._now_s = stream, now_s
        self._began_s = self._last_s = now_s()
        self._on_empty_line = True
        self._shown = 0
        self._lock = threading.RLock()  # a signal handler may print while its thread prints
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="sign of life", daemon=True)

    def start(self) -> None:
        """Look for silence from now on, in a thread."""
        self._thread.start()

    def before(self, text: str) -> None:
        """Make room for a text that is printed next."""
        if self._stopped.is_set() and not self._shown:
            return
        if not self._lock.acquire(timeout=_PATIENCE_S):
            self._give_up()
            return
        try:
            self._erase()
            self._last_s = self._now_s()
            self._on_empty_line = text.endswith(_ENDS_OF_LINE) if text else self._on_empty_line
        finally:
            self._lock.release()

    def look(self) -> None:
        """Show the line, or renew it, where it is due."""
        with self._lock:
            now_s = self._now_s()
            if self._stopped.is_set() or not self._on_empty_line or now_s - self._last_s < SILENT_S:
                return
            text = f"{self.words}, {now_s - self._began_s:.0f} s"[: _columns() - 1]
            shown, self._shown = self._shown, len(text)
            self._put("\r" + text.ljust(shown))

    def stop(self) -> None:
        """End it: what follows waits for the user, or has output of its own."""
        self.before("")
        self._stopped.set()
        if self._thread.is_alive():
            self._thread.join(_PATIENCE_S)

    def _erase(self) -> None:
        if self._shown:
            self._put("\r" + " " * self._shown + "\r")
            self._shown = 0

    def _put(self, text: str) -> None:
        try:
            if not _takes_text(self._stream):
                self._give_up()
                return
            self._stream.write(text)
            self._stream.flush()
        except (OSError, ValueError):  # the terminal is gone
            self._give_up()

    def _give_up(self) -> None:
        self._stopped.set()
        self._shown = 0

    def _run(self) -> None:
        while not self._stopped.wait(EVERY_S if self._shown else SILENT_S / 3):
            self.look()


class _Watched:
    """A text stream that tells the sign of life of each text."""

    def __init__(self, stream: TextIO, sign: SignOfLife) -> None:
        self._stream, self._sign = stream, sign

    def write(self, text: str) -> int:
        self._sign.before(text)
        return self._stream.write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


_SIGN: SignOfLife | None = None


def start(words: str) -> None:
    """Watch stdout and stderr of this process; does nothing where one of them is not a terminal, or a dumb one."""
    global _SIGN
    if not (sys.stdout and sys.stderr and sys.stdout.isatty() and sys.stderr.isatty()) or _is_dumb():
        return
    _SIGN = SignOfLife(sys.stderr, words)
    sys.stdout = cast(TextIO, _Watched(sys.stdout, _SIGN))
    sys.stderr = cast(TextIO, _Watched(sys.stderr, _SIGN))
    _SIGN.start()


def stop() -> None:
    """No sign from now on."""
    if _SIGN is not None:
        _SIGN.stop()


def before(text: str) -> None:
    """Make room for a text that goes to the terminal past ``sys.stdout`` and ``sys.stderr``."""
    if _SIGN is not None:
        _SIGN.before(text)


@contextmanager
def working(words: str) -> Iterator[None]:
    """Say in the line what is being done."""
    if _SIGN is None:
        yield
        return
    outer, _SIGN.words = _SIGN.words, words
    try:
        yield
    finally:
        _SIGN.words = outer


def _takes_text(stream: TextIO) -> bool:
    """Whether a write returns at once; Windows, and a stream without a file, do not tell."""
    try:
        return os.name == "nt" or bool(select.select([], [stream.fileno()], [], 0)[1])
    except OSError:
        return True


def _is_dumb() -> bool:
    return os.environ.get("TERM", "") in ("dumb", "unknown")


def _columns() -> int:
    try:
        return os.get_terminal_size(2).columns or 80
    except OSError:
        return 80
