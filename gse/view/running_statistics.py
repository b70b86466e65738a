"""Running statistics for the status line and the live verdict panel."""

import math
from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkEvent, LinkKind
from gse.drawing.palette import GREEN, GREY, ORANGE, SKY_BLUE, VERMILLION, YELLOW
from gse.instant import NS_PER_S
from gse.limits import Limits
from gse.station.event_kinds import StationKind
from gse.station.frame_table import ANSWER_CHECKS, STATUSES
from gse.station.results import ERRORS, AnswerCheck, AttitudeError, Status
from gse.view.glance_word import NO_ANSWER_S

LINK_WORDS: dict[str, str] = {
    LinkKind.NO_PORT: "no port",
    LinkKind.LOST: "no port",
    LinkKind.OPENED: "waiting",
    LinkKind.REOPENED: "waiting",
    LinkKind.WAITING: "waiting",
    LinkKind.SYNCING: "syncing",
    LinkKind.STREAMING: "streaming",
    LinkKind.STALE: "silent",
    StationKind.CLOSED: "closed",
}
"""The state of the link after each kind of event that changes it; the other kinds are only logged."""

SKY_WORDS: dict[str, str] = {
    StationKind.CLEAR: "clear",
    StationKind.CLOUDED: "clouded",
    StationKind.NO_STARS: "no stars",
    StationKind.DAYLIGHT: "daylight",
    StationKind.DARK_NIGHT: "dark night",
}
"""The sky after each kind of event that changes it."""

NO_SKY = ("clouded", "no stars", "daylight")
"""Skies in which frames without an answer do not count, as in the verdict: there too only many seconds of them."""
_NO_SKY_NS = 10 * NS_PER_S

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

_RATE_WINDOW = 50
"""Frames over which the rate is taken."""

_FALSE = ANSWER_CHECKS.index(AnswerCheck.FALSE)
_IDENTIFIED = STATUSES.index(Status.IDENTIFIED)


@dataclass(slots=True)
class Moments:
    """Mean and standard deviation of all values so far, mean of the absolute; ``nea`` from successive differences.

    The differences of neighbours know nothing of bias and drift: std(differences) / sqrt(2).
    """

    n: int = 0
    mean: float = 0.0
    mean_abs: float = 0.0
    _m2: float = 0.0
    last: float = math.nan
    _steps: int = 0
    _steps_squared: float = 0.0

    def add(self, values: NDArray[np.float64]) -> None:
        """Add values (N,), of which there may be none."""
        if not len(values):
            return
        mean = float(values.mean())
        steps = np.diff(values, prepend=[] if math.isnan(self.last) else [self.last])
        self.n += len(values)
        share, step = len(values) / self.n, mean - self.mean
        self._m2 += float(((values - mean) ** 2).sum()) + step * step * (1 - share) * len(values)
        self.mean += share * step
        self.mean_abs += share * (float(np.abs(values).mean()) - self.mean_abs)
        self._steps += len(steps)
        self._steps_squared += float((steps**2).sum())
        self.last = float(values[-1])

    @property
    def std(self) -> float:
        """Sample standard deviation; NaN of fewer than two values."""
        return math.sqrt(self._m2 / (self.n - 1)) if self.n > 1 else math.nan

    @property
    def nea(self) -> float:
        """Noise equivalent angle of the values; NaN of fewer than two values."""
        return math.sqrt(self._steps_squared / (2 * self._steps)) if self._steps else math.nan


