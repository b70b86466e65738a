"""Compiled search of the neighbour technique, over the table of pairs.

Levels 1 and 2 of the LAPAN paper, section 2, eqs 2-5 and 2-6, for one alpha star after the other.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gse.identifier.acceptance import wahba_residual_rad
from gse.identifier.consistency import (
    MOST_CANDIDATES,
    Candidates,
    agreements,
    angle_urad,
    bits,
    largest_group,
    pigeonhole_bound,
    room_for_candidates,
    separations,
    windows,
)
from gse.identifier.input_checks import distinct_objects
from gse.identifier.tables import PairTable
from gse.jit import compiled

_VOTERS = 10
_BRIGHT_OBJECTS = 15
"""Only these vote: the fainter an object, the less likely it is in the catalogue."""

_STARS_TRIED = 12
_FEWEST_VOTES = 2
_BIN_BITS = np.uint64(7)
_BIN_URAD = 128
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


class Alpha(NamedTuple):
    """The other objects as seen from an alpha star: rows and distances in microradians, nearest first.

    Bit u of ``fits``, 64 to a word, tells whether a distance of u whole microradians fits any of them. A neighbour
    whose distance falls into bin b can only be one of the objects ``begin[b]`` to ``end[b]``.
    """

    others: NDArray[np.int64]
    distances: NDArray[np.float64]
    fits: NDArray[np.uint64]
    begin: NDArray[np.int8]
    end: NDArray[np.int8]


class Found(NamedTuple):
    """Answers to K panoramas: objects and stars (M,) of panorama k are ``ends[k]`` to before ``ends[k + 1]``.

    ``alphas`` (K,) is how many alpha stars were tried, ``rms_rad`` (K,) how far the stars are off their objects.
    """

    ends: NDArray[np.int64]
    objects: NDArray[np.int64]
    stars: NDArray[np.int64]
    alphas: NDArray[np.int64]
    rms_rad: NDArray[np.float64]


@compiled
def first_fit_many(
    directions: NDArray[np.float64],
    first: NDArray[np.int64],
    icrs: NDArray[np.float64],
    table: PairTable,
    limits: Limits,
) -> Found:
    """``first_fit`` for K panoramas: rows ``first[k]`` to before ``first[k + 1]``, each object taken once."""
    found = _room_for_answers(len(first) - 1, len(directions))
    for k in range(len(first) - 1):
        distinct, rows = _distinct(directions[first[k] : first[k + 1]])
        objects, stars, alphas = first_fit(rows, icrs, table, limits)
        _put(found, k, objects, stars, alphas, distinct, rows, icrs)
    return found


@compiled
def best_vote_many(
    directions: NDArray[np.float64],
    first: NDArray[np.int64],
    icrs: NDArray[np.float64],
    table: PairTable,
    limits: Limits,
) -> Found:
    """As ``first_fit_many``, by ``best_vote``."""
    found = _room_for_answers(len(first) - 1, len(directions))
    for k in range(len(first) - 1):
        distinct, rows = _distinct(directions[first[k] : first[k + 1]])
        objects, stars, alphas = best_vote(rows, icrs, table, limits)
        _put(found, k, objects, stars, alphas, distinct, rows, icrs)
    return found


@compiled
def _room_for_answers(panoramas: int, objects: int) -> Found:
    return Found(
        np.zeros(panoramas + 1, np.int64),
        np.empty(objects, np.int64),
        np.empty(objects, np.int64),
        np.empty(panoramas, np.int64),
        np.zeros(panoramas),
    )


@compiled
def _distinct(directions: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Rows of the objects that are no second listing of another one, and their directions."""
    distinct = distinct_objects(directions)
    rows = np.empty((len(distinct), 3))
    for i in range(len(distinct)):
        for axis in range(3):
            rows[i, axis] = directions[distinct[i], axis]
    return distinct, rows


