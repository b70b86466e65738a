"""Star identification: objects of one panorama in, stars or the reason why not out; each algorithm is a module.

Answers have the shapes of ``result``. May not import truth, station or the simulator: an identifier knows neither the
time nor where the sensor should look.
"""

import importlib
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog
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

    ``made`` of the module of that name does it. The module is imported here: compiled parts take a second.
    """
    if options.algorithm == "external":
        raise UsageError("an external identifier works in a session or on panoramas; name a built-in one here")
    module = importlib.import_module(f"gse.identifier.{options.algorithm.replace('-', '_')}")
    identifier: Identifier = module.made(options, camera, source)
    return identifier
