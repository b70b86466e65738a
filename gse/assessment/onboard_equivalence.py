"""The equivalence test: the sensor's own answers (ATTITUDE frames) against the onboard-equivalent ones here.

Same stars, same direction: where firmware and its rebuilding do the same, both agree to what the wire carries.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.assessment.percentiles import Percentiles, percentiles
from gse.assessment.sensor_answers import SensorAnswers
from gse.constants import ARCSEC_PER_RAD
from gse.station.frame_table import STATUSES
from gse.station.results import Status

SAME_WITHIN_ARCSEC = 1.0
"""The wire carries 0.0036 arcsec; single precision on board makes some 0.1."""


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
    frames: NDArray[np.void], excluded: NDArray[np.bool_], matched: NDArray[np.int64], own: SensorAnswers
) -> OnboardEquivalence | None:
    """Compare the sensor's answers with those here, without ``excluded`` frames (M,); None where there are none.

    ``matched`` (M,) is how many stars the sensor says it identified.
    """
    rows = np.flatnonzero(own.sent & ~excluded)
    if not len(rows):
        return None
    here, acquired = frames[rows], own.acquired[rows]
    identified = here["status"] == STATUSES.index(Status.IDENTIFIED)
    both = identified & acquired
    sensor, station = _unit(own.ra_deg[rows], own.de_deg[rows]), _unit(here["ra_deg"], here["de_deg"])
    apart = np.linalg.norm(sensor - station, axis=1) * ARCSEC_PER_RAD
    turned = np.abs((own.roll_deg[rows] - here["roll_deg"] + 180) % 360 - 180) * 3600
    return OnboardEquivalence(
        answers=len(rows),
        both=int(both.sum()),
        only_sensor=int((acquired & ~identified).sum()),
        only_station=int((identified & ~acquired).sum()),
        same_number=int((both & (matched[rows] == here["matched"])).sum()),
        separation_arcsec=percentiles(apart[both]),
        roll_arcsec=percentiles(turned[both]),
        latency_ms=percentiles(own.latency_ms[rows]),
    )


def _unit(ra_deg: NDArray[np.float64], de_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    ra, de = np.radians(ra_deg), np.radians(de_deg)
    return np.column_stack([np.cos(de) * np.cos(ra), np.cos(de) * np.sin(ra), np.sin(de)])
