"""Match Group Algorithm, as the pivot paper compares itself with it: the pivot pattern, and a gate on magnitudes.

Magnitudes are -2.5 log10 of the index plus a zero point, which is a matter of calibration. Where it is not known, each
group is given the zero point that suits it best, which makes the gate a little wider than it is.
"""

from gse.catalog import StarCatalog
from gse.identifier.pivot import PIVOT_MEMBERS, PivotIdentifier, brightest_stars
from gse.values.camera import Camera
from gse.values.identifier_options import IdentifierOptions

MAGNITUDE_GATE = 1.0
"""Of the gates from 0.5 to 1.5 mag this one comes nearest to the curve of the pivot paper, figure 14."""


class MatchGroupIdentifier(PivotIdentifier):
    """The Match Group Algorithm with its catalogue, pairs and cells, for fields of one diameter.

    ``for_camera`` makes one whose zero point is unknown.
    """

    name = "match-group"

    def __init__(
        self,
        catalog: StarCatalog,
        field_rad: float,
        tolerance_rad: float,
        *,
        members: int = PIVOT_MEMBERS,
        follows: bool = False,
        zero_point: float | None = None,
    ) -> None:
        super().__init__(catalog, field_rad, tolerance_rad, members=members, follows=follows)
        self._gates = self._gates._replace(
            magnitude=MAGNITUDE_GATE, zero_point=float("nan") if zero_point is None else zero_point
        )


def made(options: IdentifierOptions, camera: Camera, source: StarCatalog) -> MatchGroupIdentifier:
    """The identifier with the mission catalogue of pivots."""
    return MatchGroupIdentifier.for_camera(brightest_stars(options, camera, source), camera, options)
