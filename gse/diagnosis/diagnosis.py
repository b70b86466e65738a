"""Diagnosis: the causes of what a session shows, gross and fine, as findings.

A finding is a hint for the operator. None makes a row PASS or FAIL; one that is a mistake of the set-up may excuse rows
that fail (gse.diagnosis.set_up_mistake, gse.statistics.excuses). There is one cause for one effect: fine ones compete
with each other, a gross one silences them, and events that say the same are left out.
"""

import math
import queue
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkEvent
from gse.diagnosis.field_patterns import field_of_errors, unexplained_residuals
from gse.diagnosis.fine_causes import forget_fits
from gse.diagnosis.fine_findings import Setting, fine_findings, without_shaking
from gse.diagnosis.gross_causes import gross_finding
from gse.diagnosis.late_frames import LateFrames
from gse.diagnosis.misplaced_stars import (
    STARS_FALL_OUT,
    dark_half,
    hidden_field,
    most_unmatched,
    other_size,
    stars_fall_out,
)
from gse.diagnosis.moved_mount import moved_finding, moved_mount
from gse.diagnosis.plain_findings import (
    event_findings,
    faulty_panoramas,
    focus_finding,
    focus_loss,
    hot_pixels,
    moon_near,
    nothing_identified,
    often_stand_still,
    ran_away_s,
    sensor_clock_drift,
    stars_by_day,
    still_panoramas,
    time_tag_faults,
    wrapped_tags,
)
from gse.diagnosis.sensor_findings import sensor_findings
from gse.diagnosis.session_model import ErrorSeries, SessionModel, error_series, often_answered, with_left_out
from gse.diagnosis.turns import pole
from gse.station.events import ClockStep, Finding, FindingEvent, StationKind
from gse.station.frame_results import FrameResults
from gse.station.host_clock import clock_steps, clock_stretches
from gse.station.own_answers import sensor_answers
from gse.station.results import Subject
from gse.station.session_data import SessionData
from gse.station.session_tables import thinned, xy_px_of
from gse.statistics.counted_frames import CountedFrames, counted_frames
from gse.statistics.sensor_convention import session_convention
from gse.statistics.session_statistics import Statistics
from gse.truth import horizon_to_sensor, time_blocks
from gse.values.axis import AXES, ON_SKY
from gse.values.camera import Camera
from gse.values.constants import ARCSEC_PER_RAD, ARCSEC_RAD, EARTH_RATE_ARCSEC_PER_S
from gse.values.instant import NS_PER_S
from gse.values.matrices import length, product
from gse.values.mount import Mount
from gse.values.site import Site
from gse.values.star_influence import FrameFits, StarCells, boresight_shifts

# Steps of the host's clock that its own clocks showed, taken out of the errors: they are known, and need no search.


def without_steps(
    series: ErrorSeries, host_utc_ns: NDArray[np.int64], steps: Sequence[ClockStep], site: Site, mount: Mount
) -> ErrorSeries:
    """The errors as one of the clocks gives them: that under which they are least, as any of them may be the right one.

    ``host_utc_ns`` (M,) are the host's stamps of all frames, in the order of arrival.
    """
    fast_s = np.zeros(len(host_utc_ns))
    for stretch in clock_stretches(host_utc_ns, steps):
        fast_s[stretch.first : stretch.until] = stretch.offset_ns / NS_PER_S
    fast_s = fast_s[series.rows]
    turned = boresight_shifts(product(horizon_to_sensor(mount), pole(site))[None])[0] * EARTH_RATE_ARCSEC_PER_S
    tried = [series.errors_arcsec - np.outer(fast_s - right_s, turned) for right_s in np.unique(fast_s).tolist()]
    least = min(tried, key=lambda errors: length(errors[:, :2].mean(axis=0)))
    return replace(series, errors_arcsec=least)


# Errors beyond their limits that no cause explains: the noise of single stars, or none of what is known here.

_MOST_RATIO = 1.4
"""Largest ratio of the errors to what single stars leave; within it nothing else makes half of their variance."""
_FITTED = 1.5
"""Stars' worth of residuals that a fit of three angles takes."""


def unexplained(session: SessionData, stats: Statistics) -> Iterator[Finding]:
    """What is over its limit, as one finding; nothing where nothing is."""
    limits = session.station.limits
    over = {
        axis: f"95 % of |{axis.label}| is {stats.onboard.axes[axis.key].p95_abs_arcsec:.0f} arcsec"
        for axis in AXES
        if stats.onboard.axes[axis.key].p95_abs_bounds_arcsec.lower > limits.of(axis)
    }
    if over.keys() & set(ON_SKY) and (noise := _noise_of_stars(session, stats)):
        size = f"{', '.join(over.values())}: {noise}"
        yield Finding(
            "centroid noise", size, ("seeing",), "see to focus and exposure; gse plan tells what noise passes"
        )
    elif over:
        yield Finding(
            "none of these",
            f"{', '.join(over.values())}, and no cause that is known here fits",
            (),
            "look at the errors over time: gse view SESSION; for a maintainer: gse why SESSION --bundle FILE",
        )


