"""The facts of the glance page: one small document of how a session stands.

The thread of the page's server calls ``absorb`` and ``document`` a few times per second; both only read the live state.
"""

import math
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkEvent, LinkKind
from drivers.clock import ClockReading
from gse.station.events import StationKind
from gse.station.frame_results import FrameResult, FrameResults
from gse.station.results import Subject
from gse.station.sky_condition import SUN_LIMIT_DEG
from gse.truth import horizon_to_sensor
from gse.truth.solar_system import sun_altitude_deg
from gse.values import instant
from gse.values.axis import ALL_AXES, AXES, CROSS_X, CROSS_Y, D_DE, D_RA_COSDE, D_ROLL, Axis
from gse.values.instant import NS_PER_S
from gse.values.limits import Limits
from gse.values.matrices import length, product
from gse.values.mount import Mount
from gse.values.panorama import Panorama
from gse.values.site import Site
from gse.view.glance_word import LATE_S, Facts, Phase, word_of
from gse.view.live_state import ErrorsSoFar, LiveState, SessionSoFar
from gse.view.verdict_text import clock_health, host_minus_sensor
from protocols import COLOURS

# The errors of a session over time in few numbers: each bin has count, mean, spread and extremes of every axis.
#
# Two levels: bins of a second over the last ten minutes, for a close-up, and at most MOST_BINS over the whole session,
# which grow in length as it does. The loop adds; a page's thread reads at any time without a lock: a bin never changes,
# and what is read is a list that only grows, or the one before.

CLOSE_S = 600
"""Seconds, and bins, of the close-up."""
MOST_BINS = 1000
"""Bins of the whole session: one for each column of pixels of a plot that fills half of a large screen."""

VIEWS: dict[str, tuple[Axis, ...]] = {"sky": (D_RA_COSDE, D_DE), "across": (CROSS_X, CROSS_Y), "roll": (D_ROLL,)}
"""The axes that a page shows together."""

_COUNT, _MEAN, _SQUARES, _LOW, _HIGH = range(5)
_DECIMALS = 2


@dataclass(frozen=True, slots=True, eq=False)
class TraceBin:
    """The errors of a stretch of time: ``stats`` (5, A) has count, mean, squares about it, least, greatest by axis."""

    number: int
    stats: NDArray[np.float64]


_Bins = list[TraceBin]


