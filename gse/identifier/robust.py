"""The robust identifier: the reference that each answer under test is checked by.

Theory of operation
-------------------

The task: objects of one panorama, some of them false, and a catalogue of the whole sky. Find the attitude under which
the stars explain the objects, or say that there is none. A wrong answer is worse than none, because every other answer
is called correct or false by this one. The identifier therefore separates *guessing*, which may be wrong, from
*believing*, which must not.

1. **Guess** (``votes``). One object is the alpha star. For each of its nearest partners, every catalogue pair of the
   same distance votes for "the alpha star is this star, at this roll". A true star gets the votes of all its true
   partners at one roll, so two votes that agree make a hypothesis. The vote includes the sense of the roll, so a
   mirrored image gives no hypotheses. Hypotheses under which other objects lie near stars come first.
2. **Verify** (``verify``). A hypothesis gives an attitude, the attitude projects the catalogue into the field, and
   objects are matched to stars. The gate of each star is the noise plus what the attitude and the scale are still
   uncertain by at its place: it is narrow near the two stars of the hypothesis and wide far away. Each round of matches
   improves the attitude and narrows the gates, until nothing changes. The scale is fitted too, so that a focal length
   0.5 % off does no harm.
3. **Weigh** (``evidence``). The logarithm of the Bayes factor "this attitude" against "all objects are random",
   averaged over everything unknown: direction, roll, noise, limiting magnitude, missed stars, false objects. By
   Markov's inequality, random objects reach a factor x with a probability of 1 / x at most, no matter how many
   hypotheses were tried. So one threshold serves three objects and thirty, narrow fields and wide ones.
4. **Decide.** An answer needs a false-match probability below 1e-3 (LOG_ACCEPTED), and must explain the panorama 100
   times better than any other attitude (LOG_UNAMBIGUOUS); else it is AMBIGUOUS. Evidence above LOG_STRONG ends the
   search, since hardly any other attitude can come near it.

**The search plan** is a table of passes, from the usual to the unusual. The first passes take the brightest objects,
few partners and narrow windows: most panoramas end there, within a tenth of a millisecond. Later passes expect more
noise, bright hot pixels, or few objects with a faint alpha star. The whole plan is bounded by MAX_HYPOTHESES: a
panorama of 30 random objects costs it all, 10 ms with a field of 14 deg and 40 ms with 8 deg. ``around`` gives the
identifier of a part of the sky, for which that is 0.1 to 0.5 and 0.2 to 1.2 ms; a session searches there where frame
after frame shows no stars (``gse/station/thinned_search.py``).

**The brightest objects come last as alpha star** (the brightest quarter or third), since hot pixels and planets are
bright.

**A mirrored image** is searched for when the image itself gives no answer: flipped, in the first passes only, and with
a stricter threshold. It is reported as a reason and never answered, because the station file is then wrong.

**Brightness is used weakly** (0.5 mag, with a share of stars whose brightness is anything), because colours, clouds and
saturation change it. Positions decide.

The compiled searches take plain arrays and release Python's lock; the same input gives the same answer on any
machine. The sources of the parts are in docs/references.md.
"""

import copy
import math
from dataclasses import dataclass
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog, merge_doubles
from gse.catalog.mission import MERGED_WITHIN_PX
from gse.identifier.checks import refusal, refusals
from gse.identifier.evidence import CHANCE_OF_EVIDENCE, LOG_ACCEPTED, LOG_UNAMBIGUOUS, TRUSTED_SCALE_SIGMA
from gse.identifier.hypotheses import search_many
from gse.identifier.result import Answers, Identification, ObjectColumns, Reason, Unidentified, answered
from gse.identifier.robust_tables import SkyTables, field_radius_rad, part_of_sky, sky_tables
from gse.identifier.search_plan import plan_of_part, search_plan
from gse.identifier.verify import outside_fields
from gse.values.camera import Camera
from gse.values.identifier_options import IdentifierOptions
from gse.values.matrices import product
from gse.values.panorama import Parts

_FEWEST_OBJECTS = 3

_FIELD_STARS = 90.0
"""Mean number of stars per field in the catalogue that is projected: thrice what a panorama holds."""

_SMALLEST_SIGMA_PX = 0.12

_SIGMA_STEPS = 6
"""Evidence is averaged over noise from 0.12 to 1.7 px."""

_MAGNITUDE_SIGMA = 0.5
"""Brightness is used weakly: colours, extinction and peak pixels make errors of this size."""

_SCALE_SIGMA = 2.5e-3
"""How far the focal length may be off: 0.5 % is two sigma."""

_WINDOW_SIGMAS = 5.0
"""No window is wider than this where the noise is known: 3.5 sigma of a distance between two objects."""


