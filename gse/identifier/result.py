"""Answer of an identifier."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray


class Reason(StrEnum):
    """Why there is no identification."""

    TOO_FEW = "TOO_FEW"
    NO_MATCH = "NO_MATCH"
    MIRRORED = "MIRRORED"
    """The image is a mirror image of the sky: ``sensor.mirrored`` of the station file is wrong."""
    AMBIGUOUS = "AMBIGUOUS"
    SENSOR_FAULT = "SENSOR_FAULT"


@dataclass(frozen=True, slots=True, eq=False)
class Identification:
    """Objects of a panorama and their stars.

    ``objects`` (M,) are row numbers of the panorama, ``stars`` (M,) row numbers of the identifier's catalogue, in the
    same order; ``false_match_probability`` bounds the probability of such an answer to a panorama of random objects.
    """

    objects: NDArray[np.int64]
    stars: NDArray[np.int64]
    false_match_probability: float


@dataclass(frozen=True, slots=True)
class Unidentified:
    """No answer, with its reason; ``detail`` is one line for a person."""

    reason: Reason
    detail: str
