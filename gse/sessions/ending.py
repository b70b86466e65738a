"""End of a live session by signals from a person, a terminal or the system.

first signal       the session ends: it is closed, judged and reported
Ctrl-Z             nothing but a word: a stopped process would lose what its port cannot hold
Ctrl-C after that  no verdict: judging is left at once, closing is not, since data come first
"""

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Any, Self

_NAMED = {
    "SIGINT": "Ctrl-C (SIGINT)",
    "SIGTERM": "SIGTERM",
    "SIGHUP": "the hang-up of its terminal (SIGHUP)",
    "SIGQUIT": "Ctrl-\\ (SIGQUIT)",
    "SIGBREAK": "Ctrl-Break (SIGBREAK)",
}
REASONS = {signal.Signals[name]: text for name, text in _NAMED.items() if hasattr(signal, name)}
"""Of the signals that this system has."""
SAME_PRESS_S = 1.0
"""A second Ctrl-C within this time is ignored: a double keystroke, or terminal and shell both sent one."""


class Ending:
    """Catches the signals that end a session, and keeps the reason; a context manager.

    An ignored hang-up, as under nohup, stays ignored.
    """

    def __init__(self, say: Callable[[str], None] = lambda text: None) -> None:
        self.reason = ""
        self.leaves = False
        self._say = say
        self._first_s = 0.0
        self._interruptible = False
        self._before: dict[int, Any] = {}

    def asked(self) -> bool:
        """Whether a signal asked for the end of the session."""
        return bool(self.reason)

    @contextmanager
    def interruptible(self) -> Iterator[None]:
        """A block that a second Ctrl-C interrupts with KeyboardInterrupt, also one pressed before the block."""
        try:
            self._interruptible = True
            if self.leaves:
                raise KeyboardInterrupt
            yield
        finally:
            self._interruptible = False

    def __enter__(self) -> Self:
        for number in REASONS:
            if number.name != "SIGHUP" or signal.getsignal(number) is not signal.SIG_IGN:
                self._before[number] = signal.signal(number, self._on_signal)
        if hasattr(signal, "SIGTSTP"):
            self._before[signal.SIGTSTP] = signal.signal(signal.SIGTSTP, self._on_stop)
        # With `stty tostop` a word from the background would stop the process.
        if hasattr(signal, "SIGTTOU"):
            self._before[signal.SIGTTOU] = signal.signal(signal.SIGTTOU, signal.SIG_IGN)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _on_stop(self, number: int, frame: FrameType | None) -> None:
        self._say("Ctrl-Z stops no session: it would lose bytes. Ctrl-C ends it; --detach runs one without a terminal")

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if not self.reason:
            self.reason = REASONS[signal.Signals(number)]
            self._first_s = time.monotonic()
            self._say(
                f"{self.reason}: the session is closed, judged and reported; Ctrl-C again leaves it without a verdict"
            )
        elif number == signal.SIGINT and not self.leaves and time.monotonic() - self._first_s >= SAME_PRESS_S:
            self.leaves = True
            self._say("Ctrl-C again: the session is closed, but not judged")
            if self._interruptible:
                raise KeyboardInterrupt
