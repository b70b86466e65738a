"""Compiled search of the neighbour technique, over the table of pairs.

Levels 1 and 2 of the LAPAN paper, section 2, eqs 2-5 and 2-6, for one alpha star after the other. Level 1 counts how
many neighbours of a catalogue star fit those of the alpha star. Most stars of the catalogue have a fit or none by
chance, so stars that follow each other are looked at together: their neighbours stand nearest first in one list, of
which only those are read that fit.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gse.identifier.consistency import (
    MOST_CANDIDATES,
    Separations,
    agreements,
    angle_urad,
    bits,
    candidate_of,
    largest_group,
    no_group,
    object_of,
    pigeonhole_bound,
    separations,
    star_of,
    windows,
)
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


# Compiled vote for catalogue stars: one for each pair as far apart as the alpha star and a bright neighbour.

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


_MOST_WORK = 100_000_000
"""Comparisons after which a search gives up, in less than a second: 30 random objects over 4200 stars take 24 million.

Only tolerances of many pixels, or catalogues far denser than the field needs, come here.
"""


_FEWEST_CLOSED = 4
"""Fewer objects that are out of question save less than it costs to look at a star twice."""

EVERYWHERE = -2.0
"""A cosine of no angle: all objects count as central."""


class SearchOptions(NamedTuple):
    """The options of a search; a tuple, because compiled functions take tuples whole."""

    tolerance_urad: float
    min_fit: int
    min_fit_2: int
    alphas: int
    all_stars: bool
    central_cosine: float
    all_pairs: bool
    """Whether the table has each pair, for both of its stars: then a group is one for each of its members."""


class View(NamedTuple):
    """A panorama against the catalogue: its angles and their windows, and the room for what fits a block or a star."""

    icrs: NDArray[np.float64]
    table: PairTable
    angles: Separations
    gates: NDArray[np.float64]
    fits: Fits
    fits_of_star: Fits


@compiled
def view_of(
    directions: NDArray[np.float64], icrs: NDArray[np.float64], table: PairTable, limits: SearchOptions
) -> View:
    """The view of a panorama, its objects given as directions (N, 3)."""
    angles = separations(directions)
    gates = windows(angles, limits.tolerance_urad)
    return View(icrs, table, angles, gates, room_for_fits(BLOCK), room_for_fits(1))


@compiled
def first_fit(
    directions: NDArray[np.float64],
    icrs: NDArray[np.float64],
    table: PairTable,
    blocks: Blocks,
    limits: SearchOptions,
    hopeless: bool,
) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """Objects and their stars (M,), the alpha star first, and how many alpha stars were tried; M is 0 for no answer.

    With ``all_stars`` the search goes on to the end of the catalogue: the star with the greatest Fn2 is the answer, and
    where two have it there is none; the number of alpha stars is then negative. ``hopeless`` says only when to try to
    prove that there is no answer: at once, or after the first alpha star.
    """
    view = view_of(directions, icrs, table, limits)
    tried = min(limits.alphas, len(directions))
    order = _alpha_order(directions, limits.central_cosine)
    open_ = np.ones(len(directions), np.bool_)
    work = 0
    is_long = tried >= _ALPHAS_OF_A_PROOF
    if hopeless and is_long and _none_has_a_group(directions, view, limits):
        return np.empty(0, np.int64), np.empty(0, np.int64), tried
    # Figure 2-7: the first alpha star that has an answer gives it. One that has none may be a hot pixel, so the next is
    # tried; proven to be in no group, it is not looked at again as a neighbour of the others.
    for rank in range(tried):
        alpha = order[rank]
        objects, stars, tie, proven, more = _of_alpha(alpha, open_, blocks, view, limits, _MOST_WORK - work)
        work += more
        if work > _MOST_WORK:
            return np.empty(0, np.int64), np.empty(0, np.int64), rank + 1
        if tie:
            return np.empty(0, np.int64), np.empty(0, np.int64), -(rank + 1)
        if len(objects) > 0:
            return objects, stars, rank + 1
        open_[alpha] = not proven
        if rank == 0 and is_long and not hopeless and _none_has_a_group(directions, view, limits):
            break
    return np.empty(0, np.int64), np.empty(0, np.int64), tried


_ALPHAS_OF_A_PROOF = 10
"""For fewer alpha stars the search itself is as quick: the proof takes the time of four."""
_NO_ENTRY = -1
_MOST_ENTRIES = 100_000
"""Neighbours that fit objects of a sector, for one alpha star: 10,000 of the 13,000 stars for a field of 8 deg do."""
_MOST_PROOF_WORK = 2_000_000
"""Comparisons of stars after which the proof gives up: it takes a tenth of them for random objects."""


@compiled_part
def _none_has_a_group(directions: NDArray[np.float64], view: View, limits: SearchOptions) -> bool:
    """Whether it is proven that no object is the alpha star of a group: then a panorama is at its end, unsearched.

    A group has Fn2 + 1 members. The objects are dealt to half of Fn2 sectors about the boresight, so three members of
    any group are in one sector. So a star is looked at only if two of its neighbours fit objects of the alpha star's
    sector, and each other. That takes a fifth of the distances and leaves few stars, which levels 1 and 2 with all
    objects exclude. Where they do not, the search decides.
    """
    sectors, count = limits.min_fit_2 // 2, len(directions)
    if sectors < 2 or count < 2 or not limits.all_pairs:
        return False
    size = -(-count // sectors)
    order = _in_sectors(directions, size)
    everything, work = np.ones(count, np.bool_), 0
    latest = np.empty(len(view.icrs), np.int32)
    entries = np.empty((2, _MOST_ENTRIES), np.int32)
    for place in range(count):
        alpha = order[place]
        whole = seen_from(alpha, view.angles, limits.tolerance_urad, everything)
        if whole.distances[-1] + limits.tolerance_urad >= _longest_urad(view.table):
            return False
        others = order[place + 1 : min((place // size + 1) * size, count)]
        more = _excluded(alpha, others, whole, latest, entries, view, limits)
        work += more
        if more < 0 or work > _MOST_PROOF_WORK:
            return False
    return True


@compiled_part
def _excluded(
    alpha: int,
    others: NDArray[np.int64],
    whole: Alpha,
    latest: NDArray[np.int32],
    entries: NDArray[np.int32],
    view: View,
    limits: SearchOptions,
) -> int:
    """The work of proving that an alpha star is in no group with two of the others; negative where it is not proven.

    Entry e is the neighbour ``entries[0, e]`` of a star, with the place of the object that it fits; ``entries[1, e]``
    is the entry of the same star before it, and ``latest`` (stars,) the last.
    """
    if len(others) < 2:
        return 0
    # Arrays have names of their own here, since each access through a tuple counts references.
    gates, icrs, fitted_before, entry_before = view.gates, view.icrs, entries[0], entries[1]
    urad, brighter, dimmer = view.table.distance_urad, view.table.brighter, view.table.dimmer
    latest[:] = _NO_ENTRY
    number = work = 0
    for place in range(len(others)):
        other = others[place]
        distance = angle_urad(view.angles.cosine[alpha, other], view.angles.sine[alpha, other])
        begin = _first_above(urad, distance - limits.tolerance_urad)
        end = _first_above(urad, math.ceil(distance + limits.tolerance_urad) - 1)
        if number + 2 * (end - begin) > len(fitted_before):
            return -1
        pairs = np.empty(end - begin + 1, np.int64)
        for side in range(2):
            star_at, neighbour_at = (dimmer, brighter) if side else (brighter, dimmer)
            # Those whose star has an entry already, first: a branch on each would often be predicted wrong. Before the
            # first of the others there are no entries, and after the last none is looked up.
            again = 0
            for pair in range(np.uint64(begin), np.uint64(end if place > 0 else begin)):
                pairs[again] = pair
                again += latest[np.uint64(star_at[pair])] != _NO_ENTRY
            for pair in pairs[:again]:
                star, neighbour = np.uint64(star_at[pair]), np.uint64(neighbour_at[pair])
                before, agrees = latest[star], False
                while before != _NO_ENTRY:
                    fitted = fitted_before[np.uint64(before)]
                    a, row = star_of(fitted), others[object_of(fitted)]
                    dot = (
                        icrs[neighbour, 0] * icrs[a, 0]
                        + icrs[neighbour, 1] * icrs[a, 1]
                        + icrs[neighbour, 2] * icrs[a, 2]
                    )
                    # The same star for both objects is no agreement; two hot pixels side by side would fit it.
                    agrees |= (a != neighbour) & (gates[0, row, other] <= dot) & (dot <= gates[3, row, other])
                    before = entry_before[np.uint64(before)]
                    work += 1
                if agrees:
                    more = _excluded_star(int(star), whole, view, limits)
                    if more < 0:
                        return -1
                    work += more
            for pair in range(np.uint64(begin), np.uint64(end if place + 1 < len(others) else begin)):
                star = np.uint64(star_at[pair])
                fitted_before[number], entry_before[number] = candidate_of(place, neighbour_at[pair]), latest[star]
                latest[star] = number
                number += 1
    return work


@compiled_part
def _excluded_star(star: int, whole: Alpha, view: View, limits: SearchOptions) -> int:
    """The work of proving that a star has no group as alpha star; negative where it is not proven."""
    put_fits_of_star(star, whole, view.table, view.fits_of_star)
    fewest, count = limits.min_fit_2, view.fits_of_star.number[0]
    if count > MOST_CANDIDATES:
        return -1
    candidates = _candidates(0, view.fits_of_star)
    if not pigeonhole_bound(view.fits_of_star.candidate, np.uint64(0), count, view.icrs, view.gates, fewest):
        agrees = agreements(candidates, view.icrs, view.angles, view.gates, limits.tolerance_urad)
        if not no_group(agrees, fewest):
            return -1
    work: int = view.table.first[star + 1] - view.table.first[star] + count * count
    return work


@compiled_part
def _in_sectors(directions: NDArray[np.float64], size: int) -> NDArray[np.int64]:
    """The objects (N,), each ``size`` of one sector about the boresight together, those in its middle first.

    Near objects have few pairs of stars as far apart, and those in the middle are near to all others.
    """
    order, keys = np.arange(len(directions)), np.empty(len(directions))
    for i in range(len(directions)):
        keys[i] = math.atan2(directions[i, 1], directions[i, 0])
    _sort_by(keys, order, 0, len(order))
    for begin in range(0, len(order), size):
        end = min(begin + size, len(order))
        x = y = 0.0
        for i in order[begin:end]:
            x, y = x + directions[i, 0] / (end - begin), y + directions[i, 1] / (end - begin)
        for i in order[begin:end]:
            keys[i] = (directions[i, 0] - x) ** 2 + (directions[i, 1] - y) ** 2
        _sort_by(keys, order, begin, end)
    return order


@compiled_part
def _sort_by(keys: NDArray[np.float64], order: NDArray[np.int64], begin: int, end: int) -> None:
    """Sort a part of an order by the keys of what stands in it; numba's own sort takes seconds to compile."""
    for i in range(begin + 1, end):
        one, place = order[i], i
        while place > begin and keys[order[place - 1]] > keys[one]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = one


