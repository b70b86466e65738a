"""What the figures of a report are drawn from."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from gse.assessment.counted_frames import CountedFrames
from gse.assessment.sensor_answers import SensorAnswers
from gse.station.exclusions import Exclusion
from gse.station.results import Subject
from gse.station.session_data import SessionData

_OF_ANSWERS = ("utc_ns", "de_true_deg", "d_ra_cosde_arcsec", "d_de_arcsec", "cross_x_arcsec", "cross_y_arcsec")
"""What the plots of a subject are drawn from."""
_EDGE_PERCENTILE = 99.5
_ARCSEC_PER_DEG = 3600.0


@dataclass(frozen=True, slots=True, eq=False)
class PlotData:
    """Frames of a night in order of time, and which of them the accuracy figures are taken over.

    ``frames`` are rows of FRAME, ``utc`` (N,) their instants, ``good`` (N,) marks identified frames that are neither
    false nor left out; ``unidentified`` (N,) those without an answer. All is of one ``subject``.
    """

    session: SessionData
    frames: NDArray[np.void]
    utc: NDArray[np.datetime64]
    good: NDArray[np.bool_]
    unidentified: NDArray[np.bool_]
    exclusions: tuple[Exclusion, ...]
    subject: Subject = Subject.ONBOARD

    @classmethod
    def of(cls, session: SessionData, counted: CountedFrames) -> "PlotData":
        """The frames of a session; ``counted`` decides which of them the accuracy is drawn of."""
        frames = session.frames.columns
        used, answered = counted.used, counted.answered
        if (np.diff(frames["utc_ns"]) < 0).any():  # a step of the clock; a copy of a long session is 40 MB
            order = np.argsort(frames["utc_ns"], kind="stable")
            frames, used, answered = frames[order], used[order], answered[order]
        utc = frames["utc_ns"].astype("datetime64[ns]")
        return cls(session, frames, utc, used, ~answered, counted.exclusions, session.subject)

    @classmethod
    def of_sensor(
        cls, session: SessionData, own: SensorAnswers, used: NDArray[np.bool_], counted: CountedFrames
    ) -> Self:
        """The sensor's own answers beside panoramas, in columns of the same names."""
        table = session.frames.columns
        frames = np.empty(len(table), dtype=[(name, table.dtype[name]) for name in _OF_ANSWERS])
        for name in _OF_ANSWERS:
            frames[name] = getattr(own, name) if hasattr(own, name) else table[name]
        acquired = own.acquired
        if (np.diff(frames["utc_ns"]) < 0).any():
            order = np.argsort(frames["utc_ns"], kind="stable")
            frames, used, acquired = frames[order], used[order], acquired[order]
        utc = frames["utc_ns"].astype("datetime64[ns]")
        return cls(session, frames, utc, used, ~acquired, counted.exclusions, Subject.SENSOR)

    def used(self, name: str) -> NDArray[Any]:
        """A column of the good frames."""
        column: NDArray[Any] = self.frames[name][self.good]
        return column


def unit_of(edge_arcsec: float) -> tuple[float, str]:
    """The unit of an axis that reaches to this edge, and its size: degrees from one degree on."""
    return (1 / 3600, "deg") if edge_arcsec >= _ARCSEC_PER_DEG else (1.0, "arcsec")


def edge_of(values: NDArray[np.float64], limit: float) -> float:
    """The range that a figure needs: 1.3 limits, or more where most of the values lie further out."""
    finite = np.abs(values[np.isfinite(values)])
    most = float(np.percentile(finite, _EDGE_PERCENTILE)) if len(finite) else 0.0
    return max(1.3 * limit, 1.2 * most)
