"""Statistics of a session: those of each subject on trial, and those of its frames and clocks."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gse.recording.session_format import PowerReading
from gse.station.columns import ANSWER_CHECKS, STATUSES
from gse.station.events import StationKind
from gse.station.exclusions import Exclusion, excluded
from gse.station.host_clock import instants_ns
from gse.station.own_answers import SensorAnswers, sensor_answers
from gse.station.results import Status, Subject
from gse.station.session_data import SessionData
from gse.station.session_tables import thinned, xy_px_of
from gse.station.star_names import NamedStars, named_stars
from gse.statistics.clock_health import ClockHealth, clock_health
from gse.statistics.counted_frames import CountedFrames, counted_frames, own_counted
from gse.statistics.incidents import AnswersWithin, Incident, answers_within, incidents, pauses
from gse.statistics.onboard_equivalence import OnboardEquivalence, equivalence
from gse.statistics.sampling import Bounds, Percentiles, error_bounds, root_mean_square_bounds
from gse.statistics.sensor_convention import ConventionSearch, is_wrong, session_convention
from gse.statistics.spatial_errors import SpatialErrors, spatial_errors
from gse.statistics.subject_statistics import NO_EARTH_RATE, SubjectAnswers, SubjectStatistics, subject_statistics
from gse.truth import horizon_to_sensor
from gse.values.attitude_convention import to_answers
from gse.values.axis import ALL_AXES
from gse.values.constants import EARTH_RATE_ARCSEC_PER_S
from gse.values.instant import NS_PER_S
from gse.values.matrices import product
from protocols.vocabulary import quantity

_MOST_STAR_ERRORS = 20_000
"""Most star errors in the fit, 300 bytes each; of a longer session every second, third, ... frame enters."""

RATES = ("rate_x", "rate_y", "rate_z")
"""Items in which a sensor states the rates about its axes.

