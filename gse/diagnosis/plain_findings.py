"""Plain findings: what events, counts and rates of a session say by themselves, without a model of its errors."""

from collections.abc import Iterator

import numpy as np

from drivers.chunk import LinkEvent, LinkKind
from gse.count_text import count_text
from gse.diagnosis.late_frames import CRYSTAL_PPM
from gse.diagnosis.misplaced_stars import FALLEN_OUT_SHARE
from gse.finding import Finding
from gse.instant import NS_PER_S
from gse.station.event_kinds import ClockStep, StationKind
from gse.station.frame_table import STATUSES
from gse.station.results import Status
from gse.station.session_data import SessionData
from gse.station.sky_condition import FEWEST_UNMATCHED
from gse.statistics.low_field import air_in_field, only_reference_answers
from gse.statistics.session_statistics import Statistics

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
        (
            LinkKind.NOT_RUN,
            "station stopped",
            "stop no session (kill -STOP), and keep heavy work off this computer",
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
    if is_day or kinds & {StationKind.WRONG_CAMERA, StationKind.MIRRORED}:
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


def faulty_panoramas(session: SessionData) -> Iterator[Finding]:
    """Where more than half of the panoramas are."""
    status = session.frames.columns["status"]
    faulty = int((status == STATUSES.index(Status.SENSOR_FAULT)).sum())
    if 2 * faulty > len(status):
        yield Finding(
            "faulty panoramas",
            f"{faulty} of {len(status)} panoramas cannot be: the sensor reports a fault, a value is not a number (a "
            "place, an index value, the temperature), or an index value is too great, negative, or the same for all "
            "objects, so that no object is the brightest",
            ("a protocol description that reads index or x and y from the wrong bytes",),
            "read what was sent: gse decode SESSION --explain",
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
