"""A mount that was moved while the session ran: pushed for good, kicked and put back, jumping, or turned repeatedly.

Panoramas then show directions that hold still. Nobody vouches that a mount is not touched; without panoramas
nothing independent tells such an error from one of the sensor.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gse.diagnosis.fine_causes import MOST_SLIP_ARCSEC
from gse.diagnosis.gross_causes import angle_text
from gse.station.columns import ANSWER_CHECKS
from gse.station.events import Finding
from gse.station.exclusions import Cause, Exclusion
from gse.station.frame_columns import Columns
from gse.station.results import AnswerCheck, Subject
from gse.station.session_data import SessionData
from gse.statistics.counted_frames import CountedFrames
from gse.values.axis import ON_SKY
from gse.values.constants import ARCSEC_PER_RAD
from gse.values.instant import LAST_NS, NS_PER_S, to_text
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


# A mount that was turned several times, and held still after each.
#
# A stretch begins with frames that look in one direction, and ends where several in a row do not. What drifts or swings
# leaves it as well, but into a next one that lies beside it; a mount that was turned stands far from where it stood.

_FEWEST_HELD, _LEAST_HELD_NS = 20, 30 * NS_PER_S
"""What is looked at for less is passed on the way."""
_IN_A_ROW, _MOST_STRAY = 5, 0.25
"""So many frames in a row leave a stretch; of the first of it so large a share may be false, as elsewhere."""
_BLOCK = 1000
_TIMES_NOISE, _LEAST_WITHIN_ARCSEC = 6.0, 15.0
"""Frames of one stretch lie within this of each other: stars come and go, and a mount settles."""
_TIMES_WITHIN = 4.0
"""Two stretches lie so many times further apart; those of a drift lie twice as far."""
_MOST_BETWEEN = 0.1
"""Share of the frames that belong to no stretch: more are no mount that stands, and would hide too much."""


def pointings(session: SessionData, counted: CountedFrames) -> tuple[NDArray[np.int64], ...]:
    """The rows of the frames in each stretch in which the mount held still, three or more of them; none of another.

    Two directions that are further apart than a push may well be two sensors, or another sky.
    """
    frames = session.frames.columns
    rows = np.flatnonzero(shown_frames(session, counted))
    if session.subject is not Subject.ONBOARD or len(rows) < 3 * _FEWEST_HELD:
        return ()
    rows = rows[np.argsort(frames["utc_ns"][rows], kind="stable")]
    errors = np.column_stack([frames[name][rows] for name in ("cross_x_arcsec", "cross_y_arcsec", "d_roll_arcsec")])
    errors = errors.astype(np.float64) * _WEIGHTS
    noise = float(np.median(np.linalg.norm(np.diff(errors, axis=0), axis=1))) / math.sqrt(2)
    within = max(_TIMES_NOISE * noise, _LEAST_WITHIN_ARCSEC)
    held = [part for part in _held(errors, within) if np.ptp(frames["utc_ns"][rows[part]]) >= _LEAST_HELD_NS]
    if len(held) < 3 or sum(len(rows[part]) for part in held) < (1 - _MOST_BETWEEN) * len(rows):
        return ()
    middles = np.array([np.median(errors[part], axis=0) for part in held])
    apart = np.linalg.norm(middles[:, None] - middles, axis=2)
    are_two = bool((apart[:, [0, 1]].min(axis=1) < _TIMES_WITHIN * within).all())
    if np.diagonal(apart, 1).min() < _TIMES_WITHIN * within or (are_two and apart[0, 1] > MOST_SLIP_ARCSEC):
        return ()
    of_reference = [_from_reference_arcsec(frames, rows[part]) for part in held]
    return tuple(rows[part] for part in held) if max(of_reference) - min(of_reference) < within else ()


_WEIGHTS = np.array([1.0, 1.0, 0.1])
"""A field shows roll ten times worse than direction."""


def _held(errors: NDArray[np.float64], within: float) -> Iterator[slice]:
    """The stretches of errors (K, 3) that lie so near to each other; those that are long enough."""
    first = passed = 0
    while first + _FEWEST_HELD <= len(errors) and passed <= _MOST_BETWEEN * len(errors):
        begin = errors[first : first + _FEWEST_HELD]
        middle = np.median(begin, axis=0)
        off = np.linalg.norm(begin - middle, axis=1) > within
        if off[0] or off.mean() > _MOST_STRAY:
            first, passed = first + 1, passed + 1
            continue
        until = _left(errors, first, middle, within)
        yield slice(first, until)
        first = until


def _left(errors: NDArray[np.float64], first: int, middle: NDArray[np.float64], within: float) -> int:
    """Where several errors in a row lie elsewhere, from the first on; in blocks, as short stretches may be many."""
    for at in range(first, len(errors), _BLOCK):
        off = np.linalg.norm(errors[at : at + _BLOCK + _IN_A_ROW - 1] - middle, axis=1) > within
        left = np.flatnonzero(np.convolve(off, np.ones(_IN_A_ROW), "valid") == _IN_A_ROW)
        if len(left):
            return at + int(left[0])
    return len(errors)


def _from_reference_arcsec(frames: Columns, rows: NDArray[np.int64]) -> float:
    """How far the answers of some frames lie from those of the reference identifier; 0 where it has none."""
    ra, de, ra_reference, de_reference = (
        np.radians(frames[f"{name}_deg"][rows]) for name in ("ra", "de", "ra_reference", "de_reference")
    )
    across = np.sin((ra - ra_reference) / 2) ** 2 * np.cos(de) * np.cos(de_reference)
    arcsec = 2 * ARCSEC_PER_RAD * np.arcsin(np.sqrt(np.sin((de - de_reference) / 2) ** 2 + across))
    known = arcsec[np.isfinite(arcsec)]
    return float(np.median(known)) if len(known) else 0.0


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
