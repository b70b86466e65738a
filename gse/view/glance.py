"""The facts of the glance page: a listener of the station loop that makes one small document of a session.

``on_results`` and ``on_event`` only append to a queue that drops its oldest item: the loop never waits here. All else
is done by the thread of the page's server, which calls ``absorb`` and ``document`` a few times per second.
"""

import math
import shutil
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkEvent, LinkKind
from drivers.clock import ClockReading
from gse import instant
from gse.config.station import Station
from gse.instant import NS_PER_S
from gse.mount import Mount
from gse.station.event_kinds import StationKind
from gse.station.frame_results import FrameResult, FrameResults
from gse.station.results import Subject
from gse.station.session_data import SessionData
from gse.view.dawn import NextDawn, is_bright
from gse.view.event_lines import EventLines
from gse.view.focus import focus_of
from gse.view.glance_word import Facts, Phase, word_of
from gse.view.mount_turn import mount_turn
from gse.view.own_answers import OwnAnswerErrors
from gse.view.recent_errors import RecentErrors
from gse.view.running_statistics import LINK_WORDS, Moments, Running
from gse.view.verdict_text import clock_health

SCHEMA = "gse.glance/1"
QUEUE_ITEMS = 2000
"""Three minutes at 10 Hz; some 10 MB."""

_SLOW_EVERY_NS = NS_PER_S
"""What changes slowly (disk, turn of the mount, histogram, dawn) is found once a second."""
_EVENTS_SHOWN = 8
_SKY_EVERY_FRAMES = 10
_SKY_WITHIN_FRAMES = 1000
_CAUSES = (LinkKind.NO_FRAMES, StationKind.MIRRORED, StationKind.WRONG_CAMERA, StationKind.FINDING)
"""Events that say why a session is not as it should be."""
_SKY_WORDS = {"clouded": "CLOUD", "no stars": "NO STARS", "daylight": "DAYLIGHT"}


@dataclass(frozen=True, slots=True)
class _Shown:
    """A result, with what the session counted when it came."""

    result: FrameResult
    frames: int
    lost: int
    clock: str
    mount: Mount | None
    expected: float


