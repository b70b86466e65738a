"""Compiled vote for catalogue stars: one for each pair as far apart as the alpha star and a bright neighbour."""

import numpy as np
from numpy.typing import NDArray

from gse.identifier.neighbour_level_1 import Alpha
from gse.identifier.tables import PairTable
from gse.process.jit import compiled_part

_VOTERS = 10
_BRIGHT_OBJECTS = 15
"""Only these vote: the fainter an object, the less likely it is in the catalogue."""

_STARS_TRIED = 12
_FEWEST_VOTES = 2


@compiled_part
def most_voted(alpha: Alpha, table: PairTable, tolerance_urad: float) -> NDArray[np.int64]:
    """The stars with most votes, most first, then in catalogue order: one vote for each pair that fits a distance."""
    votes = np.zeros(len(table.first) - 1, np.int32)
    for distance in alpha.distances[alpha.others < _BRIGHT_OBJECTS][:_VOTERS]:
        low = _first_above(table.distance_urad, distance - tolerance_urad)
        while low < len(table.distance_urad) and table.distance_urad[low] < distance + tolerance_urad:
            votes[table.brighter[low]] += 1
            votes[table.dimmer[low]] += 1
            low += 1
    stars = np.empty(_STARS_TRIED, np.int64)
    count, fewest = 0, _FEWEST_VOTES
    for star in range(len(votes)):
        if votes[star] < fewest:
            continue
        place = min(count, _STARS_TRIED - 1)
        while place > 0 and votes[stars[place - 1]] < votes[star]:
            stars[place] = stars[place - 1]
            place -= 1
        stars[place] = star
        count = min(count + 1, _STARS_TRIED)
        if count == _STARS_TRIED:
            fewest = votes[stars[count - 1]] + 1
    return stars[:count]


@compiled_part
def _first_above(distances_urad: NDArray[np.int32], distance_urad: float) -> int:
    """The first place of a greater distance: numpy's search would bring scipy's linear algebra along."""
    low, high = 0, len(distances_urad)
    while low < high:
        middle = (low + high) // 2
        if distances_urad[middle] <= distance_urad:
            low = middle + 1
        else:
            high = middle
    return low
