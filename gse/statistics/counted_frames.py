"""Which frames of a session count, decided once for statistics, false answers and plots.

An answer that was given is judged wherever its time and truth are known, whatever the sky. What is left out, and what
that excuses, is the table of gse.statistics.excuses: sky and link excuse an answer that is absent, never one that is
wrong.

A false answer is one number, ``limits.false_arcsec``. Where the reference identifier has an attitude for the same
panorama, it decides: a false boresight differs from it by more than that, or most of the stars are others
(gse.station.frame_processor). Else truth decides, widened by what its own uncertainty and an uncertain time explain.
An error that all confirmed answers share is that of mount, clock or site, not of an answer: truth is turned by it
first. Where no reference answers in the whole session, nothing independent tells such an error from one of the
subject: then truth decides alone for up to half of the answers. Beyond that the error of most answers is taken as
shared, and the rows of the accuracy show it.

A panorama may itself be of another sky than the mount's. Then the reference identifier confirms what lies degrees from
truth, and the answer is false all the same, unless such panoramas are the rule.

In orbit there is no truth (``subject: sensor``): there a false answer is one that far from a smooth path through its
neighbours (gse.statistics.smooth_path).
"""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gse.station.columns import ANSWER_CHECKS, STATUSES
from gse.station.exclusions import Cause, Exclusion, excluded
from gse.station.frame_columns import Columns
from gse.station.host_clock import clock_steps, first_rows
from gse.station.own_answers import SensorAnswers, by_other_stars_arcsec
from gse.station.results import AnswerCheck, Status, Subject
from gse.station.session_data import SessionData
from gse.statistics.availability import never_sent
from gse.statistics.clock_health import clock_health
from gse.statistics.decision import Claim
from gse.statistics.excuses import excusing, left_out
from gse.statistics.smooth_path import SmoothPath, smooth_path
from gse.statistics.truth_budget import session_facts, truth_budget
from gse.values.axis import ON_SKY
from gse.values.constants import ARCSEC_PER_RAD, EARTH_RATE_ARCSEC_PER_S

OTHER_SKY_ARCSEC = 3600.0
"""No mount at rest moves by a degree and comes back: a panorama that lies so far off is of another sky."""
_FEWEST_CONFIRMED = 10
"""Fewer answers do not tell what all of them share."""
_ABERRATION_ARCSEC = 20.5
"""By as much a sensor that corrects aberration lies from the reference identifier, which leaves it in."""
_STAR_SIGMAS = 3.0
"""Standard deviations of what another choice of stars makes of a fix: in a low field air lifts each by another."""


@dataclass(frozen=True, slots=True, eq=False)
class CountedFrames:
    """Masks (M,) over the rows of the frame table for the answers of one subject, and the stretches that are left out.

    ``answered`` frames have an answer, which is ``judged`` where the reference identifier or truth can tell whether it
    is ``false``. ``excluded`` ones have no certain time or no truth: they are left out of the statistics of accuracy,
    which ``used`` ones enter. ``expected`` frames must have an answer. Before each frame ``never_came`` (M,) more were
    expected; ``unplaced`` are those that were lost nobody knows when. Where the station file says that there is no
    truth, ``path`` is what a smooth path leaves of the answers, and decides which are false.
    """

    answered: NDArray[np.bool_]
    judged: NDArray[np.bool_]
    false: NDArray[np.bool_]
    excluded: NDArray[np.bool_]
    expected: NDArray[np.bool_]
    never_came: NDArray[np.int64]
    unplaced: int
    used: NDArray[np.bool_]
    exclusions: tuple[Exclusion, ...]
    path: SmoothPath | None = None

    @property
    def frames_expected(self) -> int:
        """How many frames must have an answer, with those that never came."""
        return int(self.expected.sum()) + int(self.never_came.sum()) + self.unplaced

    def uncompared(self) -> Self:
        """The same where the convention of the answers is not known: none of them can be judged."""
        nothing = np.zeros(len(self.used), dtype=bool)
        return replace(self, judged=nothing, false=nothing, used=nothing)

    def frames_of(self, cause: Cause, utc_ns: NDArray[np.int64]) -> int:
        """How many frames at instants (M,) the stretches of one cause leave out."""
        return int(excluded(utc_ns, [item for item in self.exclusions if item.cause is cause]).sum())


