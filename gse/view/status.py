"""Status line of a running session in the terminal."""

import math
import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from rich.cells import cell_len
from rich.console import Console
from rich.live import Live
from rich.text import Text

from drivers.chunk import LinkEvent, LinkKind
from gse.station.events import StationKind
from gse.station.frame_results import FrameResults
from gse.station.host_clock import LEAST_OFF_S
from gse.station.session_data import SessionData
from gse.values import instant
from gse.values.axis import D_DE, D_RA_COSDE
from gse.values.text import count_text
from gse.view.live_state import NO_SKY, STATE_EVERY_NS, ErrorsSoFar, LiveState, SessionSoFar
from gse.view.verdict_text import clock_health, host_minus_sensor, percent

# Messages to the operator: the first event of each kind, then a count.

_ROUTINE = {LinkKind.OPENED, LinkKind.WAITING, LinkKind.SYNCING, LinkKind.STREAMING}
"""Routine events: announced once, left out of the repeat counts."""

_EACH_TIME = {
    "RECORDER_REFUSED",
    "RECORDER_RECOVERED",
    StationKind.FINDING,
    StationKind.NOTE,
    StationKind.MOUNT_TOUCHED,
}
"""Announced each time, because data may be lost, or because each is another; their makers limit their number."""


_OF_STEPS = {StationKind.STEP_BEGUN, StationKind.STEP_DONE}
"""Never announced: who runs a procedure says each step, and its report has them all."""


