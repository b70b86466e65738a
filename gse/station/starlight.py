"""Starlight: what the named stars of a panorama show of the sky."""

import math

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog
from gse.identifier import Identification
from gse.station.results import Starlight

MARGIN_MAG = 1.0
"""Colours, noise and doubles make a star as much brighter than its catalogue magnitude says, or as much fainter."""


def starlight(brightness: NDArray[np.float64], found: Identification, catalog: StarCatalog) -> Starlight:
    """The light of the stars that an identifier found among objects of a brightness (N,).

    Objects that are all of one brightness come from a sensor that sends none: they have no zero point.
    """
    magnitude = catalog.magnitude.take(found.stars)
    index = np.maximum(brightness.take(found.objects), 1.0)
    limiting_mag = float(magnitude.max())
    if index.min() == index.max():
        return Starlight(len(magnitude), math.nan, limiting_mag)
    zero_point_mag = float(np.median(magnitude + 2.5 * np.log10(index)))
    faintest_index = 10 ** (0.4 * (zero_point_mag - float(catalog.magnitude[-1]) + MARGIN_MAG))
    return Starlight(len(magnitude), zero_point_mag, limiting_mag, faintest_index)