@compiled
def _put(
    found: Found,
    k: int,
    objects: NDArray[np.int64],
    stars: NDArray[np.int64],
    alphas: int,
    distinct: NDArray[np.int64],
    rows: NDArray[np.float64],
    icrs: NDArray[np.float64],
) -> None:
    """Put the answer to panorama k into its place."""
    begin = found.ends[k]
    measured, placed = np.empty((len(objects), 3)), np.empty((len(objects), 3))
    for i in range(len(objects)):
        found.objects[begin + i], found.stars[begin + i] = distinct[objects[i]], stars[i]
        for axis in range(3):
            measured[i, axis], placed[i, axis] = rows[objects[i], axis], icrs[stars[i], axis]
    found.ends[k + 1] = begin + len(objects)
    found.alphas[k] = alphas
    if len(objects) > 0:
        found.rms_rad[k] = wahba_residual_rad(measured, placed)


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
        seen = _seen_from(alpha, angles.cosine, angles.sine, limits.tolerance_urad)
        objects, stars = np.empty(0, np.int64), np.empty(0, np.int64)
        fewest, tie = limits.min_fit_2, False
        for star in range(len(icrs)):
            work += table.first[star + 1] - table.first[star]
            fit, count = _level_1(star, seen, table, limits, room)
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
        seen = _seen_from(alpha, angles.cosine, angles.sine, limits.tolerance_urad)
        objects, stars = np.empty(0, np.int64), np.empty(0, np.int64)
        for star in _most_voted(seen, table, limits.tolerance_urad):
            fit, count = _level_1(star, seen, table, limits, room)
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
def _seen_from(alpha: int, cosine: NDArray[np.float64], sine: NDArray[np.float64], tolerance_urad: float) -> Alpha:
    """The panorama as seen from an alpha star."""
    distances = np.empty(len(cosine) - 1)
    others = np.empty(len(cosine) - 1, np.int64)
    for i in range(len(distances)):
        other = i if i < alpha else i + 1
        distance = angle_urad(cosine[alpha, other], sine[alpha, other])
        place = i
        while place > 0 and distances[place - 1] > distance:
            distances[place], others[place] = distances[place - 1], others[place - 1]
            place -= 1
        distances[place], others[place] = distance, other
    return _looked_up(others, distances, tolerance_urad)


@compiled
def _looked_up(others: NDArray[np.int64], distances: NDArray[np.float64], tolerance_urad: float) -> Alpha:
    last = 0 if len(distances) == 0 else int(distances[-1] + tolerance_urad) + 1
    fits = np.zeros(last // 64 + 1, np.uint64)
    begin, end = np.zeros(last // _BIN_URAD + 1, np.int8), np.zeros(last // _BIN_URAD + 1, np.int8)
    for i in range(len(distances)):
        low, high = max(int(distances[i] - tolerance_urad), 0), int(distances[i] + tolerance_urad) + 1
        while low < high and not abs(low - distances[i]) < tolerance_urad:
            low += 1
        while low < high and not abs(high - 1 - distances[i]) < tolerance_urad:
            high -= 1
        _set_bits(fits, low, high)
        for place in range(low // _BIN_URAD, (high - 1) // _BIN_URAD + 1):
            if end[place] == 0:
                begin[place] = i
            end[place] = i + 1
    return Alpha(others, distances, fits, begin, end)


@compiled
def _set_bits(words: NDArray[np.uint64], low: int, high: int) -> None:
    """Set the bits from ``low`` up to, not including, ``high``."""
    while low < high:
        beyond = min(high, (low | 63) + 1)
        words[low >> 6] |= (~np.uint64(0) >> np.uint64(64 - (beyond - low))) << np.uint64(low & 63)
        low = beyond


@compiled
def _level_1(star: int, alpha: Alpha, table: PairTable, limits: Limits, room: Candidates) -> tuple[int, int]:
    """Fn of a catalogue star, and how many candidates (object, neighbour) were put into ``room``, nearest first.

    There are none where Fn is too small. No branch depends on a fit: most stars are there by chance, and no processor
    foresees which of their neighbours fit.
    """
    words = np.uint64(len(alpha.fits))
    fit = np.int64(0)
    for k in range(np.uint64(table.first[star]), np.uint64(table.first[star + 1])):
        urad = np.uint64(table.neighbour_urad[k])
        word = urad >> np.uint64(6)
        if word >= words:
            break
        room.hit[np.uint64(min(fit, np.int64(MOST_CANDIDATES)))] = k
        fit += np.int64((alpha.fits[word] >> (urad & np.uint64(63))) & np.uint64(1))
    if fit < limits.min_fit:
        return int(fit), 0
    count = 0
    for hit in range(min(int(fit), MOST_CANDIDATES)):
        k = room.hit[hit]
        urad = np.uint64(table.neighbour_urad[k])
        place = urad >> _BIN_BITS
        for i in range(alpha.begin[place], alpha.end[place]):
            if abs(np.int64(urad) - alpha.distances[i]) < limits.tolerance_urad and count < MOST_CANDIDATES:
                room.object[count], room.star[count] = alpha.others[i], table.neighbour[k]
                count += 1
    return int(fit), count


@compiled
def _most_voted(alpha: Alpha, table: PairTable, tolerance_urad: float) -> NDArray[np.int64]:
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


@compiled
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
