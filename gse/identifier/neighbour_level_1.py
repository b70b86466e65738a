"""Compiled level 1 of the neighbour technique: how many neighbours of a catalogue star fit those of the alpha star.

The LAPAN paper, section 2, eq 2-5. Most stars of the catalogue have a fit or none by chance, so stars that follow each
other are looked at together: their neighbours stand nearest first in one list, of which only those are read that fit.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gse.identifier.consistency import MOST_CANDIDATES, Separations, angle_urad, candidate_of
from gse.identifier.tables import PairTable
from gse.process.jit import compiled, compiled_part

BLOCK = 256
"""Stars looked at together: half a block is looked at in vain, and each block costs a search for each distance."""
_BIN_BITS = 8
_ONE = np.uint64(1)


class Blocks(NamedTuple):
    """The neighbours of BLOCK stars together, nearest first, for each block of the catalogue.

    Entry e says that star ``neighbour[e]`` is ``urad[e]`` microradians away from star ``member[e]`` of its block.
    Those of block b that are at least 256 n microradians away begin at ``begin[b, n]``.
    """

    begin: NDArray[np.uint64]
    urad: NDArray[np.int32]
    neighbour: NDArray[np.uint32]
    member: NDArray[np.uint8]


@compiled
def blocks_of(table: PairTable) -> Blocks:
    """The blocks of a table, whose pairs are in the order of their distance."""
    stars, size = len(table.first) - 1, len(table.neighbour)
    bins = 2 if len(table.distance_urad) == 0 else (table.distance_urad[-1] >> _BIN_BITS) + 2
    begin = np.zeros((-(-stars // BLOCK), bins), np.uint64)
    urad, neighbour, member = np.empty(size, np.int32), np.empty(size, np.uint32), np.empty(size, np.uint8)
    entry_of = table.first[:-1:BLOCK].copy()
    # The pairs come nearest first, so each block's list is filled in the order of distance: a counting sort by block,
    # with no sort at all. ``begin`` first counts the entries of each bin of 256 microradians, then adds them up.
    for p in range(len(table.distance_urad)):
        for star, other in ((table.brighter[p], table.dimmer[p]), (table.dimmer[p], table.brighter[p])):
            block = star // BLOCK
            entry = entry_of[block]
            urad[entry], neighbour[entry], member[entry] = table.distance_urad[p], other, star % BLOCK
            begin[block, (table.distance_urad[p] >> _BIN_BITS) + 1] += _ONE
            entry_of[block] += 1
    for block in range(len(begin)):
        begin[block, 0] = table.first[block * BLOCK]
        for place in range(1, bins):
            begin[block, place] += begin[block, place - 1]
    return Blocks(begin, urad, neighbour, member)


class Alpha(NamedTuple):
    """The other objects as seen from an alpha star: rows and distances in microradians, nearest first.

    A distance of ``low[s]`` to before ``high[s]`` whole microradians fits the objects ``begin[s]`` to before ``end[s]``
    and no other; a distance between two such stretches fits none.
    """

    others: NDArray[np.int64]
    distances: NDArray[np.float64]
    low: NDArray[np.int64]
    high: NDArray[np.int64]
    begin: NDArray[np.int64]
    end: NDArray[np.int64]


@compiled
def seen_from(alpha: int, angles: Separations, tolerance_urad: float, among: NDArray[np.bool_]) -> Alpha:
    """The panorama as seen from an alpha star: those of the other objects that are ``among`` (N,)."""
    distances, others = np.empty(len(among)), np.empty(len(among), np.int64)
    count = 0
    for other in range(len(among)):
        if other == alpha or not among[other]:
            continue
        distance = angle_urad(angles.cosine[alpha, other], angles.sine[alpha, other])
        place = count
        while place > 0 and distances[place - 1] > distance:
            distances[place], others[place] = distances[place - 1], others[place - 1]
            place -= 1
        distances[place], others[place] = distance, other
        count += 1
    return _stretches(others[:count], distances[:count], tolerance_urad)


@compiled_part
def _stretches(others: NDArray[np.int64], distances: NDArray[np.float64], tolerance_urad: float) -> Alpha:
    # Objects at nearly the same distance have tolerances that overlap:
    #
    #     object 0   |--------|
    #     object 1        |--------|
    #     stretches  |-0--|0,1|-1--|     a distance in the middle fits both objects
    #
    # A sweep from the least distance up cuts where a tolerance begins (``last`` goes on) or ends (``first`` goes on).
    fitting = [_fitting(distance, tolerance_urad) for distance in distances]
    low, high, begin, end = np.empty((4, 2 * len(fitting)), np.int64)
    count = first = last = at = 0
    while first < len(fitting):
        if first == last:
            at = max(at, fitting[first][0])
        while last < len(fitting) and fitting[last][0] <= at:
            last += 1
        until = fitting[first][1]
        if last < len(fitting):
            until = min(until, fitting[last][0])
        low[count], high[count], begin[count], end[count] = at, until, first, last
        count, at = count + 1, until
        while first < last and fitting[first][1] <= at:
            first += 1
    return Alpha(others, distances, low[:count], high[:count], begin[:count], end[:count])


@compiled_part
def _fitting(distance_urad: float, tolerance_urad: float) -> tuple[int, int]:
    """The first whole distance that fits, and the first that no longer does."""
    low, high = max(int(distance_urad - tolerance_urad), 0), int(distance_urad + tolerance_urad) + 1
    while low < high and not abs(low - distance_urad) < tolerance_urad:
        low += 1
    while low < high and not abs(high - 1 - distance_urad) < tolerance_urad:
        high -= 1
    return low, high


class Fits(NamedTuple):
    """What fits each star of a block.

    ``number`` (BLOCK,) candidates do, ``again`` (BLOCK,) of them with a neighbour that fits another object before: the
    difference is Fn. The first, nearest first, are in the rows of ``candidate``. ``crowded`` (1,) says whether a star
    with enough of them had more than there is room for.
    """

    number: NDArray[np.int64]
    again: NDArray[np.int64]
    candidate: NDArray[np.uint32]
    crowded: NDArray[np.bool_]


@compiled_part
def room_for_fits(stars: int) -> Fits:
    """Room for the fits of so many stars, made once for all blocks."""
    candidate = np.empty((stars, MOST_CANDIDATES + 1), np.uint32)  # those beyond overwrite the last
    return Fits(np.empty(stars, np.int64), np.empty(stars, np.int64), candidate, np.zeros(1, np.bool_))


@compiled
def put_fits(block: int, alpha: Alpha, blocks: Blocks, fits: Fits) -> None:
    """Level 1 of all stars of a block."""
    fits.number[:] = 0
    fits.again[:] = 0
    begin, urad, neighbour_of, member_of = blocks.begin[block], blocks.urad, blocks.neighbour, blocks.member
    counts, candidates = fits.number, fits.candidate
    last = begin[-1]
    for stretch in range(len(alpha.low)):
        low, high = alpha.low[stretch], alpha.high[stretch]
        if low >> _BIN_BITS >= len(begin):
            break
        # The bin brings within 256 microradians of the first entry that fits; a few steps do the rest.
        entry = begin[low >> _BIN_BITS]
        while entry < last and urad[entry] < low:
            entry += _ONE
        one, others = candidate_of(alpha.others[alpha.begin[stretch]], 0), alpha.end[stretch] - alpha.begin[stretch] - 1
        while entry < last and urad[entry] < high:
            member, star = np.uint64(member_of[entry]), neighbour_of[entry]
            count = counts[member]
            # No branch on a star that has all its candidates already: what is too much overwrites the last place.
            candidates[member, np.uint64(min(count, MOST_CANDIDATES))] = one | star
            counts[member] = count + 1
            if others:
                _put_others(int(member), int(star), stretch, alpha, fits)
            entry += _ONE


@compiled_part
def _put_others(member: int, star: int, stretch: int, alpha: Alpha, fits: Fits) -> None:
    """The candidates of a neighbour that fits several objects, after the first."""
    for i in range(alpha.begin[stretch] + 1, alpha.end[stretch]):
        place = min(fits.number[member], MOST_CANDIDATES)
        fits.candidate[member, place] = candidate_of(alpha.others[i], star)
        fits.number[member] += 1
        fits.again[member] += 1


@compiled
def put_fits_of_star(star: int, alpha: Alpha, table: PairTable, fits: Fits) -> None:
    """Level 1 of one star, which takes the place of the first of a block."""
    fits.number[0] = fits.again[0] = 0
    # A merge of two sorted lists: the star's neighbours and the stretches, both nearest first.
    stretch = 0
    for row in range(table.first[star], table.first[star + 1]):
        urad = table.neighbour_urad[row]
        while stretch < len(alpha.high) and alpha.high[stretch] <= urad:
            stretch += 1
        if stretch == len(alpha.high):
            break
        if alpha.low[stretch] <= urad:
            place = min(fits.number[0], MOST_CANDIDATES)
            fits.candidate[0, place] = candidate_of(alpha.others[alpha.begin[stretch]], table.neighbour[row])
            fits.number[0] += 1
            _put_others(0, table.neighbour[row], stretch, alpha, fits)
