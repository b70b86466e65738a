"""The pivot algorithm, pivot paper, section 4: no magnitudes, only the order of brightness within a pair.

Step 1: the pivot is the brightest object, its members the three next (``pivot_members`` 5: four). A catalogue star with
dimmer stars at the distances of all members makes a group, and K - 2 or more of the members' mutual distances must fit
too. The best group names the pivot: the one in which most mutual distances fit, then in which most of these have their
brighter star where the brighter object is. Where different stars have the best group, or none has one, the next object
is the pivot.

Step 2: every other object is looked for at its distances from the three brightest of the group, its anchors, among the
stars in the group's cells and the cells around; here either star of a pair may be the brighter. The paper makes a new
pattern for each star instead.

The cells as knowledge a priori (``a_priori: cells``; the paper suggests it in section 5): step 1 takes pivots from the
cells of the panorama before and those around only. Where that finds nothing, or a tie, the whole sky is searched.

The paper leaves open how far "best concurrence" reaches and which members a later pivot has; with these rules the
published success is met within a point. The search is compiled, over angles between objects, the table of pairs, and
cells.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog, brightest_per_field, mission_catalog
from gse.identifier.checks import RandomSky, accepted, distinct_objects, refusal
from gse.identifier.consistency import Separations, angle_urad, separations, stars_fit
from gse.identifier.result import Answers, Identification, ObjectColumns, Reason, Unidentified
from gse.identifier.tables import PairTable, field_diameter_rad, pair_table, tolerance_rad
from gse.process.jit import compiled, compiled_part
from gse.values.camera import Camera
from gse.values.identifier_options import IdentifierOptions

PIVOT_MEMBERS = 4
"""K of the pivot paper, the pivot and its members: four, or five."""

_MORE_THAN_PAIRS = 8
"""More than the mutual distances that members of five can have in order: more distances that fit always count more."""

FEWEST_OBJECTS = 3
NO_GATE = math.inf
FOUND, NO_GROUP, TIE = 0, 1, 2

_MOST_GROUPS = 200_000
"""Cap for one pivot, where the tolerance lets everything fit: such a search is a tie."""

# Cells of the sky, pivot paper, section 3.2: zones of declination, each cut into equal parts of right ascension.
#
# With every bracket a floor, and eqs 7-9 mended (as printed they put few stars into the right cell): zone k counts from
# the north pole in steps of D = 2 pi / (2N + 1), its order is n = 2k, or 2N + 1 - 2k once 2k > N, it has 2n + 1 cells,
# and cell j of it, counted so that j = 0 is centred on right ascension 0, has the index n^2 + j in 0 .. (N + 1)^2 - 1.


@dataclass(frozen=True, slots=True)
class Cells:
    """The cells for a field: each at least as high as the field is wide (``order`` is N of eq 6)."""

    order: int

    @classmethod
    def for_field(cls, diameter_rad: float) -> "Cells":
        """Eq 6. A field of more than 120 deg has one cell."""
        return cls(max(0, math.floor(0.5 * (2 * math.pi / diameter_rad - 1))))

    def __len__(self) -> int:
        return (self.order + 1) ** 2

    def zones_deg(self) -> list[tuple[float, float, int]]:
        """Each zone from the north: lowest and highest declination in degrees, and its number of cells."""
        height_deg = math.degrees(self._height_rad)
        zones = []
        for zone in range(self.order + 1):
            n = 2 * zone if 2 * zone <= self.order else 2 * self.order + 1 - 2 * zone
            middle_deg = 90 - zone * height_deg
            zones.append((max(middle_deg - height_deg / 2, -90.0), min(middle_deg + height_deg / 2, 90.0), 2 * n + 1))
        return zones

    def index(self, icrs: NDArray[np.float64]) -> NDArray[np.int64]:
        """Cell of each unit vector (N, 3), eqs 7-9 as mended."""
        ra = np.arctan2(icrs[:, 1], icrs[:, 0])
        colatitude = np.arctan2(np.hypot(icrs[:, 0], icrs[:, 1]), icrs[:, 2])
        zone = np.minimum(self.order, np.floor(colatitude / self._height_rad + 0.5).astype(np.int64))
        n = np.where(2 * zone <= self.order, 2 * zone, 2 * self.order + 1 - 2 * zone)
        width = 2 * n + 1
        j = np.floor(ra * width / (2 * math.pi) + 0.5).astype(np.int64) % width
        cells: NDArray[np.int64] = n**2 + j
        return cells

    def around(self) -> NDArray[np.bool_]:
        """Which cells (C, C) touch which: each itself, and those that share an edge or a corner with it."""
        n = np.floor(np.sqrt(np.arange(len(self)))).astype(np.int64)
        zone = np.where(n % 2 == 0, n // 2, (2 * self.order + 1 - n) // 2)
        width = 2 * n + 1
        centre = (np.arange(len(self)) - n**2) / width
        separation = np.abs((centre[:, None] - centre[None] + 0.5) % 1 - 0.5)
        reach = 0.5 / width
        touching = separation <= reach[:, None] + reach[None] + 1e-9
        nearby: NDArray[np.bool_] = (np.abs(zone[:, None] - zone[None]) <= 1) & touching
        return nearby

    @property
    def _height_rad(self) -> float:
        return 2 * math.pi / (2 * self.order + 1)


class PivotIdentifier:
    """The pivot algorithm with its catalogue, pairs and cells, for fields of one diameter."""

    name = "pivot"

    def __init__(
        self,
        catalog: StarCatalog,
        field_rad: float,
        tolerance_rad: float,
        *,
        members: int = PIVOT_MEMBERS,
        follows: bool = False,
    ) -> None:
        self.catalog = catalog
        self._tolerance_rad = tolerance_rad
        table = pair_table(catalog, field_rad)
        cells = Cells.for_field(field_rad)
        self._sky = PivotSky(table, catalog.icrs, catalog.magnitude, cells.index(catalog.icrs), cells.around())
        self._random = RandomSky(len(catalog), len(table.distance_urad), field_rad, tolerance_rad)
        self._gates = Gates(1e6 * tolerance_rad, NO_GATE, 0.0, members)
        self._follows = follows
        self._everywhere = np.ones(len(cells), np.bool_)
        self._before: NDArray[np.int64] | None = None

    @classmethod
    def for_camera(cls, catalog: StarCatalog, camera: Camera, options: IdentifierOptions) -> Self:
        """The identifier for a camera; the tolerance is that of the LAPAN paper, eq 2-1."""
        tolerance = tolerance_rad(camera, options.tolerance_px)
        return cls(
            catalog,
            field_diameter_rad(camera),
            tolerance,
            members=options.pivot_members,
            follows=options.a_priori == "cells",
        )

    def identify(
        self,
        directions_sensor: NDArray[np.float64],
        brightness: NDArray[np.float64],
        *,
        before: NDArray[np.int64] | None = None,
    ) -> Identification | Unidentified:
        """Name the stars among objects given as unit vectors (N, 3) and brightness (N,), brightest first.

        ``before`` (M,) are stars of the field that was seen before: the cells of these and those around come first.
        """
        directions = np.ascontiguousarray(directions_sensor, dtype=np.float64)
        brightness = np.ascontiguousarray(brightness, dtype=np.float64)
        refused = refusal(directions, brightness, FEWEST_OBJECTS)
        if refused:
            return refused
        distinct = distinct_objects(directions)
        named = self.identify_angles(separations(directions[distinct]), brightness[distinct], before=before)
        if isinstance(named, Unidentified):
            return named
        objects, stars = distinct[named[0]], named[1]
        false_match_probability = self._random.false_match_probability(
            len(directions), len(objects) - 1, len(directions)
        )
        return accepted(directions, self.catalog, objects, stars, self._tolerance_rad, false_match_probability)

    def _cells_of(self, before: NDArray[np.int64] | None) -> NDArray[np.bool_]:
        """The cells of some stars and all that touch them, or all cells."""
        if before is None:
            return self._everywhere
        return np.asarray(self._sky.around[np.unique(self._sky.cell[before])].any(axis=0))

    def identify_many(self, objects: ObjectColumns) -> Answers:
        """The answers to many panoramas that follow each other, each as for ``identify``.

        With ``a_priori: cells`` each is looked for where the one before was; after one without an answer, everywhere.
        """
        return Answers.from_answers([self._next(*seen) for seen in objects])

    def _next(self, directions: NDArray[np.float64], brightness: NDArray[np.float64]) -> Identification | Unidentified:
        answer = self.identify(directions, brightness, before=self._before)
        self._before = answer.stars if self._follows and isinstance(answer, Identification) else None
        return answer

    def identify_angles(
        self, angles: Separations, brightness: NDArray[np.float64], *, before: NDArray[np.int64] | None = None
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]] | Unidentified:
        """Objects and their stars (M,), the pivot first, from the angles between objects alone.

        The pivot paper validates this, with noise on each angle; without directions no attitude can be solved.
        """
        magnitude = -2.5 * np.log10(np.maximum(brightness, 1.0))
        seen = PivotObjects(angles.cosine, angles.sine, magnitude)
        outcome, objects, stars = search(seen, self._sky, self._gates, self._cells_of(before))
        if outcome != FOUND and before is not None:
            outcome, objects, stars = search(seen, self._sky, self._gates, self._everywhere)
        if outcome == FOUND:
            return objects, stars
        if outcome == TIE:
            return Unidentified(Reason.AMBIGUOUS, "several catalogue stars fit a pivot equally well")
        return Unidentified(
            Reason.NO_MATCH, f"none of {len(brightness)} objects is the pivot of a group in the catalogue"
        )


def made(options: IdentifierOptions, camera: Camera, source: StarCatalog) -> PivotIdentifier:
    """The identifier with its mission catalogue."""
    return PivotIdentifier.for_camera(brightest_stars(options, camera, source), camera, options)


def brightest_stars(options: IdentifierOptions, camera: Camera, source: StarCatalog) -> StarCatalog:
    """The mission catalogue of pivots: the brightest stars of each field (pivot paper, section 3)."""
    mission = mission_catalog(source.brightest_first(), camera, options.catalog_stars)
    if options.magnitude_limit is not None:
        mission = mission.rows(np.flatnonzero(mission.magnitude <= options.magnitude_limit))
    return (
        mission if mission.is_flight else brightest_per_field(mission, 2 * math.sqrt(camera.solid_angle_sr / math.pi))
    )


class PivotSky(NamedTuple):
    """The sky, as the search reads it.

    ``cell`` (S,) is the cell of each star, ``around`` (C, C) is True for cells that touch.
    """

    table: PairTable
    icrs: NDArray[np.float64]
    magnitude: NDArray[np.float64]
    cell: NDArray[np.int64]
    around: NDArray[np.bool_]


class Gates(NamedTuple):
    """How far objects may be from stars: in distance, and in magnitude after a zero point (NaN: that of the group)."""

    tolerance_urad: float
    magnitude: float
    zero_point: float
    members: int = PIVOT_MEMBERS


class PivotObjects(NamedTuple):
    """The objects, brightest first: cosine and sine (N, N) of their angles, and -2.5 log10 of their index (N,)."""

    cosine: NDArray[np.float64]
    sine: NDArray[np.float64]
    magnitude: NDArray[np.float64]


class Group(NamedTuple):
    """Objects, the pivot first, and the stars that they are thought to be."""

    object: NDArray[np.int64]
    star: NDArray[np.int64]


@compiled
def search(
    objects: PivotObjects, sky: PivotSky, gates: Gates, cells: NDArray[np.bool_]
) -> tuple[int, NDArray[np.int64], NDArray[np.int64]]:
    """Both steps: FOUND, NO_GROUP or TIE, and the named objects with their stars, the pivot first.

    The pivot is a star of the ``cells`` (C,) that are True: all of them, or those where the sky was before.
    """
    count = len(objects.magnitude)
    outcome = NO_GROUP
    # The pivot is the brightest object. Where it has no group it may be no star: the next brightest is pivot then, and
    # those before it are left out of the pattern.
    for pivot in range(count - FEWEST_OBJECTS + 1):
        members = np.arange(pivot, min(pivot + gates.members, count))
        group = Group(members, np.full(len(members), -1))
        found = _best_group(group, objects, sky, gates, cells)
        if found == FOUND:
            named = _with_others(group, objects, sky, gates)
            return FOUND, named.object, named.star
        if found == TIE:
            outcome = TIE
    return outcome, np.empty(0, np.int64), np.empty(0, np.int64)


@compiled_part
def _best_group(best: Group, objects: PivotObjects, sky: PivotSky, gates: Gates, cells: NDArray[np.bool_]) -> int:
    """Step 1 for one pivot: put the stars of the best group into ``best``."""
    table, size = sky.table, len(best.object)
    group = Group(best.object, best.star.copy())
    best_score, tie, groups = -1, False, 0
    # The pattern of four: distances from the pivot (0) to its members, each found by bisection in a sorted list.
    #
    #          2                the pair 0-1 comes from the table of all pairs,
    #         /                 2 and 3 from the neighbours of star 0;
    #     0 --- 1               the three distances between 1, 2 and 3 then
    #         \                 say how well the group concurs
    #          3
    low, high = _window(table.distance_urad, group, 1, objects, gates)
    for pair in range(low, high):
        if not cells[sky.cell[table.brighter[pair]]]:
            continue
        group.star[0], group.star[1] = table.brighter[pair], table.dimmer[pair]
        begin, end = table.first[group.star[0]], table.first[group.star[0] + 1]
        distances = table.neighbour_urad[begin:end]
        low_2, high_2 = _window(distances, group, 2, objects, gates)
        low_3, high_3 = (0, 1) if size < 4 else _window(distances, group, 3, objects, gates)
        low_4, high_4 = (0, 1) if size < 5 else _window(distances, group, 4, objects, gates)
        groups += (high_2 - low_2) * (high_3 - low_3) * (high_4 - low_4)
        if groups > _MOST_GROUPS:
            return TIE
        for second in range(low_2, high_2):
            group.star[2] = table.neighbour[begin + second]
            for third in range(low_3, high_3):
                if size > 3:
                    group.star[3] = table.neighbour[begin + third]
                for fourth in range(low_4, high_4):
                    if size > 4:
                        group.star[4] = table.neighbour[begin + fourth]
                    score = _concurrence(group, objects, sky, gates)
                    if score > best_score:
                        best_score, tie = score, False
                        best.star[:] = group.star
                    elif score == best_score and group.star[0] != best.star[0]:
                        tie = True
    if best_score < 0:
        return NO_GROUP
    return TIE if tie else FOUND


@compiled_part
def _window(
    distances_urad: NDArray[np.int32], group: Group, member: int, objects: PivotObjects, gates: Gates
) -> tuple[int, int]:
    """Where, among sorted distances, those lie that fit a member's distance from the pivot."""
    p, q = group.object[0], group.object[member]
    distance = angle_urad(objects.cosine[p, q], objects.sine[p, q])
    low = np.searchsorted(distances_urad, distance - gates.tolerance_urad, side="right")
    high = np.searchsorted(distances_urad, distance + gates.tolerance_urad, side="left")
    return int(low), int(high)