@dataclass(slots=True)
class Running:
    """Statistics of a running session."""

    limits: Limits
    frames: int = 0
    by_status: Counter[str] = field(default_factory=Counter)
    false_answers: int = 0
    d_ra: Moments = field(default_factory=Moments)
    d_de: Moments = field(default_factory=Moments)
    own_d_ra: Moments = field(default_factory=Moments)
    own_d_de: Moments = field(default_factory=Moments)
    inside: int = 0
    last: AttitudeError | None = None
    utc_ns: int = 0
    objects: int = 0
    sky: str = ""
    sky_text: str = ""
    housekeeping: str = ""
    _without_sky: int = 0
    _silent_frames: int = 0
    """Those since the last answer: the event that says why comes some seconds after the sky has gone."""
    _silent_from_ns: int = 0
    _silent_until_ns: int = 0
    _answered_utc_ns: int | None = None
    _recent_utc_ns: deque[int] = field(default_factory=lambda: deque(maxlen=_RATE_WINDOW))

    def add(self, rows: NDArray[np.void]) -> None:
        """Add frames, rows of FRAME."""
        if not len(rows):
            return
        utc_ns = rows["utc_ns"].tolist()
        self.frames += len(rows)
        for code, count in Counter(rows["status"].tolist()).items():
            self.by_status[STATUSES[code].value] += count
        self.false_answers += int(np.count_nonzero(rows["answer_check"] == _FALSE))
        self.utc_ns, self.objects = utc_ns[-1], int(rows["objects"][-1])
        is_answered = rows["status"] == _IDENTIFIED
        for row in np.flatnonzero(~is_answered | ~np.append(False, is_answered[:-1])).tolist():
            self._count_silent(utc_ns[row], bool(is_answered[row]))  # an answer after another one changes nothing
        answered = rows["utc_ns"][is_answered]
        if len(answered):
            self._answered_utc_ns = int(answered[-1])
        elif self._answered_utc_ns is None:
            self._answered_utc_ns = utc_ns[0]
        self._recent_utc_ns.extend(utc_ns)
        compared = rows[list(ERRORS)][~np.isnan(rows[ERRORS[0]])]
        if len(compared):
            self.last = AttitudeError(*compared[-1].tolist())
        d_ra, d_de = _axes_arcsec(compared)
        self.d_ra.add(d_ra)
        self.d_de.add(d_de)
        limits = self.limits
        inside = (np.abs(d_ra) <= limits.d_ra_cosde_arcsec) & (np.abs(d_de) <= limits.d_de_arcsec)
        self.inside += int(np.count_nonzero(inside))

    def _count_silent(self, utc_ns: int, has_answer: bool) -> None:
        if has_answer:
            self._without_sky, self._silent_frames = self.without_sky, 0
            return
        if not self._silent_frames:
            self._silent_from_ns = utc_ns
        self._silent_until_ns = utc_ns
        self._silent_frames += 1

    @property
    def without_sky(self) -> int:
        """Frames that do not count, since there was no sky to see."""
        is_long = self._silent_until_ns - self._silent_from_ns >= _NO_SKY_NS
        return self._without_sky + (self._silent_frames if is_long and self.sky in NO_SKY else 0)

    def add_own(self, errors: NDArray[np.void]) -> None:
        """Add errors of the sensor's own answers, rows of OWN_ERROR."""
        d_ra, d_de = _axes_arcsec(errors[~np.isnan(errors["d_ra_cosde_arcsec"])])
        self.own_d_ra.add(d_ra)
        self.own_d_de.add(d_de)

    def add_event(self, event: LinkEvent) -> None:
        """Note what an event says of the sky."""
        if event.kind in SKY_WORDS:
            self.sky, self.sky_text = SKY_WORDS[event.kind], event.text

    @property
    def identified(self) -> float:
        """Share of the frames with sky that were identified, 0..1; NaN of none."""
        counted = self.frames - self.without_sky
        return self.by_status[Status.IDENTIFIED.value] / counted if counted else math.nan

    def outside(self, lost: int) -> tuple[str, ...]:
        """The limits that the session does not keep so far, with the values; ``lost`` counts frames that never came."""
        return tuple(self._outside(lost))

    def _outside(self, lost: int) -> Iterator[str]:
        limits = self.limits
        axes = (
            ("dRA*", self.d_ra, limits.d_ra_cosde_arcsec),
            ("dDE", self.d_de, limits.d_de_arcsec),
            ("sensor dRA*", self.own_d_ra, limits.d_ra_cosde_arcsec),
            ("sensor dDE", self.own_d_de, limits.d_de_arcsec),
        )
        for name, axis, limit in axes:
            if axis.mean_abs > limit:
                yield f"mean |{name}| {axis.mean_abs:.1f} arcsec (limit {limit:g})"
        answers = self.by_status[Status.IDENTIFIED.value]
        expected = self.frames - self.without_sky + lost
        if expected < _FEWEST_FOR_SHARES:
            return
        if answers < limits.availability * expected:
            yield f"availability {100 * answers / expected:.1f} % (limit {100 * limits.availability:g} %)"
        if self.false_answers > limits.false_share * max(answers, 1):
            yield f"{self.false_answers} false answers (limit {100 * limits.false_share:g} % of the answers)"

    @property
    def silence(self) -> str:
        """A warning if none of the last frames was identified (clouds, a lamp, the Sun); otherwise empty."""
        since_s = (self.utc_ns - (self._answered_utc_ns or self.utc_ns)) / NS_PER_S
        objects = f"{self.objects} object{'' if self.objects == 1 else 's'}"
        return f"NO ANSWER for {since_s:.0f} s, {objects}" if since_s >= NO_ANSWER_S else ""

    @property
    def frames_per_s(self) -> float:
        """Frames per second of sensor time, over the last frames; NaN of fewer than two."""
        recent = self._recent_utc_ns
        span_ns = recent[-1] - recent[0] if len(recent) > 1 else 0
        return (len(recent) - 1) * NS_PER_S / span_ns if span_ns > 0 else math.nan


def _axes_arcsec(errors: NDArray[np.void]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The errors in right ascension and declination of rows that have them."""
    return errors["d_ra_cosde_arcsec"].astype(np.float64), errors["d_de_arcsec"].astype(np.float64)
