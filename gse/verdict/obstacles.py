"""What stands between a session and PASS, though each of its rows may pass.

All of it was left out, or more than a little for clock or link; frames are missing or were not counted; most of it had
no sky; the fitted mount is not the stated one; stars are seen by day; the sensor follows another convention than
stated; the temperature in its STATUS frames is not a number; or no subject has all the rows that PASS needs. None of
it changes a row: what excuses one that fails is in gse.statistics.excuses.

A sensor that leaves panoramas out, falls silent, starts anew or counts without sense hides from the sequence numbers
how many frames are missing. The time between those that came shows it: by the sensor's time tags, and by the host's
stamps where a tag stands still or jumps back. A fault of one clock alone makes no frame missing: the lesser number
counts. A sensor's answer that belongs to no panorama, or is not its last word on one, is compared with nothing.
"""

import math
import re
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from gse.diagnosis.plain_findings import stars_by_day
from gse.station.events import StationKind
from gse.station.exclusions import Cause, excluded
from gse.station.frame_columns import Columns
from gse.station.housekeeping import parameter_differences
from gse.station.own_answers import not_compared
from gse.station.results import Subject
from gse.station.session_data import SessionData
from gse.statistics.availability import LONGEST_S
from gse.statistics.counted_frames import after_suspensions
from gse.statistics.decision import Outcome, Row
from gse.statistics.sensor_convention import is_wrong, to_state, words_of
from gse.statistics.session_statistics import Statistics
from gse.truth import horizon_to_sensor, small_rotations
from gse.values.constants import ARCSEC_PER_RAD
from gse.values.instant import NS_PER_S
from gse.values.matrices import length
from gse.values.mount import Mount, MountUncertainty
from gse.verdict.requirements import REQUIREMENTS

MOST_EXCLUDED_SHARE = 0.02
MOST_EXCLUDED_S = 60.0
"""More than both of a session left out for clock or link decides nothing."""

OTHER_MOUNT_DEG = 1.0
OTHER_MOUNT_HALF_WIDTHS = 1.96 / 3
"""Three standard deviations, in the half-widths of 95 % that a station file states."""

_WINDOW = 15
"""Frames that tell the usual time between two: a sensor may be told to send more or fewer of them."""
_ALIKE = 1.4
"""Where no time is longer than another by this factor, none holds two frames: 1.5 is rounded to two."""
FEW_RESTARTS = 2
"""A sensor that is switched on again, or loses its power for a moment, has an event; one that starts anew again
and again was away."""


NOTHING_COMPARED = "nothing can pass: dRA*, dDE, availability and false answers are needed, and no subject has all"

NO_SKY_WORDS = re.compile(r"no sky in \d+ of \d+ frames|(?:the only frame is|all \d+ frames are) left out: no sky")
"""How a reason begins that says that there was too little sky."""
NO_TRUTH = (
    "no truth: the station file says subject: sensor, so that only availability, noise and jumps of its answers show"
)


def obstacles(session: SessionData, stats: Statistics, rows: tuple[Row, ...]) -> Iterator[str]:
    """A line per reason why a session cannot pass, the gravest first."""
    if session.station.subject is not None:
        yield NO_TRUTH
    left_out = tuple(_all_excluded(stats))
    yield from left_out
    yield from _much_excluded(session, stats)
    yield from _missing_frames(session, stats)
    yield from _answers_not_compared(session, stats)
    if not left_out:
        yield from _little_sky(session, stats)
    yield from _other_mount(session)
    yield from map(str, stars_by_day(session, stats.counted))
    if stats.convention is not None and is_wrong(stats.convention, session.station.sensor.attitude):
        yield (
            "sensor: its answers follow another convention than the station file states, so they were not compared: "
            f"{words_of(stats.convention)}; state {to_state(stats.convention)}"
        )
    yield from _other_sensor(session)
    yield from parameter_differences(session.housekeeping, session.station.test)
    yield from _no_temperature(session)
    yield from (event.text for event in session.events if event.kind == StationKind.SENSOR_CLOCK)
    if session.station.subject is None:
        yield from _untested_core(rows)


def _untested_core(rows: tuple[Row, ...]) -> Iterator[str]:
    """PASS needs the core rows of one subject at least."""
    core = {requirement.name for requirement in REQUIREMENTS if requirement.core}
    tested = [
        {row.name for row in rows if row.subject is subject and row.outcome is not Outcome.NOT_TESTED}
        for subject in {row.subject for row in rows}
    ]
    if not any(core <= names for names in tested):
        yield NOTHING_COMPARED


def _other_sensor(session: SessionData) -> Iterator[str]:
    """What one sensor showed says nothing of another."""
    told = [event for event in session.events if event.kind == StationKind.OTHER_SENSOR]
    if told:
        yield f"{told[0].text}; judge the sensors one by one: 'gse session trim' parts the session"