def _noise_of_stars(session: SessionData, stats: Statistics) -> str:
    """What single stars leave of the boresight's errors, in words, where that is nearly all; else nothing."""
    used, matches = stats.counted.used, session.frames.matches
    frames, matches = session.frames.columns, matches.compress(used[matches["frame"]])
    count = float(np.median(frames["matched"][used])) if used.any() else 0.0
    if count <= _FITTED or not len(matches):
        return ""
    residuals = np.array([matches["residual_x_arcsec"], matches["residual_y_arcsec"]], dtype=np.float64)
    of_star = math.sqrt(float((residuals**2).mean()) * count / (count - _FITTED))
    left = of_star / math.sqrt(count)
    errors = np.array([frames[name][used] for name in ("cross_x_arcsec", "cross_y_arcsec")], dtype=np.float64)
    if math.sqrt(float(np.nanmean(errors**2))) > _MOST_RATIO * left:
        return ""
    px = of_star * ARCSEC_RAD / session.station.sensor.camera().pixel_rad
    stars = f"single stars scatter by {of_star:.0f} arcsec ({px:.2f} px)"
    return f"{stars}, so that {count:.0f} of them leave {left:.0f} arcsec on each axis"


# What stars with lasting errors do to the attitude as they come into the field and leave it.
#
# A double star, a bad place in the catalogue or a star in the blur of the lens keeps its error; the day it leaves the
# field the boresight steps. Each star's error is the mean of its residuals and of what the fits of its frames took of
# it, as far as it is more than chance: the means of all stars together tell how great lasting errors are, and each mean
# is made smaller by its own part of chance (James & Stein 1961). Whole means would hand the noise of one star on to the
# next as stars come and go, which looks like a drift.

_MOST_ROWS = 40_000
_ROUNDS = 5
"""Each takes what the one before left of a star among the others of its frames, a twentieth or less."""


def sampled_matches(matches: NDArray[np.void], series: ErrorSeries) -> NDArray[np.void]:
    """Those that answers name in the frames of a series, of every second, third, ... frame where they are many."""
    return thinned(matches.compress(matches["named"] & np.isin(matches["frame"], series.rows)), _MOST_ROWS)


def without_star_changes(
    series: ErrorSeries, matches: NDArray[np.void], residuals_arcsec: NDArray[np.float64], camera: Camera
) -> ErrorSeries:
    """The errors without what a change of the stars makes of their lasting errors; their mean stays.

    ``residuals_arcsec`` (N, 2) are those of matches (rows of MATCH), of some frames at least.
    """
    xy_px = xy_px_of(matches)
    directions = camera.directions(xy_px)
    fits = FrameFits.from_directions(directions, matches["frame"])
    at_s = np.interp(matches["frame"], series.rows, series.time_s)
    cells = _Cells.from_stars(matches["star"], time_blocks(np.asarray(at_s * NS_PER_S, dtype=np.int64)))
    turns = np.zeros((len(fits.numbers), 3))
    for _ in range(_ROUNDS):
        turns = fits.turns(cells.lasting(residuals_arcsec + np.cross(turns[fits.place], directions)[:, :2]))
    shifts = boresight_shifts(turns)
    made = np.column_stack([np.interp(series.rows, fits.numbers, shift) for shift in shifts.T])
    return replace(series, errors_arcsec=series.errors_arcsec - (made - made.mean(axis=0)))


@dataclass(frozen=True, slots=True, eq=False)
class _Cells:
    """Cells of one star in one stretch of time: ``cell`` (N,) of each sighting, ``star`` (C,) of each cell."""

    cell: NDArray[np.int64]
    star: NDArray[np.int64]

    @classmethod
    def from_stars(cls, stars: NDArray[np.integer], blocks: NDArray[np.int64]) -> "_Cells":
        cells = StarCells.from_stars(stars, blocks)
        return cls(cells.of_row, np.unique(cells.star, return_inverse=True)[1])

    def lasting(self, errors: NDArray[np.float64]) -> NDArray[np.float64]:
        """What each sighting (N, 2) has of the lasting error of its star, by errors (N, 2); zero where none shows it.

        The variance of a cell's mean is what the cells of one star scatter by, that of lasting errors what the means of
        stars scatter by beyond it.
        """
        means, cells = _means(errors, self.cell), np.bincount(self.star)
        stars = _means(means, self.star)
        freedom = len(self.star) - len(cells)
        if not freedom:
            return np.zeros_like(errors)
        chance = float(((means - stars[self.star]) ** 2).sum()) / (2 * freedom)
        lasting = max(float((cells[:, None] * stars**2).sum()) / 2 - len(cells) * chance, 0.0) / len(self.star)
        sure = lasting / np.maximum(lasting + chance / cells, 1e-300)
        return np.asarray((sure[:, None] * stars)[self.star[self.cell]])


