"""Starlight: what the named stars of a panorama show of the sky."""

import math

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog
from gse.identifier import Identification
from gse.station.results import Starlight


def starlight(brightness: NDArray[np.float64], found: Identification, catalog: StarCatalog) -> Starlight:
    """The light of the stars that an identifier found among objects of a brightness (N,).

    Objects that are all of one brightness come from a sensor that sends none: they have no zero point.
    """
    magnitude = catalog.magnitude.take(found.stars)
    index = np.maximum(brightness.take(found.objects), 1.0)
    limiting_mag = float(magnitude.max())
    if index.min() == index.max():
        return Starlight(len(magnitude), math.nan, limiting_mag)
    return Starlight(len(magnitude), float(np.median(magnitude + 2.5 * np.log10(index))), limiting_mag)