def counted_frames(session: SessionData) -> CountedFrames:
    """Decide which frames of a session count for the subject of its frame table."""
    frames = session.frames.columns
    stretches = left_out(session)
    answered = np.asarray(frames["status"] == STATUSES.index(Status.IDENTIFIED))
    check = frames["answer_check"]
    confirmed, refuted = (
        answered & (check == ANSWER_CHECKS.index(one)) for one in (AnswerCheck.CORRECT, AnswerCheck.FALSE)
    )
    excluded_frames = excluded(frames["utc_ns"], excusing(Claim.ACCURACY, stretches))
    absences = excusing(Claim.ABSENCE, stretches)
    expected = ~excluded(frames["utc_ns"], absences)
    crossed = _Crossed(frames["cross_x_arcsec"], frames["cross_y_arcsec"], answered)
    path = smooth_path(session) if session.station.subject and session.subject is Subject.SENSOR else None
    if path is None:
        judged, false = _judged(session, crossed, confirmed, refuted, excluded_frames, stretches)
    else:
        judged = answered & np.isfinite(path.across_arcsec)
        false = judged & (path.across_arcsec > session.station.limits.false_beyond_arcsec)
    used = answered & ~false & ~excluded_frames & np.isfinite(frames["d_de_arcsec"])
    never_came = never_sent(frames)
    unplaced = max(session.panoramas_lost - int(never_came.sum()), 0)
    never_came[after_suspensions(session)] = 0
    for item in absences:
        never_came[1:][_touches(item, frames["utc_ns"])] = 0
    return CountedFrames(
        answered, judged, false, excluded_frames, expected, never_came, unplaced, used, stretches, path
    )


def after_suspensions(session: SessionData) -> list[int]:
    """Rows of the first frame after each time in which the host slept, and not the sensor."""
    steps = clock_steps(session.events)
    rows = first_rows(session.frames.columns["host_utc_ns"], steps)
    return [row for row, step in zip(rows, steps, strict=True) if step.utc_kept and row < len(session.frames)]


