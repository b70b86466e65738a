"""Which frames of a session count, decided once for statistics, false answers and plots.

What is left out, and what that excuses, is the table of gse.statistics.excuses. False answers count everywhere.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.station.columns import ANSWER_CHECKS, STATUSES
from gse.station.exclusions import Cause, Exclusion, excluded
from gse.station.frame_columns import Columns
from gse.station.results import AnswerCheck, Status
from gse.station.session_data import SessionData
from gse.statistics.decision import Claim
from gse.statistics.excuses import excusing, left_out
from gse.values.constants import EARTH_RATE_ARCSEC_PER_S

OUTLIER_ARCSEC = 1800.0
"""An answer this far from the median of all is not noise: half a degree."""


@dataclass(frozen=True, slots=True, eq=False)
class CountedFrames:
    """Masks (M,) over the rows of the frame table, and the stretches that are left out.

    ``answered`` frames have an answer under test; ``false`` ones a wrong one; ``excluded`` ones are left out of the
    statistics of accuracy, which ``used`` ones enter. ``expected`` frames must have an answer: an uncertain time
    excuses none that is missing or false.
    """

    answered: NDArray[np.bool_]
    false: NDArray[np.bool_]
    excluded: NDArray[np.bool_]
    expected: NDArray[np.bool_]
    used: NDArray[np.bool_]
    exclusions: tuple[Exclusion, ...]

    def frames_of(self, cause: Cause, utc_ns: NDArray[np.int64]) -> int:
        """How many frames at instants (M,) the stretches of one cause leave out."""
        return int(excluded(utc_ns, [item for item in self.exclusions if item.cause is cause]).sum())


def counted_frames(session: SessionData) -> CountedFrames:
    """Decide which frames of a session count."""
    frames = session.frames.columns
    stretches = left_out(session)
    mask = excluded(frames["utc_ns"], excusing(Claim.ACCURACY, stretches))
    answered = np.asarray(frames["status"] == STATUSES.index(Status.IDENTIFIED))
    false = false_answers(frames, mask, stretches)
    used = answered & ~false & ~mask & np.isfinite(frames["d_de_arcsec"])
    expected = ~excluded(frames["utc_ns"], excusing(Claim.ABSENCE, stretches))
    return CountedFrames(answered, false, mask, expected, used, stretches)


def false_answers(
    frames: Columns, mask: NDArray[np.bool_] | None = None, stretches: tuple[Exclusion, ...] = ()
) -> NDArray[np.bool_]:
    """Which frames (M,) were answered falsely.

    The reference identifier names other stars; or the answer lies far from the median of the frames that are not in
    ``mask``, and nothing confirms its stars; or it lies further off than the uncertain time of its stretch explains.
    """
    answered = np.asarray(frames["status"] == STATUSES.index(Status.IDENTIFIED))
    checked_false = answered & (frames["answer_check"] == ANSWER_CHECKS.index(AnswerCheck.FALSE))
    among = answered & ~checked_false if mask is None else answered & ~checked_false & ~mask
    separation_arcsec = _from_median(frames, among)
    outlier = answered & (separation_arcsec > OUTLIER_ARCSEC)
    confirmed = frames["answer_check"] == ANSWER_CHECKS.index(AnswerCheck.CORRECT)
    within_arcsec = explained_arcsec(frames, stretches)
    unexplained = outlier & (within_arcsec > OUTLIER_ARCSEC) & (separation_arcsec > within_arcsec)
    return np.asarray(checked_false | (outlier & ~confirmed) | unexplained)


def _from_median(frames: Columns, among: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Separation (M,) of each answer from the median one, in arcsec; 0 where there is nothing to compare.

    A wrong mount moves all answers alike, a false answer only itself.
    """
    x, y = frames["cross_x_arcsec"], frames["cross_y_arcsec"]
    known = among & np.isfinite(x)
    if not known.any():
        return np.zeros(len(frames))
    separation: NDArray[np.float64] = np.hypot(x - np.median(x[known]), y - np.median(y[known]))
    return np.nan_to_num(separation)


def explained_arcsec(frames: Columns, stretches: tuple[Exclusion, ...]) -> NDArray[np.float64]:
    """How far (M,) from the median an answer may lie: half a degree, and what the uncertain time of a stretch makes."""
    time_error_s = np.zeros(len(frames))
    for item in stretches:
        if item.time_error_s:
            inside = excluded(frames["utc_ns"], [item])
            time_error_s[inside] = np.maximum(time_error_s[inside], item.time_error_s)
    return np.asarray(OUTLIER_ARCSEC + EARTH_RATE_ARCSEC_PER_S * time_error_s)
