"""Frame processor: panoramas in, results out."""

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gse.attitude import Attitude, paper_mean, solve_attitudes
from gse.camera import Camera
from gse.constants import ARCSEC_PER_RAD
from gse.external.identifier import ExternalIdentifier, Given
from gse.identifier import Identification, Identifier, Reason, Unidentified
from gse.identifier.robust import RobustIdentifier
from gse.mount import Mount
from gse.panorama import MAX_OBJECTS, Panorama
from gse.station import external_result
from gse.station.attitude_error import attitude_error, attitude_errors
from gse.station.left_out_stars import LeftOutStars, SolvedFrames
from gse.station.non_stellar import NonStellarObjects
from gse.station.results import (
    NO_MATCHES,
    NO_STARLIGHT,
    AnswerCheck,
    AttitudeError,
    FrameResult,
    Matches,
    Starlight,
    Status,
)
from gse.station.starlight import starlights
from gse.truth import SiderealTruth

CENTROID_SIGMA_PX = 0.3
"""Position noise of a whole-pixel object, 1 / sqrt(12) px, for the covariance of an attitude."""

SAME_BORESIGHT_RAD = math.radians(0.05)
"""The answer under test is correct when its boresight is within this of the reference identifier's."""

FAULT_FLAGS = frozenset({"detector fault", "memory fault"})

Compared = tuple[NDArray[np.float64], Attitude | None, Attitude | None, AttitudeError | None, Matches]
"""Residuals (M, 2) in arcsec, geometric attitude, true attitude, the error of the one against the other, and stars that
the answer left out."""


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """The answer of the identifier under test to one panorama, its attitude, and the reference identifier's check.

    ``elapsed_us`` is the time from objects to RA and DE: this host's (of panoramas that waited together, the mean), or
    an external identifier's own. ``given`` is what an external identifier gave, ``light`` what the named stars show of
    the sky.
    """

    directions_sensor: NDArray[np.float64]
    identification: Identification | Unidentified
    attitude: Attitude | None
    answer_check: AnswerCheck
    elapsed_us: float | None
    given: Given | None = None
    light: Starlight = NO_STARLIGHT

    @property
    def is_mirrored(self) -> bool:
        """Whether the identifier under test found the panorama to be a mirror image of the sky."""
        return isinstance(self.identification, Unidentified) and self.identification.reason is Reason.MIRRORED


