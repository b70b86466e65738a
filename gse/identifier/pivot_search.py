"""The compiled search of the pivot algorithm, over angles between objects, the table of pairs, and cells."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gse.identifier.consistency import angle_urad, stars_fit
from gse.identifier.tables import PairTable
from gse.process.jit import compiled, compiled_part

PIVOT_MEMBERS = 4
"""K of the pivot paper, the pivot and its members: four, or five."""

_MORE_THAN_PAIRS = 8
"""More than the mutual distances that members of five can have in order: more distances that fit always count more."""

FEWEST_OBJECTS = 3
NO_GATE = math.inf
FOUND, NO_GROUP, TIE = 0, 1, 2

_MOST_GROUPS = 200_000
"""Cap for one pivot, where the tolerance lets everything fit: such a search is a tie."""


class PivotSky(NamedTuple):
    """The sky, as the search reads it.

    ``cell`` (S,) is the cell of each star, ``around`` (C, C) is True for cells that touch.
    """

    table: PairTable
    icrs: NDArray[np.float64]
    magnitude: NDArray[np.float64]
    cell: NDArray[np.int64]
    around: NDArray[np.bool_]


class Gates(NamedTuple):
    """How far objects may be from stars: in distance, and in magnitude after a zero point (NaN: that of the group)."""

    tolerance_urad: float
    magnitude: float
    zero_point: float
    members: int = PIVOT_MEMBERS


class PivotObjects(NamedTuple):
    """The objects, brightest first: cosine and sine (N, N) of their angles, and -2.5 log10 of their index (N,)."""

    cosine: NDArray[np.float64]
    sine: NDArray[np.float64]
    magnitude: NDArray[np.float64]


class Group(NamedTuple):
    """Objects, the pivot first, and the stars that they are thought to be."""

    object: NDArray[np.int64]
    star: NDArray[np.int64]


@compiled
def search(
    objects: PivotObjects, sky: PivotSky, gates: Gates, cells: NDArray[np.bool_]
) -> tuple[int, NDArray[np.int64], NDArray[np.int64]]:
    """Both steps: FOUND, NO_GROUP or TIE, and the named objects with their stars, the pivot first.

    The pivot is a star of the ``cells`` (C,) that are True: all of them, or those where the sky was before.
    """
    count = len(objects.magnitude)
    outcome = NO_GROUP
    # The pivot is the brightest object. Where it has no group it may be no star: the next brightest is pivot then, and
    # those before it are left out of the pattern.
    for pivot in range(count - FEWEST_OBJECTS + 1):
        members = np.arange(pivot, min(pivot + gates.members, count))
        group = Group(members, np.full(len(members), -1))
        found = _best_group(group, objects, sky, gates, cells)
        if found == FOUND:
            named = _with_others(group, objects, sky, gates)
            return FOUND, named.object, named.star
        if found == TIE:
            outcome = TIE
    return outcome, np.empty(0, np.int64), np.empty(0, np.int64)


@compiled_part
def _best_group(best: Group, objects: PivotObjects, sky: PivotSky, gates: Gates, cells: NDArray[np.bool_]) -> int:
    """Step 1 for one pivot: put the stars of the best group into ``best``."""
    table, size = sky.table, len(best.object)
    group = Group(best.object, best.star.copy())
    best_score, tie, groups = -1, False, 0
    # The pattern of four: distances from the pivot (0) to its members, each found by bisection in a sorted list.
    #
    #          2                the pair 0-1 comes from the table of all pairs,
    #         /                 2 and 3 from the neighbours of star 0;
    #     0 --- 1               the three distances between 1, 2 and 3 then
    #         \                 say how well the group concurs
    #          3
    low, high = _window(table.distance_urad, group, 1, objects, gates)
    for pair in range(low, high):
        if not cells[sky.cell[table.brighter[pair]]]:
            continue
        group.star[0], group.star[1] = table.brighter[pair], table.dimmer[pair]
        begin, end = table.first[group.star[0]], table.first[group.star[0] + 1]
        distances = table.neighbour_urad[begin:end]
        low_2, high_2 = _window(distances, group, 2, objects, gates)
        low_3, high_3 = (0, 1) if size < 4 else _window(distances, group, 3, objects, gates)
        low_4, high_4 = (0, 1) if size < 5 else _window(distances, group, 4, objects, gates)
        groups += (high_2 - low_2) * (high_3 - low_3) * (high_4 - low_4)
        if groups > _MOST_GROUPS:
            return TIE
        for second in range(low_2, high_2):
            group.star[2] = table.neighbour[begin + second]
            for third in range(low_3, high_3):
                if size > 3:
                    group.star[3] = table.neighbour[begin + third]
                for fourth in range(low_4, high_4):
                    if size > 4:
                        group.star[4] = table.neighbour[begin + fourth]
                    score = _concurrence(group, objects, sky, gates)
                    if score > best_score:
                        best_score, tie = score, False
                        best.star[:] = group.star
                    elif score == best_score and group.star[0] != best.star[0]:
                        tie = True
    if best_score < 0:
        return NO_GROUP
    return TIE if tie else FOUND


@compiled_part
def _window(
    distances_urad: NDArray[np.int32], group: Group, member: int, objects: PivotObjects, gates: Gates
) -> tuple[int, int]:
    """Where, among sorted distances, those lie that fit a member's distance from the pivot."""
    p, q = group.object[0], group.object[member]
    distance = angle_urad(objects.cosine[p, q], objects.sine[p, q])
    low = np.searchsorted(distances_urad, distance - gates.tolerance_urad, side="right")
    high = np.searchsorted(distances_urad, distance + gates.tolerance_urad, side="left")
    return int(low), int(high)


