"""Ctrl-C, wherever Python is when it comes.

Python raises KeyboardInterrupt in whatever code runs, and three kinds do not bear it. LLVM's objects, half made, end
the process (signal 11). Of an error in a destructor Python only tells, and goes on. Compiled code of others takes it
for an error of its own, or for an answer. The first two get it a moment later; after it no other error is worth a
report.
"""

import _thread
import signal
import sys
import threading
import time
from types import FrameType
from typing import Any

_LATER_S = 0.01
"""A destructor takes less, and most of what LLVM does."""
_NOT_BEARING = "llvmlite"

_came = threading.Event()


def start() -> None:
    """Take Ctrl-C over from Python, where Python has it: not where the shell said to ignore it."""
    sys.unraisablehook = _not_in_destructors
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, interrupt)


def came() -> bool:
    """Whether a Ctrl-C has come, so that an error after it needs no report."""
    return _came.is_set()


def interrupt(number: int, frame: FrameType | None) -> None:
    """The handler of a signal that ends the command: raises KeyboardInterrupt, now or a moment later."""
    _came.set()
    while frame is not None:
        if str(frame.f_globals.get("__name__")).partition(".")[0] == _NOT_BEARING:
            _again_later(number)
            return
        frame = frame.f_back
    raise KeyboardInterrupt


def _not_in_destructors(what: Any) -> None:
    """What Python does with an error that nobody can catch."""
    if issubclass(what.exc_type, KeyboardInterrupt):
        _again_later(signal.SIGINT)
    elif not came():
        sys.__unraisablehook__(what)


def _again_later(number: int) -> None:
    # Not by a Timer, whose start takes a lock that the code that is interrupted may hold.
    _thread.start_new_thread(_send_later, (number,))


def _send_later(number: int) -> None:
    time.sleep(_LATER_S)
    _thread.interrupt_main(signal.Signals(number))
