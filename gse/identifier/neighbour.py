"""The neighbour technique of the LAPAN star sensor: LAPAN paper, section 2.

Alpha star: the brightest object. Level 1: for a catalogue star, Fn counts its neighbours whose distance fits that of an
object from the alpha star, |d_k - d_l| < d_m. Level 2: Fn2 counts the objects of level 1 that also fit each other
pairwise. Distances of stars are whole microradians, as in the onboard table (figure 2-5).

``first-fit`` goes through the catalogue in its order, and the first star that reaches Fn and Fn2 is the alpha star, as
on board. ``best-vote`` lets the ten nearest of the 15 brightest objects vote through the table of pairs, tries the 12
stars with most votes, and takes the one with the greatest Fn2; where that names nothing, it is first-fit. It answers
sooner, and differs only where several catalogue stars reach Fn and Fn2.

Measured (14 x 14 deg, 1024 px, whole pixels, 10 arcsec, 30 objects of which some are false): Fn = Fn2 = 6 names the
right stars in 99.9 % and false ones in none of 10,000 panoramas with 0 or 3 false objects. Fn = Fn2 = 3 names false
ones in 8 and 18 % with 3 and 8 false objects, and in a quarter of panoramas without a star; from 4 on, in none of 1000.
With ``alpha_retries`` 0 a brightest object that is not a star ends the search: 3 false objects then leave 60 % right.

Distances cannot tell a panorama from its mirror image, so an answer must also be solvable as an attitude. A flight unit
has no such check: with ``check: none`` its false answers are seen.

``all-fit`` looks at all stars of the catalogue, as figure 2-7 does: the greatest Fn2 is the answer, and two equal ones
are none. ``alpha: central`` takes the brightest object near the boresight, ``fit_rule: exceeded`` more than Fn and Fn2.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog, mission_catalog
from gse.identifier.checks import RandomSky, distinct_objects, misfit, refusals, wahba_residual_rad
from gse.identifier.neighbour_search import EVERYWHERE, Blocks, SearchOptions, best_vote, blocks_of, first_fit
from gse.identifier.result import Answers, Identification, ObjectColumns, Reason, Unidentified, answered
from gse.identifier.tables import PairTable, field_diameter_rad, pair_table, tolerance_rad
from gse.process.jit import compiled, compiled_part
from gse.values.camera import Camera
from gse.values.identifier_options import IdentifierOptions
from gse.values.panorama import Parts

# Compiled search of the neighbour technique for many panoramas: each object once, answers in one table.


class Found(NamedTuple):
    """Answers to K panoramas: objects and stars (M,) of panorama k are ``ends[k]`` to before ``ends[k + 1]``.

    ``alphas`` (K,) is how many alpha stars were tried, ``rms_rad`` (K,) how far the stars are off their objects.
    """

    ends: NDArray[np.int64]
    objects: NDArray[np.int64]
    stars: NDArray[np.int64]
    alphas: NDArray[np.int64]
    rms_rad: NDArray[np.float64]


@compiled
def first_fit_many(
    directions: NDArray[np.float64],
    first: NDArray[np.int64],
    icrs: NDArray[np.float64],
    table: PairTable,
    blocks: Blocks,
    limits: SearchOptions,
) -> Found:
    """``first_fit`` for K panoramas: rows ``first[k]`` to before ``first[k + 1]``, each object taken once."""
    found, hopeless = _room_for_answers(len(first) - 1, len(directions)), False
    for k in range(len(first) - 1):
        panorama = directions[first[k] : first[k + 1]]
        distinct = distinct_objects(panorama)
        rows = panorama[distinct]
        objects, stars, alphas = first_fit(rows, icrs, table, blocks, limits, hopeless)
        hopeless = len(objects) == 0
        _put(found, k, distinct[objects], stars, alphas)
        found.rms_rad[k] = _rms_rad(rows[objects], icrs[stars])
    return found


@compiled
def best_vote_many(
    directions: NDArray[np.float64],
    first: NDArray[np.int64],
    icrs: NDArray[np.float64],
    table: PairTable,
    blocks: Blocks,
    limits: SearchOptions,
) -> Found:
    """As ``first_fit_many``, by ``best_vote``."""
    found, hopeless = _room_for_answers(len(first) - 1, len(directions)), False
    for k in range(len(first) - 1):
        panorama = directions[first[k] : first[k + 1]]
        distinct = distinct_objects(panorama)
        rows = panorama[distinct]
        objects, stars, alphas = best_vote(rows, icrs, table, blocks, limits, hopeless)
        hopeless = len(objects) == 0
        _put(found, k, distinct[objects], stars, alphas)
        found.rms_rad[k] = _rms_rad(rows[objects], icrs[stars])
    return found


@compiled_part
def _room_for_answers(panoramas: int, objects: int) -> Found:
    return Found(
        np.zeros(panoramas + 1, np.int64),
        np.empty(objects, np.int64),
        np.empty(objects, np.int64),
        np.empty(panoramas, np.int64),
        np.empty(panoramas),
    )


@compiled_part
def _put(found: Found, k: int, objects: NDArray[np.int64], stars: NDArray[np.int64], alphas: int) -> None:
    """Put the answer to panorama k into its place.

    One by one: for a slice numba compiles what tells of shapes that do not fit, which takes two seconds.
    """
    begin, end = found.ends[k], found.ends[k] + len(objects)
    for i in range(len(objects)):
        found.objects[begin + i], found.stars[begin + i] = objects[i], stars[i]
    found.ends[k + 1], found.alphas[k] = end, alphas


@compiled_part
def _rms_rad(measured: NDArray[np.float64], stars: NDArray[np.float64]) -> float:
    """As ``wahba_residual_rad``, zero where no star was found."""
    return wahba_residual_rad(measured, stars) if len(measured) > 0 else 0.0


class NeighbourIdentifier:
    """The neighbour technique with its catalogue and table."""

    name = "neighbour"

    def __init__(self, catalog: StarCatalog, camera: Camera, options: IdentifierOptions) -> None:
        widest_rad = field_diameter_rad(camera)
        self.catalog = catalog
        self._table = pair_table(catalog, widest_rad)
        self._blocks = blocks_of(self._table)
        self._tolerance_rad = tolerance_rad(camera, options.tolerance_px)
        self._sky = RandomSky(len(catalog), len(self._table.distance_urad), widest_rad, self._tolerance_rad)
        more = int(options.fit_rule == "exceeded")
        fn, fn2 = options.min_fit + more, (options.min_fit_2 or options.min_fit) + more
        all_stars = options.selection == "all-fit"
        radius_px = options.alpha_radius_px or min(camera.rows, camera.columns) / 4
        is_central = options.alpha == "central"
        central_cosine = math.cos(math.atan2(radius_px, camera.focal_length_px)) if is_central else EVERYWHERE
        alphas = 1 + options.alpha_retries
        all_pairs = catalog.neighbours is None
        self._limits = SearchOptions(1e6 * self._tolerance_rad, fn, fn2, alphas, all_stars, central_cosine, all_pairs)
        self._search = best_vote_many if options.selection == "best-vote" else first_fit_many
        self._check = options.check == "wahba"

    def identify(
        self, directions_sensor: NDArray[np.float64], brightness: NDArray[np.float64]
    ) -> Identification | Unidentified:
        """Name the stars among objects given as unit vectors (N, 3) and brightness (N,), brightest first."""
        return self.identify_many(ObjectColumns.from_panoramas([(directions_sensor, brightness)]))[0]

    def identify_many(self, objects: ObjectColumns) -> Answers:
        """The answers to many panoramas, each as for ``identify``, by one search that lets other threads run."""
        return answered(objects, refusals(objects, self._limits.min_fit + 1), self._found)

    def _found(self, objects: ObjectColumns) -> Answers:
        """The answers to panoramas that nothing is wrong with."""
        directions, first = objects.directions_sensor, objects.parts.first
        found = self._search(directions, first, self.catalog.icrs, self._table, self._blocks, self._limits)
        parts = Parts(found.ends)
        fits = list(zip(objects.parts.counts.tolist(), parts.counts.tolist(), found.alphas.tolist(), strict=True))
        bounds = {
            (n, m, alphas): self._sky.false_match_probability(n, m - 1, alphas) if m else math.nan
            for n, m, alphas in set(fits)
        }
        probability = np.array([bounds[fit] for fit in fits])
        size = int(found.ends[-1])
        answers = Answers(parts, found.objects[:size], found.stars[:size], probability, {})
        off = found.rms_rad > self._tolerance_rad if self._check else np.zeros(len(objects), dtype=np.bool_)
        wrong = (off | (found.alphas < 0) | (parts.counts == 0)).nonzero()[0].tolist()
        return answers.but({k: self._unidentified(k, answers, found, directions[objects.parts.rows(k)]) for k in wrong})

    def _unidentified(self, k: int, answers: Answers, found: Found, directions: NDArray[np.float64]) -> Unidentified:
        """Why what was found for panorama k is not an answer."""
        alphas, answer = int(found.alphas[k]), answers[k]
        if alphas < 0:
            return Unidentified(Reason.AMBIGUOUS, "two catalogue stars reach the greatest fit equally well")
        assert isinstance(answer, Identification)
        if not len(answer.stars):
            reached = f"no catalogue star reached a fit of {self._limits.min_fit}"
            return Unidentified(Reason.NO_MATCH, f"{reached} with any of {alphas} alpha star(s)")
        return misfit(answer, directions, self.catalog.icrs, float(found.rms_rad[k]), self._tolerance_rad)


def made(options: IdentifierOptions, camera: Camera, source: StarCatalog) -> NeighbourIdentifier:
    """The identifier with its mission catalogue: a flight catalogue in its own order."""
    return NeighbourIdentifier(mission_catalog(source, camera, options.catalog_stars), camera, options)
