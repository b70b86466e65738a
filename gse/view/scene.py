"""Scene of a session in rerun, for the live view and the saved view."""

import math
import re
from collections import deque
from collections.abc import Callable, Container, Sequence
from operator import itemgetter
from typing import Generic, TypeVar

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from drivers.chunk import LinkEvent, LinkKind
from drivers.clock import ClockReading
from gse.catalog import StarCatalog
from gse.config.station import Station
from gse.recording.session_format import RecorderKind
from gse.station.columns import STATUSES
from gse.station.events import LINK_WORDS, SKY_WORDS, StationKind
from gse.station.frame_results import FrameResult
from gse.station.housekeeping import Housekeeping
from gse.station.results import Status
from gse.station.session_tables import FrameTable
from gse.values import instant
from gse.values.instant import NS_PER_S
from gse.view.blueprint import LIVE_WINDOW_S, layout
from gse.view.live_state import (
    LINK_COLOURS,
    SKY_COLOURS,
    VERDICT_COLOURS,
    EventLines,
    SessionSoFar,
)
from gse.view.rerun_columns import (
    MEAN_S,
    OUTAGE_NS,
    TRACK_ROW_NS,
    DetectorPicture,
    begin_item,
    begin_scatter,
    begin_series,
    begin_sky,
    near_rows,
    send_clock,
    send_item,
    send_near,
    send_outages,
    send_own_answers,
    send_scatter,
    send_series,
    send_sky,
    times,
    unit_vectors,
)
from gse.view.viewer import NextPiece
from protocols import Item

_GOOD_EVENTS = {
    LinkKind.OPENED,
    LinkKind.REOPENED,
    LinkKind.WAITING,
    LinkKind.SYNCING,
    LinkKind.STREAMING,
    StationKind.CLOSED,
    StationKind.ALIGNED,
    StationKind.NOTE,
    StationKind.MOUNT_TOUCHED,
    StationKind.CLEAR,
    StationKind.DARK_NIGHT,
    RecorderKind.FILE_RESTORED,
    RecorderKind.RECOVERED,
    RecorderKind.SEGMENT,
}


_PICTURES_AT_ONCE = 1 << 10
"""Their labels are lists of words, and Arrow copies them: a night at once would take 150 MB."""
_ROWS_AT_ONCE = 1 << 14
_MOST_RECENT = 700
_MOST_ITEMS = 20_000
"""Values of items, one a second of each: ten minutes of 32 items."""
_MOST_LINES = 40
"""Lines of the log."""

_STATES_AGAIN = 200
"""Changes of state that a viewer gets that has just come."""

T = TypeVar("T")

_MARKDOWN = re.compile(r"([\\`*\[\]<>~|&])")

_COUNTS_LOGGED = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
"""Which repetitions of an event get a line: a link that flaps does not hide all else."""


class Recent(Generic[T]):
    """At most ``most`` values, none of them ``window_s`` seconds older than the last one."""

    def __init__(self, most: int, window_s: float) -> None:
        self._window_ns = window_s * NS_PER_S
        self._kept: deque[tuple[int, int, T]] = deque(maxlen=most)

    def add(self, number: int, utc_ns: int, value: T) -> None:
        """Keep a value of an instant; numbers grow."""
        self._kept.append((number, utc_ns, value))
        while self._kept[0][1] < utc_ns - self._window_ns:
            self._kept.popleft()

    def after(self, number: int) -> list[T]:
        """The values with greater numbers, in order."""
        return [value for kept, _, value in self._kept if kept > number]