@dataclass(frozen=True, slots=True)
class KnownSensor:
    """What is known of a sensor beside its camera; it helps where stars are few.

    ``sigma_px`` is the noise of a position on each axis and means that the camera is calibrated (None: 0.12 to 1.7 px,
    and 0.5 % of the focal length), ``zero_point`` the magnitude of index value 1 (None: brightness is compared within a
    panorama only), ``magnitude_sigma`` its error.
    """

    sigma_px: float | None = None
    zero_point: float | None = None
    magnitude_sigma: float = _MAGNITUDE_SIGMA


_NOTHING_KNOWN = KnownSensor()


class RobustIdentifier:
    """The stars of a panorama in the full catalogue, or the reason why not; never a guess.

    ``catalog`` is what the sensor can see of the source: cut to three times the stars that a panorama of this camera
    holds (or to ``stars``), doubles closer than 2 px merged. ``field_of_view_deg`` is the diameter of a round stop in
    front of the detector, None where there is none.
    """

    name = "robust"

    def __init__(
        self,
        camera: Camera,
        catalog: StarCatalog,
        *,
        stars: int | Literal["auto"] = "auto",
        field_of_view_deg: float | None = None,
        known: KnownSensor = _NOTHING_KNOWN,
    ) -> None:
        sigma_px = known.sigma_px
        pixel = 1.0 / camera.focal_length_px
        field = _field(camera, field_of_view_deg)
        fields_on_sky = 4 * math.pi / float(field[5])
        count = stars_looked_at(camera, field_of_view_deg) if stars == "auto" else stars
        self._rows: NDArray[np.int64] | None = None
        self.catalog = merge_doubles(catalog.rows(slice(0, count)), MERGED_WITHIN_PX * pixel)
        self._field = field
        self._sky: tuple[Any, ...] = tuple(sky_tables(self.catalog.icrs, self.catalog.magnitude, field))
        smallest, steps = (_SMALLEST_SIGMA_PX, _SIGMA_STEPS) if sigma_px is None else (sigma_px, 1)
        zero_point = math.nan if known.zero_point is None else known.zero_point
        scale_sigma = _SCALE_SIGMA if sigma_px is None else TRUSTED_SCALE_SIGMA
        self._noise = np.array([smallest * pixel, steps, scale_sigma, zero_point, known.magnitude_sigma])
        widest = math.inf if sigma_px is None else _WINDOW_SIGMAS * sigma_px
        self._plan = search_plan(pixel, fields_on_sky, widest_px=widest, sigma_px=sigma_px)

    @property
    def field_radius_rad(self) -> float:
        """Greatest angle of an object from the boresight."""
        return field_radius_rad(self._field)

    def around(self, places_icrs: NDArray[np.float64], reach_rad: float) -> Self:
        """This identifier for fields whose stars lie within ``reach_rad`` of one of some directions (P, 3).

        It has the stars there alone, so its search is the shorter the smaller that part of the sky is. Fields
        elsewhere are not found; what is believed is the same.
        """
        tables = SkyTables(*self._sky)
        near = product(tables.icrs, places_icrs.T).max(axis=1) > math.cos(min(reach_rad, math.pi))
        other = copy.copy(self)
        other._rows = np.flatnonzero(near)
        other._sky = tuple(part_of_sky(tables, near))
        share = np.count_nonzero(near[: tables.pair_stars]) / max(tables.pair_stars, 1)
        other._plan = plan_of_part(self._plan, share)
        return other

    def identify(
        self, directions_sensor: NDArray[np.float64], brightness: NDArray[np.float64]
    ) -> Identification | Unidentified:
        """Name the stars among objects given as unit vectors (N, 3) and brightness (N,), brightest first.

        As one of many panoramas, without columns of answers: these take nearly as long as the search.
        """
        refused = refusal(directions_sensor, brightness, _FEWEST_OBJECTS)
        if refused:
            return refused
        directions, brightness = _contiguous(directions_sensor, brightness)
        first, outside = np.array([0, len(brightness)]), np.empty(1, dtype=np.int64)
        outside_fields(directions, first, self._field, outside)
        if outside[0] >= 0:
            return _outside(int(outside[0]))
        evidence, mirrored, _, objects, stars = search_many(
            self._sky, directions, brightness, first, self._plan, self._noise
        )
        best, second = evidence[0].tolist()
        wrong = _wrong(best, second, bool(mirrored[0]), len(objects), len(brightness))
        return wrong or Identification(objects, self._in_catalog(stars), _false_match_probability(best))

    def best_false_match_probability(
        self, directions_sensor: NDArray[np.float64], brightness: NDArray[np.float64]
    ) -> float:
        """False match probability of the best attitude found, even one that is not good enough for an answer."""
        directions, brightness = _contiguous(directions_sensor, brightness)
        first = np.array([0, len(brightness)])
        evidence = search_many(self._sky, directions, brightness, first, self._plan, self._noise)[0]
        return _false_match_probability(float(evidence[0, 0]))

    def identify_many(self, objects: ObjectColumns) -> Answers:
        """The answers to many panoramas, each as for ``identify``, by one search that lets other threads run."""
        refused = refusals(objects, _FEWEST_OBJECTS)
        outside = np.empty(len(objects), dtype=np.int64)
        outside_fields(objects.directions_sensor, objects.parts.first, self._field, outside)
        for k in (outside >= 0).nonzero()[0].tolist():
            refused.setdefault(k, _outside(int(outside[k])))
        return answered(objects, refused, self._found)

    def _found(self, objects: ObjectColumns) -> Answers:
        """The answers to panoramas that nothing is wrong with."""
        evidence, mirrored, ends, found, stars = search_many(
            self._sky, objects.directions_sensor, objects.brightness, objects.parts.first, self._plan, self._noise
        )
        return _believed(evidence, mirrored, Parts(ends), found, self._in_catalog(stars), objects.parts.counts)

    def _in_catalog(self, stars: NDArray[np.int64]) -> NDArray[np.int64]:
        """Rows of the catalogue of rows of the tables."""
        return stars if self._rows is None else self._rows[stars]


