"""What an external identifier gave, as an answer and as a result of the station.

Its RA, DE and roll are taken as they are: nothing is solved again. To compare them with truth they are corrected as the
station's own answers are: the objects that it calls stars (all, where it names none) lose their refraction, the places
on the sky where it puts them become apparent places, and the attitude between the two is the geometric one.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gse.attitude import Attitude, Attitudes, solve_attitude
from gse.catalog import StarCatalog
from gse.constants import ARCSEC_PER_RAD
from gse.external.answers import ExternalAnswer, Failure
from gse.external.identifier import ExternalIdentifier, Given
from gse.external.panoramas import rows_here
from gse.identifier import Answers, Identification, Reason, Unidentified
from gse.mount import Mount
from gse.panorama import Panorama, Panoramas
from gse.station.attitude_error import attitude_error
from gse.station.frame_table import ANSWER_CHECKS
from gse.station.identified import Identified
from gse.station.results import NO_MATCHES, FrameResult, Matches, Status
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
    answers = Answers.of([found[k][0] if k in found else faults[k] for k in every])
    return answers, Attitudes.of([found[k][1] if k in found else None for k in every]), elapsed_us, given


def results_of(
    identifier: ExternalIdentifier,
    panoramas: Panoramas,
    identified: Identified,
    elapsed_us: Sequence[float],
    truth: SiderealTruth | None,
    mount: Mount | None,
) -> list[FrameResult]:
    """The results of K panoramas, with the RA, DE and roll that were answered."""
    results = []
    for k, us in enumerate(elapsed_us):
        answered = _answered(identifier, panoramas[k], identified, k, None if math.isnan(us) else us)
        directions_sensor = identified.directions_sensor[panoramas.parts.rows(k)]
        results.append(_compared(answered, directions_sensor, identifier.catalog, truth, mount))
    return results


def _answered(
    identifier: ExternalIdentifier, panorama: Panorama, identified: Identified, k: int, elapsed_us: float | None
) -> FrameResult:
    """The answer to panorama k, compared with nothing yet."""
    found, given = identified.answers[k], identified.given.get(k)
    if given is None:
        assert isinstance(found, Unidentified)
        return FrameResult(panorama, Status.SENSOR_FAULT, found.detail, identifier.name)
    identification = found if isinstance(found, Identification) else None
    status, detail = (Status.IDENTIFIED, "") if identification is not None else status_of(given)
    return FrameResult(
        panorama,
        status,
        detail,
        identifier.name,
        identification=identification,
        attitude=identified.attitudes[k],
        elapsed_us=elapsed_us,
        answer_check=ANSWER_CHECKS[identified.answer_check[k]],
        light=identified.light[k],
        has_roll=identification is None or has_roll(given),
        given=given,
    )


def _compared(
    answered: FrameResult,
    directions_sensor: NDArray[np.float64],
    catalog: StarCatalog,
    truth: SiderealTruth | None,
    mount: Mount | None,
) -> FrameResult:
    """The same with its matches, and where there is a truth with its error; a roll that was not answered has none."""
    found, attitude, utc_ns = answered.identification, answered.attitude, answered.panorama.utc_ns
    if found is None or attitude is None:
        return answered
    true = truth.attitude_true(utc_ns, mount) if truth and mount else None
    if not answered.has_roll and true is not None:
        attitude = with_roll(attitude, true.roll_deg)
    geometric = None
    if truth is not None:
        stars_sensor = directions_sensor.take(found.objects, axis=0)
        geometric = geometric_of(attitude, stars_sensor if len(stars_sensor) > 1 else directions_sensor, truth, utc_ns)
    error = attitude_error(geometric, true) if geometric and true else None
    return replace(
        answered,
        attitude=attitude,
        matches=matches_of(found, catalog, geometric or attitude, directions_sensor, truth, utc_ns),
        attitude_geometric=geometric,
        attitude_error=error if answered.has_roll or error is None else replace(error, d_roll_arcsec=math.nan),
        attitude_true=true,
    )


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
