"""What a reader of a session must know of, whatever the verdict: when, how long, how much.

Incidents are stretches in which answers jump by more than a limit, are false, a fault is reported, or no frame came. Of
the stretches that are left out it tells how far off the answers in them were.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.station.columns import STATUSES
from gse.station.exclusions import Cause, Exclusion, excluded
from gse.station.frame_columns import Columns
from gse.station.results import Status, Subject
from gse.statistics.availability import LONGEST_S
from gse.statistics.counted_frames import CountedFrames
from gse.values.axis import CROSS_X, CROSS_Y, D_DE, D_RA_COSDE
from gse.values.instant import NS_PER_S
from gse.values.limits import Limits

MOST_OF_A_KIND = 10
"""Stretches of one kind that have a line each; of more there is one line for all of them."""
_BRIDGED_NS, _BRIDGED_FRAMES = 3 * NS_PER_S, 1.5
_PAUSE_STEPS = 10
"""Times the usual time between frames that a pause lasts at least."""
_NUMBERED = 0.5
"""Share of the exposures of a pause whose numbers passed in it, from which on the sensor made them."""
_FRAMES_OF_A_PART, _MOST_PARTS = 600, 60
"""A jump is told against the median of a part of the session: a mount that drifts does not jump."""


@dataclass(frozen=True, slots=True)
class Incident:
    """Frames of a subject from one instant to another, UTC in nanoseconds, and what they show.

    ``stretches`` are more than one where so many are of the kind that they have one line. ``worst_arcsec`` is how far
    the worst answer lies off, NaN where nothing was compared.
    """

    subject: Subject
    from_ns: int
    until_ns: int
    what: str
    frames: int
    stretches: int
    worst_arcsec: float


@dataclass(frozen=True, slots=True)
class AnswersWithin:
    """Answers of a subject in a stretch that is left out, how many of them were compared, and how far they lie off."""

    subject: Subject
    answers: int
    compared: int
    mean_arcsec: float
    worst_arcsec: float


Given = tuple[CountedFrames, Mapping[str, NDArray[np.float64]]]
"""The answers of a subject: which of them count, and their errors by column."""


def answers_within(given: Mapping[Subject, Given], utc_ns: NDArray[np.int64]) -> tuple[tuple[AnswersWithin, ...], ...]:
    """For each stretch that is left out, the answers that were given in it, by subject."""
    stretches = next(iter(given.values()))[0].exclusions
    off_arcsec = {subject: _off_arcsec(columns) for subject, (_, columns) in given.items()}
    found = []
    for item in stretches:
        inside = excluded(utc_ns, (item,))
        all_of = [_within(one, counted.answered & inside, off_arcsec[one]) for one, (counted, _) in given.items()]
        found.append(tuple(one for one in all_of if one.answers))
    return tuple(found)


def _off_arcsec(columns: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """How far (M,) the boresights lie from truth, NaN where that is not known."""
    return np.asarray(np.hypot(columns[CROSS_X.column], columns[CROSS_Y.column]))


def _within(subject: Subject, answered: NDArray[np.bool_], off_arcsec: NDArray[np.float64]) -> AnswersWithin:
    known = off_arcsec[answered & np.isfinite(off_arcsec)]
    mean, worst = (float(known.mean()), float(known.max())) if len(known) else (math.nan, math.nan)
    return AnswersWithin(subject, int(answered.sum()), len(known), mean, worst)


def incidents(
    subject: Subject,
    frames: Columns,
    columns: Mapping[str, NDArray[np.float64]],
    counted: CountedFrames,
    limits: Limits,
) -> Iterator[Incident]:
    """The incidents of one subject, whose errors ``columns`` (M,) hold, in the order of their kinds."""
    order = np.argsort(frames["utc_ns"], kind="stable")
    off_arcsec = _off_arcsec(columns)
    jumps = np.zeros(len(order), dtype=bool)
    used = order[counted.used[order]]
    for axis in (D_RA_COSDE, D_DE):
        errors = columns[axis.column][used]
        jumps[used] |= np.abs(errors - _usual(errors)) > limits.of(axis)
    faults = np.asarray(frames["status"] == STATUSES.index(Status.SENSOR_FAULT))
    kinds = {
        "answers jump by more than a limit": jumps,
        "false answers": counted.false,
        "the sensor reports a fault, or sends impossible values": faults & (subject is Subject.ONBOARD),
    }
    for what, happened in kinds.items():
        yield from _stretches(subject, what, frames["utc_ns"], order[happened[order]], off_arcsec)


def pauses(subject: Subject, frames: Columns, left_out: Iterable[Exclusion]) -> Iterator[Incident]:
    """Times longer than LONGEST_S without a frame, but for those that a lost port or a wrong clock makes."""
    if len(frames) < 3:
        return
    order = np.argsort(frames["utc_ns"], kind="stable")
    utc_ns, numbers = frames["utc_ns"][order], frames["frame_no"][order].astype(np.int64)
    steps_ns = np.diff(utc_ns)
    usual_ns = max(float(np.median(steps_ns)), 1.0)
    known = [item for item in left_out if item.cause in (Cause.LINK, Cause.CLOCK_STEP)]
    found = []
    for row in np.flatnonzero(steps_ns > max(LONGEST_S * NS_PER_S, _PAUSE_STEPS * usual_ns)).tolist():
        from_ns, until_ns = int(utc_ns[row]), int(utc_ns[row + 1])
        if any(item.from_ns <= until_ns and item.until_ns > from_ns for item in known):
            continue
        passed = int(numbers[row + 1] - numbers[row])
        made = passed > _NUMBERED * float(steps_ns[row]) / usual_ns
        why = f"its numbers went on by {passed}: lost on the way, or not recorded" if made else "the sensor made none"
        what = f"no frame came for {_seconds(until_ns - from_ns)} ({why if passed > 0 else 'its numbers begin anew'})"
        found.append(Incident(subject, from_ns, until_ns, what, 0, 1, math.nan))
    if len(found) <= MOST_OF_A_KIND:
        yield from found
    else:
        what = f"no frame came for {_seconds(sum(one.until_ns - one.from_ns for one in found))} in all"
        yield Incident(subject, found[0].from_ns, found[-1].until_ns, what, 0, len(found), math.nan)


def _seconds(duration_ns: int) -> str:
    return f"{duration_ns / NS_PER_S:.1f} s"


def _usual(errors: NDArray[np.float64]) -> NDArray[np.float64]:
    """What is usual about each of the errors (K,): medians of parts of the session, and a line between them."""
    parts = np.array_split(np.arange(len(errors)), min(max(len(errors) // _FRAMES_OF_A_PART, 1), _MOST_PARTS))
    medians = [float(np.median(errors[part])) if len(part) else 0.0 for part in parts]
    return np.asarray(
        np.interp(np.arange(len(errors)), [float(part.mean()) if len(part) else 0.0 for part in parts], medians)
    )


def _stretches(
    subject: Subject, what: str, utc_ns: NDArray[np.int64], rows: NDArray[np.int64], off_arcsec: NDArray[np.float64]
) -> Iterator[Incident]:
    """Incidents of a kind that happened in some rows (K,), in the order of time."""
    if not len(rows):
        return
    steps_ns = np.diff(np.sort(utc_ns))
    bridged_ns = max(_BRIDGED_NS, _BRIDGED_FRAMES * float(np.median(steps_ns))) if len(steps_ns) else _BRIDGED_NS
    parts = np.split(rows, np.flatnonzero(np.diff(utc_ns[rows]) > bridged_ns) + 1)
    for part in parts if len(parts) <= MOST_OF_A_KIND else [rows]:
        off = off_arcsec[part][np.isfinite(off_arcsec[part])]
        yield Incident(
            subject,
            int(utc_ns[part[0]]),
            int(utc_ns[part[-1]]),
            what,
            len(part),
            1 if len(parts) <= MOST_OF_A_KIND else len(parts),
            float(off.max()) if len(off) else math.nan,
        )
