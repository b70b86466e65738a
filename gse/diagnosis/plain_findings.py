"""Plain findings: what events, counts and rates of a session say by themselves, without a model of its errors."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkEvent, LinkKind
from gse.diagnosis.late_frames import CRYSTAL_PPM
from gse.diagnosis.misplaced_stars import ENTER_CAMERA, FALLEN_OUT_SHARE
from gse.station.columns import SKY_CONDITIONS, STATUSES
from gse.station.events import ClockStep, Finding, StationKind
from gse.station.exclusions import Cause, after_restart, excluded, leapt_clock
from gse.station.frame_columns import Columns
from gse.station.host_clock import clock_steps, first_rows
from gse.station.results import SkyCondition, Status, Subject
from gse.station.session_data import SessionData
from gse.station.session_tables import residuals_of
from gse.station.sky_condition import FEWEST_UNMATCHED, MOON_GLARE_DEG, SUN_LIMIT_DEG
from gse.statistics.counted_frames import CountedFrames
from gse.statistics.excuses import BY_MOON, air_in_field, only_reference_answers
from gse.statistics.session_statistics import Statistics
from gse.statistics.slopes import slope_within
from gse.values.constants import ARCSEC_PER_RAD, ARCSEC_RAD, EARTH_RATE_ARCSEC_PER_S
from gse.values.instant import NS_PER_S, to_text
from gse.values.text import count_text, percent

# Panoramas that show the same objects on the same pixels while the sky moves: a sensor whose picture is frozen.
#
# The link detects repeated frames with one time tag (FROZEN); this sensor counts on and sends its last picture again.
# Errors then grow with the Earth's turn, which looks like a driven mount or a mount that moves.

_FEWEST = 5
_LEAST_MOVED_PX = 2.0
"""Whole pixels of a star stay the same while the sky moves by one: by two, none does. So with other units of places."""
_OFTEN_REPEATED, _MOST_PLACES = 0.2, 10_000


def still_panoramas(session: SessionData) -> Finding | None:
    """The longest run of them, where the sky moved by some pixels meanwhile; None of a sensor that follows the sky."""
    frames, station = session.frames.columns, session.station
    rows, place = np.unique(session.frames.matches["frame"], return_inverse=True)
    if station.mount.inertial is not None or len(rows) < _FEWEST:
        return None
    pictures = _pictures(session.frames.matches, place)
    first, last = _longest_run(rows, pictures)
    camera = station.sensor.camera()
    declination = math.radians(float(np.nan_to_num(frames["de_true_deg"][rows[first]])))
    across = max(math.cos(declination), camera.diagonal_rad / 2)  # at the pole the field turns about its middle
    px_per_s = EARTH_RATE_ARCSEC_PER_S * across / (camera.pixel_rad * ARCSEC_PER_RAD)
    seconds = float(frames["utc_ns"][rows[last]] - frames["utc_ns"][rows[first]]) / NS_PER_S
    moved_px = px_per_s * seconds
    if last - first + 1 < _FEWEST or moved_px < _LEAST_MOVED_PX:
        step_px = px_per_s * float(np.median(np.diff(frames["utc_ns"][rows]))) / NS_PER_S
        return _repeated(rows, pictures, step_px, _unit_px(session.frames.matches))
    return Finding(
        "frozen sensor",
        f"{last - first + 1} panoramas in a row show the same objects on the same pixels, for {seconds:.0f} s in which "
        f"the sky moves by {moved_px:.0f} px; their time tags go on",
        ("a sensor that looks at a picture, not at the sky",),
        "switch the sensor off and on: it repeats one picture; ask the maker",
    )


def _repeated(rows: NDArray[np.int64], pictures: NDArray[np.float64], step_px: float, unit_px: float) -> Finding | None:
    """That many panoramas repeat the one before, where the sky moves on by some units of the places meanwhile."""
    copies = int(((pictures[1:] == pictures[:-1]).all(axis=1) & (np.diff(rows) == 1)).sum())
    is_often = copies >= max(_FEWEST, _OFTEN_REPEATED * len(rows)) and len(rows) - copies >= _FEWEST
    if not is_often or step_px < _LEAST_MOVED_PX * unit_px:
        return None
    return Finding(
        "repeated panoramas",
        f"{copies} of {count_text(len(rows), 'panorama')} show each star exactly where the one before shows it, while "
        f"the sky moves by {step_px:.2f} px; their time tags go on",
        ("a sensor that sends faster than it exposes",),
        "ask for panoramas at the rate of its exposures; the answers of the others are older than their time tags",
    )


def _unit_px(matches: NDArray[np.void]) -> float:
    """The smallest step of the places, as the wire has them."""
    fractions = np.unique(matches["x_px"][:_MOST_PLACES].astype(np.float64) % 1)
    return float(np.diff(fractions).min()) if len(fractions) > 1 else 1.0


def _pictures(matches: NDArray[np.void], place: NDArray[np.int64]) -> NDArray[np.float64]:
    """Number and sums of the places (L, 3) of the stars of each frame, the same where the stars are the same."""
    x, y = matches["x_px"].astype(np.float64), matches["y_px"].astype(np.float64)
    return np.column_stack([np.bincount(place, weights=part) for part in (np.ones(len(place)), x, y)])


def _longest_run(rows: NDArray[np.int64], pictures: NDArray[np.float64]) -> tuple[int, int]:
    """First and last place of the longest run of equal pictures of frames that follow each other."""
    changes = (pictures[1:] != pictures[:-1]).any(axis=1) | (np.diff(rows) > 1)
    edges = np.concatenate([[0], np.flatnonzero(changes) + 1, [len(rows)]])
    longest = int(np.diff(edges).argmax())
    return int(edges[longest]), int(edges[longest + 1]) - 1


# Faults of the sensor's time tags: tags that stand still, leap, or run fast or slow for a while.

_UNITS_US = (("1 us", 1.0), ("10 us", 10.0), ("100 us", 100.0), ("1 ms", 1e3), ("10 ms", 1e4), ("1/256 s", 1e6 / 256))

LEAP_S = 0.5
"""A tag that is ahead of the host by this much more than in the frame before, though no frame is missing, has leapt."""

_FEWEST_STUCK = 3
_OFTEN_STUCK = 0.1
"""Share of frames with a stuck time tag from which on no cause is named: their instants are not known."""
_RATE_FRAMES = 40
_RATE_OFF = 0.05
"""A share that no oscillator is off by."""
_HALVES = 20
"""Frames wait for no more than so many halves of a stretch."""
_SIGMAS = 5.0
_MAD, _OF_MEDIAN = 1.4826, 1.2533
"""Standard deviation of normal numbers in their median deviation, and error of their median in that of their mean."""


def time_tag_faults(frames: Columns, events: Sequence[LinkEvent]) -> tuple[str, ...]:
    """A line for each kind of fault in frames (rows of FRAME, as they came); without host times leaps and restarts."""
    if len(frames) < 3 or not (frames["host_utc_ns"] > 0).all():
        left_out = (*leapt_clock(frames), *after_restart(events, frames))
        return tuple(f"sensor time tag: {item.reason}" for item in left_out)
    return (*_stuck(frames), *_leaps(frames, events), *_rate(frames))


def often_stand_still(frames: Columns) -> bool:
    """Whether so many tags stood still that the instants of the frames (rows of FRAME) tell no cause."""
    return len(frames) >= _FEWEST_STUCK and _still(frames) > _OFTEN_STUCK * len(frames)


def _still(frames: Columns) -> int:
    """In how many frames the tag stood still while the host's clock went on."""
    tags_us = frames["time_us"].astype(np.int64)
    host_ns = np.diff(frames["host_utc_ns"])
    return int(((np.diff(tags_us) == 0) & (host_ns > np.median(host_ns) / 2)).sum())


