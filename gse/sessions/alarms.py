"""Alarms of a running session: one message when something has been wrong for a while, one when it is over.

A thread looks at the live state once a second, so that a session that hangs is told, too. Messages go to a program or
a URL that the operator's station file names, and into the session as notes; a replay sends none. The page shows an
alarm until it is over, or somebody says there that it was seen.
"""

import contextlib
import importlib
import importlib.util
import json
import math
import shutil
import subprocess
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Self

from gse.config.station import AlarmKind, Alarms
from gse.errors import GseError
from gse.station.events import MOST_CHARACTERS, Notes
from gse.values.instant import NS_PER_S
from gse.view.glance_word import NO_ANSWER_S
from gse.view.live_state import NO_SKY, LiveState, SessionSoFar

_EVERY_S = 1.0
_SENT_WITHIN_S = 30.0
_LITTLE_BYTES = 1_000_000_000
_WAYS_OF_APPRISE = "apprise"


class Alarmed:
    """Watches a ``live`` state, whose session is in ``folder``; a context manager.

    ``send`` takes a message (default: as the station file says), ``tell`` a line on one that could not be sent.
    """

    def __init__(
        self,
        asked: Alarms,
        live: LiveState,
        folder: Path | None,
        notes: Notes,
        *,
        send: Callable[[str], None] | None = None,
        tell: Callable[[str], None] = lambda text: None,
    ) -> None:
        self._asked, self._live, self._folder, self._notes = asked, live, folder, notes
        self._send = send or (lambda text: send_message(asked, text))
        self._tell = tell
        self._since: dict[AlarmKind, float] = {}
        self._raised: set[AlarmKind] = set()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="alarms", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._thread.join(_EVERY_S)

    def _run(self) -> None:
        while not self._closing.wait(_EVERY_S):
            self.look(time.monotonic())

    def look(self, now_s: float) -> None:
        """Raise what has been wrong for long enough, and end what is over."""
        wrong = {kind: text for kind, text in troubles(self._live.so_far, self._folder) if kind in self._asked.on}
        for kind, text in wrong.items():
            began_s = self._since.setdefault(kind, now_s)
            if kind not in self._raised and now_s - began_s >= self._asked.after_s:
                self._raised.add(kind)
                self._live.alarms = (*self._live.alarms, f"{kind}: {text}")
                self._say(f"ALARM {kind}: {text}")
        for kind in [kind for kind in self._since if kind not in wrong]:
            del self._since[kind]
            if kind in self._raised:
                self._raised.discard(kind)
                self._live.alarms = tuple(one for one in self._live.alarms if not one.startswith(f"{kind}: "))
                self._say(f"ALARM over, {kind}: it is well again")

    def _say(self, text: str) -> None:
        self._notes.put(text[:MOST_CHARACTERS])
        try:
            self._send(f"{self._live.station.sensor.name}: {text}")
        except GseError as error:
            self._tell(str(error))


def troubles(so_far: SessionSoFar, folder: Path | None) -> Iterator[tuple[AlarmKind, str]]:
    """What is wrong with a session now."""
    if so_far.link_word in ("no port", "silent"):
        yield "link", "the port is gone" if so_far.link_word == "no port" else "the sensor is silent"
    if so_far.sky in NO_SKY:
        yield "cloud", so_far.sky_text or so_far.sky
    elif so_far.frames and _without_answer_s(so_far) >= NO_ANSWER_S:
        yield "no answer", f"no panorama was identified for {_without_answer_s(so_far):.0f} s"
    clock = so_far.clock
    if clock is not None and so_far.clock_error_s is None and not clock.synchronised:
        yield "clock", f"the clock of this computer is not synchronised ({clock.source})"
    with contextlib.suppress(OSError):
        free = shutil.disk_usage(folder).free if folder else math.inf
        if free < _LITTLE_BYTES:
            yield "disk", f"{free / 1e9:.1f} GB of disk are free"


def _without_answer_s(so_far: SessionSoFar) -> float:
    answered_ns = so_far.first_utc_ns if so_far.answered_utc_ns is None else so_far.answered_utc_ns
    return (so_far.utc_ns - answered_ns) / NS_PER_S


def send_message(asked: Alarms, text: str) -> None:
    """Send a message as the station file asks; GseError where that fails."""
    if asked.command:
        _run_program([*asked.command, text])
    if asked.post:
        _post(asked.post, text)


def _run_program(command: list[str]) -> None:
    try:
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, timeout=_SENT_WITHIN_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise GseError(f"the alarm was not sent: {command[0]}: {error}; try it with: gse alarms test") from error
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().splitlines()
        raise GseError(
            f"the alarm was not sent: {command[0]} ended with {done.returncode}: {(said or ['no word'])[-1]:.200}"
        )


def _post(url: str, text: str) -> None:
    if not url.startswith(("http://", "https://")):
        _by_apprise(url, text)
        return
    body = json.dumps({"text": text}).encode()
    request = urllib.request.Request(url, body, {"Content-Type": "application/json"})
    try:
        urllib.request.urlopen(request, timeout=_SENT_WITHIN_S).close()
    except (OSError, ValueError) as error:
        raise GseError(f"the alarm was not sent to {url:.80}: {error}; try it with: gse alarms test") from error


def _by_apprise(url: str, text: str) -> None:
    """Any other address is one of apprise's hundred ways, where that is installed."""
    if importlib.util.find_spec(_WAYS_OF_APPRISE) is None:
        raise GseError(f"alarms.post: {url:.80} is not http(s); pip install apprise knows mail, chat and telephone")
    sender = importlib.import_module(_WAYS_OF_APPRISE).Apprise()
    if not (sender.add(url) and sender.notify(body=text)):
        raise GseError(f"the alarm was not sent: apprise could not use {url:.80}")
