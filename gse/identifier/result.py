"""What an identifier answers."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray


class Reason(StrEnum):
    """Why there is no identification; the names are those of ``status`` in gse.frame/1."""

    TOO_FEW = "TOO_FEW"
    NO_MATCH = "NO_MATCH"
    AMBIGUOUS = "AMBIGUOUS"
    SENSOR_FAULT = "SENSOR_FAULT"


@dataclass(frozen=True, slots=True, eq=False)
class Identification:
    """Objects of a panorama and the stars that they are.

    ``objects`` (M,) are row numbers of the panorama, ``stars`` (M,) row numbers of the identifier's catalogue, in the
    same order; ``chance`` bounds the probability that a panorama of random objects would be answered so.
    """

    objects: NDArray[np.int64]
    stars: NDArray[np.int64]
    false_match_probability: float


@dataclass(frozen=True, slots=True)
class Unidentified:
    """No answer, and why: ``detail`` is one line for a person."""

    reason: Reason
    detail: str