@dataclass(frozen=True, slots=True)
class FrameProcessor:
    """Processes panoramas with camera, identifier under test, reference identifier, and sidereal truth for a mount.

    ``truth`` is None without an Earth orientation for the date, ``mount`` is None until it is fitted: then results have
    no attitude error. ``paper_mean`` takes the boresight of the LAPAN paper instead of Wahba's.
    """

    camera: Camera
    index_max: int
    identifier: Identifier | ExternalIdentifier
    reference: RobustIdentifier | None
    non_stellar: NonStellarObjects
    truth: SiderealTruth | None
    mount: Mount | None
    paper_mean: bool = False
    left_out: LeftOutStars | None = None

    def identify(self, panoramas: Sequence[Panorama]) -> list[Answer | str]:
        """The part that depends on one panorama alone: its answer, or the fault of the sensor in words.

        Each step runs for all panoramas before the next step: tables and code then stay in the processor's caches,
        which almost halves the time.
        """
        faults = [self._fault(panorama) for panorama in panoramas]
        sound = [panorama for panorama, fault in zip(panoramas, faults, strict=True) if not fault]
        answers = iter(self._answers(sound) if sound else ())
        return [fault or next(answers) for fault in faults]

    def conclude(
        self, panoramas: Sequence[Panorama], answers: Sequence[Answer | str], elapsed_us: Sequence[float | None]
    ) -> list[FrameResult]:
        """Correct, compare with truth, and classify non-stellar objects; panoramas must come in their order.

        ``elapsed_us`` are the identification times of the results.
        """
        named = [
            (panorama, answer.directions_sensor, answer.identification, answer.attitude)
            for panorama, answer in zip(panoramas, answers, strict=True)
            if isinstance(answer, Answer) and answer.given is None
            if isinstance(answer.identification, Identification) and answer.attitude is not None
        ]
        compared = iter(self._compared(*zip(*named, strict=True)) if named else ())
        return [
            self._result(panorama, answer, us, compared)
            for panorama, answer, us in zip(panoramas, answers, elapsed_us, strict=True)
        ]

    def _result(
        self, panorama: Panorama, answer: Answer | str, elapsed_us: float | None, compared: Iterator[Compared]
    ) -> FrameResult:
        if isinstance(answer, str):
            return FrameResult(panorama, Status.SENSOR_FAULT, answer, self.identifier.name)
        if answer.given is not None:
            return self._conclude_external(panorama, answer, answer.given, elapsed_us)
        found, attitude = answer.identification, answer.attitude
        if isinstance(found, Unidentified) or attitude is None:
            status, detail = _explain(found)
            return FrameResult(
                panorama,
                status,
                detail,
                self.identifier.name,
                elapsed_us=elapsed_us,
                answer_check=answer.answer_check,
                light=answer.light,
            )
        residuals_arcsec, geometric, true, error, left_out = next(compared)
        return FrameResult(
            panorama,
            Status.IDENTIFIED,
            "",
            self.identifier.name,
            identification=found,
            attitude=attitude,
            matches=Matches(found.objects, found.stars, residuals_arcsec, self.identifier.catalog.name),
            left_out=left_out,
            elapsed_us=elapsed_us,
            attitude_geometric=geometric,
            attitude_error=error,
            attitude_true=true,
            answer_check=answer.answer_check,
            light=answer.light,
            others=self.non_stellar.name(
                panorama,
                answer.directions_sensor,
                found.objects,
                geometric or attitude,
                truth_known=self.truth is not None and (self.mount is None or self.mount.inertial is None),
            ),
        )

    def _answers(self, panoramas: Sequence[Panorama]) -> list[Answer]:
        started_ns = time.perf_counter_ns()
        whole = self.camera.directions(np.concatenate([panorama.xy_px for panorama in panoramas]))
        ends = np.cumsum([len(panorama.brightness) for panorama in panoramas])
        directions_sensor = np.split(whole, ends[:-1])
        objects = [(of_one, panorama.brightness) for of_one, panorama in zip(directions_sensor, panoramas, strict=True)]
        given: Sequence[Given | None] = [None] * len(panoramas)
        if isinstance(self.identifier, ExternalIdentifier):
            given = came = self.identifier.source.answers(panoramas)
            found = [self._taken(one, panorama) for one, panorama in zip(came, panoramas, strict=True)]
        else:
            named = self.identifier.identify_many(objects)
            attitudes = self._attitudes_of(named, directions_sensor)
            elapsed_us = round((time.perf_counter_ns() - started_ns) / 1000 / len(panoramas), 1)
            found = [(answer, attitude, elapsed_us) for answer, attitude in zip(named, attitudes, strict=True)]
        true_stars: Sequence[Identification | Unidentified | None] = [None] * len(objects)
        if self.reference is not None:
            true_stars = self.reference.identify_many(objects)
        checks = self._checks([attitude for _, attitude, _ in found], directions_sensor, true_stars)
        lights = self._lights(
            [panorama.brightness for panorama in panoramas], [answer for answer, _, _ in found], true_stars
        )
        return [
            Answer(of_one, answer, attitude, check, elapsed_us, one, light)
            for of_one, (answer, attitude, elapsed_us), check, one, light in zip(
                directions_sensor, found, checks, given, lights, strict=True
            )
        ]

    def _taken(
        self, given: Given, panorama: Panorama
    ) -> tuple[Identification | Unidentified, Attitude | None, float | None]:
        assert isinstance(self.identifier, ExternalIdentifier)
        answer, attitude = external_result.identification_of(given, panorama, self.identifier)
        return answer, attitude, None if given.elapsed_us is None else round(given.elapsed_us, 1)

    def _conclude_external(
        self, panorama: Panorama, answer: Answer, given: Given, elapsed_us: float | None
    ) -> FrameResult:
        """As ``conclude``, with the RA, DE and roll that were answered."""
        name, found, attitude = self.identifier.name, answer.identification, answer.attitude
        if isinstance(found, Unidentified) or attitude is None:
            status, detail = external_result.status_of(given)
            check = answer.answer_check
            return FrameResult(panorama, status, detail, name, elapsed_us=elapsed_us, answer_check=check, given=given)
        utc_ns, directions_sensor = panorama.utc_ns, answer.directions_sensor
        true = self.truth.attitude_true(utc_ns, self.mount) if self.truth and self.mount else None
        has_roll = external_result.has_roll(given)
        if not has_roll and true is not None:
            attitude = external_result.with_roll(attitude, true.roll_deg)
        geometric = None
        if self.truth is not None:
            stars_sensor = directions_sensor.take(found.objects, axis=0)
            seen = stars_sensor if len(stars_sensor) > 1 else directions_sensor
            geometric = external_result.geometric_of(attitude, seen, self.truth, utc_ns)
        error = attitude_error(geometric, true) if geometric and true else None
        stars = external_result.matches_of(
            found, self.identifier.catalog, geometric or attitude, directions_sensor, self.truth, utc_ns
        )
        return FrameResult(
            panorama,
            Status.IDENTIFIED,
            "",
            name,
            identification=found,
            attitude=attitude,
            matches=stars,
            elapsed_us=elapsed_us,
            attitude_geometric=geometric,
            attitude_error=error if has_roll or error is None else replace(error, d_roll_arcsec=math.nan),
            attitude_true=true,
            answer_check=answer.answer_check,
            light=answer.light,
            has_roll=has_roll,
            given=given,
        )

    def _attitudes_of(
        self, answers: Sequence[Identification | Unidentified], directions_sensor: Sequence[NDArray[np.float64]]
    ) -> list[Attitude | None]:
        """The attitude of each answer, None where it names no stars."""
        named = [
            (answer, of_one)
            for answer, of_one in zip(answers, directions_sensor, strict=True)
            if isinstance(answer, Identification)
        ]
        attitudes = iter(self._attitudes(*self._pairs(named)) if named else ())
        return [next(attitudes) if isinstance(answer, Identification) else None for answer in answers]

    def _fault(self, panorama: Panorama) -> str:
        faults = sorted(panorama.flags & FAULT_FLAGS)
        if faults:
            return f"the sensor reports {' and '.join(faults)}"
        if panorama.problems:
            return f"the sensor sent an impossible value: {panorama.problems[0]}"
        if len(panorama.brightness) > MAX_OBJECTS:
            return f"{len(panorama.brightness)} objects came, at most {MAX_OBJECTS} were expected"
        if len(panorama.brightness) and panorama.brightness[0] > self.index_max:
            return f"index value {panorama.brightness[0]:.0f} came, at most {self.index_max} was expected"
        return ""

    def _attitudes(
        self, directions_sensor: NDArray[np.float64], stars_icrs: NDArray[np.float64], ends: NDArray[np.int64]
    ) -> list[Attitude]:
        """Wahba's attitudes, or the mean about the sensor centre of the LAPAN paper if the station file asks for it."""
        sigma_rad = CENTROID_SIGMA_PX * self.camera.pixel_rad
        attitudes = solve_attitudes(directions_sensor, stars_icrs, ends, sigma_rad)
        if not self.paper_mean:
            return attitudes
        pairs = zip(np.split(directions_sensor, ends[:-1]), np.split(stars_icrs, ends[:-1]), strict=True)
        return [paper_mean(attitude, *pair) for attitude, pair in zip(attitudes, pairs, strict=True)]

    def _compared(
        self,
        panoramas: Sequence[Panorama],
        directions_sensor: Sequence[NDArray[np.float64]],
        found: Sequence[Identification],
        attitudes: Sequence[Attitude],
    ) -> list[Compared]:
        """Residuals, and attitudes from apparent places and un-refracted directions, against the true ones.

        The stars of all panoramas are rows of the same columns: ``frame_of`` (M,) names the panorama of each.
        """
        measured_sensor, stars_icrs, ends = self._pairs(list(zip(found, directions_sensor, strict=True)))
        frame_of = np.repeat(np.arange(len(found)), np.diff(ends, prepend=0))
        geometric: Sequence[Attitude | None] = [None] * len(found)
        true: Sequence[Attitude | None] = geometric
        errors: Sequence[AttitudeError | None] = [None] * len(found)
        rotations = raw = np.array([attitude.icrs_to_sensor for attitude in attitudes])
        utc_ns = np.array([panorama.utc_ns for panorama in panoramas])
        icrs_to_horizon = None
        if self.truth is not None:
            icrs_to_horizon = self.truth.icrs_to_horizon_at(utc_ns)
            zenith_sensor = np.einsum("kij,kj->ki", rotations, icrs_to_horizon[:, 2])
            measured_sensor = self.truth.unrefracted(measured_sensor, zenith_sensor[frame_of])
            stars_icrs = self.truth.apparent_at(stars_icrs, utc_ns, icrs_to_horizon, frame_of)
            geometric = solved = self._attitudes(measured_sensor, stars_icrs, ends)
            rotations = np.array([attitude.icrs_to_sensor for attitude in solved])
            if self.mount is not None:
                true = looking = self.truth.attitudes_true(icrs_to_horizon, self.mount)
                errors = attitude_errors(solved, looking)
        expected_sensor = np.einsum("mij,mj->mi", rotations[frame_of], stars_icrs)
        residuals_arcsec = (measured_sensor - expected_sensor)[:, :2] * ARCSEC_PER_RAD
        left_out = [NO_MATCHES] * len(found)
        if self.left_out is not None:
            frames = SolvedFrames(raw, rotations, self.truth, utc_ns, icrs_to_horizon)
            left_out = self.left_out.of(found, directions_sensor, frames)
        return list(zip(np.split(residuals_arcsec, ends[:-1]), geometric, true, errors, left_out, strict=True))

    def _lights(
        self,
        brightness: Sequence[NDArray[np.float64]],
        answers: Sequence[Identification | Unidentified],
        true_stars: Sequence[Identification | Unidentified | None],
    ) -> list[Starlight]:
        """What the stars show of the sky: those of the answer, or of the reference identifier where there is none."""
        lights = [NO_STARLIGHT] * len(answers)
        named = {
            k: answer for k, answer in enumerate(answers) if isinstance(answer, Identification) and len(answer.stars)
        }
        shown = [(named, self.identifier.catalog)]
        if self.reference is not None:
            known = {
                k: stars for k, stars in enumerate(true_stars) if k not in named and isinstance(stars, Identification)
            }
            shown.append((known, self.reference.catalog))
        for found, catalog in shown:
            of_found = starlights([brightness[k] for k in found], list(found.values()), catalog)
            for k, light in zip(found, of_found, strict=True):
                lights[k] = light
        return lights

    def _pairs(
        self, found: Sequence[tuple[Identification, NDArray[np.float64]]]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
        """Identified directions (M, 3) and their stars (M, 3) of answers with all directions, and where each ends."""
        # ``take`` is three times as fast as indexing with brackets.
        measured = np.concatenate([directions.take(answer.objects, axis=0) for answer, directions in found])
        stars = self.identifier.catalog.icrs.take(np.concatenate([answer.stars for answer, _ in found]), axis=0)
        return measured, stars, np.cumsum([len(answer.stars) for answer, _ in found])

    def _checks(
        self,
        attitudes: Sequence[Attitude | None],
        directions_sensor: Sequence[NDArray[np.float64]],
        true_stars: Sequence[Identification | Unidentified | None],
    ) -> list[AnswerCheck]:
        """The check of each answer's attitude by the stars that the reference identifier found."""
        checks = [AnswerCheck.UNKNOWN] * len(attitudes)
        known = [(k, stars) for k, stars in enumerate(true_stars) if isinstance(stars, Identification)]
        if self.reference is None or not known:
            return checks
        measured = np.concatenate([directions_sensor[k].take(stars.objects, axis=0) for k, stars in known])
        stars_icrs = self.reference.catalog.icrs.take(np.concatenate([stars.stars for _, stars in known]), axis=0)
        true = solve_attitudes(measured, stars_icrs, np.cumsum([len(stars.stars) for _, stars in known]), 1e-4)
        for (k, _), looking in zip(known, true, strict=True):
            attitude = attitudes[k]
            if attitude is None:
                checks[k] = AnswerCheck.ABSENT
            else:
                separation_rad = math.dist(attitude.boresight_icrs, looking.boresight_icrs)
                checks[k] = AnswerCheck.CORRECT if separation_rad < SAME_BORESIGHT_RAD else AnswerCheck.FALSE
        return checks


_STATUS = {
    Reason.TOO_FEW: Status.TOO_FEW,
    Reason.NO_MATCH: Status.NO_MATCH,
    Reason.MIRRORED: Status.NO_MATCH,
    Reason.AMBIGUOUS: Status.AMBIGUOUS,
    Reason.SENSOR_FAULT: Status.SENSOR_FAULT,
}
"""``status`` of gse.frame/1."""


def _explain(answer: Identification | Unidentified) -> tuple[Status, str]:
    if isinstance(answer, Unidentified):
        return _STATUS[answer.reason], answer.detail
    return Status.NO_MATCH, "no attitude follows from the matches"
