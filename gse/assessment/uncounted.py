"""What no count of a session covers, so that its shares decide nothing: frames that never came, answers to no panorama.

A sensor that leaves panoramas out, falls silent, starts anew or counts without sense hides from the sequence numbers
how many frames are missing. The time between those that came shows it: by the sensor's time tags, and by the host's
stamps where a tag stands still or jumps back. A fault of one clock alone makes no frame missing: the lesser number
counts. A sensor's answer that belongs to no panorama, or is not its last word on one, is compared with nothing.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from gse.instant import NS_PER_S
from gse.station.clock_steps import clock_steps, first_rows
from gse.station.exclusions import Cause, excluded
from gse.station.frame_columns import Columns
from gse.station.results import Subject
from gse.station.session_data import SessionData
from gse.statistics.sensor_answers import not_compared
from gse.statistics.session_statistics import Statistics

_WINDOW = 15
"""Frames that tell the usual time between two: a sensor may be told to send more or fewer of them."""
_ALIKE = 1.4
"""Where no time is longer than another by this factor, none holds two frames: 1.5 is rounded to two."""
LONGEST_S = 60.0
"""A longer time without a frame is a pause of the session, which its events and plots show."""
FEW_RESTARTS = 2
"""A sensor that is switched on again, or loses its power for a moment, has an event; one that starts anew again
and again was away."""


def uncounted(session: SessionData, stats: Statistics) -> Iterator[str]:
    """A line for each share of the session that is open because of what was not counted."""
    yield from _missing_frames(session, stats)
    yield from _answers_not_compared(session, stats)


def _missing_frames(session: SessionData, stats: Statistics) -> Iterator[str]:
    frames = session.frames.columns
    told = session.panoramas_lost
    pauses = [item for item in stats.counted.exclusions if item.cause in (Cause.OPERATOR, Cause.NO_SKY)]
    excused = excluded(frames["utc_ns"], pauses)
    excused[_after_suspensions(session)] = True
    untold = missing_by_time(frames, excused) - told
    available = stats.subjects[session.subject].available
    if untold > 0 and available.count < session.station.limits.availability * (available.of + untold):
        yield (
            f"by time {untold} frames are missing that no sequence number tells, so the availability is not known: the "
            "sensor left them out, was silent or started anew; a pause that was meant is left out with --leave-out"
        )


def _after_suspensions(session: SessionData) -> list[int]:
    """Rows of the first frame after each time in which the host slept, and not the sensor."""
    steps = clock_steps(session.events)
    rows = first_rows(session.frames.columns["host_utc_ns"], steps)
    return [row for row, step in zip(rows, steps, strict=True) if step.utc_kept and row < len(session.frames)]


def missing_by_time(frames: Columns, excused: NDArray[np.bool_] | None = None) -> int:
    """How many frames are missing between those of a table (rows of FRAME, in order of arrival), at their usual rate.

    None is missing beside frames that are ``excused`` (M,), at few restarts, and in pauses longer than LONGEST_S. Where
    the rate changes, some ten may be taken for missing.
    """
    if len(frames) <= _WINDOW:
        return 0
    here = np.ones(len(frames) - 1, dtype=bool) if excused is None else ~(excused[1:] | excused[:-1])
    tags_s: NDArray[np.float64] = np.diff(frames["time_us"].astype(np.float64)) / 1e6
    restarts = tags_s < 0
    if restarts.sum() <= FEW_RESTARTS:
        here &= ~restarts
    if not (frames["host_utc_ns"] > 0).all():
        return _missing(tags_s, here)
    host_s: NDArray[np.float64] = np.diff(frames["host_utc_ns"]) / NS_PER_S
    by_tags = _missing(np.where(tags_s > 0, tags_s, host_s), here)
    return min(by_tags, _missing(host_s, here)) if by_tags else 0


def _missing(seconds: NDArray[np.float64], here: NDArray[np.bool_]) -> int:
    """Whole frames that fit between two that came, by the median time between those about them."""
    if seconds.max() < _ALIKE * seconds.min():
        return 0
    from scipy.ndimage import median_filter  # 40 ms, which a session without a gap need not wait

    usual_s = median_filter(seconds, _WINDOW, mode="nearest")
    known = here & (usual_s > 0) & (seconds <= LONGEST_S)
    return int(np.maximum(np.rint(seconds[known] / usual_s[known]) - 1, 0).sum())


def _answers_not_compared(session: SessionData, stats: Statistics) -> Iterator[str]:
    """More of them than may be false; answers to panoramas that were lost on the way are no fault."""
    if session.subject is Subject.SENSOR:
        return
    count = not_compared(session) - session.link.frames_lost
    given = 0 if stats.own is None else int(stats.own.acquired.sum())
    if count > session.station.limits.false_share * (given + count):
        yield (
            f"sensor: {count} of its answers belong to no panorama, or another answer to the same one followed: they "
            "were compared with nothing, and may be false"
        )