A sensor that stands on the Earth turns with it: by 15.041 arcsec/s about the pole, whose components in the sensor's
frame are those of the mount. Before a star simulator there is no such truth.
"""


@dataclass(frozen=True, slots=True)
class PowerUse:
    """Mean current of the sensor while it is on, and its greatest current while it is switched on; NaN if unknown."""

    mean_a: float = math.nan
    inrush_a: float = math.nan


@dataclass(frozen=True, slots=True)
class RateError:
    """The rate that a sensor states about one axis: ``bias`` is the mean less the truth, ``noise`` the deviation.

    Of ``values``, ``n_eff`` are independent; bounds are NaN where these are too few.
    """

    axis: str
    values: int
    true_arcsec_per_s: float
    bias_arcsec_per_s: float
    noise_arcsec_per_s: float
    n_eff: float
    bias_bounds_arcsec_per_s: Bounds
    noise_bounds_arcsec_per_s: Bounds


def rate_errors(session: SessionData) -> tuple[RateError, ...]:
    """The errors of the rates that came, none of a sensor that sends none, or whose mount is not known."""
    mount = session.alignment.mount if session.alignment else session.station.mount
    items = {item.name: number for number, item in enumerate(session.housekeeping.items)}
    if not session.station.is_under_sky or (mount.align is not None and session.alignment is None):
        return ()
    latitude = math.radians(session.station.site.latitude_deg)
    turn_enu = EARTH_RATE_ARCSEC_PER_S * np.array([0.0, math.cos(latitude), math.sin(latitude)])
    true = product(to_answers(horizon_to_sensor(mount)[None], session.station.sensor.attitude)[0], turn_enu)
    rows, found = session.housekeeping.rows, []
    for at, name in enumerate(RATES):
        if name not in items:
            continue
        unit = session.housekeeping.items[items[name]].unit
        try:
            arcsec = quantity(f"1 {unit}", "arcsec/s")
        except ValueError:  # a rate without a unit of angles
            continue
        stated = np.asarray(rows["value"])[np.asarray(rows["item"]) == items[name]] * arcsec
        stated = stated[np.isfinite(stated)]
        if len(stated) > 1:
            bias, noise = float(stated.mean() - true[at]), float(stated.std(ddof=1))
            of_bias, of_noise = error_bounds(stated - true[at]), root_mean_square_bounds(stated - stated.mean())
            of_axis = name[-1], len(stated), float(true[at]), bias, noise
            found.append(RateError(*of_axis, of_bias.n_eff, of_bias.bias, of_noise))
    return tuple(found)


@dataclass(frozen=True, slots=True)
class Statistics:
    """All statistics of a session.

    ``frames_expected`` are those received and not excused, and those that never came. ``onboard`` is
    there where panoramas came, ``sensor`` where the sensor sent answers of its own, ``equivalence`` compares these two.
    ``own`` are the sensor's answers beside panoramas, which ``own_counted`` counts, ``convention`` what its answers
    show of their convention: where another one is stated, no error of theirs is computed. ``spatial``
    are the errors of single stars along columns and rows, None of too few stars. For each of the ``exclusions``
    there are ``answers_excluded`` that were given in it.
    """

    frames: int
    duration_s: float
    frames_expected: int
    statuses: dict[str, int]
    answer_checks: dict[str, int]
    subjects: dict[Subject, SubjectStatistics]
    arrival_ms: Percentiles
    clock: ClockHealth
    equivalence: OnboardEquivalence | None
    spatial: tuple[SpatialErrors, SpatialErrors] | None
    exclusions: tuple[tuple[Exclusion, int], ...]
    counted: CountedFrames
    answers_excluded: tuple[tuple[AnswersWithin, ...], ...] = ()
    incidents: tuple[Incident, ...] = ()
    own: SensorAnswers | None = None
    own_counted: CountedFrames | None = None
    convention: ConventionSearch | None = None
    power: PowerUse = field(default_factory=PowerUse)
    rates: tuple[RateError, ...] = ()
    names: NamedStars | None = None

    @property
    def judged_s(self) -> float:
        """Seconds of the session that count: a longer one is as many times as long in these, not in its twilights."""
        counts = self.counted.expected | self.counted.used
        return self.duration_s * float(counts.mean()) if len(counts) else 0.0

    @property
    def counts_any(self) -> bool:
        """Whether there is a frame whose time is known and that must have an answer."""
        return bool((self.counted.expected & ~self.counted.excluded).any())

    @property
    def onboard(self) -> SubjectStatistics:
        """The statistics of the frame table: the identifier under test, or a sensor that sends no panoramas."""
        return self.subjects.get(Subject.ONBOARD) or self.subjects[Subject.SENSOR]


def statistics(session: SessionData) -> Statistics:
    """The statistics of a session, without what its events, its sky and its operator exclude."""
    frames = session.frames.columns
    counted = counted_frames(session)
    status, check = frames["status"][counted.expected], frames["answer_check"][counted.expected]
    limits = session.station.limits
    field_rad = session.station.sensor.camera().diagonal_rad / 2
    convention = session_convention(session) if len(session.sensor_attitudes) else None
    unreadable = is_wrong(convention, session.station.sensor.attitude)
    if session.subject is Subject.SENSOR and unreadable:
        counted = counted.uncompared()
    answers = {session.subject: _answers_of_frames(session, counted)}
    own = sensor_answers(session) if session.subject is Subject.ONBOARD else None
    counted_own = None
    if own is not None:
        counted_own = own_counted(session, own, counted)
        if unreadable:
            counted_own = counted_own.uncompared()
        answers[Subject.SENSOR] = _answers_of_sensor(own, counted_own)
    subjects = {name: subject_statistics(name, frames, one, limits, field_rad) for name, one in answers.items()}
    given = {name: (one.counted, one.columns) for name, one in answers.items()}
    if not session.station.is_under_sky:
        subjects = {name: replace(subject, earth_rate=NO_EARTH_RATE) for name, subject in subjects.items()}
    return Statistics(
        frames=len(frames),
        duration_s=float(np.ptp(instants_ns(frames, session.events))) / 1e9 if len(frames) else 0.0,
        frames_expected=counted.frames_expected,
        statuses=_statuses(status),
        answer_checks={name.value: int((check == place).sum()) for place, name in enumerate(ANSWER_CHECKS)},
        subjects=subjects,
        arrival_ms=subjects[session.subject].arrival_ms,
        clock=clock_health(session.clock, session.events, frames, stated_error_s=session.clock_error_s),
        equivalence=equivalence(frames, counted.excluded, own.matched, own) if own is not None else None,
        spatial=_spatial(session, counted),
        exclusions=tuple((item, int(excluded(frames["utc_ns"], (item,)).sum())) for item in counted.exclusions),
        counted=counted,
        answers_excluded=answers_within(given, frames["utc_ns"]),
        incidents=(
            *(
                incident
                for subject, (one, columns) in given.items()
                for incident in incidents(subject, frames, columns, one, session.station.limits)
            ),
            *pauses(session.subject, frames, counted.exclusions),
        ),
        own=own,
        own_counted=counted_own,
        convention=convention,
        power=_power_use(session),
        rates=rate_errors(session),
        names=named_stars(session.star_names.rows, session.stars),
    )


def power_use(readings: Sequence[PowerReading], switched: Iterable[tuple[int, bool]], settle_s: float) -> PowerUse:
    """The currents of readings, where the supply was ``switched`` on (True) or off at instants of UTC.

    A sensor that nobody switches is on. The mean leaves out ``settle_s`` after each time that it was switched on; the
    greatest reading of these seconds is the inrush current, as far as readings that often show it.
    """
    turns = [(-1, True, False), *((utc_ns, on, on) for utc_ns, on in sorted(switched))]
    steady, rush = [], []
    for reading in readings:
        began_ns, is_on, was_switched_on = next(turn for turn in reversed(turns) if turn[0] <= reading.utc_ns)
        if was_switched_on and reading.utc_ns - began_ns <= settle_s * NS_PER_S:
            rush.append(reading.amperes)
        elif is_on:
            steady.append(reading.amperes)
    return PowerUse(math.fsum(steady) / len(steady) if steady else math.nan, max(rush, default=math.nan))


def _power_use(session: SessionData) -> PowerUse:
    switched = (
        (event.utc_ns, event.kind == StationKind.POWER_ON)
        for event in session.events
        if event.kind in (StationKind.POWER_ON, StationKind.POWER_OFF)
    )
    return power_use(session.power, switched, session.station.power.settle_s if session.station.power else 0.0)


def _statuses(status: NDArray[np.uint8]) -> dict[str, int]:
    """Frames (M,) by status; the fault of an external identifier only where there is one."""
    counts = {name.value: int((status == place).sum()) for place, name in enumerate(STATUSES)}
    if not counts[Status.IDENTIFIER_FAULT]:
        del counts[Status.IDENTIFIER_FAULT]
    return counts


def _answers_of_frames(session: SessionData, counted: CountedFrames) -> SubjectAnswers:
    frames, given = session.frames.columns, session.external_counts
    columns = {axis.column: frames[axis.column] for axis in ALL_AXES}
    columns |= {name: frames[name] for name in ("ra_deg", "de_deg")}
    return SubjectAnswers(
        columns,
        counted,
        frames["elapsed_us"] / 1e3,
        np.where(frames["host_utc_ns"] > 0, (frames["host_utc_ns"] - frames["utc_ns"]) / 1e6, np.nan),
        session.subject is Subject.SENSOR or 0 < given.answers == given.own_times,
    )


def _answers_of_sensor(own: SensorAnswers, counted: CountedFrames) -> SubjectAnswers:
    columns = {axis.column: getattr(own, axis.column) for axis in ALL_AXES}
    columns |= {"ra_deg": own.ra_deg, "de_deg": own.de_deg}
    return SubjectAnswers(columns, counted, own.latency_ms, own.arrival_ms, time_is_stated=True)


def _spatial(session: SessionData, counted: CountedFrames) -> tuple[SpatialErrors, SpatialErrors] | None:
    """Of the counted frames; of a long session evenly spaced ones."""
    matches, camera = session.frames.matches, session.station.sensor.camera()
    part = thinned(matches.compress(counted.used[matches["frame"]]), _MOST_STAR_ERRORS)
    if not len(part):
        return None
    xy_px = xy_px_of(part)
    return spatial_errors(part, camera.directions(xy_px), (camera.columns, camera.rows))
