"""Status line of a running session in the terminal."""

import math
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from rich.cells import cell_len
from rich.console import Console
from rich.live import Live
from rich.text import Text

from drivers.chunk import LinkEvent
from gse import instant
from gse.count_text import count_text
from gse.station.announcer import Announcer
from gse.station.frame_results import FrameResults
from gse.view.live_state import STATE_EVERY_NS, ErrorsSoFar, LiveState, SessionSoFar
from gse.view.verdict_text import clock_health, percent

_LINK_STYLES = {"streaming": "green", "silent": "bold red", "no port": "bold red", "closed": "dim"}
_NO_LINK = "no link"
_BAD = "bold red"
_LITTLE_BYTES = 1_000_000_000


class StatusLine:
    """A display and context manager: one line, renewed twice a second.

    It is written to stderr; where that is no terminal there is a line for each STATE_EVERY_NS of the data's time.
    ``folder`` is the session folder: the free space of its disk is shown. ``progress`` says how far a replay is.
    """

    def __init__(
        self,
        live: LiveState,
        folder: Path | None = None,
        console: Console | None = None,
        *,
        progress: Callable[[], str] = lambda: "",
    ) -> None:
        self._progress = progress
        self._console = console or Console(stderr=True, highlight=False)
        self._is_terminal = self._console.is_terminal
        self._width = self._console.width
        self._folder = folder
        self._state = live
        self._due_ns = 0
        self._closed = False
        self._announcer = Announcer(
            lambda text: self._console.print(text, soft_wrap=not self._is_terminal, markup=False)
        )
        self._live = Live(console=self._console, get_renderable=self.line, refresh_per_second=2, transient=True)

    def on_results(self, results: FrameResults, so_far: SessionSoFar) -> None:
        """Print a line where there is no terminal, and one is due."""
        if self._is_terminal or so_far.utc_ns < self._due_ns:
            return
        self._due_ns = so_far.utc_ns + STATE_EVERY_NS
        # Without rich, which needs a millisecond: a replay of a long session writes thousands of lines.
        print("".join(part.text for part in self._shown(self._width)), file=self._console.file, flush=True)

    def on_event(self, event: LinkEvent, so_far: SessionSoFar) -> None:
        """Announce the event, each kind once; the state of the link stays in the line."""
        self._announcer.on_event(event)

    def line(self) -> Text:
        """The line as it is now, no longer than the terminal is wide: what matters least is left out."""
        return Text.assemble(*((part.text, part.style) for part in self._shown(self._console.width)))

    def _shown(self, room: int) -> list["_Part"]:
        """The parts of the line that have room."""
        parts = [part for part in self._parts() if part.text]
        shown = set()
        for place, part in sorted(enumerate(parts), key=lambda item: item[1].rank):
            cells = cell_len(part.text)
            if cells <= room:
                shown.add(place)
                room -= cells
        return [part for place, part in enumerate(parts) if place in shown]

    def _parts(self) -> Iterator["_Part"]:
        so_far = self._state.so_far
        limits = so_far.limits
        word = so_far.link_word
        yield _Part(f"{instant.to_text(so_far.utc_ns, 0)[11:]} " if so_far.frames else "", 0)
        progress = self._progress()
        link = f"link {word}" if word != _NO_LINK else word
        yield _Part(link, 5 if progress and word == "streaming" else 0, _LINK_STYLES.get(word, ""))
        yield _Part(f"  {progress}" if progress else "", 1)
        yield _Part(f"  {count_text(so_far.frames, 'frame')}{_rate(so_far)}", 5)
        lost = so_far.link.frames_lost
        yield _Part(f"  {lost} lost" if lost else "", 2, _BAD)
        yield _warned(f"  sky {so_far.sky}" if so_far.sky else "", 4, so_far.sky in ("clouded", "no stars"))
        yield _Part(f"  {so_far.silence}" if so_far.silence else "", 1, _BAD)
        yield _warned(f"  {percent(so_far.identified)} identified", 3, so_far.identified < limits.availability)
        yield _mean("dRA*", so_far.d_ra, limits.d_ra_cosde_arcsec)
        yield _mean("dDE", so_far.d_de, limits.d_de_arcsec)
        yield _Part(f"  NEA {_nea(so_far.d_ra.nea)}, {_nea(so_far.d_de.nea)} arcsec", 6)
        yield _clock(so_far)
        yield self._disk()
        yield _Part(f"  {forecast}" if (forecast := self._state.forecast) else "", 4)

    def _disk(self) -> "_Part":
        if self._folder is None:
            return _Part("", 0)
        try:
            free = shutil.disk_usage(self._folder).free
        except OSError as error:
            return _warned(f"  disk: {error.strerror}", 0, True)
        return _warned(f"  disk {free / 1e9:.1f} GB free", 8, free < _LITTLE_BYTES)

    def __enter__(self) -> Self:
        if self._is_terminal:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Remove the line and print the number of repeated events; further calls do nothing."""
        self._live.stop()
        if not self._closed:
            self._closed = True
            self._announcer.conclude()


@dataclass(frozen=True, slots=True)
class _Part:
    """A part of the line; of a higher rank, it is left out earlier."""

    text: str
    rank: int
    style: str = ""


def _warned(text: str, rank: int, is_bad: bool) -> _Part:
    return _Part(text, 1, _BAD) if is_bad else _Part(text, rank)


def _clock(so_far: SessionSoFar) -> _Part:
    clock, stated_s = so_far.clock, so_far.clock_error_s
    if clock is None:
        return _Part("  clock not read", 7)
    return _warned(f"  clock {clock_health(clock, stated_s)}", 7, stated_s is None and not clock.synchronised)


def _rate(so_far: SessionSoFar) -> str:
    return "" if math.isnan(so_far.frames_per_s) else f" at {so_far.frames_per_s:.1f}/s"


def _mean(name: str, errors: ErrorsSoFar, limit_arcsec: float) -> _Part:
    value = f"{errors.mean:+.1f}" if errors.n else "-"
    return _warned(f"  {name} {value}", 2, abs(errors.mean) > limit_arcsec)


def _nea(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.1f}"