def _means(values: NDArray[np.float64], group: NDArray[np.int64]) -> NDArray[np.float64]:
    """Of values (N, 2) over each group (N,)."""
    return np.column_stack([np.bincount(group, weights=part) for part in values.T]) / np.bincount(group)[:, None]


@dataclass(frozen=True, slots=True, eq=False)
class ModelledSession:
    """Errors as models compete for them, all of their series, and what findings are worded with."""

    model: SessionModel
    series: ErrorSeries
    setting: Setting


def findings(session: SessionData, stats: Statistics) -> tuple[Finding, ...]:
    """The causes of what a session shows, a gross one alone: under it all fine ones are guesses."""
    gross, fine = _causes(session, stats.counted)
    causes = (*gross, *fine)
    facts = tuple(_facts(session, stats, {finding.cause for finding in causes}))
    if not gross:
        facts = (*facts, *stars_by_day(session, stats.counted))
    return (*causes, *facts) or tuple(unexplained(session, stats))


def causes_so_far(session: SessionData) -> tuple[Finding, ...]:
    """The causes that a running session shows, without the statistics of a whole one."""
    counted = counted_frames(session)
    gross, fine = _causes(session, counted)
    causes = (*gross, *fine)
    return (
        *causes,
        *event_findings(session, {finding.cause for finding in causes}),
        *nothing_identified(session),
        *_of_sensor(session, causes, is_gross=bool(gross)),
    )


def _causes(session: SessionData, counted: CountedFrames) -> tuple[tuple[Finding, ...], tuple[Finding, ...]]:
    """The gross cause, or fine ones; none of these where the frames' own instants are not known."""
    if still := still_panoramas(session):
        return (still,), ()
    moved = moved_mount(session, counted)
    jump = moved_finding(session, moved) if moved else None
    if moved and jump:  # the others tell all other causes
        counted = replace(counted, answered=counted.answered & ~moved.away, used=counted.used & ~moved.away)
    beside = (jump,) if jump else ()
    if gross := other_size(session, counted) or gross_finding(session, counted):
        return (gross,), beside
    return (), (*beside, *(() if often_stand_still(session.frames.columns) else _fine(session, counted)))


def _of_sensor(session: SessionData, named: tuple[Finding, ...], *, is_gross: bool) -> tuple[Finding, ...]:
    """What the sensor's own answers look like so far; under a gross mistake they are compared with nothing."""
    if not len(session.sensor_attitudes):
        return ()
    own = None if is_gross or session.subject is Subject.SENSOR else sensor_answers(session)
    return sensor_findings(session, own, session_convention(session), named=named)


def _facts(session: SessionData, stats: Statistics, named: set[str]) -> Iterator[Finding]:
    """What events, time tags and counts say by themselves; nothing that a named cause says already."""
    is_other_size = "detector size" in named or any(one.kind == StationKind.WRONG_DETECTOR for one in session.events)
    hidden = () if is_other_size or named & set(STARS_FALL_OUT) else tuple(hidden_field(session))
    moon = tuple(moon_near(session, stats))
    yield from moon
    yield from hidden or (() if moon or is_other_size or named & set(STARS_FALL_OUT) else dark_half(session))
    yield from event_findings(session, named)
    yield from () if hidden else nothing_identified(session)
    yield from faulty_panoramas(session, stats.counted)
    if not named & set(STARS_FALL_OUT) and (loss := focus_loss(session, stats.counted)):
        yield focus_finding(loss)
    elif not named:
        yield from most_unmatched(session, stats.counted)
    yield from wrapped_tags(session)
    for line in time_tag_faults(session.frames.columns, session.events):
        yield Finding("sensor time tag", line.split(": ", 1)[1], (), "ask the maker; gse decode SESSION --explain")
    if "clock drift" not in named:
        yield from sensor_clock_drift(stats)
    if not (named & set(STARS_FALL_OUT) and stars_fall_out(session.frames.columns, stats.counted.used)):
        yield from hot_pixels(session)


def _fine(session: SessionData, counted: CountedFrames) -> tuple[Finding, ...]:
    try:
        modelled = session_model(session, counted)
        found = fine_findings(modelled.model, modelled.series, modelled.setting) if modelled else ()
        found = without_shaking(found, session)
    except np.linalg.LinAlgError:  # stars or errors that lie on one line: they tell no cause, and end no session
        return ()
    finally:
        forget_fits()
    of_camera = [finding for finding in found if finding.cause in STARS_FALL_OUT]
    return tuple(of_camera[:1]) if of_camera and stars_fall_out(session.frames.columns, counted.used) else found


