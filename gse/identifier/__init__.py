"""Star identification: objects of one panorama in, stars or the reason why not out; each algorithm is a module.

Answers have the shapes of ``result``. May not import truth, station or the simulator: an identifier knows neither the
time nor where the sensor should look.
"""

import math
from typing import Protocol, assert_never

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog, brightest_per_field, mission_catalog
from gse.errors import UsageError
from gse.identifier.result import Answers, Identification, ObjectColumns, Reason, Unidentified
from gse.values.camera import Camera
from gse.values.identifier_options import IdentifierOptions

__all__ = [
    "Answers",
    "Identification",
    "Identifier",
    "ObjectColumns",
    "Reason",
    "Unidentified",
    "make_identifier",
]


class Identifier(Protocol):
    """An algorithm with its catalogue and tables, ready to work."""

    name: str
    catalog: StarCatalog
    """The catalogue whose row numbers the answers give."""

    def identify(
        self, directions_sensor: NDArray[np.float64], brightness: NDArray[np.float64]
    ) -> Identification | Unidentified:
        """Name the stars among objects given as unit vectors (N, 3) and brightness (N,), brightest first."""
        ...

    def identify_many(self, objects: ObjectColumns) -> Answers:
        """The answers to many panoramas, each as for ``identify``."""
        ...


def make_identifier(options: IdentifierOptions, camera: Camera, source: StarCatalog) -> Identifier:
    """The identifier that the options name, with its mission catalogue chosen from ``source`` for the camera.

    The algorithms are imported here, one at a time: with their compiled parts they take a second.
    """
    if source.is_flight and options.algorithm != "neighbour":  # all others take the order of brightness for granted
        source = source.rows(np.argsort(source.magnitude, kind="stable"))
    if options.algorithm == "robust":
        from gse.identifier.robust import RobustIdentifier

        return RobustIdentifier(camera, source)
    if options.algorithm == "external":
        raise UsageError("an external identifier works in a session or on panoramas; name a built-in one here")
    mission = mission_catalog(source, camera, options.catalog_stars)
    if options.algorithm == "neighbour":
        from gse.identifier.neighbour import NeighbourIdentifier

        return NeighbourIdentifier(mission, camera, options)
    brightest = mission
    if options.magnitude_limit is not None:
        brightest = mission = mission.rows(np.flatnonzero(mission.magnitude <= options.magnitude_limit))
    if not mission.is_flight:
        brightest = brightest_per_field(mission, 2 * math.sqrt(camera.solid_angle_sr / math.pi))
    if options.algorithm == "pivot":
        from gse.identifier.pivot import PivotIdentifier

        return PivotIdentifier.for_camera(brightest, camera, options)
    if options.algorithm == "match-group":
        from gse.identifier.match_group import MatchGroupIdentifier

        return MatchGroupIdentifier.for_camera(brightest, camera, options)
    assert_never(options.algorithm)
