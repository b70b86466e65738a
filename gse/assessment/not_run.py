"""Frames that were lost while this computer did not run the station: no fault of the sensor."""

from dataclasses import replace

import numpy as np

from drivers.chunk import LinkKind
from gse.assessment.requirements import requirement_of
from gse.instant import NS_PER_S
from gse.station.session_data import SessionData
from gse.statistics.decision import Claim, Outcome, Row
from gse.statistics.session_statistics import Statistics

_FOUND_WITHIN_NS = 5 * NS_PER_S
"""First come the frames that the port held, then those that follow the loss."""


def lost_while_not_run(session: SessionData) -> int:
    """How many panoramas are missing right after the events NOT_RUN: by time tags, and at most those that are lost."""
    frames = session.frames.columns
    resumed_ns = np.sort([event.utc_ns for event in session.events if event.kind == LinkKind.NOT_RUN])
    if len(resumed_ns) == 0 or len(frames) < 2:
        return 0
    latest = np.searchsorted(resumed_ns, frames["host_utc_ns"][1:], side="right") - 1
    after_ns = frames["host_utc_ns"][1:] - resumed_ns[latest]
    gaps_us = np.diff(frames["time_us"].astype(np.float64))
    usual_us = float(np.median(gaps_us))
    if usual_us <= 0:
        return 0
    missing = np.maximum(np.rint(gaps_us / usual_us) - 1, 0)
    found = missing[(latest >= 0) & (after_ns < _FOUND_WITHIN_NS)].sum()
    return min(int(found), session.panoramas_lost)


def under_stop(row: Row, session: SessionData, stats: Statistics) -> Row:
    """An availability that fails by frames that were lost while the station was not run: INCONCLUSIVE."""
    if row.outcome is not Outcome.FAIL or requirement_of(row).claim is not Claim.ABSENCE:
        return row
    lost, available = lost_while_not_run(session), stats.subjects[row.subject].available
    if lost == 0 or available.count < row.limit * (available.of - lost):
        return row
    reason = f"{row.reason}: {lost} were lost while this computer did not run the station"
    return replace(row, outcome=Outcome.INCONCLUSIVE, reason=reason)
