"""A low field: air parts its stars by more than an identifier allows that knows no air.

In orbit there is none: an identifier that fails for it on the ground has not failed.
"""

from gse.station.columns import ANSWER_CHECKS, STATUSES
from gse.station.own_answers import OwnAnswerTruth, field_of
from gse.station.results import AnswerCheck, Status
from gse.station.session_data import SessionData, middle_instant_ns
from gse.truth import truth_of
from gse.values.constants import ARCSEC_PER_RAD

_OF_TOLERANCE = 0.5
"""Root mean square over the field: the distance of two stars is then off by up to three times as much."""


def air_in_field(session: SessionData) -> str:
    """How far air parts the stars of the field, in words, where that is too far for an identifier; else nothing."""
    station, utc_ns = session.station, middle_instant_ns(session)
    mount = session.alignment.mount if session.alignment else station.mount
    truth = truth_of(station.site, mount, session.earth_orientation)
    if truth is None or mount.inertial is not None or utc_ns is None:
        return ""
    camera = station.sensor.camera()
    field = OwnAnswerTruth(truth, mount, aberration_corrected=True, field_sensor=field_of(camera))
    arcsec = field.uneven_arcsec(utc_ns)
    px = arcsec / (camera.pixel_rad * ARCSEC_PER_RAD)
    if px < _OF_TOLERANCE * station.identifier.tolerance_px:
        return ""
    return f"air parts the stars of this low field by {arcsec:.0f} arcsec ({px:.1f} px, rms)"


def only_reference_answers(session: SessionData) -> bool:
    """Whether only the reference identifier names the stars of most frames, and the one under test does not fail."""
    frames = session.frames.columns
    failed = frames["status"] == STATUSES.index(Status.IDENTIFIER_FAULT)
    absent = (frames["answer_check"] == ANSWER_CHECKS.index(AnswerCheck.ABSENT)) & ~failed
    return bool(2 * absent.sum() > len(frames))
