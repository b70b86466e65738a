"""Star identification: each algorithm is a module, each answers in the shapes of ``result``."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog
from gse.identifier.result import Identification, Reason, Unidentified

__all__ = ["Identification", "Identifier", "Reason", "Unidentified"]


class Identifier(Protocol):
    """An algorithm with its catalogue and tables, ready to work."""

    name: str
    catalog: StarCatalog
    """The catalogue whose row numbers the answers give."""

    def identify(
        self, directions_sensor: NDArray[np.float64], index: NDArray[np.float64]
    ) -> Identification | Unidentified:
        """Name the stars among objects given as unit vectors (N, 3) and brightness (N,), brightest first."""
        ...
