"""Frame processor: panoramas in, results out; every step works on columns of many panoramas."""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog
from gse.external.answers import ExternalAnswer, Failure
from gse.external.identifier import ExternalIdentifier, Given
from gse.external.panoramas import rows_here
from gse.identifier import Answers, Identification, Identifier, ObjectColumns, Reason, Unidentified
from gse.identifier.result import answered
from gse.identifier.robust import RobustIdentifier
from gse.station.columns import ANSWER_CHECKS, STATUSES
from gse.station.frame_results import FrameResults
from gse.station.non_stellar import NonStellarObjects, Others
from gse.station.results import ERRORS, AnswerCheck, Matches, Starlight, Status, attitude_errors
from gse.station.shown_stars import LeftOutStars, SolvedFrames, rows_of, starlights
from gse.station.thinned_search import ThinnedSearch
from gse.truth import SiderealTruth
from gse.values.attitude import Attitude, Attitudes, paper_mean, solve_attitude, solve_attitudes
from gse.values.camera import Camera
from gse.values.constants import ARCSEC_PER_RAD, ARCSEC_RAD
from gse.values.limits import Limits
from gse.values.matrices import product
from gse.values.mount import Mount
from gse.values.panorama import MAX_OBJECTS, Panorama, Panoramas, Parts


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


# What an external identifier gave, as answers of the station, and compared with truth.
#
# Its RA, DE and roll are taken as they are: nothing is solved again. To compare them with truth they are corrected as
# the station's own answers are: the objects that it calls stars (all, where it names none) lose their refraction, the
# places on the sky where it puts them become apparent places, and the attitude between the two is the geometric one.

_ARMS = np.array([[0.05, 0.0, 1.0], [-0.05, 0.0, 1.0], [0.0, 0.05, 1.0], [0.0, -0.05, 1.0]])
_CROSS = _ARMS / np.linalg.norm(_ARMS, axis=1, keepdims=True)
"""Directions that stand for the objects where there are fewer than two."""


