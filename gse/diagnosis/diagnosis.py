"""Diagnosis: the causes of what a session shows, gross and fine, as findings.

A finding is a hint for the operator. None makes a row PASS or FAIL; one that is a mistake of the set-up may excuse rows
that fail (gse.diagnosis.set_up_mistake, gse.statistics.excuses). There is one cause for one effect: fine ones compete
with each other, a gross one silences them, and events that say the same are left out.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gse.diagnosis.error_series import ErrorSeries, error_series, often_answered, with_left_out
from gse.diagnosis.field_patterns import field_of_errors, unexplained_residuals
from gse.diagnosis.fine_causes import forget_fits
from gse.diagnosis.fine_findings import Setting, fine_findings
from gse.diagnosis.focus import focus_finding, focus_loss
from gse.diagnosis.known_clock_steps import without_steps
from gse.diagnosis.late_frames import LateFrames
from gse.diagnosis.misplaced_stars import STARS_FALL_OUT, most_unmatched, stars_fall_out
from gse.diagnosis.plain_findings import (
    event_findings,
    faulty_panoramas,
    hot_pixels,
    nothing_identified,
    ran_away_s,
    sensor_clock_drift,
)
from gse.diagnosis.sensor_findings import sensor_findings
from gse.diagnosis.session_gross_cause import gross_finding
from gse.diagnosis.session_model import SessionModel
from gse.diagnosis.star_changes import sampled_matches, without_star_changes
from gse.diagnosis.still_panoramas import still_panoramas
from gse.diagnosis.time_tags import often_stand_still, time_tag_faults
from gse.diagnosis.unexplained import unexplained
from gse.diagnosis.vibration import without_shaking
from gse.finding import Finding
from gse.station.clock_steps import clock_steps
from gse.station.own_answers import sensor_answers
from gse.station.results import Subject
from gse.station.session_data import SessionData
from gse.statistics.counted_frames import CountedFrames, counted_frames
from gse.statistics.sensor_convention import session_convention
from gse.statistics.session_statistics import Statistics
from gse.truth import horizon_to_sensor


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
    if gross := still_panoramas(session) or gross_finding(session, counted):
        return (gross,), ()
    return (), () if often_stand_still(session.frames.columns) else _fine(session, counted)


def _of_sensor(session: SessionData, named: tuple[Finding, ...], *, is_gross: bool) -> tuple[Finding, ...]:
    """What the sensor's own answers look like so far; under a gross mistake they are compared with nothing."""
    if not len(session.sensor_attitudes):
        return ()
    own = None if is_gross or session.subject is Subject.SENSOR else sensor_answers(session)
    return sensor_findings(session, own, session_convention(session), named=named)


def _facts(session: SessionData, stats: Statistics, named: set[str]) -> Iterator[Finding]:
    """What events, time tags and counts say by themselves; nothing that a named cause says already."""
    yield from event_findings(session, named)
    yield from nothing_identified(session)
    yield from faulty_panoramas(session)
    if not named & set(STARS_FALL_OUT) and (loss := focus_loss(session, stats.counted)):
        yield focus_finding(loss)
    elif not named:
        yield from most_unmatched(session, stats.counted)
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
    model = SessionModel.of(series.shortened(), field, station.site, mount, is_fitted=session.alignment is not None)
    frame_hz = 1 / max(float(np.median(np.diff(series.time_s))), 1e-9)
    late = LateFrames.of(frames, session.events)
    return ModelledSession(model, series, Setting(camera, station.site, mount, first_ns, exposure_s, frame_hz, late))