class Announcer:
    """A listener of the station loop that prints the first event of each kind, and the number of further ones at the
    end.

    A link that fails ten thousand times gives two lines.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._seen: Counter[str] = Counter()
        self._said = ""

    def on_results(self, results: FrameResults, session: SessionData) -> None:
        """Panoramas are not announced."""

    def on_event(self, event: LinkEvent) -> None:
        """Print an event if it is the first of its kind, and says more than the one before (LOST, then NO_PORT)."""
        if event.kind in _OF_STEPS:
            return
        self._seen[event.kind] += 1
        is_new, self._said = event.text != self._said, event.text
        if is_new and (self._seen[event.kind] == 1 or event.kind in _EACH_TIME):
            when = instant.to_text(event.utc_ns, 1) if event.utc_ns else "before the first byte"
            self._say(f"{when} {event.kind}: {event.text}")

    def conclude(self) -> None:
        """Print the number of further events of each kind."""
        excluded = _ROUTINE | _EACH_TIME
        more = [f"{kind} {count - 1}" for kind, count in self._seen.items() if count > 1 and kind not in excluded]
        if more:
            self._say(f"events that came again, not shown: {', '.join(more)}")


_LINK_STYLES = {"streaming": "green", "silent": "bold red", "no port": "bold red", "closed": "dim"}
_NO_LINK = "no link"
_PROMPT = "> "
_CLEAR_LINE = "\r\x1b[2K"
_BAD = "bold red"
_LITTLE_BYTES = 1_000_000_000


class StatusLine:
    """A display and context manager: one line, renewed twice a second.

    It is written to stderr; where that is no terminal there is a line for each STATE_EVERY_NS of the data's time.
    ``folder`` is the session folder: the free space of its disk is shown. ``progress`` says how far a replay is; with
    ``quiet`` there is nothing but the line, and that on a terminal only.
    """

    def __init__(
        self,
        live: LiveState,
        folder: Path | None = None,
        console: Console | None = None,
        *,
        progress: Callable[[], str] = lambda: "",
        quiet: bool = False,
    ) -> None:
        self._progress = progress
        self._quiet = quiet
        self._console = console or Console(stderr=True, highlight=False)
        self._is_terminal = self._console.is_terminal
        self._width = self._console.width
        self._folder = folder
        self._state = live
        self._due_ns = 0
        self._closed = False
        self._asks = False
        self._step = ""
        self._announcer = Announcer(self._print)
        self._live = Live(console=self._console, get_renderable=self.line, refresh_per_second=2, transient=True)

    def on_results(self, results: FrameResults, so_far: SessionSoFar) -> None:
        """Print a line where there is no terminal, and one is due."""
        if self._is_terminal or self._quiet or so_far.utc_ns < self._due_ns:
            return
        self._due_ns = so_far.utc_ns + STATE_EVERY_NS
        # Without rich, which needs a millisecond: a replay of a long session writes thousands of lines.
        print("".join(part.text for part in self._shown(self._width)), file=self._console.file, flush=True)

    def on_event(self, event: LinkEvent, so_far: SessionSoFar) -> None:
        """Announce the event, each kind once; the state of the link and the step that runs stay in the line."""
        if event.kind == StationKind.STEP_BEGUN:
            self._step = f"step {event.text.split(' | ')[0]}"
        elif event.kind == StationKind.PROCEDURE_ENDED:
            self._step = ""
        if not self._quiet:
            self._announcer.on_event(event)

    def line(self) -> Text:
        """The line as it is now, no longer than the terminal is wide: what matters least is left out."""
        return Text.assemble(*((part.text, part.style) for part in self._shown(self._console.width)))

    def _shown(self, room: int) -> list["_LinePart"]:
        """The parts of the line that have room."""
        parts = [part for part in self._parts() if part.text]
        shown = set()
        for place, part in sorted(enumerate(parts), key=lambda item: item[1].rank):
            cells = cell_len(part.text)
            if cells <= room:
                shown.add(place)
                room -= cells
        return [part for place, part in enumerate(parts) if place in shown]

    def _parts(self) -> Iterator["_LinePart"]:
        so_far = self._state.so_far
        limits = so_far.limits
        word = so_far.link_word
        yield _LinePart(f"{instant.to_text(so_far.utc_ns, 0)[11:]} " if so_far.frames else "", 0)
        progress = self._progress()
        link = f"link {word}" if word != _NO_LINK else word
        yield _LinePart(link, 5 if progress and word == "streaming" else 0, _LINK_STYLES.get(word, ""))
        yield _LinePart(f"  {progress}" if progress else "", 1)
        yield _LinePart(f"  {self._step}" if self._step else "", 1)
        yield _LinePart(f"  {count_text(so_far.frames, 'frame')}{_rate(so_far)}", 5)
        lost = so_far.link.frames_lost
        yield _LinePart(f"  {lost} lost" if lost else "", 2, _BAD)
        sky = "" if so_far.silence and so_far.sky in NO_SKY else so_far.sky  # the silence says it
        yield _warned(f"  sky {sky}" if sky else "", 4, sky in ("clouded", "no stars"))
        yield _LinePart(f"  {so_far.behind_s:.0f} s behind" if so_far.late else "", 1, _BAD)
        yield _LinePart(f"  {so_far.silence}" if so_far.silence else "", 1, _BAD)
        yield _warned(f"  {percent(so_far.identified)} identified", 3, so_far.identified < limits.availability)
        yield _mean(D_RA_COSDE.label, so_far.d_ra, limits.of(D_RA_COSDE))
        yield _mean(D_DE.label, so_far.d_de, limits.of(D_DE))
        yield _LinePart(f"  NEA {_nea(so_far.d_ra.nea)}, {_nea(so_far.d_de.nea)} arcsec", 6)
        yield _clock(so_far)
        apart_s = so_far.host_minus_sensor_s
        yield _warned("" if math.isnan(apart_s) else f"  {host_minus_sensor(apart_s)}", 7, abs(apart_s) >= LEAST_OFF_S)
        yield self._disk()
        yield _LinePart(f"  {forecast}" if (forecast := self._state.forecast) else "", 4)

    def _disk(self) -> "_LinePart":
        if self._folder is None:
            return _LinePart("", 0)
        try:
            free = shutil.disk_usage(self._folder).free
        except OSError as error:
            return _warned(f"  disk: {error.strerror}", 0, True)
        return _warned(f"  disk {free / 1e9:.1f} GB free", 8, free < _LITTLE_BYTES)

    def __enter__(self) -> Self:
        if self._is_terminal:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def ask(self, question: str) -> None:
        """Show a question to the operator in the place of the line, where the answer is typed; empty ends it."""
        self._live.stop()
        self._prompt("")
        self._asks = bool(question)
        if question:
            self._print(question)
        elif self._is_terminal and not self._closed:
            self._live.start()

    def _print(self, text: str) -> None:
        self._prompt("")
        self._console.print(text, soft_wrap=not self._is_terminal, markup=False)
        self._prompt(_PROMPT)

    def _prompt(self, text: str) -> None:
        """Renew the line where the operator types; there is none unless one is asked on a terminal."""
        if self._asks and self._is_terminal:
            self._console.file.write(f"{_CLEAR_LINE}{text}")
            self._console.file.flush()

    def close(self) -> None:
        """Remove the line and print the number of repeated events; further calls do nothing."""
        self._live.stop()
        if not self._closed:
            self._closed = True
            self._announcer.conclude()


@dataclass(frozen=True, slots=True)
class _LinePart:
    """A part of the line; of a higher rank, it is left out earlier."""

    text: str
    rank: int
    style: str = ""


def _warned(text: str, rank: int, is_bad: bool) -> _LinePart:
    return _LinePart(text, 1, _BAD) if is_bad else _LinePart(text, rank)


def _clock(so_far: SessionSoFar) -> _LinePart:
    clock, stated_s = so_far.clock, so_far.clock_error_s
    if clock is None:
        return _LinePart("  clock not read", 7)
    return _warned(f"  clock {clock_health(clock, stated_s)}", 7, stated_s is None and not clock.synchronised)


def _rate(so_far: SessionSoFar) -> str:
    return "" if math.isnan(so_far.frames_per_s) else f" at {so_far.frames_per_s:.1f}/s"


def _mean(name: str, errors: ErrorsSoFar, limit_arcsec: float) -> _LinePart:
    value = f"{errors.mean:+.1f}" if errors.n else "-"
    return _warned(f"  {name} {value}", 2, abs(errors.mean) > limit_arcsec)


def _nea(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.1f}"
