"""Starlight: what the named stars of panoramas show of the sky."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog
from gse.identifier import Identification
from gse.station.results import Starlight

MARGIN_MAG = 1.0
"""Colours, noise and doubles make a star as much brighter than its catalogue magnitude says, or as much fainter."""


def starlights(
    brightness: Sequence[NDArray[np.float64]], found: Sequence[Identification], catalog: StarCatalog
) -> list[Starlight]:
    """The light of the stars that an identifier found among the objects of K panoramas, with their brightness (N,).

    Objects that are all of one brightness come from a sensor that sends none: they have no zero point.
    """
    if not found:
        return []
    counts = [len(answer.stars) for answer in found]
    begins = np.cumsum([0, *counts[:-1]])
    magnitude = catalog.magnitude.take(np.concatenate([answer.stars for answer in found]))
    index = np.concatenate([of_one.take(answer.objects) for of_one, answer in zip(brightness, found, strict=True)])
    index = np.maximum(index, 1.0)
    faintest = np.maximum.reduceat(magnitude, begins).tolist()
    varies = np.maximum.reduceat(index, begins) > np.minimum.reduceat(index, begins)
    zero_points = _medians(magnitude + 2.5 * np.log10(index), counts)
    fainter_mag = MARGIN_MAG - float(catalog.magnitude[-1])
    return [
        Starlight(count, zero_point, faintest_mag, 10 ** (0.4 * (zero_point + fainter_mag)))
        if varied
        else Starlight(count, math.nan, faintest_mag)
        for count, zero_point, varied, faintest_mag in zip(counts, zero_points, varies.tolist(), faintest, strict=True)
    ]


def _medians(values: NDArray[np.float64], counts: Sequence[int]) -> list[float]:
    """The median of each part of the values (M,), of these lengths."""
    part = np.repeat(np.arange(len(counts)), counts)
    ordered = values[np.lexsort((values, part))]
    ends, sizes = np.cumsum(counts), np.array(counts)
    medians: list[float] = (
        (ordered[ends - sizes + (sizes - 1) // 2] + ordered[ends - sizes + sizes // 2]) / 2
    ).tolist()
    return medians
