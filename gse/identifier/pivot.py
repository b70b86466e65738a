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
published success is met within a point.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog, brightest_per_field, mission_catalog
from gse.identifier.acceptance import RandomSky, accepted
from gse.identifier.consistency import Separations, separations
from gse.identifier.input_checks import distinct_objects, refusal
from gse.identifier.pivot_search import (
    FEWEST_OBJECTS,
    FOUND,
    NO_GATE,
    PIVOT_MEMBERS,
    TIE,
    Gates,
    PivotObjects,
    PivotSky,
    search,
)
from gse.identifier.result import Answers, Identification, ObjectColumns, Reason, Unidentified
from gse.identifier.tables import field_diameter_rad, pair_table, tolerance_rad
from gse.values.camera import Camera
from gse.values.identifier_options import IdentifierOptions

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
