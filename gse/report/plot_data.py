"""What the figures of a report are drawn from."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gse.assessment.statistics import OUTLIER_ARCSEC
from gse.station.exclusions import excluded
from gse.station.frame_table import ANSWER_CHECKS, STATUSES
from gse.station.results import AnswerCheck, Status
from gse.station.session_data import SessionData

_EDGE_PERCENTILE = 99.5


@dataclass(frozen=True, slots=True, eq=False)
class PlotData:
    """Frames of a night in order of time, and which of them the accuracy figures are taken over.

    ``frames`` are rows of FRAME, ``utc`` (N,) their instants, ``good`` (N,) marks identified frames that are neither
    false nor left out; ``unidentified`` (N,) those without an answer.
    """

    session: SessionData
    frames: NDArray[np.void]
    utc: NDArray[np.datetime64]
    good: NDArray[np.bool_]
    unidentified: NDArray[np.bool_]

    @classmethod
    def of(cls, session: SessionData) -> "PlotData":
        """The frames of a night."""
        frames = session.frames.columns
        if (np.diff(frames["utc_ns"]) < 0).any():  # a step of the clock; a copy of a long night is 40 MB
            frames = frames[np.argsort(frames["utc_ns"], kind="stable")]
        answered = frames["status"] == STATUSES.index(Status.IDENTIFIED)
        named_false = frames["judge"] == ANSWER_CHECKS.index(AnswerCheck.FALSE)
        out = excluded(frames["utc_ns"], session.exclusions())
        good = answered & ~named_false & ~out & np.isfinite(frames["d_de_arcsec"]) & _near(frames)
        return cls(session, frames, frames["utc_ns"].astype("datetime64[ns]"), good, ~answered)

    def used(self, name: str) -> NDArray[Any]:
        """A column of the good frames."""
        column: NDArray[Any] = self.frames[name][self.good]
        return column


def _near(frames: NDArray[np.void]) -> NDArray[np.bool_]:
    x, y = frames["cross_x_arcsec"], frames["cross_y_arcsec"]
    if not np.isfinite(x).any():
        return np.zeros(len(frames), dtype=bool)
    near: NDArray[np.bool_] = np.hypot(x - np.nanmedian(x), y - np.nanmedian(y)) <= OUTLIER_ARCSEC
    return near


def edge_of(values: NDArray[np.float64], limit: float) -> float:
    """The range that a figure needs: 1.3 limits, or more where most of the values lie further out."""
    finite = np.abs(values[np.isfinite(values)])
    most = float(np.percentile(finite, _EDGE_PERCENTILE)) if len(finite) else 0.0
    return max(1.3 * limit, 1.2 * most)
