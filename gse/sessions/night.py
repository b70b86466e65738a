"""The night at a site: when a session from dusk to dawn begins and ends.

Dusk and dawn are where the Sun passes SUN_LIMIT_DEG; ``dusk+20m`` and ``dawn-10m`` keep a margin. All of it is UTC: a
change to summer time moves nothing.

``run_every_night`` runs each night in a process of its own, so that one that breaks takes no other with it.
"""

import json
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from types import FrameType

from gse.errors import UsageError
from gse.sessions.status_file import session_folders
from gse.station.sky_condition import SUN_LIMIT_DEG
from gse.values import instant
from gse.values.instant import NS_PER_S
from gse.values.site import Site
from gse.view.glance import is_bright, next_dawn_ns

_MARK = re.compile(r"(dusk|dawn)(?:([+-]\d{1,3})m)?")
_MINUTE_NS = 60 * NS_PER_S
_DAY_NS = 86_400 * NS_PER_S
_STEP_NS = 10 * _MINUTE_NS
_MOST_DAYS = 200
"""Longer than any polar summer."""


def begin_ns(text: str, site: Site, now_ns: int, until: str | None = None) -> int:
    """UTC at which a session begins: ``dusk``, now where it is dark already, or an instant.

    In the last minutes of a night that ``until`` leaves out, the next dusk is meant.
    """
    mark, margin_ns = _read(text, "--from")
    if mark is None:
        return instant.from_text(text)
    if mark == "dawn":
        raise UsageError("--from dawn would begin a day; expected dusk, dusk+20m, or UTC such as 2026-03-20T18:30:00Z")
    dawn_ns = next_dawn_ns(site, now_ns)
    if until is not None and dawn_ns is not None and now_ns >= dawn_ns + _read(until, "--until")[1]:
        now_ns = dawn_ns + _MINUTE_NS
    dusk_ns = next_dusk_ns(site, now_ns)
    return max(now_ns, dusk_ns + (margin_ns if dusk_ns > now_ns else 0))


def end_ns(text: str, site: Site, begin_ns: int) -> int:
    """UTC at which a session that began ends: the next ``dawn``, a day later in polar night, or an instant."""
    mark, margin_ns = _read(text, "--until")
    if mark is None:
        found_ns = instant.from_text(text)
    elif mark == "dusk":
        raise UsageError("--until dusk would be a day; expected dawn, dawn-10m, or UTC such as 2026-03-21T04:30:00Z")
    else:
        dawn_ns = next_dawn_ns(site, begin_ns)
        found_ns = begin_ns + _DAY_NS if dawn_ns is None else dawn_ns + margin_ns
    if found_ns <= begin_ns:
        raise UsageError(f"--until {text}: it is over at {instant.to_text(begin_ns, 0)}; the session begins then")
    return found_ns


def next_dusk_ns(site: Site, utc_ns: int) -> int:
    """UTC of the next dusk, good to a second; ``utc_ns`` where it is dark. UsageError where none comes for long."""
    if not is_bright(site, utc_ns):
        return utc_ns
    for bright_ns in range(utc_ns, utc_ns + _MOST_DAYS * _DAY_NS, _STEP_NS):
        dark_ns = bright_ns + _STEP_NS
        if not is_bright(site, dark_ns):
            while dark_ns - bright_ns > NS_PER_S:
                middle_ns = (bright_ns + dark_ns) // 2
                bright_ns, dark_ns = (middle_ns, dark_ns) if is_bright(site, middle_ns) else (bright_ns, middle_ns)
            return dark_ns
    raise UsageError(f"the Sun does not sink to {SUN_LIMIT_DEG:g} deg at {site.name} within {_MOST_DAYS} days")


def _read(text: str, option: str) -> tuple[str | None, int]:
    """``dusk`` or ``dawn`` with its margin; None of an instant. UsageError of another text."""
    found = _MARK.fullmatch(text)
    if found:
        return found[1], int(found[2] or 0) * _MINUTE_NS
    try:
        instant.from_text(text)
    except ValueError as error:
        raise UsageError(f"{option}: expected dusk, dawn-10m, or an instant; {error}") from error
    return None, 0


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
