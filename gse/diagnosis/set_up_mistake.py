"""A mistake of the set-up that explains what a session shows: then its errors tell nothing of the sensor.

The identifier named the right stars, only not where site, clock and mount of the station file say. A row that keeps its
limit once the mistake is taken out does not fail for it: the word is INCONCLUSIVE, and the mistake is the first reason.
A mirrored image or a focal length under which nothing can be identified is one too, a camera with which many stars lie
too far off to be named. Where the reference identifier names no star in the whole session either, sky, station file and
sensor cannot be told apart, and no row of the identifier fails. What the sensor answers itself no camera of the station
file excuses.

A turn that panoramas and reference share with the subject may be that of site, mount, clock or air, as far as nobody
vouches for them; a stated uncertainty, --clock-error and a kernel whose clock is synchronised vouch.

A session that lost its station file is judged on the built-in one, whose limits are not its own: it neither passes nor
fails.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import erfa
import numpy as np
from numpy.typing import NDArray

from gse.config.station import Station
from gse.diagnosis.fine_findings import CLOCK_SCALES
from gse.diagnosis.gross_causes import CORRECT, MOVED_SHARE, angle_text, follows_the_sky, gross_cause_of
from gse.diagnosis.misplaced_stars import STARS_FALL_OUT, stars_fall_out
from gse.diagnosis.moved_mount import SLIP, pointings, shown_frames
from gse.diagnosis.turns import EAST, VERTICAL, about, ahead, level_axis, pole, size_rad, taken_out
from gse.station.columns import ANSWER_CHECKS, STATUSES
from gse.station.events import Finding, StationKind
from gse.station.exclusions import Cause, Exclusion
from gse.station.mount_alignment import persistent_arcsec2
from gse.station.results import ERRORS, AnswerCheck, Status, Subject, attitude_errors
from gse.station.session_data import SessionData
from gse.station.session_tables import residuals_of, xy_px_of
from gse.statistics.clock_health import ClockHealth
from gse.statistics.counted_frames import CountedFrames
from gse.statistics.excuses import MISSING_SHARE, Mistake, Mistaken
from gse.statistics.session_statistics import Statistics
from gse.statistics.truth_budget import TruthUncertaintyBudget
from gse.statistics.uncertainty import TO_STANDARD
from gse.truth import Alignment, fit_mount, horizon_to_sensor, mount_of, small_rotations
from gse.values.attitude_convention import AttitudeConvention, read_angles, state_angles
from gse.values.axis import AXES, OF_SENSOR
from gse.values.constants import ARCSEC_PER_RAD, ARCSEC_RAD, EARTH_RADIUS_M, EARTH_RATE_ARCSEC_PER_S
from gse.values.instant import LAST_NS, NS_PER_S, to_text
from gse.values.matrices import length, lstsq, product
from gse.values.mount import Mount, MountUncertainty
from gse.values.site import Site, SiteUncertainty
from gse.values.star_influence import FrameFits, boresight_shifts

_OF_CAMERA = {
    "detector size": StationKind.WRONG_DETECTOR,
    "mirrored image": StationKind.MIRRORED,
    "focal length": StationKind.WRONG_CAMERA,
}
_NO_STATION = "station file"
_NOTHING = "nothing identified"
OF_PLACE = ("mount", "clock offset", "site", "refraction", *CLOCK_SCALES)
"""Fine causes that turn the measured mount."""
_TURNS_PANORAMAS = ("pixel origin", "principal point")
"""Fine causes of the camera that turn the measured mount, too."""
_CHANGES = ("mount moves", SLIP, "thermal sinusoid", "clock drift", "clock step")
"""Fine causes whose mean over the session is a turn, too."""


def lost_station(session: SessionData) -> Finding | None:
    """That the session has no station file, so that nothing is known of its limits, site and mount."""
    for event in session.events:
        if event.kind == StationKind.NO_STATION:
            return Finding(_NO_STATION, event.text, (), "give the right one: gse report SESSION --station FILE")
    return None


def camera_mistake(session: SessionData, counted: CountedFrames, found: tuple[Finding, ...]) -> Finding | None:
    """The camera among the findings that explains it all, if there is one."""
    return next((finding for finding in found if _hides_all(session, counted, finding)), None)


def _hides_all(session: SessionData, counted: CountedFrames, finding: Finding) -> bool:
    """Whether it is a camera with which the reference cannot answer either, or instead of which another one serves.

    A built-in identifier answers with the camera that was found (gse.station.camera_watch). That is not asked of an
    external program: where the reference answers with the camera that is stated, the program could have answered.
    """
    frames = session.frames.columns
    unknown = frames["answer_check"] == ANSWER_CHECKS.index(AnswerCheck.UNKNOWN)
    known = int((counted.expected & ~unknown).sum())
    if session.station.identifier.algorithm == "external" and 2 * known >= max(int(counted.expected.sum()), 1):
        return False
    answered = frames["status"] == STATUSES.index(Status.IDENTIFIED)
    is_found = _OF_CAMERA.get(finding.cause) in {event.kind for event in session.events}
    if answered.any() and (2 * answered.sum() > len(answered) or not is_found):
        return finding.cause in STARS_FALL_OUT and stars_fall_out(frames, counted.used)
    if finding.cause == _NOTHING:
        return bool(unknown.all())
    return is_found


def hidden_mistake(session: SessionData, found: tuple[Finding, ...]) -> Finding | None:
    """The obstruction among the findings, where it hides more than half of the expected stars."""
    frames = session.frames.columns
    hides = frames["stars_seen"] < MISSING_SHARE * frames["stars_expected"]
    return next((one for one in found if one.cause == "obstruction" and 2 * hides.sum() > len(hides)), None)


def mistake_of(finding: Finding, *, is_turn: bool = False) -> Mistake:
    """What a mistake is of, which says what it excuses; a principal point that only turns all panoramas is of place."""
    if finding.cause == _NO_STATION:
        return Mistake(Mistaken.STATION_FILE, finding.cause)
    if finding.cause == "obstruction":
        return Mistake(Mistaken.FIELD, finding.cause)
    is_camera = finding.cause in (*_OF_CAMERA, _NOTHING) or (finding.cause in STARS_FALL_OUT and not is_turn)
    return Mistake(Mistaken.CAMERA if is_camera else Mistaken.PLACE, finding.cause)


# The turn that panoramas, reference and subject share, and whether the set-up may be the excuse for it.
#
# Each quantity of the set-up turns the measured mount about axes of the horizon frame: clock and longitude about the
# pole, the latitude about east, the mount about its own axes. One that nobody vouches for may be off by any angle, one
# that somebody vouches for by three of the standard deviations that were stated. What is left of the turn, once the
# free axes took what they can, is compared with the covariance of all that is known.

_MOST_SIGMAS = 3.0
_FEWEST_FRAMES, _MOST_FITTED, _MOST_SHOWN = 3, 20_000, 2_000
_LEAST_ARCSEC = 1.0
"""What the models of air and stars leave open."""
_LEAST_COS_LATITUDE = 0.01
"""Within 64 km of a pole azimuth is counted from a meridian that is chosen, not found."""
_FEW_MEANS_ARCSEC = 30.0
"""What so short a session leaves open that its means do not tell their own scatter."""
_SET_UP_TERMS = ("clock", "site position", "mount azimuth", "mount altitude", "mount roll")
_ROWS_AT_ONCE = 1 << 14
_WEIGHTS = np.array([1.0, 1.0, 0.1])
"""A field shows roll ten times worse than direction."""
_OTHER_STARS_RAD = 3600 * ARCSEC_RAD
"""Stars that lie further from where an answer has them are not those that it saw."""
_Errors = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class _Quantity:
    """One quantity of the set-up: its axes (3,) in the horizon frame, and how well they are known, one sigma.

    ``by`` says who vouches for it; empty: nobody.
    """

    name: str
    axes: tuple[NDArray[np.float64], ...]
    sigma_arcsec: float
    by: str


@dataclass(frozen=True, slots=True, eq=False)
class SharedTurn:
    """The mount that the stars fit, as ``fit``, and who vouches for the one that is stated.

    ``is_free`` where what nobody vouches for explains the turn between the two, with what is stated of the rest.
    """

    fit: Alignment
    turn_arcsec: float
    is_free: bool
    vouched: tuple[str, ...]
    unvouched: tuple[str, ...]

    @property
    def who(self) -> str:
        """Who vouches for what, in words."""
        nobody = f"nobody vouches for {' and '.join(self.unvouched)}" if self.unvouched else ""
        return "; ".join(part for part in (", ".join(self.vouched), nobody) if part)


def shared_turn(session: SessionData, stats: Statistics, budget: TruthUncertaintyBudget) -> SharedTurn | None:
    """The turn that most frames show; None where no stated mount stands under the sky, or too few frames tell it."""
    mount = session.station.mount
    if session.alignment is not None or not mount.stated or mount.inertial is not None or mount.align is not None:
        return None
    shown = shown_frames(session, stats.counted)
    rows = np.flatnonzero(shown)
    if len(rows) < _FEWEST_FRAMES:
        return None
    stated = horizon_to_sensor(mount)
    frames = session.frames.columns
    rows = rows[:: -(-len(rows) // _MOST_FITTED)]
    measured = _measured(session, rows)
    fit = fit_mount(frames["utc_ns"][rows], measured, persistent_arcsec2=persistent_arcsec2(session))
    if session.station.identifier.algorithm == "external":
        by_stars = product(erfa.rv2m(-_off_its_stars(session, shown)), horizon_to_sensor(fit.mount))
        fit = replace(fit, mount=mount_of(by_stars))
    quantities = tuple(_quantities(session.station, stats.clock))
    turn = product(stated.T, horizon_to_sensor(fit.mount))
    free = [axis for one in quantities if not one.by for axis in one.axes]
    known = product(stated.T, _covariance(fit, session.station.site, budget), stated)
    for axis, sigma_arcsec in [(axis, one.sigma_arcsec) for one in quantities if one.by for axis in one.axes]:
        known = known + sigma_arcsec**2 * np.outer(axis, axis)
    _, chi_square = taken_out(turn, free, known * ARCSEC_RAD**2)
    return SharedTurn(
        fit,
        size_rad(turn) * ARCSEC_PER_RAD,
        chi_square <= _MOST_SIGMAS**2,
        tuple(f"{one.name} vouched for by {one.by}" for one in quantities if one.by),
        tuple(dict.fromkeys(one.name.split()[0] for one in quantities if not one.by)),
    )


def mount_fit(session: SessionData, counted: CountedFrames) -> dict[str, Any] | None:
    """The stated mount beside the one that the stars fit, for a report; None where there are not both.

    Where the session was judged with a fitted mount, that one counts.
    """
    mount = session.station.mount
    if not mount.stated or mount.inertial is not None:
        return None
    rows = np.flatnonzero(shown_frames(session, counted))
    if session.alignment is not None:
        fitted = session.alignment.mount
    elif len(rows) >= _FEWEST_FRAMES:
        frames, rows = session.frames.columns, rows[:: -(-len(rows) // _MOST_SHOWN)]
        fitted = fit_mount(frames["utc_ns"][rows], _measured(session, rows)).mount
    else:
        return None
    (turn,) = small_rotations(horizon_to_sensor(fitted)[None], horizon_to_sensor(mount)) * ARCSEC_PER_RAD
    return {
        "stated_deg": [mount.azimuth_deg, mount.altitude_deg, mount.roll_deg],
        "fitted_deg": [fitted.azimuth_deg, fitted.altitude_deg, fitted.roll_deg],
        "across_arcsec": math.hypot(turn[0], turn[1]),
        "roll_arcsec": float(turn[2]),
    }


def _off_its_stars(session: SessionData, shown: NDArray[np.bool_]) -> NDArray[np.float64]:
    """The rotation vector (3,) from the answers of an external program to the attitude of the stars that it names.

    That part of its errors is its own; nothing of a program that names no stars, or others than those it saw.
    """
    matches = session.frames.matches
    matches = matches.compress(matches["named"] & shown[matches["frame"]])
    if not len(matches):
        return np.zeros(3)
    directions = session.station.sensor.camera().directions(xy_px_of(matches))
    turns = FrameFits.from_directions(directions, matches["frame"]).turns(residuals_of(matches) * ARCSEC_RAD)
    off = np.median(turns, axis=0)
    return np.asarray(off if length(off) < _OTHER_STARS_RAD else np.zeros(3))


def _measured(session: SessionData, rows: NDArray[np.int64]) -> NDArray[np.float64]:
    """The rotations (M, 3, 3) from the horizon frame to the sensor that some frames show."""
    frames = session.frames.columns
    turns = _as_turns(*(frames[axis.column][rows] for axis in OF_SENSOR))
    return np.asarray(product(turns, horizon_to_sensor(session.station.mount)))


def _as_turns(x_arcsec: _Errors, y_arcsec: _Errors, roll_arcsec: _Errors) -> NDArray[np.float64]:
    """The rotations (M, 3, 3) from true to measured attitude whose arcs and roll (M,) these are."""
    x, y, roll = (errors / ARCSEC_PER_RAD for errors in (x_arcsec, y_arcsec, roll_arcsec))
    arc = np.hypot(x, y)
    share = np.sinc(arc / np.pi)
    bx, by, bz = x * share, y * share, np.cos(arc)
    with np.errstate(divide="ignore", invalid="ignore"):
        level = 1 / (1 + bz)
    first = np.stack([1 - bx * bx * level, -bx * by * level, -bx], axis=-1)
    second = np.stack([-bx * by * level, 1 - by * by * level, -by], axis=-1)
    cos, sin = np.cos(roll)[:, None], np.sin(roll)[:, None]
    return np.stack([cos * first - sin * second, sin * first + cos * second, np.stack([bx, by, bz], axis=-1)], axis=1)


def pushed_mount(found: tuple[Finding, ...], moved_ns: int, parts: tuple[SharedTurn, ...]) -> Finding:
    """The finding that says so of a mount; the one that is named already, where there is one."""
    named = next((one for one in found if one.cause == SLIP), None)
    if named is not None:
        return replace(named, size=f"{named.size} ({parts[0].who})")
    turned = ""
    if len(parts) > 1:
        before, after = (horizon_to_sensor(part.fit.mount) for part in parts)
        turned = f" by {angle_text(math.degrees(size_rad(product(after, before.T))))}"
    return Finding(
        "slip of the mount",
        f"at {to_text(moved_ns, 0)} it was turned{turned}, and stays there ({parts[0].who})",
        ("a step of the clock", "another sensor from then on"),
        "judge each part by itself: gse session trim SESSION cuts it",
    )


def repointed_mount(
    session: SessionData, stats: Statistics, budget: TruthUncertaintyBudget
) -> tuple[Finding, SessionData] | None:
    """The finding that the mount was turned again and again, and the session as judged with where it stood each time.

    None where somebody vouches that it stands elsewhere. Frames on the way between two directions have no truth.
    """
    held = pointings(session, stats.counted)
    of_parts = []
    for rows in held:
        answered = np.zeros(len(session.frames), dtype=bool)
        answered[rows] = True
        of_part = replace(stats, counted=replace(stats.counted, answered=answered))
        shared = shared_turn(session, of_part, budget)
        if shared is None or not shared.is_free:
            return None
        of_parts.append(shared)
    if not held:
        return None
    utc_ns = session.frames.columns["utc_ns"]
    begins = [int(utc_ns[rows[0]]) for rows in held]
    stands = [horizon_to_sensor(one.fit.mount) for one in of_parts]
    longest = max(range(len(held)), key=lambda part: len(held[part]))
    there = np.array([product(one, stands[longest].T) for one in stands])
    turns = there[np.maximum(np.searchsorted(begins, utc_ns, side="right") - 1, 0)]
    left_out = replace(session, excluded=(*session.excluded, *_on_the_way(session, stats.counted, held)))
    finding = _turned_often(begins[1:], stands, session.station.site, of_parts[0].who)
    return finding, _with_mount_turned(without_turn(left_out, of_parts[longest].fit), turns)


def _on_the_way(
    session: SessionData, counted: CountedFrames, held: tuple[NDArray[np.int64], ...]
) -> Iterator[Exclusion]:
    """Before, between and after stretches in which a mount held still: times in which frames show it elsewhere."""
    utc_ns = session.frames.columns["utc_ns"]
    shown_ns = utc_ns[shown_frames(session, counted)]
    begins, ends = ([int(utc_ns[rows[place]]) for rows in held] for place in (0, -1))
    for from_ns, until_ns in zip([0, *(end + 1 for end in ends)], [*begins, LAST_NS], strict=True):
        if ((shown_ns >= from_ns) & (shown_ns < until_ns)).any():
            yield Exclusion(from_ns, until_ns, "the mount was turned", Cause.MOUNT)


_MOST_TIMES = 6
"""Turns that a finding tells each by itself."""
_ABOUT_POLE_ARCSEC = 60.0
"""What a turn that is that of a clock leaves, as the roll of a short stretch is known."""


def _turned_often(at_ns: list[int], stands: list[NDArray[np.float64]], site: Site, who: str) -> Finding:
    turns = [product(before.T, after) for before, after in itertools.pairwise(stands)]
    told = [f"at {to_text(ns, 0)} by {angle_text(math.degrees(size_rad(turn)))}"
            for ns, turn in zip(at_ns, turns, strict=True)][:_MOST_TIMES]  # fmt: skip
    more = f", and {len(turns) - _MOST_TIMES} times more" if len(turns) > _MOST_TIMES else ""
    is_clock = all(about(pole(site), turn)[1] * ARCSEC_PER_RAD < _ABOUT_POLE_ARCSEC for turn in turns)
    return Finding(
        "mount moved",
        f"it was turned {len(turns)} times and held still in between: {', '.join(told)}{more} ({who})",
        (*["a clock that was set each time"] * is_clock, "other sensors one after another"),
        "judge each part by itself: gse session trim SESSION cuts it",
    )


def beside_a_change(found: tuple[Finding, ...], named: Finding) -> Iterator[Finding]:
    """What was found beside a slip, a drive, several pointings or another rate: nothing that these make by themselves.

    A drive, and a mount that was turned several times, look like any other change.
    """
    explained = {*OF_PLACE, named.cause, "none of these"}
    may_be_any = named.cause in ("mount moved", "mount follows the sky")
    for one in found:
        is_change = one.cause in _CHANGES or any(SLIP in equal for equal in one.equals)
        if not one.is_gross and one.cause not in explained and not (may_be_any and is_change):
            yield one


def without_turn(session: SessionData, fit: Alignment) -> SessionData:
    """The session as it would have been judged with the mount that the stars fit."""
    turn = product(horizon_to_sensor(fit.mount), horizon_to_sensor(session.station.mount).T)
    turned = _with_truth_turned(session, np.broadcast_to(turn, (len(session.frames), 3, 3)))
    return replace(turned, alignment=fit)


# A drive that turns the mount with the sky.
#
# It need not stand exactly at the pole, nor keep exactly the rate of the stars: a steady turn about any axis is fitted.

_DRIVE_ROUNDS = 6
"""Each leaves of the rate what turns of degrees do not commute: a fifth at most."""
_FEWEST_DRIVEN = 30
_STILL = ("frozen sensor", "repeated panoramas")
"""Findings of a picture that stands still under the sky."""


def driven_mount(
    session: SessionData, stats: Statistics, budget: TruthUncertaintyBudget, found: tuple[Finding, ...]
) -> tuple[Finding, SessionData] | None:
    """The finding that a drive turned the mount with the sky, and the session as judged with a mount that it turns.

    None where somebody vouches that it stands where the station file says, and where panoramas do not show it: a sensor
    whose answers, or whose pictures, stand still sees no sky.
    """
    rows = np.flatnonzero(shown_frames(session, stats.counted))
    stands_still = any(one.cause in _STILL for one in found)
    if session.subject is not Subject.ONBOARD or len(rows) < _FEWEST_DRIVEN or stands_still:
        return None
    passed_s = (session.frames.columns["utc_ns"] - session.frames.columns["utc_ns"][rows[0]]) / NS_PER_S
    some = rows[:: -(-len(rows) // _MOST_FITTED)]
    by_second = _rate_of_turn(_measured(session, some), passed_s[some])
    with_sky = -pole(session.station.site) * EARTH_RATE_ARCSEC_PER_S * ARCSEC_RAD  # westwards
    if length(by_second - with_sky) > MOVED_SHARE * length(with_sky):
        return None
    turned = erfa.rv2m(passed_s[:, None] * by_second)

    def seen_from(mount: Mount) -> NDArray[np.float64]:
        stands = horizon_to_sensor(mount)
        return np.asarray(product(stands, turned, stands.T))

    shared = shared_turn(_with_truth_turned(session, seen_from(session.station.mount)), stats, budget)
    if shared is None or not shared.is_free or any(one.startswith("mount") for one in shared.vouched):
        return None
    ground_deg = math.degrees(length(with_sky)) * float(np.ptp(passed_s[rows]))
    finding = follows_the_sky(ground_deg)
    finding = next((one for one in found if one.cause == finding.cause), finding)
    finding = replace(finding, size=f"{finding.size} ({shared.who})")
    return finding, _with_mount_turned(without_turn(session, shared.fit), seen_from(shared.fit.mount))


def _rate_of_turn(measured: NDArray[np.float64], time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rate (3,) in rad/s, about axes of the horizon frame, at which a mount turns whose rotations are (M, 3, 3)."""
    by_second = np.zeros(3)
    columns = np.column_stack([np.ones(len(time_s)), time_s - time_s.mean()])
    for _ in range(_DRIVE_ROUNDS):
        at_rest = product(measured, erfa.rv2m(-time_s[:, None] * by_second))
        turns = erfa.rm2v(product(at_rest[len(at_rest) // 2].T, at_rest))
        by_second = by_second + lstsq(columns, turns)[1]
    return by_second


def _with_mount_turned(session: SessionData, turns: NDArray[np.float64]) -> SessionData:
    """The same with a mount that stood turned by a rotation (M, 3, 3) of the sensor frame in each frame."""
    return replace(_with_truth_turned(session, turns), mount_turns=turns)


def at_the_right_rate(session: SessionData, counted: CountedFrames) -> SessionData:
    """The session with the time that has passed since its first frame as the stars show it."""
    frames, station = session.frames.columns, session.station
    rows = np.flatnonzero(shown_frames(session, counted))
    passed_s = (frames["utc_ns"] - frames["utc_ns"][0]) / NS_PER_S
    pole_sensor = product(horizon_to_sensor(station.mount), pole(station.site))
    by_second = boresight_shifts(pole_sensor[None])[0] * EARTH_RATE_ARCSEC_PER_S
    errors = np.column_stack([frames[axis.column][rows] for axis in OF_SENSOR])
    at_rest = np.broadcast_to(np.eye(3), (len(rows), 3, 3))
    columns = np.concatenate([at_rest, passed_s[rows, None, None] * by_second[:, None]], axis=2)
    fast = lstsq((columns * _WEIGHTS[:, None]).reshape(-1, 4), (errors * _WEIGHTS).ravel())[3]
    fast_s = fast * passed_s
    late_rad = -fast_s * EARTH_RATE_ARCSEC_PER_S * ARCSEC_RAD
    timed = _with_truth_turned(session, erfa.rv2m(late_rad[:, None] * pole_sensor))
    timed.frames.columns["utc_ns"] -= np.rint(fast_s * NS_PER_S).astype(np.int64)
    return timed


def _with_truth_turned(session: SessionData, turns: NDArray[np.float64]) -> SessionData:
    """A copy in which the true attitude of each frame is turned by a rotation (M, 3, 3) of the sensor frame."""
    table = session.frames.snapshot()
    frames = table.columns
    for first in range(0, len(frames), _ROWS_AT_ONCE):
        part = slice(first, first + _ROWS_AT_ONCE)
        no_roll = np.isnan(frames["d_roll_arcsec"][part])
        angles = np.column_stack([frames[f"{name}_true_deg"][part] for name in ("ra", "de", "roll")])
        true = read_angles(angles, AttitudeConvention())
        x, y, roll = (frames[axis.column][part] for axis in OF_SENSOR)
        measured = product(_as_turns(x, y, np.where(no_roll, 0.0, roll)), true)
        true = product(turns[part], true)
        errors = attitude_errors(measured, true)
        errors[no_roll, ERRORS.index("d_roll_arcsec")] = np.nan
        for name, values in zip(ERRORS, errors.T, strict=True):
            frames[name][part] = values
        for name, values in zip(("ra", "de", "roll"), state_angles(true, AttitudeConvention()).T, strict=True):
            frames[f"{name}_true_deg"][part] = values
    return replace(session, frames=table)


def _quantities(station: Station, clock: ClockHealth) -> Iterator[_Quantity]:
    """What turns the measured mount, and who vouches for it: defaults and a fit of earlier stars vouch for nothing."""
    site, mount = station.site, station.mount
    boresight = horizon_to_sensor(mount)[2]
    axes = {"azimuth": (VERTICAL,), "altitude": (level_axis(mount), ahead(mount)), "roll": (boresight,)}
    for name, of_angle in axes.items():
        key = f"{name}_arcsec"
        stated = getattr(mount.uncertainty, key)
        is_vouched = stated != getattr(MountUncertainty(), key) and not mount.uncertainty.fitted
        by = f"the station file (mount.uncertainty.{key}: {stated:g})" if is_vouched else ""
        yield _Quantity(f"mount {name}", of_angle, stated * TO_STANDARD, by)
    position_m = site.uncertainty.position_m
    north_arcsec = position_m * TO_STANDARD / (EARTH_RADIUS_M * ARCSEC_RAD)
    is_vouched = position_m != SiteUncertainty().position_m
    by = f"the station file (site.uncertainty.position_m: {position_m:g})" if is_vouched else ""
    parallel = max(math.cos(math.radians(site.latitude_deg)), _LEAST_COS_LATITUDE)
    yield _Quantity("site latitude", (EAST,), north_arcsec, by)
    yield _Quantity("site longitude", (pole(site),), north_arcsec / parallel, by)
    of_clock = clock.error_bound_s / math.sqrt(3) * EARTH_RATE_ARCSEC_PER_S
    yield _Quantity("clock", (pole(site),), of_clock, clock.vouched_by)


def _covariance(fit: Alignment, site: Site, budget: TruthUncertaintyBudget) -> NDArray[np.float64]:
    """In the sensor frame (3, 3), of the fit and of all of the truth but what the quantities of the set-up are."""
    covariance = np.array(fit.covariance_arcsec2)
    if not np.isfinite(covariance).all():
        covariance = np.eye(3) * _FEW_MEANS_ARCSEC**2
    others = [term for term in budget.terms if term.name not in _SET_UP_TERMS]
    along = [[size for term in others if math.isfinite(size := term.of(axis))] for axis in AXES]
    right_ascension, declination, roll = (math.hypot(*sizes) for sizes in along)
    across = math.hypot(max(right_ascension, declination), _LEAST_ARCSEC)
    covariance += np.diag(np.square([across, across, math.hypot(roll, _LEAST_ARCSEC)]))
    if site.uncertainty.pressure_hpa is None:  # nobody vouches for the air, and it is no more than there may be
        lifted = max((term.size_arcsec for term in others if term.name == "refraction: model"), default=0.0)
        covariance[0, 0] += (lifted / _MOST_SIGMAS) ** 2
        covariance[1, 1] += (lifted / _MOST_SIGMAS) ** 2
    return covariance


def place_mistake(
    session: SessionData, counted: CountedFrames, found: tuple[Finding, ...], shared: SharedTurn
) -> tuple[Finding, ...]:
    """The findings with what of the set-up explains the shared turn in front, and who vouches for what.

    None of them where all that could explain it is vouched for. An exact hit among the gross mistakes does though
    somebody vouches: both cannot be.
    """
    turning = *OF_PLACE, *_TURNS_PANORAMAS
    named = next((finding for finding in found if finding.cause == "detector size"), None)
    named = named or next((finding for finding in found if finding.is_gross or finding.cause in turning), None)
    named = named or next((finding for finding in found if finding.cause in _CHANGES), None)
    gross = gross_cause_of(session, counted) if named and named.is_gross else None
    is_exact = named is not None and named.cause in ("detector size", *CLOCK_SCALES)
    is_exact = is_exact or (gross is not None and gross.is_exact)
    if not shared.is_free and not is_exact:
        return ()
    both = "" if shared.is_free else ", and both cannot be"
    finding = _not_the_clock(named, shared) if named else _elsewhere(session.station.mount, shared)
    finding = replace(finding, size=f"{finding.size} ({shared.who}{both})")
    return (finding, *(one for one in found if one is not named))


def _not_the_clock(named: Finding, shared: SharedTurn) -> Finding:
    """The longitude, whose error is that of a clock, where somebody vouches for the clock alone."""
    by_clock = any(one.startswith("clock") for one in shared.vouched)
    longitude = next((one for one in named.equals if one.startswith("longitude (")), "")
    if named.cause != "clock offset" or not longitude or not by_clock or "site" not in shared.unvouched:
        return named
    others = tuple(one for one in named.equals if one != longitude)
    size = longitude.removeprefix("longitude (").removesuffix(")")
    return replace(
        named, cause="longitude", size=size, equals=(f"clock offset ({named.size})", *others), next_step=CORRECT
    )


def _elsewhere(stated: Mount, shared: SharedTurn) -> Finding:
    fitted = shared.fit.mount
    size = (
        f"it looks {angle_text(shared.turn_arcsec / 3600)} from where the station file says: the stars fit azimuth "
        f"{fitted.azimuth_deg:.3f}, altitude {fitted.altitude_deg:.3f}, roll {fitted.roll_deg:.3f} deg, stated are "
        f"{stated.azimuth_deg:g}, {stated.altitude_deg:g}, {stated.roll_deg:g} deg"
    )
    return Finding("mount", size, ("site", "clock offset"), "gse align SESSION --write FILE")


def alignment_finding(shared: SharedTurn) -> Finding:
    """What remains where all of the set-up is vouched for."""
    return Finding(
        "alignment of the sensor",
        f"panoramas and stars agree on a turn of {angle_text(shared.turn_arcsec / 3600)} from the stated mount, and "
        f"the set-up cannot be the reason: {shared.who}",
        ("a latency of the sensor", "a principal point that is not as stated"),
        "measure how the sensor stands on its mount; where an uncertainty was stated too small, correct it and judge "
        "the same recording again: gse report SESSION --station FILE",
    )


def camera_beside_answers(session: SessionData, found: tuple[Finding, ...], shared: SharedTurn) -> Finding:
    """The camera of the station file, where truth confirms the sensor's own answers and all else is vouched for.

    The sensor has both from the same light: what turns only the panoramas is how the station file takes them.
    """
    off = angle_text(shared.turn_arcsec / 3600)
    (turn,) = small_rotations(horizon_to_sensor(shared.fit.mount)[None], horizon_to_sensor(session.station.mount))
    across_rad = math.hypot(turn[0], turn[1])
    px = across_rad / session.station.sensor.camera().pixel_rad
    shifted = (f"a principal point that is off by {px:.1f} px",) if across_rad > abs(turn[2]) else ()
    turned = Finding(
        "camera",
        f"seen by the camera of the station file, all panoramas are turned by {off} from the stated mount",
        (*shifted, "a camera that is turned in the frame of the own answers"),
        "compare sensor.principal_point_px with the sensor's papers; gse calibrate SESSION --write FILE",
    )
    named = next((one for one in found if one.cause in _TURNS_PANORAMAS), turned)
    own = f"the sensor's own answers show no turn of {off}, so that its alignment is not the cause"
    return replace(named, size=f"{named.size}; {own} ({shared.who})")
