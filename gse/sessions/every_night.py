"""One session each night: a process of its own for each, so that a night that breaks takes no other with it."""

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from types import FrameType

from gse.sessions.status_file import session_folders

DATA_SET = "dataset"
"""The folder below that of the sessions that the nights are added to."""
_USAGE, _FIRST_ERROR_S = 2, 60.0
"""A night that ended at once is begun again after this time; one of wrong usage is not."""
_WITH_VALUE = ("--every", "--from", "--until")


def run_every_night(words: Sequence[str], out: Path, tell: Callable[[str], None]) -> int:
    """Run the command line ``words`` of ``gse run`` from dusk until dawn, again and again; the last exit code.

    Ctrl-C and SIGTERM end the session that runs, and with it the series.
    """
    series = _Series()
    night = [sys.executable, "-m", "gse", *_alone(words)]
    while not series.ended:
        before = set(session_folders(out))
        code = series.run(night)
        new = sorted(set(session_folders(out)) - before)
        for folder in new:
            tell(_line(folder))
            _add(folder, out / DATA_SET, tell)
        if code == _USAGE:
            return code
        if not new and not series.ended:
            series.pause(_FIRST_ERROR_S)
    return code


def _alone(words: Sequence[str]) -> list[str]:
    """The words of one night: without ``--every``, from dusk until dawn where nothing else is said."""
    kept, given = [], {"--from": "dusk", "--until": "dawn"}
    rest = iter(words)
    for word in rest:
        name, equals, value = word.partition("=")
        if name not in _WITH_VALUE:
            kept.append(word)
        elif name in given:
            given[name] = value if equals else next(rest)
        elif not equals:
            next(rest)
    return [*kept, *(part for pair in given.items() for part in pair)]


class _Series:
    """The process of the present night, and whether a signal ended the series."""

    def __init__(self) -> None:
        self.ended = False
        self._running: subprocess.Popen[bytes] | None = None
        self._awake = threading.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._end)

    def _end(self, number: int, frame: FrameType | None) -> None:
        self.ended = True
        self._awake.set()
        # Ctrl-C reaches the night from the terminal itself.
        if number == signal.SIGTERM and self._running is not None:
            self._running.terminate()

    def run(self, command: Sequence[str]) -> int:
        self._running = subprocess.Popen(command, env=os.environ)
        return self._running.wait()

    def pause(self, seconds: float) -> None:
        self._awake.wait(seconds)


def _line(folder: Path) -> str:
    """The night in a line: verdict and report."""
    try:
        told = json.loads((folder / "report.json").read_bytes())["conclusion"]
        return f"{told['headline']}: {told['subject']}: {folder}/report.html"
    except (OSError, ValueError, KeyError, TypeError):
        return f"{folder} has no report; make one with: gse report {folder}"


def _add(folder: Path, dataset: Path, tell: Callable[[str], None]) -> None:
    """Judge a session into the data set of the nights."""
    if find_spec("distributed") is None:
        tell("the data set of the nights needs: pip install '.[campaign]'")
        return
    command = [sys.executable, "-m", "gse", "campaign", "judge", str(folder), "--out", str(dataset), "--workers", "1"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    last = (done.stderr.strip().splitlines() or [""])[-1]
    tell(f"added to {dataset}" if done.returncode == 0 else f"not added to {dataset}: {last}")