@compiled_part
def _of_alpha(
    alpha: int, open_: NDArray[np.bool_], blocks: Blocks, view: View, limits: SearchOptions, most_work: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], bool, bool, int]:
    """What an alpha star names: objects and stars (M,), whether two stars tie, whether there is none, and the work.

    A group is one for each of its members as alpha star. So an object that was the alpha star, and of which it is
    proven that no group has it, is not ``open_`` (N,) any more: with the others alone most stars are seen to have no
    group. What they have is worked out with all objects.
    """
    count, table = len(view.icrs), view.table
    whole = seen_from(alpha, view.angles, limits.tolerance_urad, np.ones(len(open_), np.bool_))
    take_all = _number_of(open_) > len(open_) - _FEWEST_CLOSED
    seen = whole if take_all else seen_from(alpha, view.angles, limits.tolerance_urad, open_)
    objects, stars = np.empty(0, np.int64), np.empty(0, np.int64)
    fewest, tie, work, view.fits.crowded[0] = limits.min_fit_2, False, 0, False
    # A group of other members needs no more of level 1, and has all its distances in the table.
    longest_urad = whole.distances[-1] + limits.tolerance_urad if len(whole.distances) else 0.0
    proven = limits.all_pairs and limits.min_fit <= limits.min_fit_2 and longest_urad < _longest_urad(table)
    # Stars of the catalogue one after the other: level 1 for a block of them at once, then level 2 for those few whose
    # neighbours are enough. The first with a group is the answer, or with ``all_stars`` the one with the largest.
    star = -1 if len(seen.others) >= fewest else count
    while star < count and work <= most_work:
        after = star + 1
        star = _next_possible(after, max(limits.min_fit, fewest), fewest, seen, blocks, view)
        work += table.first[min(star + 1, count)] - table.first[after]
        if star == count:
            break
        if not take_all:
            put_fits_of_star(star, whole, table, view.fits_of_star)
        candidates = _candidates(star % BLOCK, view.fits) if take_all else _candidates(0, view.fits_of_star)
        work += len(candidates) ** 2
        agrees = agreements(candidates, view.icrs, view.angles, view.gates, limits.tolerance_urad)
        group = largest_group(agrees, fewest)
        if group == 0:
            proven = proven and no_group(agrees, fewest)
            continue
        tie = len(objects) > 0 and bits(group) + 1 == len(objects)
        if not tie:
            objects, stars = _named(alpha, star, candidates, group)
        # From now on only a group at least as large counts: as large is a tie, larger takes its place.
        fewest = len(objects) - 1
        if not limits.all_stars:
            break
    return objects, stars, tie, proven and not view.fits.crowded[0], work


