"""Diagnosis: the causes of what a session shows, gross and fine, as findings.

A finding is a hint for the operator and decides nothing; the verdict goes by the limits alone. There is one cause for
one effect: fine ones compete with each other, a gross one silences them, and events that say the same are left out.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.assessment.counted_frames import CountedFrames, counted_frames
from gse.assessment.error_series import ErrorSeries, error_series, with_left_out
from gse.assessment.field_patterns import field_of_errors, unexplained_residuals
from gse.assessment.fine_findings import Setting, fine_findings
from gse.assessment.focus import focus_finding, focus_loss
from gse.assessment.gross_causes import GrossCause, gross_cause, left_with
from gse.assessment.known_steps import without_steps
from gse.assessment.raw_attitudes import RawAttitudes
from gse.assessment.sensor_answers import sensor_answers
from gse.assessment.sensor_convention import session_convention
from gse.assessment.sensor_findings import sensor_findings
from gse.assessment.session_model import SessionModel
from gse.assessment.star_changes import sampled_matches, without_star_changes
from gse.assessment.statistics import Statistics
from gse.assessment.time_tags import time_tag_faults
from gse.assessment.unexplained import unexplained
from gse.finding import Finding
from gse.instant import NS_PER_S
from gse.site import Site
from gse.station.clock_steps import clock_steps
from gse.station.event_kinds import ClockStep, StationKind
from gse.station.frame_table import ANSWER_CHECKS, STATUSES
from gse.station.results import AnswerCheck, Status, Subject
from gse.station.session_data import SessionData
from gse.station.sky_condition import FEWEST_UNMATCHED
from gse.truth import horizon_to_sensor

_FEWEST_DRIFTING = 10
_LOW_DEG = 10.0
"""At an altitude of 10 deg air lifts stars by 5 arcmin, at 30 deg by 1.7: a field holds both."""
_FEWEST_ANSWERED = 5
"""One picture may show the edge of a cloud, a bright Moon or a town."""
_SENSOR_DRIFT_PPM = 100.0
"""A crystal keeps within 50 ppm over its whole temperature range."""


STARS_FALL_OUT = ("distortion", "focal length", "principal point")
"""Causes that may move stars by more than they are matched within; beside them all others are guesses then."""
_FALLEN_OUT_SHARE = 0.3
"""Of those that are matched: more than satellites, noise or a few hot pixels."""

_EQUALS_OF_EVENT = {
    StationKind.WRONG_CAMERA: ("distortion of the lens",),
    StationKind.MIRRORED: ("x and y exchanged (in the protocol description, or by the sensor)",),
}


@dataclass(frozen=True, slots=True, eq=False)
class ModelledSession:
    """Errors as models compete for them, all of their series, and what findings are worded with."""

    model: SessionModel
    series: ErrorSeries
    setting: Setting


def findings(session: SessionData, stats: Statistics) -> tuple[Finding, ...]:
    """The causes of what a session shows, a gross one alone: under it all fine ones are guesses."""
    gross = gross_finding(session, stats.counted)
    causes = (gross,) if gross else _fine(session, stats.counted)
    facts = tuple(_facts(session, stats, {finding.cause for finding in causes}))
    return (*causes, *facts) or tuple(unexplained(session, stats))


def causes_so_far(session: SessionData) -> tuple[Finding, ...]:
    """The causes that a running session shows, without the statistics of a whole one."""
    counted = counted_frames(session)
    gross = gross_finding(session, counted)
    causes = (gross,) if gross else _fine(session, counted)
    return (
        *causes,
        *_events(session, {finding.cause for finding in causes}),
        *_nothing_identified(session),
        *_of_sensor(session, is_gross=gross is not None),
    )


def _of_sensor(session: SessionData, *, is_gross: bool) -> tuple[Finding, ...]:
    """What the sensor's own answers look like so far; under a gross mistake they are compared with nothing."""
    if not len(session.sensor_attitudes):
        return ()
    own = None if is_gross or session.subject is Subject.SENSOR else sensor_answers(session)
    return sensor_findings(session, own, session_convention(session))


