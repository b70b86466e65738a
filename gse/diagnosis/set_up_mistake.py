"""A mistake of the set-up that explains what a session shows: then its errors tell nothing of the sensor.

The identifier named the right stars, only not where site, clock and mount of the station file say. Where the errors
that are left without the mistake keep the limits, no row fails for it: the word is INCONCLUSIVE, and the mistake is the
first reason. A mirrored image or a focal length under which nothing can be identified is one too, a camera with which
many stars lie too far off to be named, air that is not that of the height, and a host whose clock shows GPS time or
TAI: no latency of a sensor is 18 or 37 s. Where the reference identifier names no star in the whole session either,
sky, station file and sensor cannot be told apart, and no row of the identifier fails. What the sensor answers itself no
camera of the station file excuses.

A session that lost its station file is judged on the built-in one, whose limits are not its own: it neither passes nor
fails.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gse.diagnosis.fine_findings import CLOCK_SCALES
from gse.diagnosis.gross_causes import gross_cause_of, left_under
from gse.diagnosis.misplaced_stars import STARS_FALL_OUT, stars_fall_out
from gse.station.columns import ANSWER_CHECKS, STATUSES
from gse.station.events import StationKind
from gse.station.results import AnswerCheck, Status
from gse.station.session_data import SessionData
from gse.statistics.counted_frames import CountedFrames
from gse.statistics.excuses import Mistake, Mistaken
from gse.values.axis import D_DE, D_RA_COSDE, D_ROLL
from gse.values.finding import Finding
from gse.values.limits import Limits

_OF_CAMERA = {"mirrored image": StationKind.MIRRORED, "focal length": StationKind.WRONG_CAMERA}
_NO_STATION = "station file"
_NOTHING = "nothing identified"
_KEPT_SHARE = 0.9
"""Share of some 15 frames that must lie inside: one may lie outside."""


def lost_station(session: SessionData) -> Finding | None:
    """That the session has no station file, so that nothing is known of its limits, site and mount."""
    for event in session.events:
        if event.kind == StationKind.NO_STATION:
            return Finding(_NO_STATION, event.text, (), "give the right one: gse report SESSION --station FILE")
    return None


def set_up_mistake(session: SessionData, counted: CountedFrames, found: tuple[Finding, ...]) -> Finding | None:
    """The one of the findings that explains it all, if there is one."""
    of_camera = [finding for finding in found if _hides_all(session, counted, finding)]
    if of_camera:
        return of_camera[0]
    for finding in found:
        if (left_arcsec := _left_without(session, counted, finding)) is not None:
            return finding if _keeps(left_arcsec, session.station.limits) else None
    gross = [finding for finding in found if finding.is_gross]
    cause = gross_cause_of(session, counted) if gross else None
    if cause is None or not _keeps(cause.left_arcsec, session.station.limits):
        return None
    return cause.finding


def _left_without(session: SessionData, counted: CountedFrames, finding: Finding) -> NDArray[np.float64] | None:
    """The errors that are left without a fine mistake that is no sensor's: of the time scale, or of the air."""
    if finding.cause in CLOCK_SCALES:
        return left_under(session, counted, fast_s=CLOCK_SCALES[finding.cause])
    if finding.cause == "refraction":
        return left_under(session, counted, site=replace(session.station.site, pressure_hpa=None, temperature_c=None))
    return None


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
    if (frames["status"] == STATUSES.index(Status.IDENTIFIED)).any():
        return finding.cause in STARS_FALL_OUT and stars_fall_out(frames, counted.used)
    if finding.cause == _NOTHING:
        return bool(unknown.all())
    kinds = {event.kind for event in session.events}
    return _OF_CAMERA.get(finding.cause) in kinds


def _keeps(left_arcsec: NDArray[np.float64], limits: Limits) -> bool:
    if not len(left_arcsec):
        return False
    across = np.hypot(left_arcsec[:, 0], left_arcsec[:, 1]) <= np.hypot(limits.of(D_RA_COSDE), limits.of(D_DE))
    return bool((across & (np.abs(left_arcsec[:, 2]) <= limits.of(D_ROLL))).mean() >= _KEPT_SHARE)


def mistake_of(finding: Finding) -> Mistake:
    """What a mistake is of, which says what it excuses."""
    if finding.cause == _NO_STATION:
        return Mistake(Mistaken.STATION_FILE, finding.cause)
    is_camera = finding.cause in (*_OF_CAMERA, *STARS_FALL_OUT, _NOTHING)
    return Mistake(Mistaken.CAMERA if is_camera else Mistaken.PLACE, finding.cause)
