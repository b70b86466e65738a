"""The plots of a report, drawn by a second process while this one judges the session.

The process is a fork: it has the session as this one has it, so that only the statistics are sent. It imports what
draws while this process judges, and forks once more to draw on two processors. Where there is no fork, or it comes to
nothing, this process draws: the plots are the same to the byte.
"""

import gc
import os
import signal
import sys
import warnings
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe
from typing import Self

from gse.station.session_data import SessionData
from gse.statistics.session_statistics import Statistics

_HALVES = 2
PATIENCE_S = 60.0
"""Drawing takes 2 s; a fork that is stuck, as libraries with threads may leave one, must not hold up a report."""


class DrawnBeside:
    """The other process; it ends with the ``with`` block or this process at the latest."""

    def __init__(self, patience_s: float = PATIENCE_S) -> None:
        self._patience_s = patience_s
        self._other: _Forked | None = None

    def start(self, session: SessionData) -> None:
        """Start it, for a session that is whole."""
        self._other = _forked(lambda link: _serve(link, session))

    def ask(self, stats: Statistics) -> None:
        """Have the plots drawn, of the session with these statistics."""
        if self._other is not None:
            self._other.send(stats)

    def plots(self) -> dict[str, str] | None:
        """SVG elements by name; None where this process has to draw them."""
        plots = self._other.answer(self._patience_s) if self._other is not None else None
        return plots if isinstance(plots, dict) else None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._other is not None:
            self._other.end()


class _Forked:
    """A process that this one forked, and the link to it. One that ended early, or is stuck, answers None."""

    def __init__(self, pid: int, link: "Connection[object, object]") -> None:
        self._pid, self._link = pid, link

    def send(self, value: object) -> None:
        with suppress(OSError):
            self._link.send(value)

    def answer(self, patience_s: float) -> object:
        try:
            return self._link.recv() if self._link.poll(patience_s) else None
        except (OSError, EOFError):
            return None

    def end(self) -> None:
        self._link.close()
        with suppress(OSError):  # somebody else waited for it
            os.kill(self._pid, signal.SIGKILL)
            os.waitpid(self._pid, 0)


def _forked(work: "Callable[[Connection[object, object]], None]") -> _Forked | None:
    """Do ``work`` in a fork of this process, which says nothing and leaves Ctrl-C to this one."""
    if not sys.platform.startswith("linux"):  # on macOS, libraries that numpy calls do not bear it
        return None
    ours, theirs = Pipe()
    try:
        with warnings.catch_warnings():
            # Python warns of locks that other threads hold in a fork: of this one's threads none has any that it takes.
            warnings.simplefilter("ignore", DeprecationWarning)
            pid = os.fork()
    except OSError:
        ours.close()
        return None
    if pid == 0:
        _work_and_exit(work, ours, theirs)
    theirs.close()
    return _Forked(pid, ours)


def _work_and_exit(
    work: "Callable[[Connection[object, object]], None]",
    ours: "Connection[object, object]",
    theirs: "Connection[object, object]",
) -> None:
    """Never returns: what the starting process wants done at its end is not done here, and no text is written twice."""
    try:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        ours.close()  # so that the end of the other process is the end of the link
        gc.freeze()
        work(theirs)
    finally:
        os._exit(0)


def _serve(link: "Connection[object, object]", session: SessionData) -> None:
    from gse.report.session_plots import session_plots  # matplotlib, while the starting process judges

    stats = link.recv()
    assert isinstance(stats, Statistics)
    other = _forked(lambda link: link.send(session_plots(session, stats, part=(1, _HALVES))))
    plots = session_plots(session, stats, part=(0, _HALVES))
    rest = other.answer(PATIENCE_S / 2) if other is not None else None
    if other is not None:
        other.end()
    link.send(plots | (rest if isinstance(rest, dict) else session_plots(session, stats, part=(1, _HALVES))))