def _facts(session: SessionData, stats: Statistics, named: set[str]) -> Iterator[Finding]:
    """What events, time tags and counts say by themselves; nothing that a named cause says already."""
    yield from _events(session, named)
    yield from _nothing_identified(session)
    yield from _faulty(session)
    if not named & set(STARS_FALL_OUT) and (loss := focus_loss(session, stats.counted)):
        yield focus_finding(loss)
    elif not named:
        yield from _most_unmatched(session, stats.counted)
    for line in time_tag_faults(session.frames.columns, session.events):
        yield Finding("sensor time tag", line.split(": ", 1)[1], (), "ask the maker; gse decode SESSION --explain")
    if "clock drift" not in named:
        yield from _sensor_clock(stats)
    if not (named & set(STARS_FALL_OUT) and stars_fall_out(session.frames.columns, stats.counted.used)):
        yield from _hot_pixels(session)


def _fine(session: SessionData, counted: CountedFrames) -> tuple[Finding, ...]:
    try:
        modelled = session_model(session, counted)
        found = fine_findings(modelled.model, modelled.series, modelled.setting) if modelled else ()
    except np.linalg.LinAlgError:  # stars or errors that lie on one line: they tell no cause, and end no session
        return ()
    of_camera = [finding for finding in found if finding.cause in STARS_FALL_OUT]
    return tuple(of_camera[:1]) if of_camera and stars_fall_out(session.frames.columns, counted.used) else found


def stars_fall_out(frames: NDArray[np.void], used: NDArray[np.bool_]) -> bool:
    """Whether many stars of the used frames (rows of FRAME) lie too far off to be matched.

    As these change, so do the errors.
    """
    unmatched, matched = (float(np.median(frames[name][used])) for name in ("false_objects", "matched"))
    return unmatched >= max(FEWEST_UNMATCHED, _FALLEN_OUT_SHARE * matched)


def session_model(session: SessionData, counted: CountedFrames) -> ModelledSession | None:
    """What fine causes compete for; None of too few frames, and where no sky turns over the mount."""
    frames, station = session.frames.columns, session.station
    series = error_series(frames, counted.used)
    if series is None or station.mount.inertial is not None:
        return None
    mount, camera = session.alignment.mount if session.alignment else station.mount, station.sensor.camera()
    zenith_sensor = np.asarray(horizon_to_sensor(mount)[:, 2])
    series = with_left_out(series, session.frames.matches, camera)
    if (steps := clock_steps(session.events)) and not _ran_away_s(session):
        series = without_steps(series, frames["host_utc_ns"], steps, station.site, mount)
    field = field_of_errors(session.frames.matches, frames["utc_ns"], counted.used, camera, station.site, zenith_sensor)
    if field is not None:
        matches = sampled_matches(session.frames.matches, series)
        residuals_arcsec = unexplained_residuals(field, matches, camera, station.site, zenith_sensor)
        series = without_star_changes(series, matches, residuals_arcsec, camera)
    exposure_s = float(np.nanmedian(frames["exposure_s"][series.rows]))
    first_ns = int(frames["utc_ns"][series.rows[0]])
    model = SessionModel.of(series.shortened(), field, station.site, mount, is_fitted=session.alignment is not None)
    frame_hz = 1 / max(float(np.median(np.diff(series.time_s))), 1e-9)
    return ModelledSession(model, series, Setting(camera, station.site, mount, first_ns, exposure_s, frame_hz))


def gross_finding(session: SessionData, counted: CountedFrames) -> Finding | None:
    """The mistake of the set-up, against the stated angles of the mount, whether or not a fit replaced them."""
    cause = gross_cause_of(session, counted)
    return cause.finding if cause else None


def gross_cause_of(session: SessionData, counted: CountedFrames) -> GrossCause | None:
    """The same with the errors that it leaves."""
    mount, orientation = session.station.mount, session.earth_orientation
    raw = _raw_attitudes(session, counted)
    if raw is None or orientation is None:
        return None
    return gross_cause(raw, session.station.site, mount, orientation)


def left_under(
    session: SessionData, counted: CountedFrames, *, fast_s: float = 0.0, site: Site | None = None
) -> NDArray[np.float64]:
    """The errors (M, 3) that a session shows with another clock or site than stated, in arcsec; none of no answers."""
    raw, orientation = _raw_attitudes(session, counted), session.earth_orientation
    if raw is None or orientation is None:
        return np.zeros((0, 3))
    return left_with(raw, site or session.station.site, session.station.mount, orientation, fast_s)