@compiled_part
def _number_of(open_: NDArray[np.bool_]) -> int:
    """How many are open; numba's own sum would import scipy, 0.2 s of each start."""
    number = 0
    for one in open_:
        number += one
    return number


@compiled_part
def _longest_urad(table: PairTable) -> int:
    """The longest distance of a table of pairs."""
    return int(table.distance_urad[-1]) if len(table.distance_urad) else 0


@compiled_part
def _next_possible(star: int, fewest_fits: int, fewest: int, seen: Alpha, blocks: Blocks, view: View) -> int:
    """The first star from ``star`` on that can have a group; past the last for none."""
    stars = len(view.icrs)
    while star < stars:
        block = star // BLOCK
        if star % BLOCK == 0:
            put_fits(block, seen, blocks, view.fits)
        end = min(BLOCK, stars - block * BLOCK)
        member = first_possible(star % BLOCK, end, fewest_fits, fewest, view.fits, view)
        star = block * BLOCK + member
        if member < end:
            return star
    return stars


@compiled_part
def first_possible(member: int, end: int, fewest_fits: int, fewest: int, fits: Fits, view: View) -> int:
    """The first of a block's stars from ``member`` to before ``end`` that can have a group; ``end`` for none.

    Arrays have names of their own here, since each access through a tuple counts references.
    """
    counts, again, candidates, icrs, gates = (
        fits.number,
        fits.again,
        fits.candidate,
        view.icrs,
        view.gates,
    )
    # Two sieves, the cheap one first: enough neighbours at all (eq 2-5), then enough of them that can agree.
    able, number = np.empty(BLOCK, np.uint8), np.uint64(0)
    for k in range(np.uint64(member), np.uint64(end)):
        able[number] = k
        number += np.uint64(counts[k] - again[k] >= fewest_fits)
    for of_star in able[:number]:
        row = np.uint64(of_star)
        fits.crowded[0] |= counts[row] > MOST_CANDIDATES
        if not pigeonhole_bound(candidates, row, min(counts[row], MOST_CANDIDATES), icrs, gates, fewest):
            return int(of_star)
    return end


