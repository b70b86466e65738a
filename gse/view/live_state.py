"""How a running session stands: the one state that the status line, the status file, the glance page and rerun read.

``LiveState`` is the listener of the station loop that feeds the displays. After each batch of results, and each event,
it has a new ``SessionSoFar``, which never changes afterwards. So the loop never waits for a display, and a display on
a thread of its own reads what it has at hand for as long as it likes. A display that shows each result is called with
it, and has a queue that drops where it is slow; one that shows only the present reads ``so_far`` when it draws.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkEvent, LinkKind
from drivers.clock import ClockReading, read_clock
from drivers.ports import is_mock
from gse.config.station import Station
from gse.station.columns import ANSWER_CHECKS, STATUSES
from gse.station.events import LINK_WORDS, SKY_WORDS, StationKind
from gse.station.frame_results import FrameResult, FrameResults
from gse.station.housekeeping import Housekeeping, ItemNow
from gse.station.own_answers import NO_OWN_ERRORS, NewOwnErrors
from gse.station.results import ERRORS, AnswerCheck, AttitudeError, LinkCounters, Status, Subject
from gse.station.session_data import SessionData
from gse.station.star_names import NamedStars
from gse.values import instant
from gse.values.axis import D_DE, D_RA_COSDE, Axis
from gse.values.instant import NS_PER_S
from gse.values.limits import Limits
from gse.values.mount import Mount
from gse.view.drawing import GREEN, GREY, ORANGE, SKY_BLUE, VERMILLION, YELLOW
from gse.view.glance_word import LATE_S, NO_ANSWER_S
from protocols import StatusMessage

NO_SKY = {"clouded": "CLOUD", "no stars": "NO STARS", "daylight": "DAYLIGHT"}
"""Skies in which frames without an answer do not count, as in the verdict (there too only many seconds of them), and
what is said of them instead of NO ANSWER."""
_NO_SKY_NS = 10 * NS_PER_S
_TWILIGHT = "daylight"
_NO_STARS = "no stars"

SKY_COLOURS = {
    "clear": GREEN,
    "clouded": ORANGE,
    "no stars": VERMILLION,
    "daylight": YELLOW,
    "dark night": SKY_BLUE,
}

LINK_COLOURS = {
    "streaming": GREEN,
    "syncing": SKY_BLUE,
    "waiting": YELLOW,
    "silent": ORANGE,
    "no port": VERMILLION,
    "closed": GREY,
}

VERDICT_COLOURS = {
    "inside": GREEN,
    "OUTSIDE": VERMILLION,
    "no answer": GREY,
    "PASS": GREEN,
    "FAIL": VERMILLION,
    "INCONCLUSIVE": ORANGE,
}
"""How a session stands so far, and its verdict."""

_FEWEST_FOR_SHARES = 100
"""Frames before which one lost frame would say that the availability is too low."""

SEEN = "alarm seen"


_RATE_WINDOW = 50
"""Frames over which the rate is taken."""

STATE_EVERY_NS = 10 * NS_PER_S
"""A batch of a replay may be longer than this time of its data: it is cut, so that a state is never far behind."""

_CAUSES = (
    LinkKind.NO_FRAMES,
    StationKind.MIRRORED,
    StationKind.WRONG_CAMERA,
    StationKind.WRONG_DETECTOR,
    StationKind.FINDING,
)
"""Events that say why a session is not as it should be."""

_EVENTS_SHOWN = 8
_SKY_EVERY_FRAMES = 10
"""The columns of the sky are filled some seconds late, by windows: one look in a second is enough."""
_SKY_WITHIN_FRAMES = 1000

_FALSE = ANSWER_CHECKS.index(AnswerCheck.FALSE)
_IDENTIFIED = STATUSES.index(Status.IDENTIFIED)


# The latest events of a session, each kind as one line with its count.

MOST_LINES = 50
"""Kinds come from outside, too; the line that changed least recently goes."""


@dataclass(frozen=True, slots=True)
class EventLine:
    """The latest event of a kind, and how many there were."""

    utc_ns: int
    kind: str
    text: str
    count: int

    def __str__(self) -> str:
        times = f" ({self.count} x)" if self.count > 1 else ""
        return f"{instant.to_text(self.utc_ns, 0)[11:19]} {self.kind}{times}: {self.text}"


class EventLines:
    """Counts events by kind; the kinds in ``single`` have a line for each event."""

    def __init__(self, single: frozenset[str] = frozenset()) -> None:
        self._single = single
        self._lines: dict[tuple[str, int], EventLine] = {}
        self._numbers = 0

    def add(self, event: LinkEvent) -> EventLine:
        """Count an event; its line as it is now."""
        self._numbers += 1
        key = (event.kind, self._numbers if event.kind in self._single else 0)
        line = EventLine(event.utc_ns, event.kind, event.text, 1)
        before = self._lines.pop(key, None)
        if before is not None:
            line = replace(line, count=before.count + 1)
        self._lines[key] = line
        if len(self._lines) > MOST_LINES:
            del self._lines[next(iter(self._lines))]
        return line

    def latest(self, count: int) -> list[EventLine]:
        """The lines that changed last, newest first."""
        return list(reversed(self._lines.values()))[:count]


# The state of a session so far.


@dataclass(frozen=True, slots=True)
class ErrorsSoFar:
    """The errors along one axis so far, in arcsec: number, mean, mean of the absolute, the last one."""

    n: int = 0
    mean: float = 0.0
    mean_abs: float = 0.0
    last: float = math.nan
    _m2: float = 0.0
    _steps: int = 0
    _steps_squared: float = 0.0

    def with_errors(self, arcsec: NDArray[np.float64]) -> "ErrorsSoFar":
        """These and later ones (N,), of which there may be none."""
        if not len(arcsec):
            return self
        mean = float(arcsec.mean())
        steps = np.diff(arcsec, prepend=[] if math.isnan(self.last) else [self.last])
        n = self.n + len(arcsec)
        share, step = len(arcsec) / n, mean - self.mean
        return ErrorsSoFar(
            n,
            self.mean + share * step,
            self.mean_abs + share * (float(np.abs(arcsec).mean()) - self.mean_abs),
            float(arcsec[-1]),
            self._m2 + (float(((arcsec - mean) ** 2).sum()) + step * step * (1 - share) * len(arcsec)),
            self._steps + len(steps),
            self._steps_squared + float((steps**2).sum()),
        )

    @property
    def std(self) -> float:
        """Sample standard deviation; NaN of fewer than two values."""
        return math.sqrt(self._m2 / (self.n - 1)) if self.n > 1 else math.nan

    @property
    def nea(self) -> float:
        """Noise equivalent angle: std(differences of neighbours) / sqrt(2), which know nothing of bias and drift.

        NaN of fewer than two values.
        """
        return math.sqrt(self._steps_squared / (2 * self._steps)) if self._steps else math.nan


@dataclass(frozen=True, slots=True)
class _Silence:
    """Frames since the last answer; ``without_sky`` are earlier ones that do not count, since there was no sky.

    The event that says why comes some seconds after the sky has gone, so the frames of a silence wait for its end.
    """

    without_sky: int = 0
    frames: int = 0
    from_ns: int = 0
    until_ns: int = 0

    def with_frame(self, utc_ns: int, *, has_answer: bool, sky: str) -> "_Silence":
        if has_answer:
            return _Silence(self.uncounted(sky))
        return _Silence(self.without_sky, self.frames + 1, self.from_ns if self.frames else utc_ns, utc_ns)

    def uncounted(self, sky: str) -> int:
        """Frames that do not count below a sky of SKY_WORDS; all at dusk and dawn, where answers come singly."""
        is_long = self.until_ns - self.from_ns >= _NO_SKY_NS or sky == _TWILIGHT
        return self.without_sky + (self.frames if is_long and sky in NO_SKY else 0)


@dataclass(frozen=True, slots=True, eq=False)
class SessionSoFar:
    """How a session stands after a batch of its results, or after an event.

    ``last`` is the latest error, ``latest`` holds the latest result, ``own_d_ra`` and ``own_d_de`` are of the sensor's
    own answers. ``behind_s`` is how long the latest frame waited in this computer. ``link_word`` is of LINK_WORDS,
    ``sky`` of SKY_WORDS. ``cause`` is what the station found out, ``events`` are the latest ones, newest first.
    ``host_minus_sensor_s`` is the host's clock less an absolute one of the sensor, NaN where it has none.
    ``mount`` is None until it is fitted, ``stars_expected`` NaN before it is known. ``readings`` of the clock and
    ``own_errors`` (rows of OWN_ERROR) came with the latest results.
    """

    limits: Limits
    subject: Subject = Subject.ONBOARD
    frames: int = 0
    by_status: Counter[str] = field(default_factory=Counter)
    false_answers: int = 0
    d_ra: ErrorsSoFar = field(default_factory=ErrorsSoFar)
    d_de: ErrorsSoFar = field(default_factory=ErrorsSoFar)
    own_d_ra: ErrorsSoFar = field(default_factory=ErrorsSoFar)
    own_d_de: ErrorsSoFar = field(default_factory=ErrorsSoFar)
    inside: int = 0
    last: AttitudeError | None = None
    latest: FrameResults | None = None
    first_utc_ns: int = 0
    utc_ns: int = 0
    answered_utc_ns: int | None = None
    answered_host_utc_ns: int = 0
    objects: int = 0
    sky: str = ""
    sky_text: str = ""
    stars_expected: float = math.nan
    link_word: str = "no link"
    link: LinkCounters = field(default_factory=LinkCounters)
    clock: ClockReading | None = None
    clock_error_s: float | None = None
    host_minus_sensor_s: float = math.nan
    status: StatusMessage | None = None
    mount: Mount | None = None
    cause: str = ""
    behind_s: float = 0.0
    events: tuple[EventLine, ...] = ()
    readings: tuple[ClockReading, ...] = ()
    own_errors: NDArray[np.void] = field(default_factory=lambda: NO_OWN_ERRORS)
    _silence: _Silence = field(default_factory=_Silence)
    _recent_utc_ns: tuple[int, ...] = ()

    def with_rows(self, rows: NDArray[np.void], latest: FrameResults | None = None) -> Self:
        """After more frames, rows of FRAME; ``latest`` holds their results, where somebody shows the last of them."""
        if not len(rows):
            return self
        utc_ns = rows["utc_ns"].tolist()
        statuses = Counter({STATUSES[code].value: n for code, n in Counter(rows["status"].tolist()).items()})
        is_answered = rows["status"] == _IDENTIFIED
        answered = rows[is_answered]
        compared = rows[~np.isnan(rows[ERRORS[0]])]
        d_ra, d_de = _axes_arcsec(compared)
        inside = (np.abs(d_ra) <= self.limits.of(D_RA_COSDE)) & (np.abs(d_de) <= self.limits.of(D_DE))
        return replace(
            self,
            frames=self.frames + len(rows),
            by_status=self.by_status + statuses,
            false_answers=self.false_answers + int(np.count_nonzero(rows["answer_check"] == _FALSE)),
            d_ra=self.d_ra.with_errors(d_ra),
            d_de=self.d_de.with_errors(d_de),
            inside=self.inside + int(np.count_nonzero(inside)),
            last=AttitudeError(*(float(compared[name][-1]) for name in ERRORS)) if len(compared) else self.last,
            latest=latest,
            first_utc_ns=self.first_utc_ns or utc_ns[0],
            utc_ns=utc_ns[-1],
            answered_utc_ns=int(answered["utc_ns"][-1]) if len(answered) else self.answered_utc_ns,
            answered_host_utc_ns=int(answered["host_utc_ns"][-1]) if len(answered) else self.answered_host_utc_ns,
            objects=int(rows["objects"][-1]),
            _silence=self._silence_after(utc_ns, is_answered),
            _recent_utc_ns=(*self._recent_utc_ns, *utc_ns[-_RATE_WINDOW:])[-_RATE_WINDOW:],
        )

    def _silence_after(self, utc_ns: list[int], is_answered: NDArray[np.bool_]) -> _Silence:
        silence = self._silence
        # An answer after another one changes nothing.
        for row in np.flatnonzero(~is_answered | ~np.append(False, is_answered[:-1])).tolist():
            silence = silence.with_frame(utc_ns[row], has_answer=bool(is_answered[row]), sky=self.sky)
        return silence

    def with_own(self, errors: NDArray[np.void]) -> Self:
        """With more errors of the sensor's own answers, rows of OWN_ERROR."""
        known = errors[~np.isnan(errors[D_RA_COSDE.column])]
        if not len(known):
            return self
        d_ra, d_de = _axes_arcsec(known)
        return replace(
            self,
            own_d_ra=self.own_d_ra.with_errors(d_ra),
            own_d_de=self.own_d_de.with_errors(d_de),
        )

    def with_event(self, event: LinkEvent) -> Self:
        """After an event, which may say how link and sky are, and what is wrong."""
        sky, sky_text, silence = self.sky, self.sky_text, self._silence
        if event.kind in SKY_WORDS:
            sky, sky_text = SKY_WORDS[event.kind], event.text
            if self.sky in NO_SKY and sky not in NO_SKY:  # the first answer may be a while after the first star
                silence = _Silence(silence.uncounted(self.sky))
        return replace(
            self,
            _silence=silence,
            sky=sky,
            sky_text=sky_text,
            link_word=LINK_WORDS.get(event.kind, self.link_word),
            cause=event.text if event.kind in _CAUSES else self.cause,
        )

    @property
    def latest_result(self) -> FrameResult | None:
        """The latest result, made now; None before the first."""
        return self.latest[-1] if self.latest else None

    @property
    def without_sky(self) -> int:
        """Frames that do not count, since there was no sky to see."""
        return self._silence.uncounted(self.sky)

    @property
    def identified(self) -> float:
        """Share of the frames with sky that were identified, 0..1; NaN of none."""
        counted = self.frames - self.without_sky
        return self.by_status[Status.IDENTIFIED.value] / counted if counted else math.nan

    @property
    def compared(self) -> tuple[tuple[str, Axis, ErrorsSoFar], ...]:
        """The errors that are shown by axis, each with a word for whose they are: empty of the subject under test."""
        own = (("sensor ", D_RA_COSDE, self.own_d_ra), ("sensor ", D_DE, self.own_d_de))
        return (("", D_RA_COSDE, self.d_ra), ("", D_DE, self.d_de), *(own if self.own_d_ra.n else ()))

    @property
    def outside(self) -> tuple[str, ...]:
        """The limits that the session does not keep so far, with the values."""
        return tuple(self._outside())

    def _outside(self) -> Iterator[str]:
        limits = self.limits
        for whose, axis, errors in self.compared:
            if errors.mean_abs > limits.of(axis):
                yield f"mean |{whose}{axis.label}| {errors.mean_abs:.1f} arcsec (limit {limits.of(axis):g})"
        answers = self.by_status[Status.IDENTIFIED.value]
        expected = self.frames - self.without_sky + self.link.frames_lost
        if expected < _FEWEST_FOR_SHARES:
            return
        if answers < limits.availability * expected:
            yield f"availability {100 * answers / expected:.1f} % (limit {100 * limits.availability:g} %)"
        if self.false_answers > limits.false_share * max(answers, 1):
            yield f"{self.false_answers} false answers (limit {100 * limits.false_share:g} % of the answers)"

    @property
    def no_sky(self) -> str:
        """CLOUD, NO STARS or DAYLIGHT where that explains frames without an answer; otherwise empty.

        A camera that is not as stated shows no stars either: a cause that was found before any answer says more.
        """
        is_camera = self.sky == _NO_STARS and self.cause and self.answered_utc_ns is None
        return "" if is_camera else NO_SKY.get(self.sky, "")

    @property
    def silence(self) -> str:
        """A warning if none of the last frames was identified (clouds, a lamp, the Sun); otherwise empty."""
        answered_ns = self.first_utc_ns if self.answered_utc_ns is None else self.answered_utc_ns
        since_s = (self.utc_ns - answered_ns) / NS_PER_S
        objects = f"{self.objects} object{'' if self.objects == 1 else 's'}"
        return f"{self.no_sky or 'NO ANSWER'} for {since_s:.0f} s, {objects}" if since_s >= NO_ANSWER_S else ""

    @property
    def late(self) -> str:
        """A sentence if what is shown is late because this computer is behind; otherwise empty."""
        if self.behind_s < LATE_S:
            return ""
        return f"this computer is {self.behind_s:.0f} s behind: what is shown is late, the recording is complete"

    @property
    def frames_per_s(self) -> float:
        """Frames per second of sensor time, over the last frames; NaN of fewer than two."""
        recent = self._recent_utc_ns
        span_ns = recent[-1] - recent[0] if len(recent) > 1 else 0
        return (len(recent) - 1) * NS_PER_S / span_ns if span_ns > 0 else math.nan


