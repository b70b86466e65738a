"""The equivalence test: the sensor's own answers (ATTITUDE frames) against the onboard-equivalent ones here.

Same stars, same direction: where firmware and its rebuilding do the same, both agree to what the wire carries.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.station.columns import STATUSES
from gse.station.frame_columns import Columns
from gse.station.own_answers import SensorAnswers
from gse.station.results import Status
from gse.statistics.sampling import Percentiles, percentiles
from gse.values.attitude_convention import from_angles
from gse.values.constants import ARCSEC_PER_RAD

# Differences between the sensor's own answers and the station's to the same panoramas, in the sensor frame.

_ROWS_AT_ONCE = 1 << 14
"""Rotations of more rows than these are large."""


def answer_differences(own: SensorAnswers, frames: Columns) -> NDArray[np.float64]:
    """The sensor's boresight (M, 2) along columns and rows from the one here, in arcsec; NaN where one is missing.

    Another body frame makes all of them alike, a wrong clock, site or mount none.
    """
    apart = np.full((len(frames), 2), np.nan)
    for first in range(0, len(frames), _ROWS_AT_ONCE):
        rows = slice(first, first + _ROWS_AT_ONCE)
        here = np.column_stack([frames[name][rows] for name in ("ra_deg", "de_deg", "roll_deg")]).astype(np.float64)
        apart[rows] = _apart(here, np.radians(own.ra_deg[rows]), np.radians(own.de_deg[rows]))
    return apart


def _apart(here_deg: NDArray[np.float64], ra: NDArray[np.float64], de: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of answers here, RA, DE and roll (M, 3), to RA and DE (M,) in radians."""
    apart = np.full((len(here_deg), 2), np.nan)
    sensor = np.column_stack([np.cos(de) * np.cos(ra), np.cos(de) * np.sin(ra), np.sin(de)])
    known = np.isfinite(here_deg).all(axis=1) & np.isfinite(sensor).all(axis=1)
    seen = np.einsum("mij,mj->mi", from_angles(*here_deg[known].T), sensor[known])
    # beyond 90 deg the sine falls again: what lies behind is as far as can be
    seen[seen[:, 2] < 0, :2] = 1.0
    apart[known] = seen[:, :2] * ARCSEC_PER_RAD
    return apart


SAME_WITHIN_ARCSEC = 1.0
"""The wire carries 0.0036 arcsec; single precision on board makes some 0.1."""
"""Directions of all frames of a night at once would take as much again as the frames."""


@dataclass(frozen=True, slots=True)
class OnboardEquivalence:
    """The sensor's answers for panoramas that are here.

    Of ``answers``, ``both`` were answered on either side, ``only_sensor`` and ``only_station`` on one; where both
    answered, ``same_number`` named as many stars, and ``separation_arcsec`` and ``roll_arcsec`` say how far the
    directions lie from each other. ``latency_ms`` is the sensor's own processing time.
    """

    answers: int
    both: int
    only_sensor: int
    only_station: int
    same_number: int
    separation_arcsec: Percentiles
    roll_arcsec: Percentiles
    latency_ms: Percentiles

    @property
    def same(self) -> bool:
        """Whether both sides always answered alike."""
        unlike = self.only_sensor + self.only_station
        return unlike == 0 and not self.separation_arcsec.max > SAME_WITHIN_ARCSEC


def equivalence(
    frames: Columns, excluded: NDArray[np.bool_], matched: NDArray[np.uint16], own: SensorAnswers
) -> OnboardEquivalence | None:
    """Compare the sensor's answers with those here, without ``excluded`` frames (M,); None where there are none.

    ``matched`` (M,) is how many stars the sensor says it identified.
    """
    counted = own.sent & ~excluded
    if not counted.any():
        return None
    identified = frames["status"] == STATUSES.index(Status.IDENTIFIED)
    rows = np.flatnonzero(counted & identified & own.acquired)  # of columns: whole rows of 8 h at 10 Hz are 54 MB
    return OnboardEquivalence(
        answers=int(counted.sum()),
        both=len(rows),
        only_sensor=int((counted & own.acquired & ~identified).sum()),
        only_station=int((counted & identified & ~own.acquired).sum()),
        same_number=int((matched[rows] == frames["matched"][rows]).sum()),
        separation_arcsec=percentiles(_separation_arcsec(frames, rows, own)),
        roll_arcsec=percentiles(np.abs((own.roll_deg[rows] - frames["roll_deg"][rows] + 180) % 360 - 180) * 3600),
        latency_ms=percentiles(own.latency_ms[counted]),
    )


def _separation_arcsec(frames: Columns, rows: NDArray[np.int64], own: SensorAnswers) -> NDArray[np.float64]:
    """How far the two boresights lie from each other in some rows (R,)."""
    separation_arcsec = np.empty(len(rows))
    for first in range(0, len(rows), _ROWS_AT_ONCE):
        part = rows[first : first + _ROWS_AT_ONCE]
        sensor = _unit(own.ra_deg[part], own.de_deg[part])
        station = _unit(frames["ra_deg"][part], frames["de_deg"][part])
        separation_arcsec[first : first + len(part)] = np.linalg.norm(sensor - station, axis=1) * ARCSEC_PER_RAD
    return separation_arcsec


def _unit(ra_deg: NDArray[np.float64], de_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    ra, de = np.radians(ra_deg), np.radians(de_deg)
    return np.column_stack([np.cos(de) * np.cos(ra), np.cos(de) * np.sin(ra), np.sin(de)])
