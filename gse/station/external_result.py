"""What an external identifier gave, as an answer and as a result of the station.

Its RA, DE and roll are taken as they are: nothing is solved again. To compare them with truth they are corrected as the
station's own answers are: the objects that it calls stars (all, where it names none) lose their refraction, the places
on the sky where it puts them become apparent places, and the attitude between the two is the geometric one.
"""

import math

import numpy as np
from numpy.typing import NDArray

from gse.attitude import Attitude, solve_attitude
from gse.catalog import StarCatalog
from gse.constants import ARCSEC_PER_RAD
from gse.external.answers import ExternalAnswer, Failure
from gse.external.identifier import ExternalIdentifier, Given
from gse.external.panoramas import rows_here
from gse.identifier import Identification, Reason, Unidentified
from gse.panorama import Panorama
from gse.station.results import NO_MATCHES, Matches, Status
from gse.truth import SiderealTruth

_CROSS = np.array([[0.0, 0.0, 1.0], [0.05, 0.0, 1.0], [0.0, 0.05, 1.0]]) / np.sqrt([[1.0], [1.0025], [1.0025]])
"""Directions that stand for the objects where there are fewer than two."""


def identification_of(
    given: Given, panorama: Panorama, identifier: ExternalIdentifier
) -> tuple[Identification | Unidentified, Attitude | None]:
    """The answer as one of the station's own: its matched stars that the catalogue has, and its attitude."""
    answer = given.answer
    if isinstance(answer, Failure):
        return Unidentified(Reason.NO_MATCH, f"{answer.kind}: {answer.detail}"), None
    if answer.attitude is None:
        return Unidentified(Reason.NO_MATCH, _no_answer(answer)), None
    stars = identifier.rows_of(answer.star_ids)
    known = stars >= 0
    return Identification(rows_here(panorama, answer.objects)[known], stars[known], math.nan), answer.attitude


def status_of(given: Given) -> tuple[Status, str]:
    """Status and detail of a panorama without an answer."""
    answer = given.answer
    if isinstance(answer, Failure):
        return Status.IDENTIFIER_FAULT, f"{answer.kind}: {answer.detail}"
    known = {Status.TOO_FEW, Status.AMBIGUOUS, Status.SENSOR_FAULT}
    return next((status for status in known if status == answer.status), Status.NO_MATCH), _no_answer(answer)


def has_roll(given: Given | None) -> bool:
    """Whether the answer has a roll; RA and DE alone are enough."""
    return given is None or not isinstance(given.answer, ExternalAnswer) or given.answer.has_roll


def with_roll(attitude: Attitude, roll_deg: float) -> Attitude:
    """The same boresight with another roll."""
    return Attitude.from_angles(attitude.ra_deg, attitude.de_deg, roll_deg)


def geometric_of(
    attitude: Attitude, directions_sensor: NDArray[np.float64], truth: SiderealTruth, utc_ns: int
) -> Attitude:
    """The geometric attitude that follows from an answered one and the directions (N, 3) of the objects."""
    seen = directions_sensor if len(directions_sensor) > 1 else _CROSS
    zenith_sensor = attitude.icrs_to_sensor @ truth.icrs_to_horizon(utc_ns)[2]
    apparent = truth.apparent(seen @ attitude.icrs_to_sensor, utc_ns)
    return solve_attitude(truth.unrefracted(seen, zenith_sensor), apparent, 1e-4)


def matches_of(
    found: Identification,
    catalog: StarCatalog,
    attitude: Attitude,
    directions_sensor: NDArray[np.float64],
    truth: SiderealTruth | None,
    utc_ns: int,
) -> Matches:
    """The matched stars with their residuals from the answered ``attitude``, geometric where there is a truth."""
    if not len(found.objects):
        return NO_MATCHES
    measured = directions_sensor.take(found.objects, axis=0)
    stars_icrs = catalog.icrs.take(found.stars, axis=0)
    if truth is not None:
        zenith_sensor = attitude.icrs_to_sensor @ truth.icrs_to_horizon(utc_ns)[2]
        measured, stars_icrs = truth.unrefracted(measured, zenith_sensor), truth.apparent(stars_icrs, utc_ns)
    residuals_arcsec = (measured - stars_icrs @ attitude.icrs_to_sensor.T)[:, :2] * ARCSEC_PER_RAD
    return Matches(found.objects, found.stars, residuals_arcsec, catalog.name)


def _no_answer(answer: ExternalAnswer) -> str:
    return f"{answer.status}: {answer.detail}" if answer.detail else answer.status