def _axes_arcsec(errors: NDArray[np.void]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The errors in right ascension and declination of rows that have them."""
    return errors[D_RA_COSDE.column].astype(np.float64), errors[D_DE.column].astype(np.float64)


class Display(Protocol):
    """What shows each result, or each event; it gets the state after it, on the thread of the loop."""

    def on_results(self, results: FrameResults, so_far: SessionSoFar) -> None:
        """Show results that follow each other."""
        ...

    def on_event(self, event: LinkEvent, so_far: SessionSoFar) -> None:
        """Show an event."""
        ...


SomeDisplay = TypeVar("SomeDisplay", bound=Display)


_CLOCKS_COMPARED = 200
"""Latest frames whose least difference is shown: any one may have waited on its way."""


def _host_minus_sensor_s(session: SessionData) -> float:
    """How much later than the end of its exposure, by the sensor's own absolute clock, the host saw a frame at best."""
    if not session.time.is_absolute:
        return math.nan
    frames = session.frames.columns[-_CLOCKS_COMPARED:]
    host_ns, exposure_s = frames["host_utc_ns"], frames["exposure_s"]
    after_s = (host_ns - frames["utc_ns"]) / NS_PER_S - exposure_s / 2
    after_s = after_s[(host_ns > 0) & np.isfinite(exposure_s)]
    return float(after_s.min()) if len(after_s) else math.nan


class LiveState:
    """A listener of the station loop that knows how the session of a ``station`` stands (``so_far``).

    ``forecast`` is the line on the time to a verdict, ``metrics`` a table in Markdown and ``names`` what the sensor's
    names of stars are worth, all empty before they are known: another thread sets them; ``alarms`` are those that
    nobody has seen yet, ``question`` is what a procedure asks its operator now. ``page`` is the
    address of the live page, None without one. ``housekeeping`` is that of the session, once there is one.
    ``in_work_since_ns`` says when the bytes came that the loop works on (monotonic; 0: it waits for some).
    """

    def __init__(self, station: Station) -> None:
        self.station = station
        self.so_far = SessionSoFar(station.limits)
        self.forecast = self.metrics = ""
        self.names: NamedStars | None = None
        self.alarms: tuple[str, ...] = ()
        self.question = ""
        self.page: str | None = None
        self.housekeeping = Housekeeping({})
        self.in_work_since_ns: Callable[[], int] = lambda: 0
        self._displays: list[Display] = []
        self._is_live = not is_mock(station.port.url)
        self._own = NewOwnErrors()
        self._events = EventLines(frozenset({StationKind.NOTE, StationKind.MOUNT_TOUCHED}))
        self._said = ""
        self._readings = 0
        self._due_ns = 0
        self._sky_due = 0

    @classmethod
    def of(cls, session: SessionData) -> "LiveState":
        """The state of a session that has begun."""
        live = cls(session.station)
        live.housekeeping = session.housekeeping
        return live

    @property
    def items(self) -> Mapping[str, ItemNow]:
        """The latest value of each item that the sensor has sent, by name; panoramas need not come."""
        return self.housekeeping.latest

    def add(self, display: SomeDisplay) -> SomeDisplay:
        """Have a display called with each result and event from now on; it is returned."""
        self._displays.append(display)
        return display

    def on_results(self, results: FrameResults, session: SessionData) -> None:
        """Take results, and what the session has learnt beside them."""
        own_errors = self._own.take(session)
        so_far = self._beside(session, own_errors).with_own(own_errors)
        for number, part in enumerate(self._parts(results)):
            if number:
                so_far = replace(so_far, readings=(), own_errors=NO_OWN_ERRORS)
            self.so_far = so_far = so_far.with_rows(part.rows, part)
            for display in self._displays:
                display.on_results(part, so_far)

    def _beside(self, session: SessionData, own_errors: NDArray[np.void]) -> SessionSoFar:
        readings = tuple(session.clock[self._readings :])
        self._readings += len(readings)
        stated = session.station.mount
        return replace(
            self.so_far,
            subject=session.subject,
            link=replace(session.link),
            clock=session.clock[-1] if session.clock else None,
            clock_error_s=session.clock_error_s,
            host_minus_sensor_s=_host_minus_sensor_s(session),
            status=session.statuses[-1][1] if session.statuses else None,
            mount=session.alignment.mount if session.alignment else stated if stated.align is None else None,
            stars_expected=self._stars_expected(session),
            readings=readings,
            own_errors=own_errors,
            behind_s=self._behind_s(session),
        )

    def _behind_s(self, session: SessionData) -> float:
        """How long ago the bytes of the latest frame came; 0 where they are simulated or replayed."""
        if not self._is_live or not len(session.frames):
            return 0.0
        came_ns = int(session.frames.columns[-1:]["host_utc_ns"][0])
        return max(0.0, (read_clock().utc_ns - came_ns) / NS_PER_S) if came_ns else 0.0

    def behind_s(self, now: ClockReading) -> float:
        """How long the loop has had bytes on a live port that it is not done with."""
        since_ns = self.in_work_since_ns() if self._is_live else 0
        return max(0.0, (now.mono_ns - since_ns) / NS_PER_S) if since_ns else 0.0

    def _stars_expected(self, session: SessionData) -> float:
        if len(session.frames) < self._sky_due:
            return self.so_far.stars_expected
        self._sky_due = len(session.frames) + _SKY_EVERY_FRAMES
        latest = session.frames.columns[-_SKY_WITHIN_FRAMES:]["stars_expected"]
        known = latest[np.isfinite(latest)]
        return float(known[-1]) if len(known) else math.nan

    def _parts(self, results: FrameResults) -> Iterator[FrameResults]:
        """The results, cut after each that is STATE_EVERY_NS later than the one before which they were cut."""
        begin = 0
        for end, at_ns in enumerate(results.rows["utc_ns"].tolist(), 1):
            if at_ns >= self._due_ns or end == len(results):
                self._due_ns = at_ns + STATE_EVERY_NS if at_ns >= self._due_ns else self._due_ns
                yield results.part(begin, end)
                begin = end

    def on_event(self, event: LinkEvent) -> None:
        """Take an event; a note that begins with SEEN says that somebody knows of the alarms."""
        if event.kind == StationKind.NOTE and event.text.startswith(SEEN):
            self.alarms = ()
        so_far = self.so_far.with_event(event)
        if event.text != self._said:  # LOST and NO_PORT are one piece of news
            self._events.add(event)
            so_far = replace(so_far, events=tuple(self._events.latest(_EVENTS_SHOWN)))
        self._said = event.text
        self.so_far = so_far
        for display in self._displays:
            display.on_event(event, so_far)
