"""Compiled search of the neighbour technique, over the table of pairs.

Levels 1 and 2 of the LAPAN paper, section 2, eqs 2-5 and 2-6, for one alpha star after the other.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gse.identifier.consistency import (
    MOST_CANDIDATES,
    Candidates,
    agreements,
    bits,
    largest_group,
    pigeonhole_bound,
    room_for_candidates,
    separations,
    windows,
)
from gse.identifier.neighbour_level_1 import level_1, seen_from
from gse.identifier.neighbour_votes import most_voted
from gse.identifier.tables import PairTable
from gse.jit import compiled

_MOST_WORK = 100_000_000
"""Comparisons after which a search gives up, in less than a second: 30 random objects over 4200 stars take 24 million.

Only tolerances of many pixels, or catalogues far denser than the field needs, come here.
"""


EVERYWHERE = -2.0
"""A cosine of no angle: all objects count as central."""


class Limits(NamedTuple):
    """The options of a search; a tuple, because compiled functions take tuples whole."""

    tolerance_urad: float
    min_fit: int
    min_fit_2: int
    alphas: int
    all_stars: bool
    central_cosine: float


@compiled
def first_fit(
    directions: NDArray[np.float64],
    icrs: NDArray[np.float64],
    table: PairTable,
    limits: Limits,
) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """Objects and their stars (M,), the alpha star first, and how many alpha stars were tried; M is 0 for no answer.

    With ``all_stars`` the search goes on to the end of the catalogue: the
    star with the greatest Fn2 is the answer, and where two have it there is none; the number of alpha stars is then
    negative.
    """
    angles = separations(directions)
    gates = windows(angles, limits.tolerance_urad)
    room = room_for_candidates()
    tried = min(limits.alphas, len(directions))
    order = _alpha_order(directions, limits.central_cosine)
    work = 0
    for rank in range(tried):
        alpha = order[rank]
        seen = seen_from(alpha, angles.cosine, angles.sine, limits.tolerance_urad)
        objects, stars = np.empty(0, np.int64), np.empty(0, np.int64)
        fewest, tie = limits.min_fit_2, False
        for star in range(len(icrs)):
            work += table.first[star + 1] - table.first[star]
            fit, count = level_1(star, seen, table, limits.tolerance_urad, limits.min_fit, room)
            if fit < max(limits.min_fit, fewest) or pigeonhole_bound(room, count, icrs, gates, fewest):
                continue
            work += count * count
            if work > _MOST_WORK:
                return np.empty(0, np.int64), np.empty(0, np.int64), rank + 1
            group = largest_group(agreements(room, count, icrs, angles, gates, limits.tolerance_urad), fewest)
            if group == 0:
                continue
            tie = len(objects) > 0 and bits(group) + 1 == len(objects)
            if not tie:
                objects, stars = _named(alpha, star, room, group)
            fewest = len(objects) - 1
            if not limits.all_stars:
                break
        if tie:
            return np.empty(0, np.int64), np.empty(0, np.int64), -(rank + 1)
        if len(objects) > 0:
            return objects, stars, rank + 1
    return np.empty(0, np.int64), np.empty(0, np.int64), tried


@compiled
def best_vote(
    directions: NDArray[np.float64],
    icrs: NDArray[np.float64],
    table: PairTable,
    limits: Limits,
) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """As ``first_fit``, but first among the stars with most votes, and of these the one with the greatest Fn2."""
    angles = separations(directions)
    gates = windows(angles, limits.tolerance_urad)
    room = room_for_candidates()
    tried = min(limits.alphas, len(directions))
    order = _alpha_order(directions, limits.central_cosine)
    for rank in range(tried):
        alpha = order[rank]
        seen = seen_from(alpha, angles.cosine, angles.sine, limits.tolerance_urad)
        objects, stars = np.empty(0, np.int64), np.empty(0, np.int64)
        for star in most_voted(seen, table, limits.tolerance_urad):
            fit, count = level_1(star, seen, table, limits.tolerance_urad, limits.min_fit, room)
            better = max(limits.min_fit_2, len(objects))
            if fit < max(limits.min_fit, better) or pigeonhole_bound(room, count, icrs, gates, better):
                continue
            group = largest_group(agreements(room, count, icrs, angles, gates, limits.tolerance_urad), better)
            if group != 0:
                objects, stars = _named(alpha, star, room, group)
        if len(objects) > 0:
            return objects, stars, rank + 1
    return first_fit(directions, icrs, table, limits)


@compiled
def _alpha_order(directions: NDArray[np.float64], central_cosine: float) -> NDArray[np.int64]:
    """Objects (N,) in the order in which they may be the alpha star: brightest first, the central ones before all."""
    order = np.empty(len(directions), np.int64)
    count = 0
    for is_central in (True, False):
        for i in range(len(directions)):
            if (directions[i, 2] >= central_cosine) == is_central:
                order[count] = i
                count += 1
    return order


@compiled
def _named(alpha: int, star: int, room: Candidates, group: np.uint64) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The objects and stars of a group, after the alpha star and its own."""
    objects, stars = np.full(MOST_CANDIDATES + 1, alpha), np.full(MOST_CANDIDATES + 1, star)
    size = 1
    for i in range(MOST_CANDIDATES):
        if group >> np.uint64(i) & np.uint64(1):
            objects[size], stars[size] = room.object[i], room.star[i]
            size += 1
    return objects[:size], stars[:size]