class Scene:
    """A rerun recording that grows with a session; not thread-safe. ``so_far`` is how the session stands."""

    def __init__(
        self, stream: rr.RecordingStream, station: Station, catalog: StarCatalog | None, *, live: bool
    ) -> None:
        self._stream = stream
        # One for all pieces: rerun never ends the two threads of a recording stream, nor frees its memory.
        self._pieces = rr.RecordingStream("gse", recording_id=stream.get_recording_id(), send_properties=False)
        self._station = station
        self._live = live
        self._began_ns = 0
        self._latest_ns: np.int64 | None = None
        self._latest = Recent[FrameResult](1, math.inf)
        self._boresight_icrs: NDArray[np.float64] | None = None
        self._window_s: float | None = None
        self._picture = DetectorPicture(station.sensor.camera(), station.sensor.index_max, catalog)
        self._track: list[NDArray[np.void]] = []
        self._status: Status | None = None
        self._events = EventLines(frozenset({StationKind.NOTE, StationKind.MOUNT_TOUCHED}))
        self._number = 0
        self._laid_out = 0
        self._layout_made = (-1, b"")
        self._item_units: tuple[str, ...] = ()
        self._item_ns: dict[str, int] = {}
        self._items_begun: dict[tuple[int, str], int] = {}
        self._items = Recent[tuple[int, str, int, float]](_MOST_ITEMS, LIVE_WINDOW_S)
        self._frames = Recent[NDArray[np.void]](_MOST_RECENT, LIVE_WINDOW_S)
        self._own = Recent[NDArray[np.void]](_MOST_RECENT, LIVE_WINDOW_S)
        self._near = Recent[NDArray[np.void]](_MOST_RECENT, LIVE_WINDOW_S)
        self._tail: NDArray[np.void] | None = None
        self._outages = Recent[NDArray[np.int64]](_MOST_RECENT, LIVE_WINDOW_S)
        self._clock = Recent[ClockReading](_MOST_RECENT, LIVE_WINDOW_S)
        self._states = Recent[tuple[str, int, str]](_STATES_AGAIN, math.inf)
        self._logged: deque[tuple[int, str]] = deque(maxlen=_MOST_LINES)
        self._log_is_shown = True
        self._words = Recent[tuple[int, str, str]](1, math.inf)
        self._log_number = 0
        self._standing = ""
        self._shows_own = False
        self.so_far = SessionSoFar(station.limits)
        stream.send_blueprint(self._layout())
        self._begin(stream)

    def _begin(self, stream: rr.RecordingStream) -> None:
        """Names and styles of all that is shown."""
        begin_series(stream)
        self._picture.begin(stream)
        begin_sky(stream, self._picture.catalog)
        begin_scatter(stream, self._station.limits)
        lanes = (("/state/link", LINK_COLOURS), ("/state/sky", SKY_COLOURS), ("/state/verdict", VERDICT_COLOURS))
        for path, colours in lanes:
            words = list(colours)
            style = rr.StateConfiguration(values=words, labels=words, colors=list(colours.values()))
            stream.log(path, style, static=True)

    def add(self, frames: Sequence[FrameResult], *, pictures: int) -> None:
        """Show some frames, in order of time; only the last ``pictures`` of them as panoramas."""
        self._send_pictures(self._stream, frames[-pictures:])
        rows = np.concatenate([frame.row for frame in frames])
        for row, frame in zip(rows, frames, strict=True):
            self._log_change(row, frame.detail)
        self.add_columns(rows)
        self._latest.add(self._next(), frames[-1].panorama.utc_ns, frames[-1])

    def _send_pictures(self, stream: rr.RecordingStream, frames: Sequence[FrameResult]) -> None:
        rows = np.concatenate([frame.row for frame in frames])
        alone = [frame.alone for frame in frames]
        matches = _numbered([one.match_rows() for one in alone])
        others = _numbered([one.other_rows() for one in alone])
        self._picture.send(stream, rows, matches, others, alone[0].star_name)
        self._picture.send_residuals(stream, rows, matches)

    def add_whole(self, frames: FrameTable, events: Sequence[LinkEvent], star_name: Callable[[int], str]) -> None:
        """Show all frames of a session that has ended, and its events.

        Of a long session every second, fourth, ... frame is shown as a panorama.
        """
        rows = frames.columns.rows()
        changed = np.flatnonzero(np.diff(rows["status"], prepend=255)).tolist()
        moments: list[tuple[int, LinkEvent | int]] = [(event.utc_ns, event) for event in events]
        begin = 0
        for at_ns, moment in sorted([*moments, *((int(rows["utc_ns"][k]), k) for k in changed)], key=itemgetter(0)):
            if isinstance(moment, LinkEvent):
                until = max(begin, int(np.searchsorted(rows["utc_ns"], at_ns, "right")))
                self.so_far = self.so_far.with_rows(rows[begin:until]).with_event(moment)
                self.event(moment)
                begin = until
            else:
                self._log_change(rows[moment])
        self.so_far = self.so_far.with_rows(rows[begin:])
        for first in range(0, len(rows), _ROWS_AT_ONCE):
            self.add_columns(rows[first : first + _ROWS_AT_ONCE])
        shown = rows[:: frames.picture_stride]
        matches, others = (_of_shown(kept, frames.picture_stride) for kept in (frames.matches, frames.others))
        for first in range(0, len(shown), _PICTURES_AT_ONCE):
            part = shown[first : first + _PICTURES_AT_ONCE]
            named, unnamed = (_of_part(objects, first, first + len(part)) for objects in (matches, others))
            self._picture.send(self._stream, part, named, unnamed, star_name)
            self._picture.send_residuals(self._stream, part, named)

    def add_own_answers(self, errors: NDArray[np.void]) -> None:
        """Show errors of the sensor's own answers, rows of OWN_ERROR."""
        if not len(errors):
            return
        if self._live:
            self._own.add(self._next(), int(errors["utc_ns"][-1]), errors.copy())
        send_own_answers(self._stream, errors, self._station.limits)

    def add_housekeeping(self, housekeeping: Housekeeping) -> None:
        """Show the items of a whole session, a graph for each unit; words and bits are in tables only."""
        shown = _drawn(housekeeping, housekeeping.summaries)
        rows = housekeeping.rows
        numbers, utc_ns, values = (np.asarray(rows[name]) for name in ("item", "utc_ns", "value"))
        for item in shown:
            mine = numbers == housekeeping.items.index(item)
            send_item(self._stream, self._begin_item(item), item.name, utc_ns[mine], values[mine])
        if shown:
            self._stream.send_blueprint(self._layout())

    def add_latest_items(self, housekeeping: Housekeeping) -> None:
        """Show the latest value of each item of a running session, where it has one that was not shown."""
        latest, graphs = housekeeping.latest, len(self._item_units)
        for item in _drawn(housekeeping, latest):
            now = latest[item.name]
            if isinstance(now.value, str) or now.utc_ns == self._item_ns.get(item.name):
                continue
            self._item_ns[item.name] = now.utc_ns
            graph = self._begin_item(item)
            self._items.add(self._next(), now.utc_ns, (graph, item.name, now.utc_ns, now.value))
            send_item(self._stream, graph, item.name, np.array([now.utc_ns]), np.array([now.value]))
        if len(self._item_units) > graphs:
            self._laid_out = self._next()
            self._stream.send_blueprint(self._layout())

    def _begin_item(self, item: Item) -> int:
        """The graph of an item, that of its unit."""
        if item.unit not in self._item_units:
            self._item_units += (item.unit,)
        graph = self._item_units.index(item.unit)
        if (graph, item.name) not in self._items_begun:
            self._items_begun[graph, item.name] = self._next()
            begin_item(self._stream, graph, item.name)
        return graph

    def piece_after(self, place: str) -> NextPiece:
        """What came after a place, of the last ten minutes at most: all of it for a place of no such recording.

        The layout comes first: a viewer that has data without it lays them out as it likes. Then comes what is read,
        since a viewer without a graphics card takes its time for the rest. Nothing comes twice: for a star that did,
        the viewer states no name.
        """
        recording, _, number = place.rpartition(".")
        own = self._stream.get_recording_id()
        after = int(number) if recording == own else -1
        until = f"{own}.{self._number}", int(self._latest_ns or 0)
        if after == self._number:
            return NextPiece(b"", *until)
        layout = self._layout_rrd() if after < self._laid_out else b""
        stream = self._pieces
        file = stream.binary_stream()
        if after < 0:
            self._begin(stream)
        for words in self._words.after(after)[-1:]:
            _send_words(stream, *words)
        if self._log_number > after and self._logged:
            self._send_log(stream)
        for path, utc_ns, word in self._states.after(after):
            stream.send_columns(path, [times([utc_ns])], rr.StateChange.columns(state=[word]))
        if latest := self._latest.after(after):
            self._send_pictures(stream, latest)
        self._send_series_after(stream, after)
        return NextPiece(file.read() or b"", *until, layout)

    def _layout_rrd(self) -> bytes:
        """The layout as a recording, made once for all viewers: rerun never ends the two threads of a blueprint."""
        if self._layout_made[0] != self._laid_out:
            file = self._pieces.binary_stream()
            self._pieces.send_blueprint(self._layout())
            self._layout_made = self._laid_out, file.read() or b""
        return self._layout_made[1]

    def _send_series_after(self, stream: rr.RecordingStream, after: int) -> None:
        if frames := self._frames.after(after):
            columns = np.concatenate(frames)
            send_series(stream, columns, self._station.limits)
            send_sky(stream, columns, self._picture.camera)
            send_scatter(stream, columns, self._station.limits, (self.so_far.d_ra, self.so_far.d_de))
        if near := self._near.after(after):
            send_near(stream, np.concatenate(near))
        if outages := self._outages.after(after):
            send_outages(stream, np.concatenate(outages), self._station.limits)
        if own := self._own.after(after):
            send_own_answers(stream, np.concatenate(own), self._station.limits)
        if readings := self._clock.after(after):
            send_clock(stream, readings)
        for (graph, name), number in self._items_begun.items():
            if number > after:
                begin_item(stream, graph, name)
        values: dict[tuple[int, str], list[tuple[int, float]]] = {}
        for graph, name, utc_ns, value in self._items.after(after):
            values.setdefault((graph, name), []).append((utc_ns, value))
        for (graph, name), of_item in values.items():
            send_item(stream, graph, name, *(np.array(column) for column in zip(*of_item, strict=True)))

    def _next(self) -> int:
        self._number += 1
        return self._number

    def add_columns(self, columns: NDArray[np.void]) -> None:
        """Show all but the objects of some frames, rows of FRAME."""
        self._break_lines(columns["utc_ns"])
        if self._live:
            self._frames.add(self._next(), int(columns["utc_ns"][-1]), columns.copy())
        send_series(self._stream, columns, self._station.limits)
        self._send_near(columns)
        self._track.append(columns)
        # A host clock that was set back must not hold the track up.
        if abs(int(columns["utc_ns"][-1]) - int(self._track[0]["utc_ns"][0])) >= TRACK_ROW_NS:
            self.flush()

    def _send_near(self, columns: NDArray[np.void]) -> None:
        """Send the errors with their running mean, for which the last frames before these are kept."""
        after_gap = self._tail is None or int(columns["utc_ns"][0]) < int(self._tail["utc_ns"][-1])
        joined = columns if self._tail is None or after_gap else np.concatenate([self._tail, columns])
        rows = near_rows(joined, self._station.limits, len(columns))
        self._tail = joined[joined["utc_ns"] > joined["utc_ns"][-1] - round(MEAN_S * NS_PER_S)].copy()
        if self._live:
            self._near.add(self._next(), int(columns["utc_ns"][-1]), rows)
        send_near(self._stream, rows)

    def _break_lines(self, utc_ns: NDArray[np.int64]) -> None:
        """Leave a gap in the series where no frames came, before these frames or among them."""
        frames_ns = np.append(utc_ns[0] if self._latest_ns is None else self._latest_ns, utc_ns)
        self._latest_ns = utc_ns[-1]
        outages = np.flatnonzero(np.diff(frames_ns) > OUTAGE_NS)
        if len(outages):
            self._outages.add(self._next(), int(frames_ns[outages][-1]), frames_ns[outages])
            send_outages(self._stream, frames_ns[outages], self._station.limits)

    def flush(self) -> None:
        """Show the rest of scatter and sky track."""
        if not self._track:
            return
        columns = np.concatenate(self._track)
        self._track = []
        self._lay_out(columns)
        send_sky(self._stream, columns, self._picture.camera)
        send_scatter(self._stream, columns, self._station.limits, (self.so_far.d_ra, self.so_far.d_de))

    def _log_change(self, row: np.void, detail: str = "") -> None:
        """A cloud gives ten unidentified frames a second: only the first and the last are logged."""
        status = STATUSES[row["status"]]
        if status != self._status:
            text = f"frame {row['frame_no']}: {status.value} {detail}".rstrip()
            self.log(int(row["utc_ns"]), text, "INFO" if status is Status.IDENTIFIED else "WARN")
        self._status = status

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
        begins_own = self.so_far.own_d_ra.n > 0 and not self._shows_own
        self._shows_own |= begins_own
        if aims or narrows or begins_own:
            self._laid_out = self._next()
            self._stream.send_blueprint(self._layout())

    def _layout(self) -> rrb.Blueprint:
        return layout(
            self._station,
            window_s=self._window_s,
            boresight_icrs=self._boresight_icrs,
            own=self._shows_own,
            item_units=self._item_units,
        )

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
        self._states.add(self._next(), utc_ns, (path, utc_ns, word))

    def clock(self, readings: Sequence[ClockReading]) -> None:
        """Show the health of the host clock."""
        for reading in readings:
            self._clock.add(self._next(), reading.utc_ns, reading)
        if readings:
            send_clock(self._stream, readings)

    def log(self, utc_ns: int, text: str, level: str = "INFO") -> None:
        """Add a line to the log, for ``show_log``."""
        plain = _MARKDOWN.sub(r"\\\1", text)
        line = f"{instant.to_text(utc_ns, 0)[11:]} {plain}"
        self._logged.appendleft((utc_ns, f"**{line}**" if level == "WARN" else line))
        self._log_is_shown = False
        self._log_number = self._next()

    def show_log(self) -> None:
        """Show the log as one text, the newest line first: sent again it stays the same, where lines would double."""
        if not self._log_is_shown:
            self._log_is_shown = True
            self._send_log(self._stream)

    def _send_log(self, stream: rr.RecordingStream) -> None:
        # Frames and events come one kind after the other; of the same instant the later one stands above.
        newest_first = sorted(self._logged, key=lambda logged: -logged[0])
        lines = "\n".join(f"- {line}" for _, line in newest_first)
        _send_text(stream, "/log", newest_first[0][0], lines)

    def words(self, utc_ns: int, markdown: str, metrics: str = "") -> None:
        """Show a text in the panel of the verdict, and a table in that of the metrics."""
        self._words.add(self._next(), utc_ns, (utc_ns, markdown, metrics))
        _send_words(self._stream, utc_ns, markdown, metrics)

    def words_for_all_times(self, markdown: str, metrics: str) -> None:
        """The same, wherever the time cursor stands."""
        for path, text in (("/verdict", markdown), ("/metrics", _headed(metrics))):
            self._stream.log(path, rr.TextDocument(text, media_type="text/markdown"), static=True)