def session_model(session: SessionData, counted: CountedFrames) -> ModelledSession | None:
    """What fine causes compete for; None of too few frames, and where no sky turns over the mount."""
    frames, station, used = session.frames.columns, session.station, often_answered(counted.used)
    series = error_series(frames, used)
    if series is None or station.mount.inertial is not None:
        return None
    mount, camera = session.alignment.mount if session.alignment else station.mount, station.sensor.camera()
    zenith_sensor = np.asarray(horizon_to_sensor(mount)[:, 2])
    series = with_left_out(series, session.frames.matches, camera)
    if (steps := clock_steps(session.events)) and not ran_away_s(session):
        series = without_steps(series, frames["host_utc_ns"], steps, station.site, mount)
    field = field_of_errors(session.frames.matches, frames["utc_ns"], used, camera, station.site, zenith_sensor)
    if field is not None:
        matches = sampled_matches(session.frames.matches, series)
        residuals_arcsec = unexplained_residuals(field, matches, camera, station.site, zenith_sensor)
        series = without_star_changes(series, matches, residuals_arcsec, camera)
    exposure_s = float(np.nanmedian(frames["exposure_s"][series.rows]))
    first_ns = int(frames["utc_ns"][series.rows[0]])
    pixel_arcsec = camera.pixel_rad * ARCSEC_PER_RAD
    model = SessionModel.from_series(
        series.shortened(),
        field,
        station.site,
        mount,
        is_fitted=session.alignment is not None,
        pixel_arcsec=(-pixel_arcsec if camera.mirrored else pixel_arcsec, pixel_arcsec),
    )
    frame_hz = 1 / max(float(np.median(np.diff(series.time_s))), 1e-9)
    late = LateFrames.from_frames(frames, session.events)
    has_host = bool((frames["host_utc_ns"] > 0).all())
    is_absolute = session.time.is_absolute
    setting = Setting(camera, station.site, mount, first_ns, exposure_s, frame_hz, late, has_host, is_absolute)
    return ModelledSession(model, series, setting)


# Live diagnosis: findings of a running session, announced when they first show.

FIRST_AFTER_S = 10.0
"""Time in the data from the first panorama to the first look; then after 20 s, and whenever a third more has passed,
20 s at least: a look costs half a second to two of a processor."""
_SHARE, _LEAST_S = 3, 20.0


@dataclass(slots=True)
class LiveDiagnosis:
    """A listener that looks for causes now and then; ``announce`` gets an event for each that is new.

    With ``snapshot``, a function that copies a session, it looks at a copy in a thread of its own, so that a live port
    does not wait for it; what it finds is announced with the next results, and it looks at one copy at a time. The
    findings of the report come from the whole session: one that was announced may be gone at the end.
    """

    announce: Callable[[LinkEvent], None]
    snapshot: Callable[[SessionData], SessionData] | None = None
    _begun_ns: int | None = None
    _due_ns: int = 0
    _known: set[str] = field(default_factory=set)
    _found: queue.SimpleQueue[tuple[int, Sequence[Finding]]] = field(default_factory=queue.SimpleQueue)
    _thread: threading.Thread | None = None

    def on_results(self, results: FrameResults, session: SessionData) -> None:
        """Look, where it is time."""
        for utc_ns in results.rows["utc_ns"].tolist():
            self._look(utc_ns, session)
        self._tell()

    def _look(self, utc_ns: int, session: SessionData) -> None:
        if self._begun_ns is None:
            self._begun_ns, self._due_ns = utc_ns, utc_ns + round(FIRST_AFTER_S * NS_PER_S)
        if utc_ns < self._due_ns or (self._thread is not None and self._thread.is_alive()):
            return
        elapsed_ns = utc_ns - self._begun_ns
        self._due_ns = utc_ns + min(elapsed_ns, max(elapsed_ns // _SHARE, round(_LEAST_S * NS_PER_S)))
        if self.snapshot is None:
            self._found.put((utc_ns, causes_so_far(session)))
            self._tell()
            return
        taken = self.snapshot(session)
        self._thread = threading.Thread(target=self._look_beside, args=(utc_ns, taken), name="diagnosis", daemon=True)
        self._thread.start()

    def _look_beside(self, utc_ns: int, session: SessionData) -> None:
        with suppress(Exception):  # a look that fails must not end the session; the report looks again, and tells
            self._found.put((utc_ns, causes_so_far(session)))

    def _tell(self) -> None:
        while not self._found.empty():
            utc_ns, found = self._found.get_nowait()
            for finding in found:
                if finding.cause not in self._known:
                    self._known.add(finding.cause)
                    self.announce(FindingEvent(utc_ns, 0, StationKind.FINDING, str(finding), finding))

    def on_event(self, event: LinkEvent) -> None:
        """Events are not frames."""
