"""The gross cause of a session: its answers against the stated site, mount and clock."""

import numpy as np
from numpy.typing import NDArray

from gse.diagnosis.gross_causes import GrossCause, gross_cause, left_with
from gse.diagnosis.raw_attitudes import RawAttitudes
from gse.finding import Finding
from gse.instant import NS_PER_DAY
from gse.site import Site
from gse.station.frame_table import ANSWER_CHECKS
from gse.station.results import AnswerCheck
from gse.station.session_data import SessionData
from gse.statistics.counted_frames import CountedFrames
from gse.truth.orientation import FIRST_NS

_TURNED_BACK_NS = 2 * NS_PER_DAY
"""More than any mistake that is tried turns the clock back by."""


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
    has_truth = frames["utc_ns"] >= FIRST_NS + _TURNED_BACK_NS
    rows = np.flatnonzero(counted.answered & ~checked_false & ~counted.excluded & has_roll & has_truth)
    if not mount.stated or mount.inertial is not None or not len(rows):
        return None
    return RawAttitudes.of(frames, rows, session.station.sensor.camera())
