"""The facts of the glance page: one small document of how a session stands.

The thread of the page's server calls ``absorb`` and ``document`` a few times per second; both only read the live state.
"""

import math
import shutil
from pathlib import Path
from typing import Any

from drivers.clock import ClockReading
from gse import instant
from gse.instant import NS_PER_S
from gse.station.frame_results import FrameResult
from gse.station.results import Subject
from gse.view.dawn import NextDawn, is_bright
from gse.view.focus import focus_of
from gse.view.glance_word import Facts, Phase, word_of
from gse.view.live_state import ErrorsSoFar, LiveState
from gse.view.mount_turn import mount_turn
from gse.view.verdict_text import clock_health

SCHEMA = "gse.glance/1"

_SLOW_EVERY_NS = NS_PER_S
"""What changes slowly (disk, turn of the mount, histogram, dawn) is found once a second."""
_SKY_WORDS = {"clouded": "CLOUD", "no stars": "NO STARS", "daylight": "DAYLIGHT"}


class Glance:
    """One session at a glance, by its ``live`` state; ``folder`` is where it is recorded."""

    def __init__(self, live: LiveState, *, folder: Path | None = None) -> None:
        self._live, self._folder = live, folder
        self._station = live.station
        self._phase, self._verdict = Phase.RUNNING, ""
        self._reasons: tuple[str, ...] = ()
        self._so_far = live.so_far
        self._latest: FrameResult | None = None
        self._latest_mono_ns = 0
        self._next_dawn = NextDawn(live.station.site)
        self._bright = False
        self._slow: dict[str, Any] = {}
        self._slow_due_ns = 0

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
        """Take in how the session stands now."""
        before, self._so_far = self._so_far, self._live.so_far
        if self._so_far.frames != before.frames:
            self._latest = self._so_far.latest_result
            self._latest_mono_ns = now.mono_ns

    def document(self, now: ClockReading) -> dict[str, Any]:
        """The whole page as one document, schema gse.glance/1."""
        if now.mono_ns >= self._slow_due_ns:
            self._slow_due_ns = now.mono_ns + _SLOW_EVERY_NS
            self._slow = self._slow_document(now)
        so_far = self._so_far
        facts = self._facts(now)
        word = word_of(facts)
        return {
            "schema": SCHEMA,
            "word": {"text": word.text, "level": word.level, "detail": word.detail},
            "ended": self.has_ended,
            "utc": instant.to_text(now.utc_ns, 1),
            "data_utc": instant.to_text(so_far.utc_ns, 3) if so_far.frames else None,
            "since_answer_s": round(facts.since_answer_s, 1) if facts.answered else None,
            "frames": so_far.frames,
            "frames_lost": so_far.link.frames_lost if so_far.frames else 0,
            "frames_per_s": _number(so_far.frames_per_s, 1),
            "identified": _number(so_far.identified, 4),
            "identified_limit": self._station.limits.availability,
            "false_answers": so_far.false_answers,
            "duration_s": round((so_far.utc_ns - so_far.first_utc_ns) / NS_PER_S),
            "axes": self._axes(),
            "stars": self._stars(),
            "sky": so_far.sky or None,
            "forecast": self._verdict if self.has_ended else self._live.forecast,
            **self._slow,
        }

    def _stars(self) -> dict[str, Any]:
        """Named stars, those expected, the faintest magnitude; null of a sensor that sends no panoramas."""
        if self._latest is None:
            return {"seen": 0, "expected": None, "objects": 0, "limiting_mag": None}
        if self._so_far.subject is Subject.SENSOR:
            return {"seen": None, "expected": None, "objects": None, "limiting_mag": None}
        (row,) = self._latest.row
        return {
            "seen": int(row["stars_seen"]),
            "expected": _number(self._so_far.stars_expected, 0),
            "objects": self._so_far.objects,
            "limiting_mag": _number(float(row["limiting_mag"]), 1),
        }

    def _axes(self) -> list[dict[str, Any]]:
        """dRA* and dDE of the results, and of the sensor's own answers beside them where it sends some."""
        so_far, limits = self._so_far, self._station.limits
        shown = [(so_far.subject, "dRA*", so_far.d_ra), (so_far.subject, "dDE", so_far.d_de)]
        if so_far.own_d_ra.n:
            shown += [(Subject.SENSOR, "dRA*", so_far.own_d_ra), (Subject.SENSOR, "dDE", so_far.own_d_de)]
        of_name = {"dRA*": limits.d_ra_cosde_arcsec, "dDE": limits.d_de_arcsec}
        return [self._axis(subject, name, errors, of_name[name]) for subject, name, errors in shown]

    def _axis(self, subject: Subject, name: str, errors: ErrorsSoFar, limit_arcsec: float) -> dict[str, Any]:
        return {
            "subject": subject.value,
            "name": name,
            "last_arcsec": _number(errors.last, 1),
            "mean_arcsec": _number(errors.mean if errors.n else math.nan, 1),
            "std_arcsec": _number(errors.std, 1),
            "nea_arcsec": _number(errors.nea, 1),
            "limit_arcsec": limit_arcsec,
            "outside": errors.mean_abs > limit_arcsec,
            "recent": errors.recent.until(self._so_far.utc_ns, limit_arcsec),
        }

    def _facts(self, now: ClockReading) -> Facts:
        so_far = self._so_far
        silent_s = (now.mono_ns - self._latest_mono_ns) / NS_PER_S if so_far.frames else 0.0
        answered_ns = so_far.first_utc_ns if so_far.answered_utc_ns is None else so_far.answered_utc_ns
        # Data may run faster than the host's clock: time without an answer is the data's, then the host's.
        waited_s = silent_s if self._phase is Phase.RUNNING else 0.0
        since_answer_s = (so_far.utc_ns - answered_ns) / NS_PER_S + waited_s
        align_s = self._station.mount.align_s or 0.0
        aligning_s = align_s - (so_far.utc_ns - so_far.first_utc_ns) / NS_PER_S if so_far.last is None else 0.0
        return Facts(
            phase=self._phase,
            verdict=self._verdict,
            reasons=self._reasons,
            link=so_far.link_word,
            port=self._station.port.url,
            since_frame_s=silent_s,
            frames=so_far.frames,
            objects=None if so_far.subject is Subject.SENSOR else so_far.objects,
            answered=so_far.answered_utc_ns is not None,
            since_answer_s=since_answer_s,
            sky="DAYLIGHT" if self._bright else _SKY_WORDS.get(so_far.sky, ""),
            aligning_s=aligning_s,
            outside=so_far.outside,
            cause=so_far.cause,
        )

    def _slow_document(self, now: ClockReading) -> dict[str, Any]:
        so_far = self._so_far
        self._bright = so_far.frames > 0 and is_bright(self._station.site, so_far.utc_ns)
        return {
            "sensor": self._station.sensor.name,
            "site": self._station.site.name,
            "port": self._station.port.url,
            "link": so_far.link_word,
            "clock": clock_health(so_far.clock, so_far.clock_error_s) if so_far.clock else None,
            "disk_free_gb": self._disk_free_gb(),
            "dawn_min": self._next_dawn.minutes(so_far.utc_ns or now.utc_ns),
            "turn": self._turn(),
            "focus": self._focus(),
            "events": [str(line) for line in so_far.events],
        }

    def _focus(self) -> dict[str, Any] | None:
        if self._latest is None or self._so_far.subject is Subject.SENSOR:
            return None
        return focus_of(self._latest.panorama, self._station.sensor.index_max)

    def _disk_free_gb(self) -> float | None:
        try:
            return round(shutil.disk_usage(self._folder).free / 1e9, 1) if self._folder else None
        except OSError:
            return None

    def _turn(self) -> dict[str, Any] | None:
        """The turn of the mount by the latest panorama; None where it has no answer, or no mount is stated."""
        mount, stated = self._so_far.mount, self._station.mount
        if self._latest is None or mount is None or not stated.stated:
            return None
        turn = mount_turn(self._latest, mount, stated)
        return turn.document() if turn else None


def _number(value: float, digits: int) -> float | None:
    return None if math.isnan(value) else round(value, digits)
