"""Bounded queues for stdout and stderr, so that a slow reader cannot delay a session.

A stopped terminal, a full or closed pipe, or a full disk must not delay a session. Each of the two streams is replaced
by a queue with a writing thread. Text beyond the limit of the queue is dropped; at the end the process waits only as
long as the reader still takes text.
"""

import contextlib
import io
import os
import select
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TextIO, cast

from gse.process import sign_of_life
from gse.station.events import StationKind

LIMIT_CHARS = 16 << 20
"""Some nine minutes of frames as JSON lines at 10 Hz."""
PIECE_BYTES = 4096
"""Bytes per write; small, so that a slow reader shows progress."""
PATIENCE_S = 1.0
"""Longest wait at the end for a reader that takes nothing."""
STUCK_S = 5.0
"""Time without a byte taken after which the event TERMINAL_STUCK is made."""

News = tuple[str, str]
"""The kind of an event, and its text."""


class QueuedOutput(io.TextIOBase):
    """A text stream whose ``write`` never fails; it waits for a reader only while ``waits()`` is true."""

    encoding = "utf-8"
    errors = "replace"

    def __init__(self, stream: TextIO, name: str, *, waits: Callable[[], bool] = lambda: False) -> None:
        self._stream, self._name, self._waits = stream, name, waits
        self.encoding = stream.encoding or "utf-8"
        self._texts: deque[str] = deque()
        self._chars = self._taken = 0
        self._given_up_at = -1
        self._was_terminal = False
        self._noted: set[str] = set()
        self._news: deque[News] = deque()
        self._progress_s = time.monotonic()
        self._ended = False
        # A signal handler may write while the same thread is writing: the lock of a Condition lets it.
        self._changed = threading.Condition()
        threading.Thread(target=self._run, name=f"output {name}", daemon=True).start()

    def write(self, text: str) -> int:
        """Queue the text; beyond the limit it is dropped."""
        if not isinstance(text, str):
            raise TypeError(f"expected text for {self._name}, not {type(text).__name__}")
        with self._changed:
            while self._chars > LIMIT_CHARS and self._waits():
                self._changed.wait(0.1)
            if self._chars <= LIMIT_CHARS and text:
                if not self._chars:
                    self._progress_s = time.monotonic()
                self._texts.append(text)
                self._chars += len(text)
                self._changed.notify_all()
        return len(text)

    def flush(self) -> None:
        """Does nothing: the thread writes queued text by itself."""

    def writable(self) -> bool:
        """Always."""
        return True

    def isatty(self) -> bool:
        """Whether the stream behind the queue is a terminal now."""
        try:
            return self._stream.isatty()
        except (OSError, ValueError):
            return False

    def fileno(self) -> int:
        """The descriptor behind the queue."""
        return self._stream.fileno()

    def news(self) -> list[News]:
        """Events of the reader since the last call, each kind once in a session."""
        is_terminal = self.isatty()
        if self._was_terminal and not is_terminal:
            self._note(StationKind.TERMINAL_LOST, f"{self._name}: the terminal is gone; the session goes on without")
        self._was_terminal = is_terminal
        if self._chars and time.monotonic() - self._progress_s > STUCK_S:
            self._note(StationKind.TERMINAL_STUCK, f"nobody reads {self._name}; the session goes on without")
        found = []
        while self._news:
            found.append(self._news.popleft())
        return found

    def settle(self) -> bool:
        """Wait until everything is written, as long as the reader takes text; whether it is."""
        with self._changed:
            while self._chars and self._given_up_at != self._taken:
                taken = self._taken
                self._changed.wait_for(lambda taken=taken: self._taken != taken, PATIENCE_S)  # type: ignore[misc]
                if self._taken == taken and not self._waits():
                    self._given_up_at = taken
            return not self._chars

    def end(self) -> bool:
        """Write the queued text and end the thread; whether everything was written."""
        settled = self.settle()
        with self._changed:
            self._ended = True
            self._changed.notify_all()
        return settled

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._texts or self._ended)
                if not self._texts:
                    return
                text = self._texts.popleft()
            try:
                sign_of_life.before(text)
                self._hand_on(text)
            except (OSError, ValueError) as error:
                reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
                self._note(StationKind.TERMINAL_LOST, f"{self._name}: {reason}; the session goes on without")
            with self._changed:
                self._chars -= len(text)
                self._count_taken()

    def _hand_on(self, text: str) -> None:
        try:
            fd = self._stream.fileno()
        except (OSError, ValueError):
            self._stream.write(text)
            self._stream.flush()
            return
        data = memoryview(text.encode(self.encoding, "replace"))
        while data:
            try:
                data = data[os.write(fd, data[:PIECE_BYTES]) :]
            except BlockingIOError:
                select.select([], [fd], [], 1.0)
            else:
                with self._changed:
                    self._count_taken()

    def _count_taken(self) -> None:
        self._taken += 1
        self._progress_s = time.monotonic()
        self._changed.notify_all()

    def _note(self, kind: str, text: str) -> None:
        if kind not in self._noted:
            self._noted.add(kind)
            self._news.append((kind, text))


class Outputs:
    """stdout and stderr of this process behind queues, without closed streams."""

    def __init__(self, waits: Callable[[], bool]) -> None:
        self._before = sys.stdout, sys.stderr
        out = QueuedOutput(sys.stdout, "stdout", waits=waits) if sys.stdout else None
        err = QueuedOutput(sys.stderr, "stderr") if sys.stderr else None
        self._queued = [output for output in (out, err) if output]
        sys.stdout, sys.stderr = cast(TextIO, out), cast(TextIO, err)

    def news(self) -> list[News]:
        """Events of the readers since the last call."""
        return [news for output in self._queued for news in output.news()]

    def settle(self) -> None:
        """Wait for the readers, so that later text comes after the queued text on both streams."""
        for output in self._queued:
            output.settle()

    def close(self) -> None:
        """Restore the streams; without a reader the queues stay, so that the process can end at once."""
        ended = [output.end() for output in self._queued]
        if all(ended):
            sys.stdout, sys.stderr = self._before


@contextmanager
def queued_output(waits: Callable[[], bool] = lambda: False) -> Iterator[Outputs]:
    """stdout and stderr behind queues. ``waits``: whether to wait for a full stdout, as a simulated sensor can."""
    with contextlib.closing(Outputs(waits)) as outputs:
        yield outputs
