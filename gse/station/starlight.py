"""Starlight: what the named stars of panoramas show of the sky."""

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog
from gse.identifier import Answers
from gse.station.results import Matches, Starlight
from gse.values.panorama import Parts

MARGIN_MAG = 1.0
"""Colours, noise and doubles make a star as much brighter than its catalogue magnitude says, or as much fainter."""


def starlights(brightness: NDArray[np.float64], panoramas: Parts, answers: Answers, catalog: StarCatalog) -> Starlight:
    """The light of the stars that an identifier found among the objects of K panoramas, with their brightness (M,).

    Objects that are all of one brightness come from a sensor that sends none: they have no zero point.
    """
    light = Starlight.none(len(answers))
    shown = answers.parts.counts > 0
    if not shown.any():
        return light
    counts, begins = answers.parts.counts[shown], answers.parts.first[:-1][shown]
    magnitude = catalog.magnitude.take(answers.stars)
    index = np.maximum(brightness.take(rows_of(panoramas, answers)), 1.0)
    varies = np.maximum.reduceat(index, begins) > np.minimum.reduceat(index, begins)
    zero_points = np.where(varies, _medians(magnitude + 2.5 * np.log10(index), counts), np.nan)
    fainter_mag = MARGIN_MAG - float(catalog.magnitude[-1])
    light.stars[shown], light.zero_point_mag[shown] = counts, zero_points
    light.limiting_mag[shown] = np.maximum.reduceat(magnitude, begins)
    light.faintest_index[shown] = np.where(varies, 10 ** (0.4 * (zero_points + fainter_mag)), np.inf)
    return light


def rows_of(panoramas: Parts, matches: Answers | Matches) -> NDArray[np.int64]:
    """The rows of all panoramas' objects that matches (M,) name."""
    rows: NDArray[np.int64] = matches.objects + np.repeat(panoramas.first[:-1], matches.parts.counts)
    return rows


def _medians(values: NDArray[np.float64], counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """The median of each part of the values (M,), of these lengths."""
    places = np.arange(counts.max())
    ordered = np.full((len(counts), len(places)), np.nan)
    ordered[places < counts[:, None]] = values
    ordered.sort(axis=1)  # of few each: a sort of all by part and value takes five times as long
    part = np.arange(len(counts))
    medians: NDArray[np.float64] = (ordered[part, (counts - 1) // 2] + ordered[part, counts // 2]) / 2
    return medians