@compiled_part
def _concurrence(group: Group, objects: PivotObjects, sky: PivotSky, gates: Gates) -> int:
    """How well a group concurs; -1 where its pivot is not the brightest star, or too few mutual distances fit."""
    # Stars are numbered brightest first, so "brighter" is "has the lower number". The paper uses no magnitudes here,
    # only their order: the pivot must be the brightest, and members in the order of the objects count as a second
    # merit.
    fits = ordered = 0
    for i in range(1, len(group.star)):
        if group.star[i] <= group.star[0]:
            return -1
        for j in range(1, i):
            if group.star[i] == group.star[j]:
                return -1
            if _pair_fits(group, i, j, objects, sky, gates):
                fits += 1
                ordered += group.star[j] < group.star[i]
    if fits < len(group.star) - 2 or not _magnitudes_fit(group, objects, sky, gates):
        return -1
    return _MORE_THAN_PAIRS * fits + ordered


@compiled_part
def _pair_fits(group: Group, i: int, j: int, objects: PivotObjects, sky: PivotSky, gates: Gates) -> bool:
    """Whether the stars of members i and j are as far apart as their objects."""
    p, q = group.object[i], group.object[j]
    cosine, sine = objects.cosine[p, q], objects.sine[p, q]
    return stars_fit(sky.icrs, group.star[i], group.star[j], cosine, sine, gates.tolerance_urad)


@compiled_part
def _magnitudes_fit(group: Group, objects: PivotObjects, sky: PivotSky, gates: Gates) -> bool:
    zero_point = _zero_point(group, objects, sky, gates)
    for i in range(len(group.star)):
        if not _magnitude_fits(group.object[i], group.star[i], objects, sky, gates, zero_point):
            return False
    return True


@compiled_part
def _magnitude_fits(p: int, a: int, objects: PivotObjects, sky: PivotSky, gates: Gates, zero_point: float) -> bool:
    return bool(abs(objects.magnitude[p] + zero_point - sky.magnitude[a]) <= gates.magnitude)


@compiled_part
def _zero_point(group: Group, objects: PivotObjects, sky: PivotSky, gates: Gates) -> float:
    """What makes magnitudes of -2.5 log10 index: the given number, else the one that suits the group best."""
    if not np.isnan(gates.zero_point):
        return gates.zero_point
    total = 0.0
    for i in range(len(group.star)):
        total += sky.magnitude[group.star[i]] - objects.magnitude[group.object[i]]
    return total / len(group.star)


@compiled_part
def _with_others(group: Group, objects: PivotObjects, sky: PivotSky, gates: Gates) -> Group:
    """Step 2: the group, and after it the other objects, brightest first, that one star in the cells around fits."""
    # Step 2 looks in the cells around the group only: a star elsewhere cannot be in the same image.
    cells = np.zeros(len(sky.around), np.bool_)
    for star in group.star:
        cells |= sky.around[sky.cell[star]]
    zero_point = _zero_point(group, objects, sky, gates)
    count, named = len(objects.magnitude), len(group.object)
    rows, stars = np.empty(count, np.int64), np.empty(count, np.int64)
    rows[:named], stars[:named] = group.object, group.star
    for other in range(count):
        if group.object[0] <= other <= group.object[-1]:
            continue
        star = _only_star(other, group, cells, objects, sky, gates)
        if star < 0 or (stars[:named] == star).any():
            continue
        if _magnitude_fits(other, star, objects, sky, gates, zero_point):
            rows[named], stars[named] = other, star
            named += 1
    return Group(rows[:named], stars[:named])


@compiled_part
def _only_star(
    other: int, group: Group, cells: NDArray[np.bool_], objects: PivotObjects, sky: PivotSky, gates: Gates
) -> int:
    """The one star in ``cells`` at an object's distances from the first three of a group; -1 for none or several."""
    table = sky.table
    begin, end = table.first[group.star[0]], table.first[group.star[0] + 1]
    trial = Group(np.empty(FEWEST_OBJECTS + 1, np.int64), np.empty(FEWEST_OBJECTS + 1, np.int64))
    trial.object[:-1], trial.star[:-1] = group.object[:FEWEST_OBJECTS], group.star[:FEWEST_OBJECTS]
    trial.object[-1] = other
    low, high = _window(table.neighbour_urad[begin:end], trial, FEWEST_OBJECTS, objects, gates)
    found = -1
    for k in range(begin + low, begin + high):
        star = table.neighbour[k]
        if not cells[sky.cell[star]]:
            continue
        trial.star[-1] = star
        fits = True
        for i in range(1, FEWEST_OBJECTS):
            fits = fits and _pair_fits(trial, FEWEST_OBJECTS, i, objects, sky, gates)
        if fits:
            if found >= 0:
                return -1
            found = star
    return found