class ErrorTrace:
    """The errors of one subject, columns named ``columns``, in the order of their coming."""

    def __init__(self, columns: Sequence[str]) -> None:
        self._columns = tuple(columns)
        self._close: _Bins = []
        self._whole: tuple[int, _Bins] = (1, [])

    def add(self, rows: NDArray[np.void]) -> None:
        """Add rows with ``utc_ns`` and the columns; rows without errors (NaN) leave a gap."""
        known = rows[~np.isnan(rows[self._columns[0]])]
        if not len(known):
            return
        seconds = known["utc_ns"] // NS_PER_S
        errors = np.column_stack([known[name].astype(np.float64) for name in self._columns])
        begins = np.flatnonzero(np.diff(seconds, prepend=seconds[0] - 1))
        for begin, end in zip(begins.tolist(), [*begins[1:].tolist(), len(known)], strict=True):
            self._take(TraceBin(int(seconds[begin]), _stats(errors[begin:end])))

    def _take(self, part: TraceBin) -> None:
        self._close = _with(self._close, part)
        if self._close[0].number <= part.number - CLOSE_S:
            first = next(place for place, one in enumerate(self._close) if one.number > part.number - CLOSE_S)
            self._close = self._close[first:]
        step_s, bins = self._whole
        bins = _with(bins, TraceBin(part.number // step_s, part.stats))
        if len(bins) > MOST_BINS:
            step_s, halves = 2 * step_s, bins
            bins = []
            for one in halves:
                bins = _with(bins, TraceBin(one.number // 2, one.stats))
        self._whole = step_s, bins

    def close_after(self, number: int, places: Sequence[int]) -> dict[str, Any]:
        """The bins of the close-up from ``number`` on; all where there is none such (the clock was set back)."""
        return _document(1, self._close, number, places)

    def whole_after(self, step_s: int, number: int, places: Sequence[int]) -> dict[str, Any]:
        """The bins of the whole session from ``number`` on; all where they have another length than ``step_s``."""
        now_s, bins = self._whole
        return _document(now_s, bins, number if step_s == now_s else -1, places)


def _stats(errors: NDArray[np.float64]) -> NDArray[np.float64]:
    mean = errors.mean(axis=0)
    squares = ((errors - mean) ** 2).sum(axis=0)
    return np.stack([np.full(len(mean), float(len(errors))), mean, squares, errors.min(axis=0), errors.max(axis=0)])


def _with(bins: _Bins, part: TraceBin) -> _Bins:
    """The bins with one more, or with its errors in the last one; one from before that begins anew."""
    if bins and part.number == bins[-1].number:
        bins[-1] = TraceBin(part.number, _merged(bins[-1].stats, part.stats))
        return bins
    if bins and part.number < bins[-1].number:
        return [part]
    bins.append(part)
    return bins


def _merged(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """The statistics of both (Chan, Golub and LeVeque 1979, equation 2.1)."""
    count = one[_COUNT] + other[_COUNT]
    step = other[_MEAN] - one[_MEAN]
    mean = one[_MEAN] + step * other[_COUNT] / count
    squares = one[_SQUARES] + other[_SQUARES] + step**2 * one[_COUNT] * other[_COUNT] / count
    return np.stack([count, mean, squares, np.minimum(one[_LOW], other[_LOW]), np.maximum(one[_HIGH], other[_HIGH])])


def _document(step_s: int, bins: _Bins, number: int, places: Sequence[int]) -> dict[str, Any]:
    """``bins``: number, count, and by axis mean, standard deviation, least and greatest error (arcsec).

    ``anew``: they take the place of all that came before.
    """
    shown = bins[:]
    anew = not any(one.number == number for one in shown)
    kept = shown if anew else [one for one in shown if one.number >= number]
    return {"step_s": step_s, "anew": anew, "bins": [_row(one, places) for one in kept]}


def _row(one: TraceBin, places: Sequence[int]) -> list[float]:
    row: list[float] = [one.number, int(one.stats[_COUNT, 0])]
    for place in places:
        count, mean, squares, low, high = one.stats[:, place].tolist()
        row += [round(value, _DECIMALS) for value in (mean, math.sqrt(squares / count), low, high)]
    return row


MARKED = frozenset(
    {
        *(LinkKind.LOST, LinkKind.REOPENED, LinkKind.STALE),
        *(StationKind.NOTE, StationKind.FINDING, StationKind.ALIGNED, StationKind.NO_TRUTH, StationKind.FROZEN),
        *(StationKind.CLEAR, StationKind.CLOUDED, StationKind.NO_STARS, StationKind.DAYLIGHT, StationKind.DARK_NIGHT),
        *(StationKind.CLOCK_STEP, StationKind.SENSOR_RESET),
    }
)
"""Events that a plot of the errors shows at their time."""
MOST_MARKS = 200


class ErrorTraces:
    """A display of a session: the traces of the identifier under test and of the sensor's own answers, with marks."""

    def __init__(self) -> None:
        self._marks: tuple[tuple[int, float, str, str], ...] = ()
        self._onboard = ErrorTrace([axis.column for axis in ALL_AXES])
        self._own = ErrorTrace([axis.column for axis in AXES])
        self._sends_own = False

    def on_results(self, results: FrameResults, so_far: SessionSoFar) -> None:
        """Add results, and what came of the sensor's own answers with them."""
        self._onboard.add(results.rows)
        if len(so_far.own_errors):
            self._own.add(so_far.own_errors)
            self._sends_own = True

    def on_event(self, event: LinkEvent, so_far: SessionSoFar) -> None:
        """Keep an event that a plot shows."""
        if event.kind in MARKED:
            number = self._marks[-1][0] + 1 if self._marks else 1
            mark = (number, round(event.utc_ns / NS_PER_S, 1), str(event.kind), event.text)
            self._marks = (*self._marks, mark)[-MOST_MARKS:]

    def document(self, request: Sequence[str], limits: Limits) -> dict[str, Any] | None:
        """What a page asked for: a view, a subject, and the last bins that it has; None of another request."""
        try:
            view, subject, *texts = request
            axes, (close, step_s, whole, mark) = VIEWS[view], map(int, texts)
        except (ValueError, KeyError):
            return None
        is_own = subject == "own" and self._sends_own and view != "across"
        trace, places = (self._own if is_own else self._onboard), [ALL_AXES.index(axis) for axis in axes]
        return {
            "view": view,
            "subject": "own" if is_own else "onboard",
            "sends_own": self._sends_own,
            "axes": [{"name": axis.label, "limit_arcsec": limits.of(axis) if axis in AXES else None} for axis in axes],
            "close": trace.close_after(close, places),
            "whole": trace.whole_after(step_s, whole, places),
            "marks": [one for one in self._marks if one[0] > mark],
        }


# Dawn: when the sky of a site becomes too bright for stars.

_STEP_NS = 600 * NS_PER_S
_STEPS = 144
_HALVINGS = 10


class NextDawn:
    """The next dawn at a site, looked for anew once the one before is over."""

    def __init__(self, site: Site) -> None:
        self._site = site
        self._from_ns, self._dawn_ns = 0, 0

    def minutes(self, utc_ns: int) -> int | None:
        """Whole minutes from an instant to dawn; None where none comes within a day."""
        if not self._from_ns <= utc_ns < self._dawn_ns:
            dawn_ns = next_dawn_ns(self._site, utc_ns)
            if dawn_ns is None:
                return None
            self._from_ns, self._dawn_ns = utc_ns, dawn_ns
        return (self._dawn_ns - utc_ns) // (60 * NS_PER_S)


def next_dawn_ns(site: Site, utc_ns: int) -> int | None:
    """UTC of the next dawn within a day, good to a second; ``utc_ns`` where it is bright, None in polar night."""
    if is_bright(site, utc_ns):
        return utc_ns
    for step in range(1, _STEPS + 1):
        if is_bright(site, utc_ns + step * _STEP_NS):
            return _between(site, utc_ns + (step - 1) * _STEP_NS, utc_ns + step * _STEP_NS)
    return None


def is_bright(site: Site, utc_ns: int) -> bool:
    """Whether the Sun is too high for stars."""
    return sun_altitude_deg(site, utc_ns) > SUN_LIMIT_DEG


def _between(site: Site, dark_ns: int, bright_ns: int) -> int:
    for _ in range(_HALVINGS):
        middle_ns = (dark_ns + bright_ns) // 2
        dark_ns, bright_ns = (dark_ns, middle_ns) if is_bright(site, middle_ns) else (middle_ns, bright_ns)
    return bright_ns


# Help to focus: how many objects the sensor sees, and how bright they are.

BINS = 12
"""Bins of equal steps in magnitude; a sharper image moves its stars to the right."""


def focus_of(panorama: Panorama, index_max: int) -> dict[str, Any]:
    """Objects of a panorama by brightness, 1 to ``index_max`` in BINS equal ratios; the wire has no star widths."""
    edges = np.geomspace(1.0, index_max, BINS + 1)
    places = np.clip(np.searchsorted(edges, panorama.brightness, side="right") - 1, 0, BINS - 1)
    return {
        "objects": len(panorama.brightness),
        "histogram": np.bincount(places, minlength=BINS).tolist(),
        "brightest": round(float(panorama.brightness.max(initial=0.0))),
        "index_max": index_max,
        "fwhm_px": None,
    }


# How far a mount must be turned, from where the sensor looks to where the station file says.

NEAR_ZENITH_DEG = 80.0
"""Higher up a mount is tilted to east and north: there azimuth means little."""

_WINDS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")


@dataclass(frozen=True, slots=True)
class Turn:
    """A turn in one direction; ``positive`` and ``negative`` name the directions of its two signs."""

    angle_deg: float
    positive: str
    negative: str

    def __str__(self) -> str:
        return f"{_degrees(self.angle_deg)} {self.positive if self.angle_deg >= 0 else self.negative}"


@dataclass(frozen=True, slots=True)
class MountTurn:
    """The turn that brings the boresight to the stated direction, seen in the viewing direction of the sensor.

    ``across`` is along the horizon, to the right where positive, and ``up`` at right angles to it; near the zenith they
    are to the east and to the north. ``roll`` is clockwise where positive.
    """

    across: Turn
    up: Turn
    roll: Turn

    def __str__(self) -> str:
        return f"{self.across}, {self.up}; then roll {self.roll}"

    def document(self) -> dict[str, float | str]:
        """Angles, directions of the positive ones and the text, for the glance page."""
        turns = (("across_deg", self.across), ("up_deg", self.up), ("roll_deg", self.roll))
        degrees = {name: round(one.angle_deg, 4) for name, one in turns}
        return {**degrees, "across": self.across.positive, "up": self.up.positive, "text": str(self)}


def mount_turn(result: FrameResult, used: Mount, stated: Mount) -> MountTurn | None:
    """The turn to the ``stated`` mount by a result that was compared with the mount ``used``; None without truth."""
    if result.attitude_geometric is None or result.attitude_true is None:
        return None
    icrs_to_horizon = product(horizon_to_sensor(used).T, result.attitude_true.icrs_to_sensor)
    measured = product(result.attitude_geometric.icrs_to_sensor, icrs_to_horizon.T)
    wanted = horizon_to_sensor(stated)
    here, there = measured[2], wanted[2]
    across, up, across_names, up_names = _axes(here)
    angle_deg = math.degrees(math.atan2(length(np.cross(here, there)), float(product(here, there))))
    x, y = float(product(there, across)), float(product(there, up))
    scale = angle_deg / math.hypot(x, y) if math.hypot(x, y) else 0.0
    roll = Turn(_roll_deg(measured, wanted), "clockwise", "counter-clockwise")
    return MountTurn(Turn(x * scale, *across_names), Turn(y * scale, *up_names), roll)


_Direction = NDArray[np.float64]
_Names = tuple[str, str]


def _axes(boresight: _Direction) -> tuple[_Direction, _Direction, _Names, _Names]:
    """Two directions across a boresight in the horizon frame (x east, y north, z up), and the names of their signs."""
    east, north, up = boresight.tolist()
    level = math.hypot(east, north)
    if math.degrees(math.atan2(up, level)) > NEAR_ZENITH_DEG:
        northwards = np.array([0.0, 1.0, 0.0]) - north * boresight
        northwards /= length(northwards)
        return np.cross(northwards, boresight), northwards, ("east", "west"), ("north", "south")
    right = np.array([north, -east, 0.0]) / (level or 1.0)
    wind = round(math.degrees(math.atan2(right[0], right[1])) / 45)
    names = (f"right (to the {_WINDS[wind % 8]})", f"left (to the {_WINDS[(wind + 4) % 8]})")
    return right, np.cross(right, boresight), names, ("up", "down")


def _roll_deg(measured: NDArray[np.float64], wanted: NDArray[np.float64]) -> float:
    """The turn about the boresight, clockwise for one who looks along it: from columns towards rows."""
    change = product(wanted, measured.T)
    return math.degrees(math.atan2(change[0, 1] - change[1, 0], change[0, 0] + change[1, 1]))


def _degrees(value: float) -> str:
    """Three significant digits; arcseconds would be no help to a hand."""
    size = abs(value)
    return f"{size:.3f} deg" if size < 1 else f"{size:.2f} deg" if size < 10 else f"{size:.1f} deg"


SCHEMA = "gse.glance/1"

_SLOW_EVERY_NS = NS_PER_S
"""What changes slowly (disk, turn of the mount, histogram, dawn) is found once a second."""
_ITEMS_SHOWN = 24
"""Items of the sensor's housekeeping for which the page has room."""


class Glance:
    """One session at a glance, by its ``live`` state; ``folder`` is where it is recorded."""

    def __init__(self, live: LiveState, *, folder: Path | None = None) -> None:
        self._live, self._folder = live, folder
        self._station = live.station
        self._phase, self._verdict = Phase.RUNNING, ""
        self._reasons: tuple[str, ...] = ()
        self._traces = live.add(ErrorTraces())
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
        detail = "; ".join(filter(None, (word.detail, so_far.late)))
        return {
            "schema": SCHEMA,
            "word": {"text": word.text, "level": word.level, "detail": detail},
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
            "alarms": list(self._live.alarms),
            "question": self._live.question,
            "forecast": self._verdict if self.has_ended else self._live.forecast,
            **self._slow,
        }

    def errors(self, request: Sequence[str]) -> dict[str, Any] | None:
        """What a page asked for of the errors over time; None of another request."""
        return self._traces.document(request, self._station.limits)

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
        return [
            self._axis(Subject.SENSOR if whose else so_far.subject, axis, errors, limits.of(axis))
            for whose, axis, errors in so_far.compared
        ]

    def _axis(self, subject: Subject, axis: Axis, errors: ErrorsSoFar, limit_arcsec: float) -> dict[str, Any]:
        return {
            "subject": subject.value,
            "name": axis.label,
            "last_arcsec": _number(errors.last, 1),
            "mean_arcsec": _number(errors.mean if errors.n else math.nan, 1),
            "std_arcsec": _number(errors.std, 1),
            "nea_arcsec": _number(errors.nea, 1),
            "limit_arcsec": limit_arcsec,
            "outside": errors.mean_abs > limit_arcsec,
        }

    def _facts(self, now: ClockReading) -> Facts:
        so_far = self._so_far
        behind_s = self._live.behind_s(now)
        silent_s = (now.mono_ns - self._latest_mono_ns) / NS_PER_S if so_far.frames and behind_s < LATE_S else 0.0
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
            behind_s=behind_s,
            stands_still_for=self._live.question if self._station.port.url.startswith("sim://") else "",
            sky="DAYLIGHT" if self._bright else so_far.no_sky,
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
            "clock": self._clock(),
            "disk_free_gb": self._disk_free_gb(),
            "dawn_min": self._next_dawn.minutes(so_far.utc_ns or now.utc_ns),
            "turn": self._turn(),
            "focus": self._focus(),
            "items": self._items(),
            "events": [str(line) for line in so_far.events],
        }

    def _items(self) -> list[tuple[str, str, str]]:
        """Name, text and colour of each line: wrong star names, then the latest items, red and yellow ones first."""
        names = self._live.names
        named = [("wrong star names", str(names), "yellow" if names.wrong else "green")] if names else []
        latest = sorted(self._live.items.items(), key=lambda of: -COLOURS.index(of[1].colour))
        return [*named, *((name, item.text, item.colour) for name, item in latest[:_ITEMS_SHOWN])]

    def _clock(self) -> str | None:
        so_far = self._so_far
        words = [clock_health(so_far.clock, so_far.clock_error_s)] if so_far.clock else []
        if not math.isnan(so_far.host_minus_sensor_s):
            words.append(host_minus_sensor(so_far.host_minus_sensor_s))
        return "; ".join(words) or None

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