class Glance:
    """One session at a glance.

    ``folder`` is where it is recorded, ``forecast`` gives the line on the time to a verdict.
    """

    def __init__(
        self, station: Station, *, folder: Path | None = None, forecast: Callable[[], str] = lambda: ""
    ) -> None:
        self._station, self._folder, self._forecast = station, folder, forecast
        self._items: deque[_Shown | LinkEvent] = deque(maxlen=QUEUE_ITEMS)
        self._phase, self._verdict = Phase.RUNNING, ""
        self._reasons: tuple[str, ...] = ()
        self._sky_due, self._expected = 0, math.nan
        self._running = Running(station.limits)
        self._own = OwnAnswerErrors(station)
        self._recent = {
            (subject, name): RecentErrors() for subject in ("onboard", "sensor") for name in ("dRA*", "dDE")
        }
        self._events = EventLines(frozenset({StationKind.NOTE}))
        self._link = "no link"
        self._cause = self._said = ""
        self._latest: _Shown | None = None
        self._latest_mono_ns = 0
        self._first_utc_ns = 0
        self._answered_utc_ns: int | None = None
        self._next_dawn = NextDawn(station.site)
        self._bright = False
        self._slow: dict[str, Any] = {}
        self._slow_due_ns = 0

    def on_results(self, results: FrameResults, session: SessionData) -> None:
        """Take results; the oldest ones that wait are dropped where there are too many."""
        clock = clock_health(session.clock[-1], session.clock_error_s) if session.clock else ""
        mount = session.alignment.mount if session.alignment else self._fixed_mount()
        count = len(session.frames)
        if count >= self._sky_due:
            # The sky's columns are filled some seconds late, by windows: one look in a second is enough.
            self._sky_due = count + _SKY_EVERY_FRAMES
            self._expected = _latest_known(session.frames.columns["stars_expected"][-_SKY_WITHIN_FRAMES:])
        for result in results:
            self._own.take(result, session)
            self._items.append(_Shown(result, count, session.link.frames_lost, clock, mount, self._expected))

    def on_event(self, event: LinkEvent) -> None:
        """Take an event."""
        self._items.append(event)

    def enter_judging(self) -> None:
        """The session is closed; the verdict follows."""
        self._phase = Phase.JUDGING

    def conclude(self, verdict: str, reasons: tuple[str, ...]) -> None:
        """The session has ended; without a verdict ``verdict`` is empty."""
        self._verdict, self._reasons = verdict, reasons
        self._phase = Phase.ENDED

    @property
    def has_ended(self) -> bool:
        """Whether the document is the last one."""
        return self._phase is Phase.ENDED

    def absorb(self, now: ClockReading) -> None:
        """Take in what came since the last call."""
        while self._items:
            item = self._items.popleft()
            if isinstance(item, LinkEvent):
                self._add_event(item)
            else:
                self._add(item)
                self._latest_mono_ns = now.mono_ns
        self._add_own(self._own.errors())

    def _add_event(self, event: LinkEvent) -> None:
        self._link = LINK_WORDS.get(event.kind, self._link)
        self._running.add_event(event)
        if event.kind in _CAUSES:
            self._cause = event.text
        if event.text != self._said:  # LOST and NO_PORT are one piece of news
            self._events.add(event)
        self._said = event.text

    def _add(self, shown: _Shown) -> None:
        result, utc_ns = shown.result, shown.result.panorama.utc_ns
        self._latest = shown
        self._first_utc_ns = self._first_utc_ns or utc_ns
        self._running.add(result.row)
        if result.attitude is not None:
            self._answered_utc_ns = utc_ns
        if (error := result.attitude_error) is not None:
            self._recent[self._subject, "dRA*"].add(utc_ns, error.d_ra_cosde_arcsec)
            self._recent[self._subject, "dDE"].add(utc_ns, error.d_de_arcsec)

    @property
    def _subject(self) -> str:
        """Whose answers the results are: of a sensor that sends no panoramas its own."""
        is_sensor = self._latest is not None and self._latest.result.identifier == Subject.SENSOR.value
        return (Subject.SENSOR if is_sensor else Subject.ONBOARD).value

    def _add_own(self, errors: NDArray[np.void]) -> None:
        self._running.add_own(errors)
        for name, column in (("dRA*", "d_ra_cosde_arcsec"), ("dDE", "d_de_arcsec")):
            for utc_ns, value in errors[["utc_ns", column]].tolist():
                if not math.isnan(value):
                    self._recent[Subject.SENSOR.value, name].add(utc_ns, value)

    def document(self, now: ClockReading) -> dict[str, Any]:
        """The whole page as one document, schema gse.glance/1."""
        if now.mono_ns >= self._slow_due_ns:
            self._slow_due_ns = now.mono_ns + _SLOW_EVERY_NS
            self._slow = self._slow_document(now)
        running, latest = self._running, self._latest
        facts = self._facts(now)
        word = word_of(facts)
        return {
            "schema": SCHEMA,
            "word": {"text": word.text, "level": word.level, "detail": word.detail},
            "ended": self.has_ended,
            "utc": instant.to_text(now.utc_ns, 1),
            "data_utc": instant.to_text(running.utc_ns, 3) if latest else None,
            "since_answer_s": round(facts.since_answer_s, 1) if facts.answered else None,
            "frames": latest.frames if latest else 0,
            "frames_lost": latest.lost if latest else 0,
            "frames_per_s": _number(running.frames_per_s, 1),
            "identified": _number(running.identified, 4),
            "identified_limit": self._station.limits.availability,
            "false_answers": running.false_answers,
            "duration_s": round((running.utc_ns - self._first_utc_ns) / NS_PER_S) if latest else 0,
            "axes": self._axes(),
            "stars": self._stars(),
            "sky": running.sky or None,
            "forecast": self._verdict if self.has_ended else self._forecast(),
            **self._slow,
        }

    def _stars(self) -> dict[str, Any]:
        """Named stars, those expected, the faintest magnitude; null of a sensor that sends no panoramas."""
        if self._latest is None:
            return {"seen": 0, "expected": None, "objects": 0, "limiting_mag": None}
        if self._subject == Subject.SENSOR:
            return {"seen": None, "expected": None, "objects": None, "limiting_mag": None}
        (row,) = self._latest.result.row
        return {
            "seen": int(row["stars_seen"]),
            "expected": _number(self._latest.expected, 0),
            "objects": self._running.objects,
            "limiting_mag": _number(float(row["limiting_mag"]), 1),
        }

    def _axes(self) -> list[dict[str, Any]]:
        """dRA* and dDE of the results, and of the sensor's own answers beside them where it sends some."""
        running, limits = self._running, self._station.limits
        shown = [(self._subject, "dRA*", running.d_ra), (self._subject, "dDE", running.d_de)]
        if running.own_d_ra.n:
            own = Subject.SENSOR.value
            shown += [(own, "dRA*", running.own_d_ra), (own, "dDE", running.own_d_de)]
        of_name = {"dRA*": limits.d_ra_cosde_arcsec, "dDE": limits.d_de_arcsec}
        return [self._axis(subject, name, moments, of_name[name]) for subject, name, moments in shown]

    def _axis(self, subject: str, name: str, moments: Moments, limit_arcsec: float) -> dict[str, Any]:
        return {
            "subject": subject,
            "name": name,
            "last_arcsec": _number(moments.last, 1),
            "mean_arcsec": _number(moments.mean if moments.n else math.nan, 1),
            "std_arcsec": _number(moments.std, 1),
            "nea_arcsec": _number(moments.nea, 1),
            "limit_arcsec": limit_arcsec,
            "outside": moments.mean_abs > limit_arcsec,
            "recent": self._recent[subject, name].until(self._running.utc_ns, limit_arcsec),
        }

    def _facts(self, now: ClockReading) -> Facts:
        running, latest = self._running, self._latest
        silent_s = (now.mono_ns - self._latest_mono_ns) / NS_PER_S if latest else 0.0
        answered_ns = self._answered_utc_ns if self._answered_utc_ns is not None else self._first_utc_ns
        # Data may run faster than the host's clock: time without an answer is the data's, then the host's.
        waited_s = silent_s if self._phase is Phase.RUNNING else 0.0
        since_answer_s = (running.utc_ns - answered_ns) / NS_PER_S + waited_s
        align_s = self._station.mount.align_s or 0.0
        aligning_s = align_s - (running.utc_ns - self._first_utc_ns) / NS_PER_S if running.last is None else 0.0
        return Facts(
            phase=self._phase,
            verdict=self._verdict,
            reasons=self._reasons,
            link=self._link,
            port=self._station.port.url,
            since_frame_s=silent_s,
            frames=running.frames,
            objects=None if self._subject == Subject.SENSOR else running.objects,
            answered=self._answered_utc_ns is not None,
            since_answer_s=since_answer_s,
            sky="DAYLIGHT" if self._bright else _SKY_WORDS.get(running.sky, ""),
            aligning_s=aligning_s,
            outside=running.outside(latest.lost if latest else 0),
            cause=self._cause,
        )

    def _slow_document(self, now: ClockReading) -> dict[str, Any]:
        running, latest = self._running, self._latest
        self._bright = latest is not None and is_bright(self._station.site, running.utc_ns)
        return {
            "sensor": self._station.sensor.name,
            "site": self._station.site.name,
            "port": self._station.port.url,
            "link": self._link,
            "clock": latest.clock or None if latest else None,
            "disk_free_gb": self._disk_free_gb(),
            "dawn_min": self._next_dawn.minutes(running.utc_ns or now.utc_ns),
            "turn": self._turn(),
            "focus": self._focus(),
            "events": [str(line) for line in self._events.latest(_EVENTS_SHOWN)],
        }

    def _focus(self) -> dict[str, Any] | None:
        if self._latest is None or self._subject == Subject.SENSOR:
            return None
        return focus_of(self._latest.result.panorama, self._station.sensor.index_max)

    def _disk_free_gb(self) -> float | None:
        try:
            return round(shutil.disk_usage(self._folder).free / 1e9, 1) if self._folder else None
        except OSError:
            return None

    def _fixed_mount(self) -> Mount | None:
        mount = self._station.mount
        return mount if mount.align is None else None

    def _turn(self) -> dict[str, Any] | None:
        """The turn of the mount by the latest panorama; None where it has no answer, or no mount is stated."""
        latest, stated = self._latest, self._station.mount
        if latest is None or latest.mount is None or not stated.stated:
            return None
        turn = mount_turn(latest.result, latest.mount, stated)
        return turn.document() if turn else None


def _latest_known(values: NDArray[np.float64]) -> float:
    known = values[np.isfinite(values)]
    return float(known[-1]) if len(known) else math.nan


def _number(value: float, digits: int) -> float | None:
    return None if math.isnan(value) else round(value, digits)