def _stuck(frames: Columns) -> Iterator[str]:
    if (still := _still(frames)) >= _FEWEST_STUCK:
        yield f"sensor time tag: it stood still in {still} frames while the host's clock went on"


def _leaps(frames: Columns, events: Sequence[LinkEvent]) -> Iterator[str]:
    tags_s: NDArray[np.float64] = np.diff(frames["time_us"].astype(np.float64)) / 1e6
    host_s: NDArray[np.float64] = np.diff(frames["host_utc_ns"] - frames["host_utc_ns"][0]).astype(np.float64) / 1e9
    numbers = np.maximum(np.diff(frames["frame_no"].astype(np.int64)), 1)
    ahead_s: NDArray[np.float64] = tags_s - host_s
    leaps = (tags_s > 0) & (ahead_s > LEAP_S + 1.5 * np.median(tags_s) * numbers)
    for row in first_rows(frames["host_utc_ns"], clock_steps(events)):
        leaps[row - 1 : row] = False
    rows = np.flatnonzero(leaps)
    if len(rows):
        first = int(rows[0])
        when = to_text(int(frames["host_utc_ns"][first + 1]), 1)
        more = f", and {len(rows) - 1} times more" if len(rows) > 1 else ""
        yield f"sensor time tag: it leapt by {ahead_s[first]:+.2f} s at {when}{more}"


