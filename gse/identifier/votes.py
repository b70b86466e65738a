"""Hypotheses by votes: which star an alpha star may be, at which roll.

An alpha star and its nearest partners: for each partner, every catalogue pair of the same distance votes for "the alpha
star is this star, at this roll". A true star gets the votes of all its true partners at one roll, so that the partners
fit each other and handedness is checked by the vote itself. Two votes that agree make a hypothesis, if other objects
have stars near them too.
"""

import math

import numpy as np
from numpy.typing import NDArray

from gse.compiled import compiled
from gse.identifier.robust_tables import SkyTables, near_bit

_VOTES = 7
"""Votes kept of a star; more come only where partners are many."""

FEW_LOOKED_AT = 12
"""A random object has a star near it by a chance of 1 to 3 %."""

_Whole = int | np.int64

(
    PLAN_WINDOW,
    PLAN_GROWTH,
    PLAN_PARTNERS,
    PLAN_CANDIDATES,
    PLAN_ALPHAS,
    PLAN_SIGMA,
    PLAN_STARS,
    PLAN_OBJECTS,
    PLAN_ALPHA_RANKS,
    PLAN_MOST_OBJECTS,
    PLAN_LOOKED_AT,
) = range(11)
"""Columns of the plan: tolerance of a distance in radians, and its growth with the distance; partners of an alpha star;
hypotheses kept of its votes; alpha stars; noise; catalogue stars looked
up per object; objects, brightest first, that take part; ranks by which the alpha star may be fainter than it looks;
the most objects of a panorama that the pass is for; objects, brightest first, that a hypothesis is first tried on."""


@compiled
def _stars_near(tables: SkyTables, directions: NDArray[np.float64], r: NDArray[np.float64]) -> int:
    """How many of directions (N, 3) have any star near them under a rotation."""
    hits = 0
    for i in range(len(directions)):
        x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
        bit = near_bit(
            r[0, 0] * x + r[1, 0] * y + r[2, 0] * z,
            r[0, 1] * x + r[1, 1] * y + r[2, 1] * z,
            r[0, 2] * x + r[1, 2] * y + r[2, 2] * z,
        )
        hits += (tables.near_star[bit >> 3] >> (bit & 7)) & 1
    return hits


