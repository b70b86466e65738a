"""A mistake of the set-up that explains what a session shows: then its errors tell nothing of the sensor.

The identifier named the right stars, only not where site, clock and mount of the station file say. Where the errors
that are left without the mistake keep the limits, no row fails for it: the word is INCONCLUSIVE, and the mistake is the
first reason. A mirrored image or a focal length under which nothing can be identified is one too, and so is a host
whose clock shows GPS time or TAI: no latency of a sensor is 18 or 37 s.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gse.assessment.counted_frames import CountedFrames
from gse.assessment.decision import Outcome, Row
from gse.assessment.diagnosis import gross_cause_of, left_with_clock_of
from gse.assessment.fine_findings import CLOCK_SCALES
from gse.finding import Finding
from gse.limits import Limits
from gse.station.event_kinds import StationKind
from gse.station.frame_table import STATUSES
from gse.station.results import Status, Subject
from gse.station.session_data import SessionData

_OF_CAMERA = {"mirrored image": StationKind.MIRRORED, "focal length": StationKind.WRONG_CAMERA}
_KEPT_SHARE = 0.9
"""Of some 15 frames: one may lie outside."""
_OF_IDENTIFICATION = ("availability",)


def set_up_mistake(session: SessionData, counted: CountedFrames, found: tuple[Finding, ...]) -> Finding | None:
    """The one of the findings that explains it all, if there is one."""
    of_camera = [finding for finding in found if _hides_all(session, finding)]
    if of_camera:
        return of_camera[0]
    for finding in found:
        if finding.cause in CLOCK_SCALES:
            left_arcsec = left_with_clock_of(session, counted, CLOCK_SCALES[finding.cause])
            return finding if _keeps(left_arcsec, session.station.limits) else None
    gross = [finding for finding in found if finding.is_gross]
    cause = gross_cause_of(session, counted) if gross else None
    if cause is None or not _keeps(cause.left_arcsec, session.station.limits):
        return None
    return cause.finding


def _hides_all(session: SessionData, finding: Finding) -> bool:
    """Whether it is a camera stated wrongly, under which no panorama was identified."""
    status = session.frames.columns["status"]
    kinds = {event.kind for event in session.events}
    is_told = _OF_CAMERA.get(finding.cause) in kinds
    return is_told and not (status == STATUSES.index(Status.IDENTIFIED)).any()


def _keeps(left_arcsec: NDArray[np.float64], limits: Limits) -> bool:
    if not len(left_arcsec):
        return False
    across = np.hypot(left_arcsec[:, 0], left_arcsec[:, 1]) <= np.hypot(limits.d_ra_cosde_arcsec, limits.d_de_arcsec)
    return bool((across & (np.abs(left_arcsec[:, 2]) <= limits.d_roll_arcsec)).mean() >= _KEPT_SHARE)


def excused(row: Row, mistake: Finding) -> Row:
    """A row that fails by the mistake: INCONCLUSIVE; another as it is."""
    is_identification = row.subject is Subject.ONBOARD and row.name in _OF_IDENTIFICATION
    by_it = is_identification if mistake.cause in _OF_CAMERA else row.unit == "arcsec"
    if row.outcome is not Outcome.FAIL or not by_it:
        return row
    return replace(row, outcome=Outcome.INCONCLUSIVE, reason=f"{row.reason}: by the set-up ({mistake.cause})")