def _touches(stretch: Exclusion, utc_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which of the times (M - 1,) between one frame and the next a stretch touches."""
    return np.asarray((utc_ns[1:] >= stretch.from_ns) & (utc_ns[:-1] < stretch.until_ns))


def own_counted(session: SessionData, own: SensorAnswers, counted: CountedFrames) -> CountedFrames:
    """The same for the sensor's own answers beside panoramas."""
    frames, answered = session.frames.columns, own.acquired
    # A panorama of another sky is no authority for an answer that may be right.
    elsewhere = counted.false & (frames["answer_check"] == ANSWER_CHECKS.index(AnswerCheck.CORRECT))
    apart_arcsec = np.where(elsewhere, np.nan, _from_reference_arcsec(own, frames))
    allowed_arcsec = _STAR_SIGMAS * by_other_stars_arcsec(session)
    allowed_arcsec += _ABERRATION_ARCSEC * (session.station.sensor.attitude.aberration == "corrected")
    within_arcsec = session.station.limits.false_beyond_arcsec + allowed_arcsec
    confirmed, refuted = answered & (apart_arcsec <= within_arcsec), answered & (apart_arcsec > within_arcsec)
    crossed = _Crossed(own.cross_x_arcsec, own.cross_y_arcsec, answered)
    # A camera that is stated wrongly turns all panoramas alike: it refutes no answers that truth confirms.
    true = refuted & crossed.known & (crossed.from_arcsec((0.0, 0.0)) <= session.station.limits.false_beyond_arcsec)
    if 2 * true.sum() > answered.sum():
        refuted &= ~true
    judged, false = _judged(session, crossed, confirmed, refuted, counted.excluded, counted.exclusions)
    used = answered & ~false & ~counted.excluded & np.isfinite(own.d_de_arcsec)
    return replace(counted, answered=answered, judged=judged, false=false, used=used)


def _from_reference_arcsec(own: SensorAnswers, frames: Columns) -> NDArray[np.float64]:
    """Separation (M,) of the sensor's boresights from those of the reference identifier; NaN where one is missing."""
    of_sensor, of_reference = (
        _unit(*(np.radians(column) for column in columns))
        for columns in ((own.ra_deg, own.de_deg), (frames["ra_reference_deg"], frames["de_reference_deg"]))
    )
    half_chord = np.sqrt(sum((one - other) ** 2 for one, other in zip(of_sensor, of_reference, strict=True))) / 2
    return np.asarray(2 * ARCSEC_PER_RAD * np.arcsin(np.minimum(half_chord, 1.0)))


def _unit(ra: NDArray[np.float64], de: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    return np.cos(de) * np.cos(ra), np.cos(de) * np.sin(ra), np.sin(de)


@dataclass(frozen=True, slots=True, eq=False)
class _Crossed:
    """How far answers lie from truth along columns and rows (M,), and which frames are ``answered``."""

    x_arcsec: NDArray[np.float64]
    y_arcsec: NDArray[np.float64]
    answered: NDArray[np.bool_]

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which answers (M,) are compared with truth."""
        return np.asarray(self.answered & np.isfinite(self.x_arcsec))

    def median_arcsec(self, among: NDArray[np.bool_]) -> tuple[float, float]:
        """The median of some of them."""
        return float(np.median(self.x_arcsec[among])), float(np.median(self.y_arcsec[among]))

    def from_arcsec(self, turn_arcsec: tuple[float, float]) -> NDArray[np.float64]:
        """How far (M,) they lie from a turn of truth; 0 where that is not known."""
        apart: NDArray[np.float64] = np.hypot(self.x_arcsec - turn_arcsec[0], self.y_arcsec - turn_arcsec[1])
        return np.nan_to_num(apart)


def _judged(
    session: SessionData,
    crossed: _Crossed,
    confirmed: NDArray[np.bool_],
    refuted: NDArray[np.bool_],
    excluded_frames: NDArray[np.bool_],
    stretches: tuple[Exclusion, ...],
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which answers (M,) can be judged, and which are false: by the reference identifier, which confirms or refutes
    them, else by truth."""
    known = crossed.known
    within_arcsec = session.station.limits.false_beyond_arcsec + _by_time_arcsec(session.frames.columns, stretches)
    turn_arcsec = _shared_turn(crossed, known & confirmed & ~excluded_frames)
    checked = confirmed | refuted
    alone = known & ~checked
    if turn_arcsec is None and alone.any():
        turn_arcsec, truth_arcsec = _without_reference(session, crossed, alone & ~excluded_frames, within_arcsec)
        within_arcsec = within_arcsec + truth_arcsec
    apart_arcsec = crossed.from_arcsec(turn_arcsec or (0.0, 0.0))
    by_truth = alone & (apart_arcsec > within_arcsec)
    elsewhere = known & confirmed & (apart_arcsec > np.maximum(within_arcsec, OTHER_SKY_ARCSEC))
    if turn_arcsec is None or not 2 * elsewhere.sum() < (known & confirmed).sum():
        elsewhere = np.zeros_like(known)
    judged = crossed.answered & (checked | (known & np.isfinite(within_arcsec)))
    return np.asarray(judged), np.asarray(refuted | by_truth | elsewhere)


def _shared_turn(crossed: _Crossed, confirmed: NDArray[np.bool_]) -> tuple[float, float] | None:
    """What most of the confirmed answers share; None where they are few, or where no half of them agree."""
    if confirmed.sum() < _FEWEST_CONFIRMED:
        return None
    turn_arcsec = crossed.median_arcsec(confirmed)
    near = crossed.from_arcsec(turn_arcsec)[confirmed] <= OTHER_SKY_ARCSEC
    return turn_arcsec if near.mean() > 0.5 else None


def _without_reference(
    session: SessionData, crossed: _Crossed, known: NDArray[np.bool_], within_arcsec: NDArray[np.float64]
) -> tuple[tuple[float, float], float]:
    """The turn and the uncertainty of truth where no reference identifier answers: those of truth for up to half."""
    clock = clock_health(
        session.clock, session.events, session.frames.columns, stated_error_s=session.clock_error_s
    ).error_bound_s
    budget = truth_budget(session_facts(session, clock_error_s=clock))
    axes = budget.own_axes if len(session.sensor_attitudes) else budget.axes
    truth_arcsec = math.hypot(*(axes[axis.key].expanded_arcsec for axis in ON_SKY))
    if not known.any():
        return (0.0, 0.0), truth_arcsec if math.isfinite(truth_arcsec) else 0.0
    if math.isfinite(truth_arcsec):
        off = crossed.from_arcsec((0.0, 0.0)) > within_arcsec + truth_arcsec
        if 2 * off[known].sum() <= known.sum():
            return (0.0, 0.0), truth_arcsec
    return crossed.median_arcsec(known), 0.0


def _by_time_arcsec(frames: Columns, stretches: tuple[Exclusion, ...]) -> NDArray[np.float64]:
    """How far (M,) an uncertain time moves truth; infinite where the mount was touched, so that there is none."""
    arcsec = np.zeros(len(frames))
    for item in stretches:
        moved_arcsec = math.inf if item.cause is Cause.MOUNT else EARTH_RATE_ARCSEC_PER_S * item.time_error_s
        if moved_arcsec:
            inside = excluded(frames["utc_ns"], [item])
            arcsec[inside] = np.maximum(arcsec[inside], moved_arcsec)
    return arcsec
