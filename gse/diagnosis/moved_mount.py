"""A mount that was moved while the session ran: pushed for good, kicked and put back, or jumping.

Panoramas then show two directions that both hold still. Nobody vouches that a mount is not touched; without panoramas
nothing independent tells such an error from one of the sensor.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gse.diagnosis.fine_causes import MOST_SLIP_ARCSEC
from gse.diagnosis.gross_causes import angle_text
from gse.station.columns import ANSWER_CHECKS
from gse.station.events import Finding
from gse.station.exclusions import Cause, Exclusion
from gse.station.results import AnswerCheck, Subject
from gse.station.session_data import SessionData
from gse.statistics.counted_frames import CountedFrames
from gse.values.axis import ON_SKY
from gse.values.instant import LAST_NS, to_text
from gse.values.matrices import length

SLIP = "slip of the mount"
_FEWEST_SHOWN = 30
_LEAST_TIMES, _MOST_OUTLIERS = 5.0, 0.01
"""The two directions are so many times further apart than answers scatter, and nearly all answers belong to one."""
_MOST_JUMPING = 0.2
"""Share of frames: more that come and go are two sensors, or a mount that is switched."""
_FEWEST_AWAY = 2
"""One frame that looks elsewhere may be any error of one exposure."""


@dataclass(frozen=True, slots=True, eq=False)
class Moved:
    """The frames (M,) that look elsewhere, by how much, and when that changed: once, twice, or more often."""

    away: NDArray[np.bool_]
    apart_arcsec: float
    changes_ns: tuple[int, ...]

    @property
    def comes_back(self) -> bool:
        """Whether it was kicked and put back, once."""
        return len(self.changes_ns) == 2 and int(self.away.sum()) >= _FEWEST_AWAY

    @property
    def is_proven(self) -> bool:
        """Whether one stretch of the session, at its end or within it, looks elsewhere."""
        return len(self.changes_ns) == 1 or self.comes_back

    def parts_of(self, session: SessionData) -> tuple[SessionData, SessionData]:
        """The session of the one direction and of the other: in each the frames of the other have no truth."""
        first, last = self.changes_ns[0], self.changes_ns[-1] if self.comes_back else LAST_NS
        reason = "the mount looked elsewhere"
        within = (Exclusion(first, last, reason, Cause.MOUNT),)
        beside = tuple(Exclusion(*ends, reason, Cause.MOUNT) for ends in ((0, first), (last, LAST_NS)))
        return tuple(replace(session, excluded=(*session.excluded, *some)) for some in (within, beside))  # type: ignore[return-value]


def shown_frames(session: SessionData, counted: CountedFrames) -> NDArray[np.bool_]:
    """Frames (M,) whose errors are those of the sky that was seen: of the right stars, at a known time."""
    frames = session.frames.columns
    known = np.isfinite(frames["cross_x_arcsec"]) & np.isfinite(frames["d_roll_arcsec"])
    wrong = frames["answer_check"] == ANSWER_CHECKS.index(AnswerCheck.FALSE)
    return np.asarray(counted.answered & known & ~wrong & ~counted.excluded)


def moved_mount(session: SessionData, counted: CountedFrames) -> Moved | None:
    """How the panoramas show that the mount was moved; None where they do not.

    No push turns a mount by more than MOST_SLIP_ARCSEC.
    """
    frames = session.frames.columns
    if session.subject is not Subject.ONBOARD:
        return None
    rows = np.flatnonzero(shown_frames(session, counted))
    rows = rows[np.argsort(frames["utc_ns"][rows], kind="stable")]
    if len(rows) < _FEWEST_SHOWN:
        return None
    errors = np.column_stack([frames["cross_x_arcsec"][rows], frames["cross_y_arcsec"][rows]]).astype(np.float64)
    away = _rarely_away(errors)
    away = _from_a_split_on(errors) if away is None else away
    middles = np.array([np.median(errors[mask], axis=0) for mask in (~away, away)])
    off = np.linalg.norm(errors[:, None] - middles, axis=2)
    away, apart = off[:, 1] < off[:, 0], length(middles[1] - middles[0])
    off = off.min(axis=1)
    if not _LEAST_TIMES * float(np.median(off)) < apart < MOST_SLIP_ARCSEC or (off > apart / 2).mean() > _MOST_OUTLIERS:
        return None
    changes = np.flatnonzero(np.diff(away)) + 1
    if len(changes) == 2:
        away = away if away[changes[0]] else ~away
    all_away = np.zeros(len(frames), dtype=bool)
    all_away[rows[away]] = True
    return Moved(all_away, apart, tuple(frames["utc_ns"][rows[changes]].tolist())) if len(changes) else None


def _rarely_away(errors: NDArray[np.float64]) -> NDArray[np.bool_] | None:
    """Those (K,) that lie far from most; None where as many lie here as there."""
    off = np.linalg.norm(errors - np.median(errors, axis=0), axis=1)
    away = off > _LEAST_TIMES * np.median(off)
    return away if away.any() else None


def _from_a_split_on(errors: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Those (K,) from the instant on that parts the errors best."""
    until = np.arange(1, len(errors))
    sums = np.cumsum(errors - errors.mean(axis=0), axis=0)[:-1]
    parts_it = int(np.argmax((sums**2).sum(axis=1) / (until * (len(errors) - until))))
    return np.arange(len(errors)) > parts_it


def moved_finding(session: SessionData, moved: Moved) -> Finding | None:
    """A mount that was put back, or that jumps; None of a smaller step than a limit, and of one that stays."""
    limits, frames = session.station.limits, session.frames.columns
    if moved.apart_arcsec <= min(limits.of(axis) for axis in ON_SKY):
        return None
    apart, count = angle_text(moved.apart_arcsec / 3600), int(moved.away.sum())
    if moved.comes_back:
        first, last = (to_text(ns, 1) for ns in moved.changes_ns)
        return Finding(
            "slip of the mount",
            f"from {first} to {last} it looked {apart} elsewhere ({count} frames), and then came back",
            ("panoramas of another sky in between",),
            f'if it was touched, say so: gse report SESSION --leave-out "{first}/{last}=mount: touched"',
        )
    if len(moved.changes_ns) > 2 and _FEWEST_AWAY <= count <= _MOST_JUMPING * len(frames):
        return Finding(
            "panoramas elsewhere",
            f"{count} of {len(frames)} panoramas show the sky {apart} away from where the others do, in "
            f"{math.ceil(len(moved.changes_ns) / 2)} stretches",
            ("a mount that is knocked or shaken again and again", "a sensor that sends older pictures in between"),
            "look at these frames: gse view SESSION; fix the mount, and repeat the session",
        )
    return None
