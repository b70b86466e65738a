"""Compiled search of the neighbour technique, over the table of pairs.

Levels 1 and 2 of the LAPAN paper, section 2, eqs 2-5 and 2-6, for one alpha star after the other.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gse.identifier.consistency import (
    MOST_CANDIDATES,
    Candidates,
    Separations,
    agreements,
    bits,
    largest_group,
    pigeonhole_bound,
    room_for_candidates,
    separations,
    windows,
)
from gse.identifier.neighbour_level_1 import (
    BLOCK,
    Alpha,
    Blocks,
    Fits,
    put_fits,
    put_fits_of_star,
    room_for_fits,
    seen_from,
)
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


class View(NamedTuple):
    """A panorama against the catalogue: its angles and their windows, and the room for what fits and for candidates."""

    icrs: NDArray[np.float64]
    table: PairTable
    angles: Separations
    gates: NDArray[np.float64]
    fits: Fits
    room: Candidates


@compiled
def view_of(directions: NDArray[np.float64], icrs: NDArray[np.float64], table: PairTable, limits: Limits) -> View:
    """The view of a panorama, its objects given as directions (N, 3)."""
    angles = separations(directions)
    gates = windows(angles, limits.tolerance_urad)
    return View(icrs, table, angles, gates, room_for_fits(), room_for_candidates())


@compiled
def first_fit(
    directions: NDArray[np.float64],
    icrs: NDArray[np.float64],
    table: PairTable,
    blocks: Blocks,
    limits: Limits,
) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """Objects and their stars (M,), the alpha star first, and how many alpha stars were tried; M is 0 for no answer.

    With ``all_stars`` the search goes on to the end of the catalogue: the star with the greatest Fn2 is the answer, and
    where two have it there is none; the number of alpha stars is then negative.
    """
    view = view_of(directions, icrs, table, limits)
    tried = min(limits.alphas, len(directions))
    order = _alpha_order(directions, limits.central_cosine)
    work = 0
    for rank in range(tried):
        alpha = order[rank]
        seen = seen_from(alpha, view.angles.cosine, view.angles.sine, limits.tolerance_urad)
        objects, stars = np.empty(0, np.int64), np.empty(0, np.int64)
        fewest, tie = limits.min_fit_2, False
        star = -1
        while True:
            after = star + 1
            star, count = _next_possible(after, max(limits.min_fit, fewest), fewest, seen, blocks, view)
            if star == len(icrs):
                work += table.first[star] - table.first[after]
                break
            work += table.first[star + 1] - table.first[after] + count * count
            if work > _MOST_WORK:
                return np.empty(0, np.int64), np.empty(0, np.int64), rank + 1
            group = _group(view, count, fewest, limits)
            if group == 0:
                continue
            tie = len(objects) > 0 and bits(group) + 1 == len(objects)
            if not tie:
                objects, stars = _named(alpha, star, view.room, group)
            fewest = len(objects) - 1
            if not limits.all_stars:
                break
        if tie:
            return np.empty(0, np.int64), np.empty(0, np.int64), -(rank + 1)
        if len(objects) > 0:
            return objects, stars, rank + 1
    return np.empty(0, np.int64), np.empty(0, np.int64), tried


@compiled
def _next_possible(
    star: int, fewest_fits: int, fewest: int, seen: Alpha, blocks: Blocks, view: View
) -> tuple[int, int]:
    """The first star from ``star`` on that can have a group, and how many candidates it has; past the last for none."""
    stars = len(view.icrs)
    while star < stars:
        block = star // BLOCK
        if star % BLOCK == 0:
            put_fits(block, seen, blocks, view.fits)
        end = min(BLOCK, stars - block * BLOCK)
        member, count = first_possible(star % BLOCK, end, fewest_fits, fewest, seen, view)
        star = block * BLOCK + member
        if member < end:
            return star, count
    return stars, 0


@compiled
def first_possible(member: int, end: int, fewest_fits: int, fewest: int, seen: Alpha, view: View) -> tuple[int, int]:
    """The first of a block's stars from ``member`` to before ``end`` that can have a group; ``end`` for none.

    Its candidates (object, neighbour), nearest first, are put into the room of the view. Arrays have names of their own
    here, since each access through a tuple counts references.
    """
    counts, rows, stretches, neighbour = view.fits.number, view.fits.row, view.fits.stretch, view.table.neighbour
    begins, ends, others, objects, stars = seen.begin, seen.end, seen.others, view.room.object, view.room.star
    icrs, gates = view.icrs, view.gates
    for k in range(np.uint64(member), np.uint64(end)):
        if counts[k] < fewest_fits:
            continue
        count = 0
        for place in range(np.uint64(min(counts[k], MOST_CANDIDATES))):
            stretch, star = stretches[k, place], neighbour[rows[k, place]]
            for i in range(begins[stretch], min(ends[stretch], begins[stretch] + MOST_CANDIDATES - count)):
                objects[count], stars[count] = others[i], star
                count += 1
        if not pigeonhole_bound(objects, stars, count, icrs, gates, fewest):
            return int(np.int64(k)), count
    return end, 0


@compiled
def _group(view: View, count: int, fewest: int, limits: Limits) -> np.uint64:
    """Level 2: the largest group of the candidates in the room, 0 where it has fewer than ``fewest``."""
    agrees = agreements(view.room, count, view.icrs, view.angles, view.gates, limits.tolerance_urad)
    return largest_group(agrees, fewest)


@compiled
def best_vote(
    directions: NDArray[np.float64],
    icrs: NDArray[np.float64],
    table: PairTable,
    blocks: Blocks,
    limits: Limits,
) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """As ``first_fit``, but first among the stars with most votes, and of these the one with the greatest Fn2."""
    view = view_of(directions, icrs, table, limits)
    tried = min(limits.alphas, len(directions))
    order = _alpha_order(directions, limits.central_cosine)
    for rank in range(tried):
        alpha = order[rank]
        seen = seen_from(alpha, view.angles.cosine, view.angles.sine, limits.tolerance_urad)
        objects, stars = np.empty(0, np.int64), np.empty(0, np.int64)
        for star in most_voted(seen, table, limits.tolerance_urad):
            put_fits_of_star(star, seen, table, view.fits)
            better = max(limits.min_fit_2, len(objects))
            member, count = first_possible(0, 1, max(limits.min_fit, better), better, seen, view)
            group = _group(view, count, better, limits) if member == 0 else np.uint64(0)
            if group != 0:
                objects, stars = _named(alpha, star, view.room, group)
        if len(objects) > 0:
            return objects, stars, rank + 1
    return first_fit(directions, icrs, table, blocks, limits)


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
