"""Switch of the sensor's supply: programs of the station file, which are run without a shell.

A thread runs one program at a time, so that a session goes on while one hangs. What it did comes out as events and
readings, which the loop records. A program that hangs is killed with all that it started.
"""

import contextlib
import math
import os
import queue
import re
import signal
import subprocess
import threading
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from drivers.clock import ClockReading, read_clock
from drivers.outside_text import plain_line
from gse.config.station import Power
from gse.recording.session_format import PowerReading
from gse.station.events import StationKind
from gse.values.instant import NS_PER_S

Event = tuple[str, str]
"""Kind and text of an event."""
News = tuple[ClockReading, Event | PowerReading]
"""What happened, and when by the clocks of this host."""

_MOST_WORDS = 200
"""Characters of what a program printed that an event keeps."""
_MOST_AMPERES, _MOST_VOLTS = 1000.0, 10_000.0
_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_READING = re.compile(rf"(?:{_NUMBER}\s*(m?)V?[\s,;]+)?{_NUMBER}\s*(m?)A?")
_FAILURES_TOLD = 3
"""Failed readings in a row that are events; those that follow are not told."""


@dataclass(frozen=True, slots=True)
class Ran:
    """Outcome of one program: whether it did its work, and what there is to say of it."""

    is_done: bool
    words: str
    output: str = ""


def run_program(command: Sequence[str], timeout_s: float) -> Ran:
    """Run a program with its arguments to its end, at most so long; then it is killed with all that it started."""
    try:
        child = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        return Ran(False, f"{command[0]} cannot be started: {reason}; see power in the station file")
    with child:
        try:
            printed, _ = child.communicate(timeout=timeout_s)
        except subprocess.TimeoutExpired:
            _kill(child)
            return Ran(False, f"{command[0]} did not end within {timeout_s:g} s (power.timeout_s), and was killed")
        except BaseException:
            _kill(child)
            raise
    output = printed.decode(errors="replace")
    words = plain_line(" ".join(output.split()))[:_MOST_WORDS]
    if child.returncode:
        return Ran(False, f"{command[0]} ended with {child.returncode}{f': {words}' if words else ''}", output)
    return Ran(True, words, output)


def _kill(child: "subprocess.Popen[bytes]") -> None:
    """Kill a program and what it started: a grandchild would hold its output open."""
    with contextlib.suppress(OSError):
        if hasattr(os, "killpg"):
            os.killpg(child.pid, signal.SIGKILL)
        else:
            child.kill()


def reading_of(output: str, utc_ns: int) -> PowerReading | None:
    """The reading that a program printed: amperes, or volts and amperes, with or without their units; None if none."""
    lines = output.strip().splitlines()
    found = _READING.fullmatch(lines[0].strip()) if lines else None
    if found is None:
        return None
    volts = float(found[1]) * (1e-3 if found[2] else 1) if found[1] else math.nan
    amperes = float(found[3]) * (1e-3 if found[4] else 1)
    is_sane = abs(amperes) <= _MOST_AMPERES and not abs(volts) > _MOST_VOLTS
    return PowerReading(utc_ns, amperes, volts) if is_sane else None


class PowerSwitch:
    """Switches the supply, and reads it each period; a context manager."""

    def __init__(self, options: Power) -> None:
        self._options = options
        self._asked: queue.Queue[tuple[bool, Future[Ran]] | None] = queue.Queue()
        self._news: queue.SimpleQueue[News] = queue.SimpleQueue()
        self._failures = 0
        self._thread = threading.Thread(target=self._run, name="power", daemon=True)

    def switch(self, *, on: bool) -> "Future[Ran]":
        """Ask for the supply; the result comes when the program has ended and the supply has settled."""
        result: Future[Ran] = Future()
        self._asked.put((on, result))
        return result

    def news(self) -> list[News]:
        """Events and readings since the last call."""
        found = []
        with contextlib.suppress(queue.Empty):
            while True:
                found.append(self._news.get_nowait())
        return found

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Do what was asked, and end."""
        self._asked.put(None)
        self._thread.join()

    def _run(self) -> None:
        period_s = self._options.period_s if self._options.read else None
        while True:
            try:
                asked = self._asked.get(timeout=period_s)
            except queue.Empty:
                self._read()
                continue
            if asked is None:
                return
            on, result = asked
            result.set_result(self._switch(on=on))

    def _switch(self, *, on: bool) -> Ran:
        command = self._options.on if on else self._options.off
        self._say(StationKind.POWER_ON if on else StationKind.POWER_OFF, " ".join(command))
        ran = run_program(command, self._options.timeout_s)
        self._say(
            StationKind.POWER_SAID if ran.is_done else StationKind.POWER_FAILED, ran.words or "it printed nothing"
        )
        if ran.is_done and on:
            self._settle()
        return ran

    def _settle(self) -> None:
        """Wait until the supply has settled, and read the current as often as it can be read meanwhile."""
        until_ns = read_clock().mono_ns + round(self._options.settle_s * NS_PER_S)
        pause = threading.Event()
        while (left_s := (until_ns - read_clock().mono_ns) / NS_PER_S) > 0:
            if not self._options.read or not self._read():
                pause.wait(left_s)

    def _read(self) -> bool:
        """Read the supply once; whether that gave a reading."""
        began = read_clock()
        ran = run_program(self._options.read, self._options.timeout_s)
        reading = reading_of(ran.output, began.utc_ns) if ran.is_done else None
        if reading is not None:
            self._failures = 0
            self._news.put((began, reading))
            return True
        self._failures += 1
        if self._failures <= _FAILURES_TOLD:
            expected = "expected amperes, or volts and amperes, such as 5.02 0.31"
            words = f"power.read printed {ran.words!r}: {expected}" if ran.is_done else ran.words
            self._say(StationKind.POWER_FAILED, words)
        return False

    def _say(self, kind: str, text: str) -> None:
        self._news.put((read_clock(), (kind, text)))
