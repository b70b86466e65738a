"""The pivot algorithm, pivot paper, section 4: no magnitudes, only the order of brightness within a pair.

Step 1: the pivot is the brightest object, its members the three next (``pivot_members`` 5: four). A catalogue star with
dimmer stars at the distances of all members makes a group, and K - 2 or more of the members' mutual distances must fit
too. The best group names the pivot: the one in which most mutual distances fit, then in which most of these have their
brighter star where the brighter object is. Where different stars have the best group, or none has one, the next object
is the pivot.

Step 2: every other object is looked for at its distances from the three brightest of the group, its anchors, among the
stars in the group's cells and the cells around; here either star of a pair may be the brighter. The paper makes a new
pattern for each star instead.

The paper leaves open how far "best concurrence" reaches and which members a later pivot has; with these rules the
published success is met within a point.
"""

import numpy as np
from numpy.typing import NDArray

from gse.camera import Camera
from gse.catalog import StarCatalog
from gse.identifier.acceptance import RandomSky, accepted
from gse.identifier.cells import Cells
from gse.identifier.consistency import Separations, separations
from gse.identifier.input_checks import distinct_objects, refusals
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
from gse.identifier.result import Answers, Identification, ObjectColumns, Reason, Unidentified, answered
from gse.identifier.tables import field_diameter_rad, pair_table, tolerance_rad
from gse.identifier_options import IdentifierOptions


class PivotIdentifier:
    """The pivot algorithm with its catalogue, pairs and cells, for fields of one diameter."""

    name = "pivot"

    def __init__(
        self, catalog: StarCatalog, field_rad: float, tolerance_rad: float, *, members: int = PIVOT_MEMBERS
    ) -> None:
        self.catalog = catalog
        self._tolerance_rad = tolerance_rad
        table = pair_table(catalog, field_rad)
        cells = Cells.for_field(field_rad)
        self._sky = PivotSky(table, catalog.icrs, catalog.magnitude, cells.index(catalog.icrs), cells.around())
        self._random = RandomSky(len(catalog), len(table.distance_urad), field_rad, tolerance_rad)
        self._gates = Gates(1e6 * tolerance_rad, NO_GATE, 0.0, members)

    @classmethod
    def for_camera(cls, catalog: StarCatalog, camera: Camera, options: IdentifierOptions) -> "PivotIdentifier":
        """The identifier for a camera; the tolerance is that of the LAPAN paper, eq 2-1."""
        tolerance = tolerance_rad(camera, options.tolerance_px)
        return cls(catalog, field_diameter_rad(camera), tolerance, members=options.pivot_members)

    def identify(
        self, directions_sensor: NDArray[np.float64], brightness: NDArray[np.float64]
    ) -> Identification | Unidentified:
        """Name the stars among objects given as unit vectors (N, 3) and brightness (N,), brightest first."""
        return self.identify_many(ObjectColumns.of([(directions_sensor, brightness)]))[0]

    def identify_many(self, objects: ObjectColumns) -> Answers:
        """The answers to many panoramas, each as for ``identify``."""
        return answered(objects, refusals(objects, FEWEST_OBJECTS), self._found)

    def _found(self, objects: ObjectColumns) -> Answers:
        """The answers to panoramas that nothing is wrong with."""
        each = (objects.parts.rows(k) for k in range(len(objects)))
        return Answers.of([self._named(objects.directions_sensor[rows], objects.brightness[rows]) for rows in each])

    def _named(self, directions: NDArray[np.float64], brightness: NDArray[np.float64]) -> Identification | Unidentified:
        distinct = distinct_objects(directions)
        named = self.identify_angles(separations(directions[distinct]), brightness[distinct])
        if isinstance(named, Unidentified):
            return named
        objects, stars = distinct[named[0]], named[1]
        false_match_probability = self._random.false_match_probability(
            len(directions), len(objects) - 1, len(directions)
        )
        return accepted(directions, self.catalog, objects, stars, self._tolerance_rad, false_match_probability)

    def identify_angles(
        self, angles: Separations, brightness: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]] | Unidentified:
        """Objects and their stars (M,), the pivot first, from the angles between objects alone.

        The pivot paper validates this, with noise on each angle; without directions no attitude can be solved.
        """
        magnitude = -2.5 * np.log10(np.maximum(brightness, 1.0))
        outcome, objects, stars = search(Objects(angles.cosine, angles.sine, magnitude), self._sky, self._gates)
        if outcome == FOUND:
            return objects, stars
        if outcome == TIE:
            return Unidentified(Reason.AMBIGUOUS, "several catalogue stars fit a pivot equally well")
        return Unidentified(
            Reason.NO_MATCH, f"none of {len(brightness)} objects is the pivot of a group in the catalogue"
        )
