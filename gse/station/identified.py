"""What follows from panoramas: first from them alone, then with truth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gse.external.identifier import Given
from gse.identifier import Answers
from gse.station.results import Matches, Starlight
from gse.values.attitude import Attitudes


@dataclass(frozen=True, slots=True, eq=False)
class Identified:
    """What follows from K panoramas alone: answers under test, their attitudes, the reference identifier's checks.

    ``directions_sensor`` (M, 3) are of all objects; a panorama that is not ``sound`` (K,) was shown to no identifier.
    ``elapsed_us`` (K,) is the time from objects to RA and DE: this host's processor time (of panoramas that waited
    together, the mean), or what an external identifier took; NaN where nothing was asked. ``given`` is what an
    external identifier gave, ``light`` what the named stars show of the sky. ``reference_icrs`` (K, 3) is the
    boresight by the reference identifier, ``separation_rad`` (K,) how far that of an answer lies from it; NaN where
    one of them is missing, and infinite where the stars of the answer are others. ``stretches`` without
    stars that ended are told in words, each with the panorama that ended it.
    """

    directions_sensor: NDArray[np.float64]
    sound: NDArray[np.bool_]
    answers: Answers
    attitudes: Attitudes
    answer_check: NDArray[np.uint8]
    separation_rad: NDArray[np.float64]
    reference_icrs: NDArray[np.float64]
    light: Starlight
    elapsed_us: NDArray[np.float64]
    given: Mapping[int, Given] = field(default_factory=dict)
    stretches: Sequence[tuple[int, str]] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """What follows from the answers to K panoramas with truth; NaN where there is no answer, or no truth.

    ``attitudes`` are those of the answers; a roll that was not answered (``has_roll`` (K,)) is that of the truth.
    ``geometric`` attitudes are freed of aberration and refraction, ``true`` ones are where the mount looked, and
    ``errors_arcsec`` (K, 5), the fields of AttitudeError, are between these two. ``residuals_arcsec`` (M, 2) are of the
    answers' matches; ``left_out`` are stars that no answer names.
    """

    attitudes: Attitudes
    geometric: Attitudes
    true: Attitudes
    errors_arcsec: NDArray[np.float64]
    residuals_arcsec: NDArray[np.float64]
    left_out: Matches
    has_roll: NDArray[np.bool_]
