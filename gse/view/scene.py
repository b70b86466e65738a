"""Scene of a session in rerun, for the live view and the saved view."""

import re
from collections import deque
from collections.abc import Sequence

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from drivers.chunk import LinkEvent, LinkKind
from drivers.clock import ClockReading
from gse import instant
from gse.catalog import StarCatalog
from gse.config.station import Station
from gse.instant import NS_PER_S
from gse.recording.event_kinds import RecorderKind
from gse.station.event_kinds import StationKind
from gse.station.frame_results import FrameResults
from gse.station.results import FrameResult, Status
from gse.view.blueprint import LIVE_WINDOW_S, layout
from gse.view.event_lines import EventLines
from gse.view.picture import Picture
from gse.view.running_statistics import (
    LINK_COLOURS,
    LINK_WORDS,
    SKY_COLOURS,
    SKY_WORDS,
    VERDICT_COLOURS,
    Running,
)
from gse.view.series import (
    OUTAGE_NS,
    begin_series,
    send_clock,
    send_outages,
    send_own_answers,
    send_series,
    times,
)
from gse.view.sky import TRACK_ROW_NS, begin_scatter, begin_sky, send_scatter, send_sky, unit_vectors

_GOOD_EVENTS = {
    LinkKind.OPENED,
    LinkKind.REOPENED,
    LinkKind.WAITING,
    LinkKind.SYNCING,
    LinkKind.STREAMING,
    StationKind.CLOSED,
    StationKind.ALIGNED,
    StationKind.NOTE,
    StationKind.CLEAR,
    StationKind.DARK_NIGHT,
    RecorderKind.FILE_RESTORED,
    RecorderKind.RECOVERED,
    RecorderKind.SEGMENT,
}


_MOST_RECENT = 700
_MOST_LINES = 40
"""Lines of the log."""

_STATES_AGAIN = 200
"""Changes of state that a viewer gets that has just come."""

_MARKDOWN = re.compile(r"([\\`*\[\]<>~|&])")

_COUNTS_LOGGED = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
"""Which repetitions of an event get a line: a link that flaps does not hide all else."""