def made(options: IdentifierOptions, camera: Camera, source: StarCatalog) -> RobustIdentifier:
    """The identifier as it is under test: it has no options."""
    return RobustIdentifier(camera, source.brightest_first())


def stars_looked_at(camera: Camera, field_of_view_deg: float | None = None) -> int:
    """How many stars of its source the identifier takes under ``auto``."""
    return round(_FIELD_STARS * 4 * math.pi / float(_field(camera, field_of_view_deg)[5]))


def _contiguous(
    directions_sensor: NDArray[np.float64], brightness: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The objects as the compiled searches take them."""
    return np.ascontiguousarray(directions_sensor, dtype=np.float64), np.ascontiguousarray(brightness, dtype=np.float64)


def _outside(row: int) -> Unidentified:
    return Unidentified(Reason.SENSOR_FAULT, f"object {row} lies outside the detector")


def _believed(
    evidence: NDArray[np.float64],
    mirrored: NDArray[np.bool_],
    parts: Parts,
    objects: NDArray[np.int64],
    stars: NDArray[np.int64],
    counts: NDArray[np.int64],
) -> Answers:
    """What of the best attitudes of K panoramas is an answer, of which ``counts`` (K,) are the objects.

    ``evidence`` (K, 2) are the logarithms of the best and of the second best. Rows (M,) of objects and stars are parts.
    """
    found = list(zip(*evidence.T.tolist(), mirrored.tolist(), strict=True))
    # Where nothing is believed a random panorama would be as good.
    probability = np.array([_false_match_probability(best) if best >= LOG_ACCEPTED else 1.0 for best, _, _ in found])
    each = zip(found, parts.counts.tolist(), counts.tolist(), strict=True)
    refused = {k: wrong for k, (one, *sizes) in enumerate(each) if (wrong := _wrong(*one, *sizes))}
    return Answers(parts, objects, stars, probability, {}).but(refused)


def _wrong(best: float, second: float, mirrored: bool, stars: int, count: int) -> Unidentified | None:
    """Why a panorama of ``count`` objects has no answer; None where it has one."""
    if mirrored:
        return Unidentified(
            Reason.MIRRORED,
            f"the image is mirrored: flipped, {stars} of {count} objects are stars; turn sensor.mirrored over",
        )
    if best < LOG_ACCEPTED:
        return Unidentified(Reason.NO_MATCH, "no attitude explains the objects better than chance")
    if best - second < LOG_UNAMBIGUOUS:
        return Unidentified(
            Reason.AMBIGUOUS, f"two attitudes explain the objects, one {math.exp(best - second):.1f} times better"
        )
    return None


def _false_match_probability(log_evidence: float) -> float:
    return CHANCE_OF_EVIDENCE * math.exp(-log_evidence) if log_evidence > math.log(CHANCE_OF_EVIDENCE) else 1.0


_EDGE_POINTS = 65
"""Along each edge of the detector: between two of them it bends by less than 0.1 px."""


def _field(camera: Camera, field_of_view_deg: float | None) -> NDArray[np.float64]:
    """The field as the tables describe it."""
    # A barrel distortion bends the edges out: their middles lie beyond the corners.
    across, down = (np.linspace(-0.5, size - 0.5, _EDGE_POINTS) for size in (camera.columns, camera.rows))
    edges = [(x, y) for x in across for y in down[[0, -1]]] + [(x, y) for x in across[[0, -1]] for y in down]
    directions = camera.directions(np.array(edges))
    uv = directions[:, :2] / directions[:, 2:]
    (left, top), (right, bottom) = uv.min(axis=0), uv.max(axis=0)
    area, radius2 = (right - left) * (bottom - top), math.inf
    if field_of_view_deg is not None:
        radius2 = math.tan(math.radians(field_of_view_deg) / 2) ** 2
        area = min(area, math.pi * radius2)
    return np.array([left, right, top, bottom, radius2, area])
