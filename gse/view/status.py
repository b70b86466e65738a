"""Status line of a running session in the terminal."""

import math
import shutil
from collections.abc import Callable, Iterator, Sequence
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
from gse.config.station import Station
from gse.count_text import count_text
from gse.station.announcer import Announcer
from gse.station.frame_results import FrameResults
from gse.station.session_data import SessionData
from gse.view.running_statistics import LINK_WORDS, Running
from gse.view.verdict_text import clock_health, percent

PLAIN_EVERY_NS = 10 * instant.NS_PER_S
"""Of the data's time, between two lines where there is no terminal."""

_LINK_STYLES = {"streaming": "green", "silent": "bold red", "no port": "bold red", "closed": "dim"}
_NO_LINK = "no link"
_BAD = "bold red"
_LITTLE_BYTES = 1_000_000_000


class StatusLine:
    """A listener and context manager: one line, renewed twice a second; plain lines if stderr is not a terminal.

    It is written to stderr. ``folder`` is the session folder: the free space of its disk is shown. ``forecast`` gives
    the line on the time to a verdict, ``progress`` how far a replay is.
    """

    def __init__(
        self,
        station: Station,
        folder: Path | None = None,
        console: Console | None = None,
        *,
        forecast: Callable[[], str] = lambda: "",
        progress: Callable[[], str] = lambda: "",
    ) -> None:
        self._forecast, self._progress = forecast, progress
        self._console = console or Console(stderr=True, highlight=False)
        self._is_terminal = self._console.is_terminal
        self._width = self._console.width
        self._folder = folder
        self._running = Running(station.limits)
        self._session: SessionData | None = None
        self._link = _NO_LINK
        self._due_ns = 0
        self._closed = False
        self._announcer = Announcer(
            lambda text: self._console.print(text, soft_wrap=not self._is_terminal, markup=False)
        )
        self._live = Live(console=self._console, get_renderable=self.line, refresh_per_second=2, transient=True)

    def on_results(self, results: FrameResults, session: SessionData) -> None:
        """Add frames."""
        self._session = session
        begin = 0
        for end in [] if self._is_terminal else self._due(results.rows["utc_ns"].tolist()):
            self._running.add(results.rows[begin:end])
            begin = end
            # Without rich, which needs a millisecond: a replay of a long session writes thousands of lines.
            print("".join(part.text for part in self._shown(self._width)), file=self._console.file, flush=True)
        self._running.add(results.rows[begin:])

    def _due(self, utc_ns: Sequence[int]) -> Iterator[int]:
        """The numbers of new frames after which a line is due."""
        for count, at_ns in enumerate(utc_ns, 1):
            if at_ns >= self._due_ns:
                self._due_ns = at_ns + PLAIN_EVERY_NS
                yield count

    def on_event(self, event: LinkEvent) -> None:
        """Announce the event, each kind once; the state of the link stays in the line."""
        self._link = LINK_WORDS.get(event.kind, self._link)
        self._running.add_event(event)
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
        running = self._running
        yield _Part(f"{instant.to_text(running.utc_ns, 0)[11:]} " if running.frames else "", 0)
        link = f"link {self._link}" if self._link != _NO_LINK else self._link
        progress = self._progress()
        yield _Part(link, 5 if progress and self._link == "streaming" else 0, _LINK_STYLES.get(self._link, ""))
        yield _Part(f"  {progress}" if progress else "", 1)
        yield _Part(f"  {count_text(running.frames, 'frame')}{_rate(running)}", 5)
        yield _Part(self._lost(), 2, _BAD)
        yield _warned(f"  sky {running.sky}" if running.sky else "", 4, running.sky in ("clouded", "no stars"))
        yield _Part(f"  {running.silence}" if running.silence else "", 1, _BAD)
        yield _warned(f"  {percent(running.identified)} identified", 3, self._misses_availability())
        yield _warned(f"  dRA* {_mean(running.d_ra.mean, running.d_ra.n)}", 2, self._outside("d_ra"))
        yield _warned(f"  dDE {_mean(running.d_de.mean, running.d_de.n)}", 2, self._outside("d_de"))
        yield _Part(f"  NEA {_nea(running.d_ra.nea)}, {_nea(running.d_de.nea)} arcsec", 6)
        yield _warned(f"  clock {self._clock()}", 7, self._clock_is_bad())
        yield self._disk()
        yield _Part(f"  {forecast}" if (forecast := self._forecast()) else "", 4)

    def _lost(self) -> str:
        lost = self._session.link.frames_lost if self._session else 0
        return f"  {lost} lost" if lost else ""

    def _misses_availability(self) -> bool:
        return self._running.identified < self._running.limits.availability

    def _outside(self, axis: str) -> bool:
        limits = self._running.limits
        moments, limit = {
            "d_ra": (self._running.d_ra, limits.d_ra_cosde_arcsec),
            "d_de": (self._running.d_de, limits.d_de_arcsec),
        }[axis]
        return abs(moments.mean) > limit

    def _clock(self) -> str:
        session = self._session
        return clock_health(session.clock[-1], session.clock_error_s) if session and session.clock else "not read"

    def _clock_is_bad(self) -> bool:
        session = self._session
        return bool(session and session.clock_error_s is None and session.clock and not session.clock[-1].synchronised)

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


def _rate(running: Running) -> str:
    return "" if math.isnan(running.frames_per_s) else f" at {running.frames_per_s:.1f}/s"


def _mean(value: float, n: int) -> str:
    return f"{value:+.1f}" if n else "-"


def _nea(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.1f}"