def _raw_attitudes(session: SessionData, counted: CountedFrames) -> RawAttitudes | None:
    """Of some answers on a stated mount that is fixed to the ground."""
    mount = session.station.mount
    frames = session.frames.columns
    checked_false = frames["answer_check"] == ANSWER_CHECKS.index(AnswerCheck.FALSE)
    has_roll = np.isfinite(frames["roll_deg"])  # an external identifier may answer RA and DE alone
    rows = np.flatnonzero(counted.answered & ~checked_false & ~counted.excluded & has_roll)
    if not mount.stated or mount.inertial is not None or not len(rows):
        return None
    return RawAttitudes.of(frames[rows], session.station.sensor.camera())


def _events(session: SessionData, named: set[str]) -> Iterator[Finding]:
    kinds = {event.kind: event for event in session.events}
    if StationKind.MIRRORED in kinds:
        kinds.pop(StationKind.WRONG_CAMERA, None)
    if away_s := _ran_away_s(session):
        kinds.pop(StationKind.CLOCK_STEP)
        if "clock drift" not in named:
            size = f"the host's UTC clock ran away from its monotonic one by {away_s:+.3f} s, a little with each frame"
            yield Finding("clock drift", size, (), "see whether the clock is synchronised: gse preflight")
    known = (
        (StationKind.CLOCK_STEP, "clock step", "synchronise the clock before the session: gse preflight"),
        (
            StationKind.MIRRORED,
            "mirrored image",
            "turn sensor.mirrored over in the station file: gse calibrate SESSION",
        ),
        (
            StationKind.WRONG_CAMERA,
            "focal length",
            "enter it and judge the same recording again: gse report SESSION --station FILE; gse calibrate fits it",
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


def _ran_away_s(session: SessionData) -> float:
    """The sum of the steps of the host's clock, where most frames have one and all go one way; else 0."""
    steps_ns = [event.step_ns for event in session.events if isinstance(event, ClockStep)]
    is_drift = len(steps_ns) > _FEWEST_DRIFTING + len(session.frames.columns) // 2
    same_way = len({step_ns > 0 for step_ns in steps_ns}) == 1
    return sum(steps_ns) / NS_PER_S if is_drift and same_way else 0.0


def _nothing_identified(session: SessionData) -> Iterator[Finding]:
    status = session.frames.columns["status"]
    no_match = int((status == STATUSES.index(Status.NO_MATCH)).sum())
    kinds = {event.kind for event in session.events}
    is_day = StationKind.DAYLIGHT in kinds and StationKind.DARK_NIGHT not in kinds
    if is_day or StationKind.WRONG_CAMERA in kinds:
        return
    if (status == STATUSES.index(Status.IDENTIFIED)).any():
        return
    unanswered = no_match + int((status == STATUSES.index(Status.TOO_FEW)).sum())
    if 2 * (session.frames.columns["answer_check"] == ANSWER_CHECKS.index(AnswerCheck.ABSENT)).sum() > unanswered:
        yield _only_reference_answers(session, unanswered)
    elif no_match:
        yield Finding(
            "nothing identified",
            f"not one of {no_match} panoramas with enough objects was identified, with no focal length within 25 % of "
            "the stated one, nor mirrored: most objects are not stars, or sensor.rows, columns or optics are others",
            ("an overcast sky with lamps or the Moon behind it", "a distortion of the lens by several pixels"),
            "look at the panoramas: gse view SESSION; check the sensor section of the station file",
        )


def _only_reference_answers(session: SessionData, unanswered: int) -> Finding:
    """The sky is there: the identifier under test knows too few of its stars, or these do not lie as it is told."""
    seen, expected, objects = (
        float(np.median(session.frames.columns[name])) for name in ("stars_seen", "stars_expected", "objects")
    )
    known = f", of which its catalogue holds {expected:.0f}" if 0 <= expected < seen else ""
    known += f"; {objects - seen:.0f} of {objects:.0f} objects are none of them" if objects > seen else ""
    equals = ["a fault of the identifier"]
    if objects - seen >= max(FEWEST_UNMATCHED, _FALLEN_OUT_SHARE * seen):
        equals.append("a distortion of the lens, or a principal point that is not as stated: gse calibrate SESSION")
    return Finding(
        "identifier without an answer",
        f"the identifier under test answers none of {unanswered} panoramas; the reference identifier does, and "
        f"{seen:.0f} stars of the sky are in each{known}",
        tuple(equals),
        "let it know more stars (identifier.catalog_stars), and try: gse report SESSION --station FILE",
    )


def _most_unmatched(session: SessionData, counted: CountedFrames) -> Iterator[Finding]:
    """What leaves too few good answers where most objects are none of the stars that ought to be there."""
    frames, known = session.frames.columns, counted.answered & ~counted.excluded
    if known.sum() < _FEWEST_ANSWERED or not stars_fall_out(frames, known):
        return
    good = (counted.answered & ~counted.false)[counted.expected].mean()
    if good >= session.station.limits.availability:
        return
    unmatched, matched, expected = (
        float(np.median(frames[name][known])) for name in ("false_objects", "matched", "stars_expected")
    )
    if unmatched > matched and expected >= matched + FEWEST_UNMATCHED:
        yield _out_of_place(
            session,
            f"{unmatched:.0f} objects as bright as stars of the catalogue are none of them, {matched:.0f} are, and "
            f"{expected:.0f} stars are expected",
        )


def _out_of_place(session: SessionData, seen: str) -> Finding:
    """Why stars do not lie where they are looked for: a field that reaches to the horizon, or another camera."""
    station, fitted = session.station, session.alignment
    mount = fitted.mount if fitted else station.mount
    lowest_deg = mount.altitude_deg - math.degrees(station.sensor.camera().diagonal_rad) / 2
    if mount.inertial is None and lowest_deg < _LOW_DEG:
        return Finding(
            "field near the horizon",
            f"{seen}: it reaches down to an altitude of {lowest_deg:.0f} deg, where air lifts stars by more than they "
            "are matched within",
            ("a camera that is not as stated",),
            "point the sensor higher, and repeat the session",
        )
    return Finding(
        "camera",
        f"{seen}: they do not lie where the camera of the station file has them",
        ("a distortion of the lens", "stars out of focus", "false objects of the sensor"),
        "fit the camera: gse calibrate SESSION --write FILE; look at the panoramas: gse view SESSION",
    )


def _faulty(session: SessionData) -> Iterator[Finding]:
    status = session.frames.columns["status"]
    faulty = int((status == STATUSES.index(Status.SENSOR_FAULT)).sum())
    if 2 * faulty > len(status):
        yield Finding(
            "faulty panoramas",
            f"{faulty} of {len(status)} panoramas cannot be: the sensor reports a fault, or an index value is too "
            "great, negative, no number, or the same for all objects, so that no object is the brightest",
            ("a protocol description that reads index or x and y from the wrong bytes",),
            "read what was sent: gse decode SESSION --explain",
        )


def _sensor_clock(stats: Statistics) -> Iterator[Finding]:
    ppm = stats.clock.sensor_drift_ppm
    if abs(ppm) > max(_SENSOR_DRIFT_PPM, 3 * stats.clock.sensor_drift_error_ppm):
        yield Finding(
            "sensor clock drift",
            f"it runs {abs(ppm):.0f} ppm {'slow' if ppm > 0 else 'fast'} against the host's",
            ("a host's clock that is being slewed",),
            "see the clock: gse preflight; the sensor's own tags are not used for UTC",
        )


def _hot_pixels(session: SessionData) -> Iterator[Finding]:
    count = session.frames.columns["hot_pixels"]
    late = count[-(len(count) // 4) :]  # a pixel is told from a star once the sky has moved
    usual = float(np.median(late)) if len(late) else 0.0
    if usual > len(session.station.sensor.hot_pixels):
        yield Finding(
            "hot pixels",
            f"{usual:.0f} objects of a frame (median) stand still on the detector while the stars move",
            ("dust or a reflex that stands still",),
            "list them in sensor.hot_pixels: gse calibrate SESSION --write FILE",
        )
