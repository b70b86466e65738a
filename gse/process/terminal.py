"""stdout and stderr of the process: a terminal that is never silent, and a reader that delays and breaks nothing.

``start`` replaces both streams once, by ``Output``. Each part buys one thing:

* ``SignOfLife``: a command that prints nothing is not taken for a dead one. A line counts seconds whenever a terminal
  was silent for a second; it is erased before the next text.
* stderr is written to past Python's buffers, and no error of it is raised: a full disk or a terminal that is gone
  changes no result and no exit code. stdout keeps its buffer and its errors: there, an incomplete result is an error.
* A text from outside that a command prints as it came cannot steer the terminal (``terminal_text``).
* ``queued``: while a session runs, a stopped terminal (Ctrl-S), a full or closed pipe, or a full disk does not delay
  its loop. Text goes into a bounded queue with a writing thread, beyond the limit it is dropped, and the session tells
  of it in its events; at the end the process waits only as long as the reader still takes text.

This module is imported before all others, so it imports little.
"""

import os
import select
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TextIO, cast

from drivers.outside_text import terminal_text

SILENT_S = 0.6
"""The line comes after this silence; with the time that Python takes to start, within a second."""
EVERY_S = 0.5
_SIGN_PATIENCE_S = 0.5
_ENDS_OF_LINE = ("\n", "\r", "\x1b[2K")
"""What a text ends with that leaves the cursor on an empty line; the last is how rich removes a progress bar."""

LIMIT_CHARS = 16 << 20
"""Some nine minutes of frames as JSON lines at 10 Hz."""
PIECE_BYTES = 4096
"""Bytes per write; small, so that a slow reader shows progress."""
PATIENCE_S = 1.0
"""Longest wait at the end for a reader that takes nothing."""
STUCK_S = 5.0
"""Time without a byte taken after which the event TERMINAL_STUCK is made."""

News = tuple[str, str]
"""The kind of an event, as in ``gse.station.events``, and its text."""


class SignOfLife:
    """One line on ``stream`` that counts the seconds since the start; ``now_s`` is a monotonic clock.

    It is shown only at the start of a line: a prompt, a progress bar or a status line is a sign of its own. A terminal
    that takes no text (Ctrl-S) ends it: the sign never blocks.
    """

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
        if not self._lock.acquire(timeout=_SIGN_PATIENCE_S):
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
            self._thread.join(_SIGN_PATIENCE_S)

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