class Scene:
    """A rerun recording that grows with a session; not thread-safe."""

    def __init__(
        self, stream: rr.RecordingStream, station: Station, catalog: StarCatalog | None, *, live: bool
    ) -> None:
        self._stream = stream
        self._station = station
        self._live = live
        self._began_ns = 0
        self._latest_ns: np.int64 | None = None
        self._boresight_icrs: NDArray[np.float64] | None = None
        self._window_s: float | None = None
        self._picture = Picture(station.sensor.camera(), station.sensor.index_max, catalog)
        self._track: list[NDArray[np.void]] = []
        self._status: Status | None = None
        self._events = EventLines(frozenset({StationKind.NOTE}))
        self._recent: deque[NDArray[np.void]] = deque()
        self._own_recent: deque[NDArray[np.void]] = deque()
        self._logged: deque[tuple[int, str]] = deque(maxlen=_MOST_LINES)
        self._log_is_shown = True
        self._states: deque[tuple[str, int, str]] = deque(maxlen=_STATES_AGAIN)
        self._words: tuple[int, str, str] | None = None
        self._standing = ""
        self._shows_own = False
        self.running = Running(station.limits)
        stream.send_blueprint(layout(station))
        begin_series(stream)
        self._picture.begin(stream)
        begin_sky(stream, catalog)
        begin_scatter(stream, station.limits)
        lanes = (("/state/link", LINK_COLOURS), ("/state/sky", SKY_COLOURS), ("/state/verdict", VERDICT_COLOURS))
        for path, colours in lanes:
            words = list(colours)
            style = rr.StateConfiguration(values=words, labels=words, colors=list(colours.values()))
            stream.log(path, style, static=True)

    def add(self, frames: Sequence[FrameResult], *, pictures: int) -> None:
        """Show some frames, in order of time; only the last ``pictures`` of them as panoramas."""
        self.add_objects(frames, pictures=pictures)
        self.add_columns(FrameResults.of(frames).rows())
        shown = FrameResults.of(frames[-pictures:])
        self.add_residuals(shown.rows(), shown.match_rows())

    def add_objects(self, frames: Sequence[FrameResult], *, pictures: int) -> None:
        """Show the objects of the last ``pictures`` of some frames, log what changes, and count."""
        self._picture.send(self._stream, frames[-pictures:])
        self.running.add(FrameResults.of(frames).rows())
        for frame in frames:
            self._log_change(frame)

    def add_own_answers(self, errors: NDArray[np.void]) -> None:
        """Show errors of the sensor's own answers, rows of OWN_ERROR."""
        if not len(errors):
            return
        self.running.add_own(errors)
        if self._live:
            self._remember_in(self._own_recent, errors)
        send_own_answers(self._stream, errors)

    def send_again(self) -> None:
        """Send the last ten minutes once more, each series in one piece: for a viewer that has just come.

        What is read comes first, since a viewer without a graphics card takes its time for the rest.
        """
        if self._words is not None:
            self.words(*self._words)
        self._log_is_shown = not self._logged
        self.show_log()
        for path, utc_ns, word in self._states:
            self._stream.send_columns(path, [times([utc_ns])], rr.StateChange.columns(state=[word]))
        if self._recent:
            columns = np.concatenate(self._recent)
            send_series(self._stream, columns, self._station.limits)
            send_sky(self._stream, columns, self._picture.camera)
            send_scatter(self._stream, columns, self._station.limits, (self.running.d_ra, self.running.d_de))
        if self._own_recent:
            send_own_answers(self._stream, np.concatenate(self._own_recent))

    @staticmethod
    def _remember_in(recent: deque[NDArray[np.void]], columns: NDArray[np.void]) -> None:
        recent.append(columns.copy())
        oldest_ns = columns["utc_ns"][-1] - round(LIVE_WINDOW_S * NS_PER_S)
        while recent[0]["utc_ns"][-1] < oldest_ns or len(recent) > _MOST_RECENT:
            recent.popleft()

    def add_residuals(self, columns: NDArray[np.void], matches: NDArray[np.void]) -> None:
        """Show the residuals of some frames: rows of FRAME, and their rows of MATCH."""
        self._picture.send_residuals(self._stream, columns, matches)

    def add_columns(self, columns: NDArray[np.void]) -> None:
        """Show all but the objects of some frames, rows of FRAME."""
        self._break_lines(columns["utc_ns"])
        if self._live:
            self._remember_in(self._recent, columns)
        send_series(self._stream, columns, self._station.limits)
        self._track.append(columns)
        if columns["utc_ns"][-1] - self._track[0]["utc_ns"][0] >= TRACK_ROW_NS:
            self.flush()

    def _break_lines(self, utc_ns: NDArray[np.int64]) -> None:
        """Leave a gap in the series where no frames came, before these frames or among them."""
        frames_ns = np.append(utc_ns[0] if self._latest_ns is None else self._latest_ns, utc_ns)
        self._latest_ns = utc_ns[-1]
        outages = np.flatnonzero(np.diff(frames_ns) > OUTAGE_NS)
        if len(outages):
            send_outages(self._stream, frames_ns[outages], self._station.limits)

    def flush(self) -> None:
        """Show the rest of scatter and sky track."""
        if not self._track:
            return
        columns = np.concatenate(self._track)
        self._track = []
        self._lay_out(columns)
        send_sky(self._stream, columns, self._picture.camera)
        send_scatter(self._stream, columns, self._station.limits, (self.running.d_ra, self.running.d_de))

    def _log_change(self, frame: FrameResult) -> None:
        """A cloud gives ten unidentified frames a second: only the first and the last are logged."""
        if frame.status != self._status:
            text = f"frame {frame.panorama.frame_no}: {frame.status.value} {frame.detail}".rstrip()
            level = "INFO" if frame.status is Status.IDENTIFIED else "WARN"
            self.log(frame.panorama.utc_ns, text, level)
        self._status = frame.status

    def _lay_out(self, columns: NDArray[np.void]) -> None:
        """Send the layout anew when boresight or own answers of the sensor first come, and after ten minutes.

        Only then, because the user's own arrangement is lost each time.
        """
        known = np.flatnonzero(np.isfinite(columns["ra_deg"]))
        aims = self._boresight_icrs is None and len(known) > 0
        if aims:
            first = known[:1]
            self._boresight_icrs = unit_vectors(columns["ra_deg"][first], columns["de_deg"][first])[0]
        self._began_ns = self._began_ns or int(columns["utc_ns"][0])
        age_s = (int(columns["utc_ns"][-1]) - self._began_ns) / NS_PER_S
        narrows = self._live and self._window_s is None and age_s > LIVE_WINDOW_S
        if narrows:
            self._window_s = LIVE_WINDOW_S
        begins_own = self.running.own_d_ra.n > 0 and not self._shows_own
        self._shows_own |= begins_own
        if aims or narrows or begins_own:
            wanted = layout(
                self._station, window_s=self._window_s, boresight_icrs=self._boresight_icrs, own=self._shows_own
            )
            self._stream.send_blueprint(wanted)

    def event(self, event: LinkEvent) -> None:
        """Show an event of the link in its state bar and in the log."""
        for path, words in (("/state/link", LINK_WORDS), ("/state/sky", SKY_WORDS)):
            if (word := words.get(event.kind)) is not None:
                self._state(path, event.utc_ns, word)
        line = self._events.add(event)
        if line.count in _COUNTS_LOGGED or line.count % _COUNTS_LOGGED[-1] == 0:
            repeated = f" ({line.count} x)" if line.count > 1 else ""
            level = "INFO" if event.kind in _GOOD_EVENTS else "WARN"
            self.log(event.utc_ns, f"{event.kind}{repeated}: {event.text}", level)

    def stands(self, utc_ns: int, word: str) -> None:
        """Show how the session stands, a word of VERDICT_COLOURS, from an instant on."""
        if word != self._standing:
            self._standing = word
            self._state("/state/verdict", utc_ns, word)

    def _state(self, path: str, utc_ns: int, word: str) -> None:
        self._stream.send_columns(path, [times([utc_ns])], rr.StateChange.columns(state=[word]))
        self._states.append((path, utc_ns, word))

    def clock(self, readings: Sequence[ClockReading]) -> None:
        """Show the health of the host clock."""
        if readings:
            send_clock(self._stream, readings)

    def log(self, utc_ns: int, text: str, level: str = "INFO") -> None:
        """Add a line to the log, for ``show_log``."""
        plain = _MARKDOWN.sub(r"\\\1", text)
        line = f"{instant.to_text(utc_ns, 0)[11:]} {plain}"
        self._logged.appendleft((utc_ns, f"**{line}**" if level == "WARN" else line))
        self._log_is_shown = False

    def show_log(self) -> None:
        """Show the log as one text, the newest line first: sent again it stays the same, where lines would double."""
        if not self._log_is_shown:
            self._log_is_shown = True
            # Frames and events come one kind after the other; of the same instant the later one stands above.
            newest_first = sorted(self._logged, key=lambda logged: -logged[0])
            lines = "\n".join(f"- {line}" for _, line in newest_first)
            columns = rr.TextDocument.columns(text=[lines], media_type=["text/markdown"])
            self._stream.send_columns("/log", [times([newest_first[0][0]])], columns)

    def words(self, utc_ns: int, markdown: str, metrics: str = "") -> None:
        """Show a text in the panel of the verdict, and a table in that of the metrics."""
        self._words = utc_ns, markdown, metrics
        for path, text in (("/verdict", markdown), ("/metrics", _headed(metrics))):
            columns = rr.TextDocument.columns(text=[text], media_type=["text/markdown"])
            self._stream.send_columns(path, [times([utc_ns])], columns)

    def words_for_all_times(self, markdown: str, metrics: str) -> None:
        """The same, wherever the time cursor stands."""
        for path, text in (("/verdict", markdown), ("/metrics", _headed(metrics))):
            self._stream.log(path, rr.TextDocument(text, media_type="text/markdown"), static=True)


def _headed(metrics: str) -> str:
    return f"with 95 % intervals, after ECSS-E-ST-60-20C (docs/metrics.md)\n\n{metrics}" if metrics else "not known yet"