@compiled_part
def _candidates(member: int, fits: Fits) -> NDArray[np.uint32]:
    """The candidates of one star."""
    return fits.candidate[member, : min(fits.number[member], MOST_CANDIDATES)]


@compiled_part
def _group(candidates: NDArray[np.uint32], view: View, fewest: int, limits: SearchOptions) -> np.uint64:
    """Level 2: the largest group of the candidates, 0 where it has fewer than ``fewest``."""
    agrees = agreements(candidates, view.icrs, view.angles, view.gates, limits.tolerance_urad)
    return largest_group(agrees, fewest)


@compiled
def best_vote(
    directions: NDArray[np.float64],
    icrs: NDArray[np.float64],
    table: PairTable,
    blocks: Blocks,
    limits: SearchOptions,
    hopeless: bool,
) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """As ``first_fit``, but first among the stars with most votes, and of these the one with the greatest Fn2."""
    view = view_of(directions, icrs, table, limits)
    tried = min(limits.alphas, len(directions))
    order = _alpha_order(directions, limits.central_cosine)
    for rank in range(tried):
        alpha = order[rank]
        seen = seen_from(alpha, view.angles, limits.tolerance_urad, np.ones(len(directions), np.bool_))
        objects, stars = np.empty(0, np.int64), np.empty(0, np.int64)
        for star in most_voted(seen, table, limits.tolerance_urad):
            put_fits_of_star(star, seen, table, view.fits_of_star)
            better = max(limits.min_fit_2, len(objects))
            if first_possible(0, 1, max(limits.min_fit, better), better, view.fits_of_star, view) == 1:
                continue
            candidates = _candidates(0, view.fits_of_star)
            group = _group(candidates, view, better, limits)
            if group != 0:
                objects, stars = _named(alpha, star, candidates, group)
        if len(objects) > 0:
            return objects, stars, rank + 1
    return first_fit(directions, icrs, table, blocks, limits, hopeless)


@compiled_part
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


@compiled_part
def _named(
    alpha: int, star: int, candidates: NDArray[np.uint32], group: np.uint64
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The objects and stars of a group, after the alpha star and its own."""
    objects, stars = np.full(MOST_CANDIDATES + 1, alpha), np.full(MOST_CANDIDATES + 1, star)
    size = 1
    for i in range(len(candidates)):
        if group >> np.uint64(i) & np.uint64(1):
            objects[size], stars[size] = object_of(candidates[i]), star_of(candidates[i])
            size += 1
    return objects[:size], stars[:size]