class Output:
    """stdout or stderr in the place of Python's ``stream``, which answers all that is not asked here.

    ``fails`` is whether an error of the reader is one of the writer too; never while there is a queue.
    """

    def __init__(self, stream: TextIO, name: str, *, fails: bool = False, sign: SignOfLife | None = None) -> None:
        self._stream, self._name, self._fails, self._sign = stream, name, fails, sign
        self._is_queued = False
        self._waits: Callable[[], bool] = lambda: False
        self._texts: deque[str] = deque()
        self._chars = self._taken = 0
        self._given_up_at = -1
        self._was_terminal = False
        self._noted: set[str] = set()
        self._news: deque[News] = deque()
        self._progress_s = 0.0
        # A signal handler may write while the same thread is writing: the lock of a Condition lets it.
        self._changed = threading.Condition()

    def __getattr__(self, name: str) -> Any:
        if name == "buffer" and (self._is_queued or not self._fails):  # click would write to it past rich and the queue
            raise AttributeError(name)
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write the text, or queue it; beyond the limit of the queue it is dropped."""
        if not isinstance(text, str):
            raise TypeError(f"expected text for {self._name}, not {type(text).__name__}")
        shown = terminal_text(text)
        if self._is_queued:
            self._queue(shown)
        elif self._fails:
            self._make_room(shown)
            self._stream.write(shown)
        else:
            self._hand_on(shown)
        return len(text)

    def writelines(self, texts: Iterable[str]) -> None:
        """Write one text after the other."""
        for text in texts:
            self.write(text)

    def flush(self) -> None:
        """Write what Python's stream holds; a queue, and stderr, hold nothing there."""
        if self._fails and not self._is_queued:
            self._stream.flush()

    def begin_queue(self, waits: Callable[[], bool] = lambda: False) -> None:
        """Queue what is written from now on; a writer waits at the limit only while ``waits()`` is true."""
        self._waits = waits
        self._is_queued = True
        threading.Thread(target=self._run, name=f"output {self._name}", daemon=True).start()

    def end_queue(self) -> None:
        """Write without a queue again; all that is queued has to be settled."""
        with self._changed:
            self._is_queued = False
            self._changed.notify_all()

    def news(self) -> list[News]:
        """Events of the reader since the last call, each kind once in a session."""
        is_terminal = self._stream.isatty()
        if self._was_terminal and not is_terminal:
            self._note("TERMINAL_LOST", f"{self._name}: the terminal is gone; the session goes on without")
        self._was_terminal = is_terminal
        if self._chars and time.monotonic() - self._progress_s > STUCK_S:
            self._note("TERMINAL_STUCK", f"nobody reads {self._name}; the session goes on without")
        found = []
        while self._news:
            found.append(self._news.popleft())
        return found

    def settle(self) -> bool:
        """Wait until everything queued is written, as long as the reader takes text; whether it is."""
        with self._changed:
            while self._chars and self._given_up_at != self._taken:
                taken = self._taken
                self._changed.wait_for(lambda taken=taken: self._taken != taken, PATIENCE_S)  # type: ignore[misc]
                if self._taken == taken and not self._waits():
                    self._given_up_at = taken
            return not self._chars

    def _queue(self, text: str) -> None:
        with self._changed:
            while self._chars > LIMIT_CHARS and self._waits():
                self._changed.wait(0.1)
            if self._chars <= LIMIT_CHARS and text:
                if not self._chars:
                    self._progress_s = time.monotonic()
                self._texts.append(text)
                self._chars += len(text)
                self._changed.notify_all()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._texts or not self._is_queued)
                if not self._texts:
                    return
                text = self._texts.popleft()
            self._hand_on(text)
            with self._changed:
                self._chars -= len(text)
                self._count_taken()
                self._changed.notify_all()

    def _hand_on(self, text: str) -> None:
        """Write past Python's buffers; an error is news."""
        try:
            self._make_room(text)
            fd = self._stream.fileno()
            data = memoryview(text.encode(self._stream.encoding, "backslashreplace"))
            while data:
                try:
                    data = data[os.write(fd, data[:PIECE_BYTES]) :]
                except BlockingIOError:
                    select.select([], [fd], [], 1.0)
                else:
                    self._count_taken()
        except (OSError, ValueError) as error:
            reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
            self._note("TERMINAL_LOST", f"{self._name}: {reason}; the session goes on without")

    def _make_room(self, text: str) -> None:
        if self._sign is not None:
            self._sign.before(text)

    def _count_taken(self) -> None:
        self._taken += 1
        self._progress_s = time.monotonic()

    def _note(self, kind: str, text: str) -> None:
        if kind not in self._noted:
            self._noted.add(kind)
            self._news.append((kind, text))


_SIGN: SignOfLife | None = None
_OUTPUTS: list[Output] = []
"""stdout and stderr; none before ``start``, as in a notebook or a test, whose streams are not ours."""


def start(words: str) -> None:
    """Replace stdout and stderr of this process; on a terminal, which is not a dumb one, begin the sign of life."""
    global _SIGN
    _open_closed_streams()
    if sys.stdout.isatty() and sys.stderr.isatty() and not _is_dumb():
        _SIGN = SignOfLife(sys.stderr, words)
        _SIGN.start()
    _OUTPUTS[:] = Output(sys.stdout, "stdout", fails=True, sign=_SIGN), Output(sys.stderr, "stderr", sign=_SIGN)
    sys.stdout, sys.stderr = cast(list[TextIO], _OUTPUTS)


def end_sign() -> None:
    """No sign of life from now on."""
    if _SIGN is not None:
        _SIGN.stop()


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


@contextmanager
def queued(waits: Callable[[], bool]) -> Iterator[None]:
    """Keep stdout and stderr behind queues. ``waits``: whether to wait for a full stdout, as a simulated sensor can.

    Without a reader the queues stay, so that the process can end at once.
    """
    for output, its_waits in zip(_OUTPUTS, (waits, lambda: False), strict=False):
        output.begin_queue(its_waits)
    try:
        yield
    finally:
        if settle():
            for output in _OUTPUTS:
                output.end_queue()


def news() -> list[News]:
    """Events of the readers since the last call."""
    return [each for output in _OUTPUTS for each in output.news()]


def settle() -> bool:
    """Wait for the readers, so that later text comes after the queued text on both streams; whether all is written."""
    are_settled = [output.settle() for output in _OUTPUTS]
    return all(are_settled)


def _open_closed_streams() -> None:
    """Open what was closed (``gse run 2>&-``), lest a session file gets its number and is written into as stderr."""
    for fd in range(3):
        try:
            os.fstat(fd)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    sys.stdin = sys.stdin or os.fdopen(0, closefd=False)
    sys.stdout = sys.stdout or os.fdopen(1, "w", closefd=False)
    sys.stderr = sys.stderr or os.fdopen(2, "w", closefd=False)


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
