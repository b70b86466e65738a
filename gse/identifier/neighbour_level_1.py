"""Compiled level 1 of the neighbour technique: how many neighbours of a catalogue star fit those of the alpha star.

The LAPAN paper, section 2, eq 2-5.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gse.identifier.consistency import MOST_CANDIDATES, Candidates, angle_urad
from gse.identifier.tables import PairTable
from gse.jit import compiled

_BIN_BITS = np.uint64(7)
_BIN_URAD = 128


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


@compiled
def seen_from(alpha: int, cosine: NDArray[np.float64], sine: NDArray[np.float64], tolerance_urad: float) -> Alpha:
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
def level_1(
    star: int, alpha: Alpha, table: PairTable, tolerance_urad: float, min_fit: int, room: Candidates
) -> tuple[int, int]:
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
    if fit < min_fit:
        return int(fit), 0
    count = 0
    for hit in range(min(int(fit), MOST_CANDIDATES)):
        k = room.hit[hit]
        urad = np.uint64(table.neighbour_urad[k])
        place = urad >> _BIN_BITS
        for i in range(alpha.begin[place], alpha.end[place]):
            if abs(np.int64(urad) - alpha.distances[i]) < tolerance_urad and count < MOST_CANDIDATES:
                room.object[count], room.star[count] = alpha.others[i], table.neighbour[k]
                count += 1
    return int(fit), count
