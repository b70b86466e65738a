"""The equivalence test: the sensor's own answers (ATTITUDE frames) against the onboard-equivalent ones here.

Same stars, same direction: where firmware and its rebuilding do the same, both agree to what the wire carries.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.assessment.percentiles import Percentiles, percentiles
from gse.constants import ARCSEC_PER_RAD
from gse.station.frame_table import STATUSES
from gse.station.results import Status
from protocols import AttitudeMessage

ACQUIRED = "acquired"
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
    frames: NDArray[np.void], kept: NDArray[np.int64], answers: Sequence[AttitudeMessage]
) -> OnboardEquivalence | None:
    """Compare the sensor's answers with rows ``kept`` of frames (dtype FRAME); None where it sent none for them."""
    if not answers:
        return None
    keys = zip(frames["frame_no"][kept].tolist(), frames["time_us"][kept].tolist(), strict=True)
    places = {key: row for row, key in zip(kept.tolist(), keys, strict=True)}
    paired = [(places[key], answer) for answer in answers if (key := (answer.frame_no, answer.time_us)) in places]
    if not paired:
        return None
    here = frames[[row for row, _ in paired]]
    identified = here["status"] == STATUSES.index(Status.IDENTIFIED)
    acquired = np.array([answer.state == ACQUIRED for _, answer in paired])
    both = identified & acquired
    ra, de, roll = (
        np.array([getattr(answer, name) for _, answer in paired]) for name in ("ra_deg", "de_deg", "roll_deg")
    )
    apart = np.linalg.norm(_unit(ra, de) - _unit(here["ra_deg"], here["de_deg"]), axis=1) * ARCSEC_PER_RAD
    turned = np.abs((roll - here["roll_deg"] + 180) % 360 - 180) * 3600
    matched = np.array([answer.matched for _, answer in paired])
    return OnboardEquivalence(
        answers=len(paired),
        both=int(both.sum()),
        only_sensor=int((acquired & ~identified).sum()),
        only_station=int((identified & ~acquired).sum()),
        same_number=int((both & (matched == here["matched"])).sum()),
        separation_arcsec=percentiles(apart[both]),
        roll_arcsec=percentiles(turned[both]),
        latency_ms=percentiles(np.array([answer.latency_s for _, answer in paired]) * 1e3),
    )


def _unit(ra_deg: NDArray[np.float64], de_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    ra, de = np.radians(ra_deg), np.radians(de_deg)
    return np.column_stack([np.cos(de) * np.cos(ra), np.cos(de) * np.sin(ra), np.sin(de)])
