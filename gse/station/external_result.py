"""What an external identifier gave, as answers of the station, and compared with truth.

Its RA, DE and roll are taken as they are: nothing is solved again. To compare them with truth they are corrected as the
station's own answers are: the objects that it calls stars (all, where it names none) lose their refraction, the places
on the sky where it puts them become apparent places, and the attitude between the two is the geometric one.
"""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from gse.attitude import Attitude, Attitudes, solve_attitude
from gse.catalog import StarCatalog
from gse.constants import ARCSEC_PER_RAD
from gse.external.answers import ExternalAnswer, Failure
from gse.external.identifier import ExternalIdentifier, Given
from gse.external.panoramas import rows_here
from gse.identifier import Answers, Identification, Reason, Unidentified
from gse.matrices import product
from gse.mount import Mount
from gse.panorama import Panorama, Panoramas
from gse.station.attitude_error import attitude_errors
from gse.station.identified import Compared, Identified
from gse.station.results import ERRORS, Matches, Status
from gse.truth import SiderealTruth

_ARMS = np.array([[0.05, 0.0, 1.0], [-0.05, 0.0, 1.0], [0.0, 0.05, 1.0], [0.0, -0.05, 1.0]])
_CROSS = _ARMS / np.linalg.norm(_ARMS, axis=1, keepdims=True)
"""Directions that stand for the objects where there are fewer than two."""


def answers_of(
    identifier: ExternalIdentifier, panoramas: Panoramas, faults: Mapping[int, Unidentified]
) -> tuple[Answers, Attitudes, NDArray[np.float64], Mapping[int, Given]]:
    """Answers to K panoramas, their attitudes, times (K,) in us, and what was given for those without a fault."""
    asked = [k for k in range(len(panoramas)) if k not in faults]
    given = dict(zip(asked, identifier.source.answers([panoramas[k] for k in asked]), strict=True))
    found = {k: identification_of(one, panoramas[k], identifier) for k, one in given.items()}
    elapsed_us = np.full(len(panoramas), np.nan)
    for k, one in given.items():
        elapsed_us[k] = np.nan if one.elapsed_us is None else round(one.elapsed_us, 1)
    every = range(len(panoramas))
    attitudes = Attitudes.none(len(panoramas))
    for k, (_, attitude) in found.items():
        if attitude is not None:
            attitudes[k] = attitude
    return Answers.of([found[k][0] if k in found else faults[k] for k in every]), attitudes, elapsed_us, given


def compared(
    identifier: ExternalIdentifier,
    panoramas: Panoramas,
    identified: Identified,
    truth: SiderealTruth | None,
    mount: Mount | None,
) -> Compared:
    """The RA, DE and roll of K answers beside truth; a roll that was not answered has no error."""
    count, answers = len(panoramas), identified.answers
    attitudes, geometric, true = (Attitudes.none(count) for _ in range(3))
    errors_arcsec, residuals_arcsec = np.full((count, 5), np.nan), np.zeros((len(answers.objects), 2))
    rolled = np.ones(count, dtype=np.bool_)
    for k in np.flatnonzero(answers.named).tolist():
        found, attitude, utc_ns = answers[k], identified.attitudes[k], int(panoramas.utc_ns[k])
        assert isinstance(found, Identification)
        assert attitude is not None
        rolled[k] = has_roll(identified.given.get(k))
        directions_sensor = identified.directions_sensor[panoramas.parts.rows(k)]
        if truth and mount:
            true[k] = looked = truth.attitude_true(utc_ns, mount)
            attitude = attitude if rolled[k] else with_roll(attitude, looked.roll_deg)
        attitudes[k] = seen_from = attitude
        if truth is not None:
            stars_sensor = directions_sensor.take(found.objects, axis=0)
            seen = stars_sensor if len(stars_sensor) > 1 else directions_sensor
            geometric[k] = seen_from = geometric_of(attitude, seen, truth, utc_ns)
        residuals_arcsec[answers.parts.rows(k)] = residuals_of(
            found, identifier.catalog, seen_from, directions_sensor, truth, utc_ns
        )
    if truth and mount:
        named = answers.named
        errors_arcsec[named] = attitude_errors(geometric.icrs_to_sensor[named], true.icrs_to_sensor[named])
        errors_arcsec[~rolled, ERRORS.index("d_roll_arcsec")] = np.nan
    left_out = Matches.none(count)
    return Compared(attitudes, geometric, true, errors_arcsec, residuals_arcsec, left_out, rolled)


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
    zenith_sensor = product(attitude.icrs_to_sensor, truth.icrs_to_horizon(utc_ns)[2])
    apparent = truth.apparent(product(seen, attitude.icrs_to_sensor), utc_ns)
    return solve_attitude(truth.unrefracted(seen, zenith_sensor), apparent, 1e-4)


def residuals_of(
    found: Identification,
    catalog: StarCatalog,
    attitude: Attitude,
    directions_sensor: NDArray[np.float64],
    truth: SiderealTruth | None,
    utc_ns: int,
) -> NDArray[np.float64]:
    """Residuals (M, 2) of the matched stars from the answered ``attitude``, geometric where there is a truth."""
    if not len(found.objects):
        return np.zeros((0, 2))
    measured = directions_sensor.take(found.objects, axis=0)
    stars_icrs = catalog.icrs.take(found.stars, axis=0)
    if truth is not None:
        zenith_sensor = product(attitude.icrs_to_sensor, truth.icrs_to_horizon(utc_ns)[2])
        measured, stars_icrs = truth.unrefracted(measured, zenith_sensor), truth.apparent(stars_icrs, utc_ns)
    residuals_arcsec: NDArray[np.float64] = (measured - product(stars_icrs, attitude.icrs_to_sensor.T))[
        :, :2
    ] * ARCSEC_PER_RAD
    return residuals_arcsec


def _no_answer(answer: ExternalAnswer) -> str:
    return f"{answer.status}: {answer.detail}" if answer.detail else answer.status