def _drawn(housekeeping: Housekeeping, came: Container[str]) -> list[Item]:
    """The items that came and are numbers: words and bits are in tables only."""
    return [item for item in housekeeping.items if item.name in came and not (item.words or item.are_bits)]


def _numbered(objects: Sequence[NDArray[np.void]]) -> NDArray[np.void]:
    """The objects of frames that are given one by one, each with the number of its frame."""
    for number, of_one in enumerate(objects):
        of_one["frame"] = number
    return np.concatenate(objects)


def _of_shown(objects: NDArray[np.void], stride: int) -> NDArray[np.void]:
    """The objects of every ``stride``-th frame, in the order of these frames, which they count."""
    chosen = np.flatnonzero(objects["frame"] % stride == 0)
    shown: NDArray[np.void] = objects[chosen[np.argsort(objects["frame"][chosen], kind="stable")]]
    shown["frame"] //= stride
    return shown


def _of_part(objects: NDArray[np.void], begin: int, end: int) -> NDArray[np.void]:
    """The objects of the frames from ``begin`` to before ``end``, counted from the first of these."""
    part: NDArray[np.void] = objects[slice(*np.searchsorted(objects["frame"], [begin, end]))].copy()
    part["frame"] -= begin
    return part


def _send_words(stream: rr.RecordingStream, utc_ns: int, markdown: str, metrics: str) -> None:
    _send_text(stream, "/verdict", utc_ns, markdown)
    _send_text(stream, "/metrics", utc_ns, _headed(metrics))


def _send_text(stream: rr.RecordingStream, path: str, utc_ns: int, markdown: str) -> None:
    stream.send_columns(path, [times([utc_ns])], rr.TextDocument.columns(text=[markdown], media_type=["text/markdown"]))


def _headed(metrics: str) -> str:
    return f"with 95 % intervals, after ECSS-E-ST-60-20C (docs/metrics.md)\n\n{metrics}" if metrics else "not known yet"