def _rate(frames: Columns) -> Iterator[str]:
    """The stretch of frames in which tags were fastest or slowest against the host's clock, if by far too much."""
    tags_s: NDArray[np.float64] = np.diff(frames["time_us"].astype(np.float64)) / 1e6
    host_s: NDArray[np.float64] = np.diff(frames["host_utc_ns"] - frames["host_utc_ns"][0]).astype(np.float64) / 1e9
    regular = np.flatnonzero((tags_s > 0) & (host_s > np.median(host_s) / 2))
    blocks = regular[: len(regular) // _RATE_FRAMES * _RATE_FRAMES].reshape(-1, _RATE_FRAMES)
    if not len(blocks):
        return
    off = _off(tags_s[blocks] / host_s[blocks])
    # An adapter that hands over its bytes in groups gives several frames one stamp, and others the double time: over
    # the whole stretch its stamps are right.
    ends = blocks[:, [0, -1]] + [0, 1]
    sensor_s, watched_s = (np.diff(times[ends], axis=1)[:, 0] for times in (_since(tags_s), _since(host_s)))
    whole = sensor_s / np.maximum(watched_s, 1e-9) - 1
    off = np.where(np.abs(whole) < np.abs(off), whole, off)
    # Frames that wait in a queue, and come together afterwards, bring tags that are right: what waited least before and
    # after the stretch has lost or gained nothing. A clock that ran away stays away.
    least_s = (_since(host_s) - _since(tags_s))[blocks.reshape(2 * len(blocks), -1)].min(axis=1)
    for worst in np.argsort(-np.abs(off), kind="stable").tolist():
        if abs(off[worst]) <= _RATE_OFF:
            return
        middle = 2 * worst + 1
        before_s, after_s = least_s[max(middle - _HALVES, 0) : middle].min(), least_s[middle : middle + _HALVES].min()
        if abs(before_s - after_s) > _RATE_OFF / 4 * sensor_s[worst]:
            when = to_text(int(frames["host_utc_ns"][blocks[worst, 0]]), 1)
            how = "fast" if off[worst] > 0 else "slow"
            yield f"sensor time tag: it ran {percent(abs(off[worst]), 0)} {how} from {when}"
            return


def _since(steps_s: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.concatenate([[0.0], np.cumsum(steps_s)])


def _off(rates: NDArray[np.float64]) -> NDArray[np.float64]:
    """By how much the median of each row of rates (K, N) is off (K,), zero where their jitter explains it."""
    median = np.median(rates, axis=1)
    deviation = np.median(np.abs(rates - median[:, None]), axis=1)
    error = _OF_MEDIAN * _MAD * deviation / math.sqrt(rates.shape[1])
    return np.where(np.abs(median - 1) > _SIGMAS * error, median - 1, 0.0)


# Focus over a session: single stars that scatter more and more about their places, though they stay as bright.

LEAST_RATIO = 1.5
_LEAST_SIGMAS = 5.0
_FEWEST_STARS, _FEWEST_ROWS = 6, 200
_HIDDEN_PX = 0.1
"""Residuals that are smaller by chance have no logarithm of use."""
_AS_BRIGHT = 0.75
"""Least transparency, as a share of that at the beginning; stars behind a cloud are faint, and scatter more for that
reason."""


@dataclass(frozen=True, slots=True)
class FocusLoss:
    """Scatter of single stars along one axis in the first and in the last quarter of a session."""

    first_px: float
    last_px: float


def focus_loss(session: SessionData, counted: CountedFrames) -> FocusLoss | None:
    """None where the scatter does not grow, or the stars fade; from the same stars, so that fainter ones do no harm."""
    frames, matches = session.frames.columns, session.frames.matches
    matches = matches.compress(counted.used[matches["frame"]])
    if len(matches) < _FEWEST_ROWS or _fades(frames["transparency"][counted.used]):
        return None
    pixel_arcsec = session.station.sensor.camera().pixel_rad * ARCSEC_PER_RAD
    residuals = np.array([matches["residual_x_arcsec"], matches["residual_y_arcsec"]], dtype=np.float64) / pixel_arcsec
    squares = (residuals**2).mean(axis=0)
    utc_ns = frames["utc_ns"][matches["frame"]]
    at = (utc_ns - utc_ns.min()) / max(int(np.ptp(utc_ns)), 1)
    found = slope_within(at, np.log(squares + _HIDDEN_PX**2), matches["star"], _FEWEST_STARS)
    parts = squares[at < 1 / 4], squares[at >= 3 / 4]
    if found is None or not found[0] > _LEAST_SIGMAS / 1.96 * found[1] or not all(len(part) for part in parts):
        return None
    first_px, last_px = (math.sqrt(float(part.mean())) for part in parts)
    return FocusLoss(first_px, last_px) if last_px >= LEAST_RATIO * first_px else None


def focus_finding(loss: FocusLoss) -> Finding:
    """It in words."""
    return Finding(
        "defocus",
        f"single stars scatter by {loss.last_px:.2f} px in the last quarter of the session, by {loss.first_px:.2f} px "
        "in the first, and are as bright as before",
        ("seeing that grows", "a vibration that smears single stars"),
        "look at focus and temperature of the lens, and repeat the session",
    )


def _fades(transparency: NDArray[np.float32]) -> bool:
    transparency = transparency[np.isfinite(transparency)]
    part = max(len(transparency) // 4, 1)
    return bool(len(transparency)) and bool(
        np.median(transparency[-part:]) < _AS_BRIGHT * np.median(transparency[:part])
    )


_FEWEST_DRIFTING = 10
_ENOUGH = 2
"""Times the stars that an answer needs: a catalogue that holds so many of the field is not short of stars."""
_EQUALS_OF_EVENT: dict[str, tuple[str, ...]] = {
    StationKind.WRONG_CAMERA: ("distortion of the lens",),
    StationKind.MIRRORED: ("x and y exchanged (in the protocol description, or by the sensor)",),
}


def event_findings(session: SessionData, named: set[str]) -> Iterator[Finding]:
    """What events say that no named cause says already."""
    kinds = {event.kind: event for event in session.events if not _kept_utc(event)}
    if stood_still := next(filter(_kept_utc, session.events), None):
        remedy = "keep this computer awake during a session, with its settings or systemd-inhibit"
        yield Finding("monotonic clock", stood_still.text, (), remedy)
    if StationKind.MIRRORED in kinds:
        kinds.pop(StationKind.WRONG_CAMERA, None)
    if away_s := ran_away_s(session):
        kinds.pop(StationKind.CLOCK_STEP)
        if "clock drift" not in named:
            size = f"the host's UTC clock ran away from its monotonic one by {away_s:+.3f} s, a little with each frame"
            yield Finding("clock drift", size, (), "see whether the clock is synchronised: gse preflight")
    known = (
        (StationKind.WRONG_DETECTOR, "detector size", ENTER_CAMERA),
        (StationKind.CLOCK_STEP, "clock step", "synchronise the clock before the session: gse preflight"),
        (
            StationKind.MIRRORED,
            "mirrored image",
            "turn sensor.mirrored over in the station file: gse calibrate SESSION",
        ),
        (
            StationKind.WRONG_CAMERA,
            "focal length",
            ENTER_CAMERA,
        ),
        (
            LinkKind.NOT_RUN,
            "station stopped",
            "stop no session (kill -STOP), and keep heavy work off this computer",
        ),
        (
            LinkKind.LINE_FULL,
            "full line",
            "raise the baud rate of the sensor and port.baudrate, or let the sensor send less",
        ),
        (
            StationKind.TRANSLATED,
            "translated bytes",
            "switch off the setting that it names (stty raw, a raw mode of the bridge) and repeat the session",
        ),
        (StationKind.NO_STATION, "station file", "give the right one: gse report SESSION --station FILE"),
        (StationKind.SEQUENCE_CHAOS, "sequence numbers", "see what the link brings: gse decode SESSION --explain"),
        (
            StationKind.FROZEN,
            "frozen sensor",
            "switch the sensor off and on: it repeats one panorama",
        ),
    )
    for kind, cause, following in known:
        if kind in kinds and cause not in named:
            yield Finding(cause, kinds[kind].text, _EQUALS_OF_EVENT.get(kind, ()), following)


def _kept_utc(event: LinkEvent) -> bool:
    """Whether it is a step of the monotonic clock alone: the host was suspended, or that clock began anew."""
    return isinstance(event, ClockStep) and event.utc_kept


def ran_away_s(session: SessionData) -> float:
    """The sum of the steps of the host's clock, where most frames have one and all go one way; else 0."""
    steps_ns = [event.step_ns for event in session.events if isinstance(event, ClockStep) and not event.utc_kept]
    is_drift = len(steps_ns) > _FEWEST_DRIFTING + len(session.frames.columns) // 2
    same_way = len({step_ns > 0 for step_ns in steps_ns}) == 1
    return sum(steps_ns) / NS_PER_S if is_drift and same_way else 0.0


def nothing_identified(session: SessionData) -> Iterator[Finding]:
    """By the identifier under test, in a whole session by night."""
    status = session.frames.columns["status"]
    no_match = int((status == STATUSES.index(Status.NO_MATCH)).sum())
    kinds = {event.kind for event in session.events}
    is_day = StationKind.DAYLIGHT in kinds and StationKind.DARK_NIGHT not in kinds
    if is_day or kinds & {StationKind.WRONG_CAMERA, StationKind.MIRRORED, StationKind.WRONG_DETECTOR}:
        return
    identified = bool((status == STATUSES.index(Status.IDENTIFIED)).any())
    failed = int((status == STATUSES.index(Status.IDENTIFIER_FAULT)).sum())
    if 2 * failed > len(status) and not identified:
        yield _only_failures(failed, len(status))
    elif only_reference_answers(session):
        yield _without_answer(session)
    elif no_match and not identified:
        yield Finding(
            "nothing identified",
            f"not one of {count_text(no_match, 'panorama')} with enough objects was identified, with no focal length "
            "within 25 % of the stated one, nor mirrored: most objects are not stars, or sensor.rows, columns or "
            "optics are others",
            ("an overcast sky with lamps or the Moon behind it", "a distortion of the lens by several pixels"),
            "look at the panoramas: gse view SESSION; check the sensor section of the station file",
        )


# The Moon in the field, or near its edge: its glare hides stars and makes objects that are none.

_FEWEST_ABSENT, _FEWEST_AWAY = 5, 20
_TIMES_AWAY = 3.0
"""Answers are missing so much more often near the Moon than away from it."""
_FEWEST_HIDDEN, _HIDDEN_SHARE = 3, 0.5
"""Fewer stars too few, or false objects, are those of any night; more than where answers come, or half of all stars."""


def moon_near(session: SessionData, stats: Statistics) -> Iterator[Finding]:
    """That answers are missing where the Moon was in the field; or near it, if they are not missing elsewhere.

    What is left out because of a cloud or the Sun says nothing of it.
    """
    own, left_out = stats.own, [item for item in stats.counted.exclusions if item.cause is Cause.NO_SKY]
    frames, radius_deg = session.frames.columns, math.degrees(session.station.sensor.camera().diagonal_rad) / 2
    known = (frames["sun_altitude_deg"] <= SUN_LIMIT_DEG) & np.isfinite(frames["stars_expected"])
    known &= frames["sky_condition"] != SKY_CONDITIONS.index(SkyCondition.CLOUDED)
    known &= ~excluded(frames["utc_ns"], [item for item in left_out if not item.reason.startswith(BY_MOON)])
    absent = {session.subject: frames["status"] != STATUSES.index(Status.IDENTIFIED)}
    if own is not None:
        absent[Subject.SENSOR] = own.sent & ~own.acquired
    up = known & (frames["moon_altitude_deg"] > 0)
    for reach_deg in (radius_deg, radius_deg + MOON_GLARE_DEG):
        near = up & (frames["moon_separation_deg"] < reach_deg)
        needs_others = reach_deg > radius_deg
        if counts := [
            f"{int((near & missing).sum())} of {int((known & missing).sum())} frames without an answer of {subject}"
            for subject, missing in absent.items()
            if _by_moon(session, near, known & ~near, missing, needs_others=needs_others)
        ]:
            yield _moon_finding(frames, near & np.any(list(absent.values()), axis=0), radius_deg, " and ".join(counts))
            return


def _by_moon(
    session: SessionData,
    near: NDArray[np.bool_],
    away: NDArray[np.bool_],
    missing: NDArray[np.bool_],
    *,
    needs_others: bool,
) -> bool:
    """Whether answers are missing near the Moon, more often than away from it, and the objects show its glare."""
    frames, rows = session.frames.columns, near & missing
    if rows.sum() < _FEWEST_ABSENT or missing[near].mean() <= 1 - session.station.limits.availability:
        return False
    has_others = away.sum() >= _FEWEST_AWAY
    if needs_others and not has_others:
        return False
    if has_others and missing[near].mean() < _TIMES_AWAY * missing[away].mean():
        return False
    if (frames["objects"][rows] > 0).mean() <= 0.5:  # a cap, a cover
        return False
    hidden, false = _glare(frames, rows)
    answered = (near | away) & ~missing
    if answered.sum() >= _FEWEST_AWAY:
        usually_hidden, usually_false = _glare(frames, answered)
        return max(hidden - usually_hidden, false - usually_false) >= _FEWEST_HIDDEN
    return false >= _FEWEST_HIDDEN or hidden >= _HIDDEN_SHARE * float(np.median(frames["stars_expected"][rows]))


def _glare(frames: Columns, rows: NDArray[np.bool_]) -> tuple[float, float]:
    """How many expected stars are not seen in some frames, and how many objects are none of them: medians."""
    seen = frames["stars_seen"][rows].astype(np.float64)
    return float(np.median(frames["stars_expected"][rows] - seen)), float(np.median(frames["objects"][rows] - seen))


def _moon_finding(frames: Columns, rows: NDArray[np.bool_], radius_deg: float, counts: str) -> Finding:
    off_deg, altitude_deg = frames["moon_separation_deg"][rows], frames["moon_altitude_deg"][rows]
    objects, seen, expected = (
        float(np.median(frames[name][rows])) for name in ("objects", "stars_seen", "stars_expected")
    )
    is_inside = np.median(off_deg) < radius_deg
    return Finding(
        "the Moon",
        f"it was {'in' if is_inside else 'near'} the field in {counts}: {off_deg.min():.1f} to {off_deg.max():.1f} deg "
        f"from the boresight (the corners of the field are {radius_deg:.1f} deg from it), {altitude_deg.min():.0f} to "
        f"{altitude_deg.max():.0f} deg up; {seen:.0f} of {expected:.0f} expected stars are seen there, and "
        f"{max(objects - seen, 0):.0f} of {objects:.0f} objects are none",
        ("a fault that came at the same time",),
        "point the sensor away from the Moon, or repeat the session when it is down: gse preflight says when",
    )


def _only_failures(failed: int, panoramas: int) -> Finding:
    """An external identifier that never answers: nothing follows on the sky or the sensor."""
    return Finding(
        "identifier fails",
        f"the external identifier failed on {failed} of {panoramas} panoramas, and identified none",
        (),
        "see what the external identifier wrote to stderr: gse session export SESSION --format stderr",
    )


def _without_answer(session: SessionData) -> Finding:
    """The sky is there: the identifier under test knows too few of its stars, or they lie elsewhere."""
    status = session.frames.columns["status"]
    answered = int((status == STATUSES.index(Status.IDENTIFIED)).sum())
    size = f"the identifier under test answers {answered or 'none'} of {len(status)} panoramas; the reference "
    if air := air_in_field(session):
        return Finding(
            "identifier without an answer",
            f"{size}identifier does: {air}, and it knows no air",
            ("a fault of the identifier",),
            "point the sensor higher, or let it allow more (identifier.tolerance_px)",
        )
    tolerance_px = session.station.identifier.tolerance_px
    if (scatter_px := _scatter_px(session)) > _MOST_SCATTER * tolerance_px:
        return Finding(
            "centroid noise",
            f"{size}identifier does; single stars scatter by {scatter_px:.1f} px about their places, and "
            f"identifier.tolerance_px is {tolerance_px:g}",
            ("seeing", "a fault of the identifier"),
            "see to focus and exposure; or raise identifier.tolerance_px, then: gse report SESSION --station FILE",
        )
    seen, expected, objects = (
        float(np.median(session.frames.columns[name])) for name in ("stars_seen", "stars_expected", "objects")
    )
    known = f", of which its catalogue holds {expected:.0f}" if 0 <= expected < seen else ""
    known += f"; {objects - seen:.0f} of {objects:.0f} objects are none of them" if objects > seen else ""
    equals = ["a fault of the identifier"]
    has_enough = min(expected, seen) >= _ENOUGH * session.station.identifier.min_fit
    if has_enough or objects - seen >= max(FEWEST_UNMATCHED, FALLEN_OUT_SHARE * seen):
        equals.append("a distortion of the lens, or a principal point that is not as stated: gse calibrate SESSION")
    is_external = session.station.identifier.algorithm == "external"
    more_stars = "a catalogue of its own with more stars" if is_external else "more stars (identifier.catalog_stars)"
    return Finding(
        "identifier without an answer",
        f"{size}identifier does, and {seen:.0f} stars of the sky are in each{known}",
        tuple(equals),
        f"let it know {more_stars}, and try: gse report SESSION --station FILE",
    )


_MOST_SCATTER = 0.5
"""Share of the tolerance: a distance of two stars that scatter by so much each is beyond it in one of six times."""


def _scatter_px(session: SessionData) -> float:
    """By how much each star scatters about its own mean place, an axis; zero where no star is seen often.

    A star that lies off by as much in all frames, as by a distortion, does not scatter.
    """
    matches = session.frames.matches
    if not len(matches):
        return 0.0
    _, star, sightings = np.unique(matches["star"], return_inverse=True, return_counts=True)
    residuals = residuals_of(matches)
    means = np.column_stack([np.bincount(star, part) for part in residuals.T]) / sightings[:, None]
    freedom = 2 * float((sightings - 1).sum())
    scatter = math.sqrt(float(((residuals - means[star]) ** 2).sum()) / max(freedom, 1.0))
    return scatter * ARCSEC_RAD / session.station.sensor.camera().pixel_rad


_DAY_DEG = 1.0
"""A Sun that is no higher may stand behind a hill, or be lifted by air."""
_FEWEST_BY_DAY = 5


def stars_by_day(session: SessionData, counted: CountedFrames) -> Iterator[Finding]:
    """Stars that are named though the Sun is up: both cannot be, but before a star simulator or an emulator."""
    frames = session.frames.columns
    is_test = any(event.kind == StationKind.TEST_STREAM for event in session.events)
    if is_test or not session.station.is_under_sky:
        return
    seen = counted.answered & ~counted.false & ~counted.excluded & (frames["sun_altitude_deg"] > _DAY_DEG)
    if seen.sum() < _FEWEST_BY_DAY:
        return
    sun_deg = float(np.median(frames["sun_altitude_deg"][seen]))
    yield Finding(
        "stars by day",
        f"stars are identified in {count_text(int(seen.sum()), 'frame')} though the Sun stands {sun_deg:.0f} deg above "
        "the horizon, by this clock and site",
        ("a clock, a date or a site that is wrong, which a fitted mount hides", "an emulator, a screen or a recording"),
        "check clock and site: gse preflight; before a star simulator state mount.inertial",
    )


def faulty_panoramas(session: SessionData, counted: CountedFrames) -> Iterator[Finding]:
    """Where more than half of the panoramas are, or more of those that are expected than may be without an answer."""
    faulty = session.frames.columns["status"] == STATUSES.index(Status.SENSOR_FAULT)
    count, missed = int(faulty.sum()), int((faulty & counted.expected).sum())
    if 2 * count > len(faulty):
        yield Finding(
            "faulty panoramas",
            f"{count} of {len(faulty)} panoramas cannot be: the sensor reports a fault, a value is not a number (a "
            "place, an index value, the temperature), or an index value is too great, negative, or the same for all "
            "objects, so that no object is the brightest",
            ("a protocol description that reads index or x and y from the wrong bytes",),
            "read what was sent: gse decode SESSION --explain",
        )
    elif missed > (1 - session.station.limits.availability) * int(counted.expected.sum()):
        yield Finding(
            "faulty panoramas",
            f"in {missed} of {len(faulty)} panoramas the sensor reports a fault, or sends values that cannot be; they "
            "have no answer",
            (),
            "see which fault it reports: gse decode SESSION --explain; ask the maker",
        )


def sensor_clock_drift(stats: Statistics) -> Iterator[Finding]:
    """By more than a crystal may, and than its error."""
    ppm = stats.clock.sensor_drift_ppm
    if abs(ppm) > max(CRYSTAL_PPM, 3 * stats.clock.sensor_drift_error_ppm):
        yield Finding(
            "sensor clock drift",
            f"it runs {abs(ppm):.0f} ppm {'slow' if ppm > 0 else 'fast'} against the host's",
            ("a host's clock that is being slewed",),
            "see the clock: gse preflight; the sensor's own tags are not used for UTC",
        )


def wrapped_tags(session: SessionData) -> Iterator[Finding]:
    """Time tags that begin anew after a round number of their units: a counter that is full, and no restart."""
    tags_us = session.frames.columns["time_us"].astype(np.int64)
    steps_us = np.diff(tags_us)
    back_us = -steps_us[steps_us < 0]
    if not len(back_us) or session.station.mount.inertial is not None:
        return
    usual_us = float(np.median(steps_us[steps_us > 0])) if (steps_us > 0).any() else 0.0
    for bits, unit, unit_us in _COUNTERS:
        full_us = 2**bits * unit_us
        if (np.abs(back_us + usual_us - full_us) <= _WRAP_STEPS * usual_us).all() and full_us > _WRAP_STEPS * usual_us:
            yield Finding(
                "wrapped time tags",
                f"the sensor's time tag began anew {count_text(len(back_us), 'time')}, after {full_us / 1e6:.6g} s: it "
                f"counts {bits} bits of {unit}",
                ("a sensor that starts anew just then",),
                "nothing: the host's stamps tell how often"
                if (session.frames.columns["host_utc_ns"] > 0).all()
                else "record with gse run, whose stamps tell how often; a capture has no times beyond the first one",
            )
            return


_COUNTERS = tuple((bits, unit, of_one_us) for bits in (16, 24, 32) for unit, of_one_us in _UNITS_US)
_WRAP_STEPS = 2.0
"""Times the usual step: the frame at the end of the count may be missing."""


def hot_pixels(session: SessionData) -> Iterator[Finding]:
    """More than the station file lists."""
    count = session.frames.columns["hot_pixels"]
    late = count[len(count) - len(count) // 4 :]  # a pixel is told from a star once the sky has moved
    usual = float(np.median(late)) if len(late) else 0.0
    if usual > len(session.station.sensor.hot_pixels):
        yield Finding(
            "hot pixels",
            f"{usual:.0f} objects of a frame (median) stand still on the detector while the stars move",
            ("dust or a reflex that stands still",),
            "list them in sensor.hot_pixels: gse calibrate SESSION --write FILE",
        )