@compiled_part
def _concurrence(group: Group, objects: PivotObjects, sky: PivotSky, gates: Gates) -> int:
    """How well a group concurs; -1 where its pivot is not the brightest star, or too few mutual distances fit."""
    # Stars are numbered brightest first, so "brighter" is "has the lower number". The paper uses no magnitudes here,
    # only their order: the pivot must be the brightest, and members in the order of the objects count as a second
    # merit.
    fits = ordered = 0
    for i in range(1, len(group.star)):
        if group.star[i] <= group.star[0]:
            return -1
        for j in range(1, i):
            if group.star[i] == group.star[j]:
                return -1
            if _pair_fits(group, i, j, objects, sky, gates):
                fits += 1
                ordered += group.star[j] < group.star[i]
    if fits < len(group.star) - 2 or not _magnitudes_fit(group, objects, sky, gates):
        return -1
    return _MORE_THAN_PAIRS * fits + ordered


@compiled_part
def _pair_fits(group: Group, i: int, j: int, objects: PivotObjects, sky: PivotSky, gates: Gates) -> bool:
    """Whether the stars of members i and j are as far apart as their objects."""
    p, q = group.object[i], group.object[j]
    cosine, sine = objects.cosine[p, q], objects.sine[p, q]
    return stars_fit(sky.icrs, group.star[i], group.star[j], cosine, sine, gates.tolerance_urad)