@compiled
def hypotheses_of(
    tables: SkyTables,
    directions: NDArray[np.float64],
    alpha: int,
    step: NDArray[np.float64],
    votes: NDArray[np.uint16],
    candidates: NDArray[np.int64],
) -> int:
    """Put the hypotheses of one alpha star that the votes make into ``candidates`` (C, 4); how many.

    A candidate is: objects near a star, partner, star of the alpha, star of the partner. Those with most objects near
    a star come first; when there are more than C the others are dropped. ``step`` is a row of the plan.
    """
    bright = min(len(directions), int(step[PLAN_OBJECTS]))
    faintest = min(tables.pair_stars, int(step[PLAN_STARS] * bright))
    alpha_faintest = min(faintest, int(step[PLAN_STARS] * (alpha + step[PLAN_ALPHA_RANKS])))
    distance, azimuth = np.empty(bright), np.empty(bright, dtype=np.int64)
    partners = np.empty(bright, dtype=np.int64)
    found = _partners(directions[:bright], alpha, 8.0 * step[PLAN_WINDOW], distance, azimuth, partners)
    rotation = np.empty((3, 3))
    looked_at = directions[: int(step[PLAN_LOOKED_AT])]
    least, plenty, count = _least_hits(bright, len(looked_at)), max(6, (2 * len(looked_at)) // 3), 0
    for star in range(alpha_faintest):
        votes[star, 0] = 0
    for p in range(min(found, int(step[PLAN_PARTNERS]))):
        k = partners[p]
        half = step[PLAN_WINDOW] + step[PLAN_GROWTH] * distance[k]
        low = max(0, int((distance[k] - half) / tables.bucket_rad))
        high = int((distance[k] + half) / tables.bucket_rad) + 1
        if high >= len(tables.pair_start):
            break
        apart = step[PLAN_WINDOW] * (1.0 / distance[k] + 1.0 / distance[partners[0]])
        tolerance = int(apart * (0.8 * 65536.0 / (2.0 * math.pi))) + 2
        for bucket in range(low, high):
            for q in range(tables.pair_start[bucket], tables.pair_start[bucket + 1]):
                if tables.pairs[q, 1] >= faintest:
                    break
                for end in range(2):
                    s = np.int64(tables.pairs[q, end])
                    if s >= alpha_faintest:
                        break
                    roll = (np.int64(tables.pairs[q, 2 + end]) - azimuth[k]) & 0xFFFF
                    if not _agrees(votes[s], roll, tolerance):
                        continue
                    t = np.int64(tables.pairs[q, 1 - end])
                    pair_rotation(directions[alpha], directions[k], tables.icrs[s], tables.icrs[t], rotation)
                    hits = _stars_near(tables, looked_at, rotation)
                    if hits >= least:
                        count = _insert(candidates, count, (hits, k, s, t))
        if count > 0 and candidates[0, 0] >= plenty:
            break
    return count


@compiled
def _least_hits(bright: int, looked_at: int) -> int:
    """Objects near a star that make a hypothesis: its own two, and what chance seldom adds."""
    if bright <= 5:
        return 3
    return 4 if looked_at <= FEW_LOOKED_AT else 6


@compiled
def _agrees(votes: NDArray[np.uint16], roll: _Whole, tolerance: int) -> bool:
    """Whether a star's alpha has a vote for the same roll already; the vote is added to its ``votes``.

    ``votes`` (8,) are how many there are, then their rolls; the first seven count.
    """
    given = np.int64(votes[0])
    agrees = False
    for v in range(1, given + 1):
        apart = (roll - np.int64(votes[v]) + 0x8000) & 0xFFFF
        if abs(apart - 0x8000) <= tolerance:
            agrees = True
    if given < _VOTES:
        votes[0] = given + 1
        votes[given + 1] = roll
    return agrees


@compiled
def _insert(candidates: NDArray[np.int64], count: int, new: tuple[_Whole, _Whole, _Whole, _Whole]) -> int:
    """Insert a candidate where its number of objects near a star puts it; the last one drops out of a full list."""
    place = count
    if count == len(candidates):
        if candidates[count - 1, 0] >= new[0]:
            return count
        place = count - 1
    else:
        count += 1
    while place > 0 and candidates[place - 1, 0] < new[0]:
        candidates[place] = candidates[place - 1]
        place -= 1
    candidates[place, 0], candidates[place, 1], candidates[place, 2], candidates[place, 3] = new
    return count


@compiled
def pair_rotation(
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    s: NDArray[np.float64],
    t: NDArray[np.float64],
    rotation: NDArray[np.float64],
) -> None:
    """Put the rotation that takes star ``s`` onto direction ``a`` and ``t`` towards ``b`` into ``rotation``."""
    left, right = np.empty((3, 3)), np.empty((3, 3))
    for frame, x, y in ((left, a, b), (right, s, t)):
        cx = x[1] * y[2] - x[2] * y[1]
        cy = x[2] * y[0] - x[0] * y[2]
        cz = x[0] * y[1] - x[1] * y[0]
        norm = 1.0 / math.sqrt(cx * cx + cy * cy + cz * cz + 1e-300)
        cx, cy, cz = cx * norm, cy * norm, cz * norm
        frame[0, 0], frame[0, 1], frame[0, 2] = x[0], x[1], x[2]
        frame[1, 0], frame[1, 1], frame[1, 2] = cx, cy, cz
        frame[2, 0] = x[1] * cz - x[2] * cy
        frame[2, 1] = x[2] * cx - x[0] * cz
        frame[2, 2] = x[0] * cy - x[1] * cx
    for j in range(3):
        for k in range(3):
            rotation[j, k] = left[0, j] * right[0, k] + left[1, j] * right[1, k] + left[2, j] * right[2, k]


@compiled
def _partners(
    directions: NDArray[np.float64],
    alpha: int,
    least: float,
    distance: NDArray[np.float64],
    azimuth: NDArray[np.int64],
    partners: NDArray[np.int64],
) -> int:
    """Distances and position angles of all objects about the alpha star; how many are far enough.

    ``partners`` gets these, nearest first.
    """
    ax, ay, az = directions[alpha, 0], directions[alpha, 1], directions[alpha, 2]
    norm = 1.0 / math.sqrt(ax * ax + az * az)
    ex, ez = az * norm, -ax * norm
    nx, ny, nz = ay * ez, az * ex - ax * ez, -ay * ex
    found = 0
    for i in range(len(directions)):
        if i == alpha:
            continue
        x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
        chord = math.sqrt((x - ax) ** 2 + (y - ay) ** 2 + (z - az) ** 2)
        distance[i] = 2.0 * math.asin(min(1.0, 0.5 * chord))
        angle = math.atan2(nx * x + ny * y + nz * z, ex * x + ez * z)
        azimuth[i] = np.int64(math.floor(angle * (65536.0 / (2.0 * math.pi)) + 0.5))
        if distance[i] < least:
            continue
        j = found
        while j > 0 and distance[partners[j - 1]] > distance[i]:
            partners[j] = partners[j - 1]
            j -= 1
        partners[j] = i
        found += 1
    return found