def external_answers_of(
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
    return Answers.from_answers([found[k][0] if k in found else faults[k] for k in every]), attitudes, elapsed_us, given


def compared_external(
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


CENTROID_SIGMA_PX = 0.3
"""Position noise of a whole-pixel object, 1 / sqrt(12) px, for the covariance of an attitude."""

_SAME_STAR_PX = 2.0
"""Catalogues place a star, or the middle of a double one, within this; two stars that a sensor tells apart are not."""
_MOST_OTHERS = 0.5
"""An answer of which more than this share of the stars are others than the reference identifier's is false."""
_MOST_BY_AIR_RAD = 1800.0 * ARCSEC_RAD
_TIMES_PARTED = 3.0
"""Standard deviations of the lift of the objects of a panorama: a few stars may all be high, or all low."""

FAULT_FLAGS = frozenset({"detector fault", "memory fault"})

_UNKNOWN, _CORRECT, _FALSE, _ABSENT = (
    ANSWER_CHECKS.index(check)
    for check in (AnswerCheck.UNKNOWN, AnswerCheck.CORRECT, AnswerCheck.FALSE, AnswerCheck.ABSENT)
)


@dataclass(frozen=True, slots=True)
class FrameProcessor:
    """Processes panoramas with camera, identifier under test, reference identifier, and sidereal truth for a mount.

    ``search`` is that of the robust identifier, the reference or under test, through a session; without it each
    panorama stands for itself. ``truth`` is None without an Earth orientation for the date, ``mount`` is None until it
    is fitted: then results have no attitude error. ``paper_mean`` takes the boresight of the LAPAN paper instead of
    Wahba's.
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
    false_arcsec: float = Limits().false_beyond_arcsec
    search: ThinnedSearch | None = None

    def identify(self, panoramas: Panoramas) -> Identified:
        """The part that depends on the panoramas alone; they must come in their order where the search is thinned."""
        started_ns = time.thread_time_ns()  # a busy host's scheduler is no fault of the identifier
        faults = self._faults(panoramas)
        sound = np.ones(len(panoramas), dtype=np.bool_)
        sound[list(faults)] = False
        objects = ObjectColumns(self._directions(panoramas, sound), panoramas.brightness, panoramas.parts)
        stretches: list[tuple[int, str]] = []
        if isinstance(self.identifier, ExternalIdentifier):
            answers, attitudes, elapsed_us, given = external_answers_of(self.identifier, panoramas, faults)
        else:
            if self.reference is None and self.search is not None:
                answers, stretches = self._searched(self.search, panoramas, objects, faults, np.zeros_like(sound))
            else:
                answers = answered(objects, faults, self.identifier.identify_many)
            given, attitudes = {}, self._attitudes_of(answers, objects)
            took_us = (time.thread_time_ns() - started_ns) / 1000
            elapsed_us = np.where(sound, round(took_us / max(len(panoramas) - len(faults), 1), 1), np.nan)
        true_stars = None
        if self.reference is not None and self.search is not None:
            true_stars, stretches = self._searched(self.search, panoramas, objects, faults, answers.named)
        elif self.reference is not None:
            true_stars = answered(objects, faults, self.reference.identify_many)
        checks, separation_rad, reference_icrs = self._checks(answers, attitudes, objects, true_stars)
        return Identified(
            objects.directions_sensor,
            sound,
            answers,
            attitudes,
            checks,
            separation_rad,
            reference_icrs,
            self._light(objects, answers, true_stars),
            elapsed_us,
            given,
            stretches,
        )

    @staticmethod
    def _searched(
        session_search: ThinnedSearch,
        panoramas: Panoramas,
        objects: ObjectColumns,
        faults: Mapping[int, Unidentified],
        answered_already: NDArray[np.bool_],
    ) -> tuple[Answers, list[tuple[int, str]]]:
        """The answers of the robust identifier to K panoramas, and the stretches without stars that they end."""
        places = np.setdiff1d(np.arange(len(panoramas)), list(faults))
        stretches: list[tuple[int, str]] = []

        def search(some: ObjectColumns) -> Answers:
            answers, ended = session_search.identify_many(some, panoramas.utc_ns[places], answered_already[places])
            stretches.extend((int(places[k]), words) for k, words in ended)
            return answers

        return answered(objects, faults, search), stretches

    def conclude(self, panoramas: Panoramas, identified: Identified, elapsed_us: NDArray[np.float64]) -> FrameResults:
        """Correct, compare with truth, and classify non-stellar objects; panoramas must come in their order.

        ``elapsed_us`` (K,) are the identification times of the results.
        """
        identified = replace(identified, answer_check=self._checks_under_air(panoramas, identified))
        if isinstance(self.identifier, ExternalIdentifier):
            compared = compared_external(self.identifier, panoramas, identified, self.truth, self.mount)
            others = Others.none(len(panoramas))
        else:
            compared = self._compared(panoramas, identified)
            others = self._others(panoramas, identified, compared)
        status, details = _outcomes(identified)
        return FrameResults(
            panoramas,
            self.identifier.name,
            self.identifier.catalog.name,
            status,
            details,
            identified.answers,
            compared.residuals_arcsec,
            np.where(identified.sound, elapsed_us, np.nan),
            compared.attitudes,
            compared.geometric,
            compared.true,
            compared.errors_arcsec,
            compared.has_roll,
            identified.answer_check,
            identified.reference_icrs,
            others,
            identified.light,
            compared.left_out,
            identified.given,
        )

    def _others(self, panoramas: Panoramas, identified: Identified, compared: Compared) -> Others:
        """The objects that the answers leave."""
        seen_from = identified.attitudes if self.truth is None else compared.geometric
        return self.non_stellar.name(
            panoramas,
            identified.directions_sensor,
            identified.answers,
            seen_from.icrs_to_sensor,
            truth_known=self.truth is not None and (self.mount is None or self.mount.inertial is None),
        )

    def _directions(self, panoramas: Panoramas, sound: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Unit vectors (M, 3) of the objects; NaN in panoramas that are not sound: their positions may be anything."""
        if sound.all():
            return self.camera.directions(panoramas.xy_px)
        directions_sensor = np.full((len(panoramas.xy_px), 3), np.nan)
        _, rows = panoramas.parts.chosen(sound)
        directions_sensor[rows] = self.camera.directions(panoramas.xy_px[rows])
        return directions_sensor

    def _faults(self, panoramas: Panoramas) -> dict[int, Unidentified]:
        """The faults of the sensor in words, by panorama."""
        counts = panoramas.parts.counts
        brightest = np.zeros(len(panoramas))
        brightest[counts > 0] = panoramas.brightness[panoramas.parts.first[:-1][counts > 0]]
        said = zip(panoramas.flags, panoramas.problems, strict=True)
        told = [bool(problems) or not FAULT_FLAGS.isdisjoint(flags) for flags, problems in said]
        suspect = (counts > MAX_OBJECTS) | (brightest > self.index_max) | np.array(told, dtype=np.bool_)
        return {
            k: Unidentified(Reason.SENSOR_FAULT, self._fault(panoramas, k, int(counts[k]), float(brightest[k])))
            for k in np.flatnonzero(suspect).tolist()
        }

    def _fault(self, panoramas: Panoramas, k: int, count: int, brightest: float) -> str:
        faults = sorted(panoramas.flags[k] & FAULT_FLAGS)
        if faults:
            return f"the sensor reports {' and '.join(faults)}"
        if panoramas.problems[k]:
            return f"the sensor sent an impossible value: {panoramas.problems[k][0]}"
        if count > MAX_OBJECTS:
            return f"{count} objects came, at most {MAX_OBJECTS} were expected"
        return f"index value {brightest:.0f} came, at most {self.index_max} was expected"

    def _attitudes_of(self, answers: Answers, objects: ObjectColumns) -> Attitudes:
        """The attitude of each answer, none where it names no stars."""
        measured = objects.directions_sensor.take(rows_of(objects.parts, answers), axis=0)
        return self._attitudes(measured, self.identifier.catalog.icrs.take(answers.stars, axis=0), answers)

    def _attitudes(self, measured: NDArray[np.float64], stars_icrs: NDArray[np.float64], answers: Answers) -> Attitudes:
        """Wahba's attitudes, or the mean about the sensor centre of the LAPAN paper if the station file asks for it.

        Directions and stars (M, 3) are those of the answers' matches.
        """
        named = answers.named
        ends = answers.parts.first[1:][named]
        attitudes = solve_attitudes(measured, stars_icrs, ends, CENTROID_SIGMA_PX * self.camera.pixel_rad)
        if self.paper_mean:
            for k, rows in enumerate(map(answers.parts.rows, np.flatnonzero(named).tolist())):
                if (solved := attitudes[k]) is not None:
                    attitudes.icrs_to_sensor[k] = paper_mean(solved, measured[rows], stars_icrs[rows]).icrs_to_sensor
        return attitudes.among(named)

    def _compared(self, panoramas: Panoramas, identified: Identified) -> Compared:
        """From apparent places and un-refracted directions; where there is no answer there is nothing to compare."""
        answers, named = identified.answers, identified.answers.named
        measured = identified.directions_sensor.take(rows_of(panoramas.parts, answers), axis=0)
        stars_icrs = self.identifier.catalog.icrs.take(answers.stars, axis=0)
        seen_from, true = identified.attitudes, Attitudes.none(len(panoramas))
        geometric, errors_arcsec = true, np.full((len(panoramas), len(ERRORS)), np.nan)
        utc_ns, icrs_to_horizon = panoramas.utc_ns[named], None
        if self.truth is not None and named.any():
            frame_of = np.repeat(np.arange(len(utc_ns)), answers.parts.counts[named])
            icrs_to_horizon = self.truth.icrs_to_horizon_at(utc_ns)
            zenith_sensor = np.einsum("kij,kj->ki", seen_from.icrs_to_sensor[named], icrs_to_horizon[:, 2])
            measured = self.truth.unrefracted(measured, zenith_sensor.take(frame_of, axis=0))
            stars_icrs = self.truth.apparent_at(stars_icrs, utc_ns, icrs_to_horizon, frame_of)
            seen_from = geometric = self._attitudes(measured, stars_icrs, answers)
            if self.mount is not None:
                true = self.truth.attitudes_true(icrs_to_horizon, self.mount).among(named)
                errors_arcsec[named] = attitude_errors(geometric.icrs_to_sensor[named], true.icrs_to_sensor[named])
        across = seen_from.icrs_to_sensor[:, :2].take(answers.parts.of_row, axis=0)
        residuals_arcsec = (measured[:, :2] - np.einsum("mij,mj->mi", across, stars_icrs)) * ARCSEC_PER_RAD
        left_out = Matches.none(len(panoramas))
        if self.left_out is not None and named.any():
            objects = ObjectColumns(identified.directions_sensor, panoramas.brightness, panoramas.parts)
            rotations = identified.attitudes.icrs_to_sensor[named], seen_from.icrs_to_sensor[named]
            frames = SolvedFrames(*rotations, self.truth, utc_ns, icrs_to_horizon)
            left_out = self.left_out.beside(objects, answers, frames)
        has_roll = np.ones(len(panoramas), dtype=np.bool_)
        return Compared(identified.attitudes, geometric, true, errors_arcsec, residuals_arcsec, left_out, has_roll)

    def _light(self, objects: ObjectColumns, answers: Answers, true_stars: Answers | None) -> Starlight:
        """What the stars show of the sky: those of the answer, or of the reference identifier where there is none.

        An external identifier may name some stars of a full panorama: the sky is that of the reference identifier.
        """
        light = starlights(objects.brightness, objects.parts, answers, self.identifier.catalog)
        if true_stars is None:
            return light
        assert self.reference is not None
        unnamed = answers.parts.counts == 0
        if isinstance(self.identifier, ExternalIdentifier):
            unnamed |= true_stars.named
        if unnamed.any():
            shown = starlights(objects.brightness, objects.parts, true_stars, self.reference.catalog)
            light.fill(unnamed, shown)
        return light

    def _checks(
        self, answers: Answers, attitudes: Attitudes, objects: ObjectColumns, true_stars: Answers | None
    ) -> tuple[NDArray[np.uint8], NDArray[np.float64], NDArray[np.float64]]:
        """The check (K,) of each answer by the stars that the reference identifier found.

        With how far apart (K,) the two boresights are (infinite where the stars of the answer are others), and the
        reference identifier's boresight (K, 3).
        """
        checks, all_separations_rad = np.full(len(objects), _UNKNOWN, dtype=np.uint8), np.full(len(objects), np.nan)
        reference_icrs = np.full((len(objects), 3), np.nan)
        if true_stars is None:
            return checks, all_separations_rad, reference_icrs
        assert self.reference is not None
        known = true_stars.named
        measured = objects.directions_sensor.take(rows_of(objects.parts, true_stars), axis=0)
        stars_icrs = self.reference.catalog.icrs.take(true_stars.stars, axis=0)
        looking = solve_attitudes(measured, stars_icrs, true_stars.parts.first[1:][known], 1e-4)
        separation_rad = np.linalg.norm(attitudes.boresights_icrs[known] - looking.boresights_icrs, axis=1)
        separation_rad[self._names_others(answers, objects.parts, true_stars)[known]] = np.inf
        same = np.where(separation_rad < self.false_arcsec * ARCSEC_RAD, _CORRECT, _FALSE)
        checks[known], all_separations_rad[known] = np.where(np.isnan(separation_rad), _ABSENT, same), separation_rad
        reference_icrs[known] = looking.boresights_icrs
        return checks, all_separations_rad, reference_icrs

    def _names_others(self, answers: Answers, parts: Parts, true_stars: Answers) -> NDArray[np.bool_]:
        """Which answers (K,) name mostly other stars than the reference identifier, of the objects that both name.

        Other stars have other numbers and another place: catalogues number the parts of a double star each in its way.
        """
        assert self.reference is not None
        mine, theirs = self.identifier.catalog, self.reference.catalog
        star_of = np.full(int(parts.first[-1]), -1)
        star_of[rows_of(parts, true_stars)] = true_stars.stars
        true = star_of[rows_of(parts, answers)]
        both = true >= 0
        stars, true = answers.stars[both], true[both]
        apart_rad = np.linalg.norm(mine.icrs.take(stars, axis=0) - theirs.icrs.take(true, axis=0), axis=1)
        is_other = apart_rad > _SAME_STAR_PX * self.camera.pixel_rad
        if mine.designation == theirs.designation:
            is_other &= mine.ids[stars] != theirs.ids[true]
        frame, count = answers.parts.of_row[both], len(parts)
        others = np.bincount(frame[is_other], minlength=count)
        return np.asarray(others > _MOST_OTHERS * np.bincount(frame, minlength=count))

    def _checks_under_air(self, panoramas: Panoramas, identified: Identified) -> NDArray[np.uint8]:
        """The checks with what air makes of the boresights of other stars: in a low field it lifts each by another."""
        checks = identified.answer_check
        close = (checks == _FALSE) & (identified.separation_rad < _MOST_BY_AIR_RAD)
        if self.truth is None or not close.any():
            return checks
        checks = checks.copy()
        for k in np.flatnonzero(close).tolist():
            stars = identified.directions_sensor[panoramas.parts.rows(k)]
            ((_, _, up),) = self.truth.icrs_to_horizon_at(panoramas.utc_ns[[k]])
            lifted = stars - self.truth.unrefracted(stars, product(identified.attitudes.icrs_to_sensor[k], up))
            by_air_rad = _TIMES_PARTED * float(np.sqrt(lifted.var(axis=0).sum()))
            if identified.separation_rad[k] < self.false_arcsec * ARCSEC_RAD + by_air_rad:
                checks[k] = _CORRECT
        return checks


def _outcomes(identified: Identified) -> tuple[NDArray[np.uint8], dict[int, str]]:
    """The status (K,) of each panorama, and the details of those without an answer."""
    status = np.full(len(identified.answers), STATUSES.index(Status.IDENTIFIED), dtype=np.uint8)
    details = {}
    for k, answer in identified.answers.unidentified.items():
        given = identified.given.get(k)
        word, details[k] = status_of(given) if given else (_STATUS[answer.reason], answer.detail)
        status[k] = STATUSES.index(word)
    return status, details


_STATUS = {
    Reason.TOO_FEW: Status.TOO_FEW,
    Reason.NO_MATCH: Status.NO_MATCH,
    Reason.MIRRORED: Status.NO_MATCH,
    Reason.AMBIGUOUS: Status.AMBIGUOUS,
    Reason.SENSOR_FAULT: Status.SENSOR_FAULT,
}
"""``status`` of gse.frame/1."""
