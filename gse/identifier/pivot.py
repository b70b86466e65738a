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

from typing import Self

import numpy as np
from numpy.typing import NDArray

from gse.camera import Camera
from gse.catalog import StarCatalog
from gse.identifier.acceptance import RandomSky, accepted
from gse.identifier.cells import Cells
from gse.identifier.consistency import Separations, separations
from gse.identifier.input_checks import distinct_objects, refusal
from gse.identifier.pivot_search import (
    FEWEST_OBJECTS,
    FOUND,
    NO_GATE,
    PIVOT_MEMBERS,
    TIE,
    Gates,
    Objects,
    PivotSky,
    search,
)
from gse.identifier.result import Answers, Identification, ObjectColumns, Reason, Unidentified
from gse.identifier.tables import field_diameter_rad, pair_table, tolerance_rad
from gse.identifier_options import IdentifierOptions


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
        return Answers.of([self._next(*seen) for seen in objects])

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
        seen = Objects(angles.cosine, angles.sine, magnitude)
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