@compiled_part
def _magnitudes_fit(group: Group, objects: PivotObjects, sky: PivotSky, gates: Gates) -> bool:
    zero_point = _zero_point(group, objects, sky, gates)
    for i in range(len(group.star)):
        if not _magnitude_fits(group.object[i], group.star[i], objects, sky, gates, zero_point):
            return False
    return True


@compiled_part
def _magnitude_fits(p: int, a: int, objects: PivotObjects, sky: PivotSky, gates: Gates, zero_point: float) -> bool:
    return bool(abs(objects.magnitude[p] + zero_point - sky.magnitude[a]) <= gates.magnitude)


@compiled_part
def _zero_point(group: Group, objects: PivotObjects, sky: PivotSky, gates: Gates) -> float:
    """What makes magnitudes of -2.5 log10 index: the given number, else the one that suits the group best."""
    if not np.isnan(gates.zero_point):
        return gates.zero_point
    total = 0.0
    for i in range(len(group.star)):
        total += sky.magnitude[group.star[i]] - objects.magnitude[group.object[i]]
    return total / len(group.star)


@compiled_part
def _with_others(group: Group, objects: PivotObjects, sky: PivotSky, gates: Gates) -> Group:
    """Step 2: the group, and after it the other objects, brightest first, that one star in the cells around fits."""
    # Step 2 looks in the cells around the group only: a star elsewhere cannot be in the same image.
    cells = np.zeros(len(sky.around), np.bool_)
    for star in group.star:
        cells |= sky.around[sky.cell[star]]
    zero_point = _zero_point(group, objects, sky, gates)
    count, named = len(objects.magnitude), len(group.object)
    rows, stars = np.empty(count, np.int64), np.empty(count, np.int64)
    rows[:named], stars[:named] = group.object, group.star
    for other in range(count):
        if group.object[0] <= other <= group.object[-1]:
            continue
        star = _only_star(other, group, cells, objects, sky, gates)
        if star < 0 or (stars[:named] == star).any():
            continue
        if _magnitude_fits(other, star, objects, sky, gates, zero_point):
            rows[named], stars[named] = other, star
            named += 1
    return Group(rows[:named], stars[:named])


@compiled_part
def _only_star(
    other: int, group: Group, cells: NDArray[np.bool_], objects: PivotObjects, sky: PivotSky, gates: Gates
) -> int:
    """The one star in ``cells`` at an object's distances from the first three of a group; -1 for none or several."""
    table = sky.table
    begin, end = table.first[group.star[0]], table.first[group.star[0] + 1]
    trial = Group(np.empty(FEWEST_OBJECTS + 1, np.int64), np.empty(FEWEST_OBJECTS + 1, np.int64))
    trial.object[:-1], trial.star[:-1] = group.object[:FEWEST_OBJECTS], group.star[:FEWEST_OBJECTS]
    trial.object[-1] = other
    low, high = _window(table.neighbour_urad[begin:end], trial, FEWEST_OBJECTS, objects, gates)
    found = -1
    for k in range(begin + low, begin + high):
        star = table.neighbour[k]
        if not cells[sky.cell[star]]:
            continue
        trial.star[-1] = star
        fits = True
        for i in range(1, FEWEST_OBJECTS):
            fits = fits and _pair_fits(trial, FEWEST_OBJECTS, i, objects, sky, gates)
        if fits:
            if found >= 0:
                return -1
            found = star
    return found