def _no_temperature(session: SessionData) -> Iterator[str]:
    """A protocol without a temperature has none that could be wrong."""
    invalid = [
        math.isnan(message.temperature_c) and any(problem.startswith("temperature ") for problem in message.problems)
        for _, message in session.statuses
    ]
    if any(invalid):
        yield f"sensor: the temperature in {sum(invalid)} of {len(invalid)} STATUS frames is not a number"


def _all_excluded(stats: Statistics) -> Iterator[str]:
    if stats.frames and not stats.counts_any:
        words = dict.fromkeys(f"{item.cause}: {item.reason}" for item, count in stats.exclusions if count)
        those = "the only frame is" if stats.frames == 1 else f"all {stats.frames} frames are"
        yield f"{those} left out: {'; '.join(list(words)[:3])}"


def _much_excluded(session: SessionData, stats: Statistics) -> Iterator[str]:
    frames_s = stats.duration_s / max(stats.frames - 1, 1)
    utc_ns = session.frames.columns["utc_ns"]
    for cause, what in ((Cause.CLOCK_STEP, "steps of the clock"), (Cause.BACKLOG, "frames read late")):
        count = stats.counted.frames_of(cause, utc_ns)
        if count > MOST_EXCLUDED_SHARE * stats.frames and count * frames_s > MOST_EXCLUDED_S:
            yield f"{count} of {stats.frames} frames are left out for {what}: too many to say anything of the session"


def _little_sky(session: SessionData, stats: Statistics) -> Iterator[str]:
    """No sky and no answer for most of the session, or empty panoramas on which the availability depends."""
    utc_ns, counted = session.frames.columns["utc_ns"], stats.counted
    stretches = [item for item in counted.exclusions if item.cause in (Cause.NO_SKY, Cause.NO_OBJECTS)]
    answered = counted.answered | stats.own_counted.answered if stats.own_counted else counted.answered
    count = int((excluded(utc_ns, stretches) & ~answered).sum())
    words = "; ".join(dict.fromkeys(item.reason for item in stretches[:3]))
    if count > stats.frames / 2:
        yield f"no sky in {count} of {stats.frames} frames: {words}"
        return
    empty = stats.counted.frames_of(Cause.NO_OBJECTS, utc_ns)
    available = stats.onboard.available
    if empty and available.count < session.station.limits.availability * (available.of + empty):
        yield f"availability depends on {empty} frames that show no stars: {words}, or the sensor was blind"


def _other_mount(session: SessionData) -> Iterator[str]:
    """A fitted mount that is not the stated one hides what is gross."""
    stated, alignment = session.station.mount, session.alignment
    if alignment is None or not stated.stated:
        return
    turn = small_rotations(horizon_to_sensor(alignment.mount)[None], horizon_to_sensor(stated))[0]
    apart_deg = math.degrees(length(turn))
    if apart_deg > OTHER_MOUNT_DEG or _beyond_stated(turn, stated):
        apart = f"{apart_deg:.1f} deg" if apart_deg > 0.1 else f"{apart_deg * 3600:.0f} arcsec"
        yield (
            f"the fitted mount is {apart} from the stated one: azimuth {alignment.mount.azimuth_deg:.2f}, "
            f"altitude {alignment.mount.altitude_deg:.2f}, roll {alignment.mount.roll_deg:.2f} deg were fitted; check "
            "the angles, the site and the clock"
        )


def _beyond_stated(turn_rad: NDArray[np.float64], stated: Mount) -> bool:
    """Whether a turn in the sensor frame is more than three of the standard deviations that the station file states.

    Across the boresight the greater of azimuth's and altitude's counts; neither defaults nor a fit are a statement.
    """
    known = stated.uncertainty
    if known == MountUncertainty() or known.fitted:
        return False
    x, y, z = np.abs(turn_rad) * ARCSEC_PER_RAD * OTHER_MOUNT_HALF_WIDTHS
    return bool(math.hypot(x, y) > max(known.azimuth_arcsec, known.altitude_arcsec) or z > known.roll_arcsec)


# What no count covers


def _missing_frames(session: SessionData, stats: Statistics) -> Iterator[str]:
    frames = session.frames.columns
    told = int(stats.counted.never_came.sum()) + stats.counted.unplaced
    pauses = [item for item in stats.counted.exclusions if item.cause in (Cause.OPERATOR, Cause.NO_SKY, Cause.LINK)]
    excused = excluded(frames["utc_ns"], pauses)
    excused[after_suspensions(session)] = True
    for item in pauses:
        later = frames["utc_ns"] >= item.until_ns
        if item.cause is Cause.LINK and later.any():  # no frame came in it: it lies before the next one
            excused[later.argmax()] = True
    untold = missing_by_time(frames, excused) - told
    available = stats.subjects[session.subject].available
    if untold > 0 and available.count < session.station.limits.availability * (available.of + untold):
        yield (
            f"by time {untold} frames are missing that no sequence number tells, so the availability is not known: the "
            "sensor left them out, was silent or started anew; a pause that was meant is left out with --leave-out"
        )


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
