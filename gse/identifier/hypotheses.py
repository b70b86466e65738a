"""Search for the attitude of a lost sensor: hypotheses are verified until one has strong evidence."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gse.identifier.evidence import CHANCE_OF_EVIDENCE, LOG_ACCEPTED, LOG_STRONG, LOG_UNAMBIGUOUS, weigh
from gse.identifier.robust_tables import SkyTables, near_bit
from gse.identifier.search_plan import SearchPass, search_pass
from gse.identifier.verify import (
    Attempt,
    Noise,
    Objects,
    attempt_at,
    fit,
    named,
    noise_of,
    objects_of,
    squared_residuals,
    with_noise,
)
from gse.process.jit import compiled, compiled_part

# Hypotheses by votes: which star an alpha star may be, at which roll.
#
# An alpha star and its nearest partners: for each partner, every catalogue pair of the same distance votes for "the
# alpha star is this star, at this roll". A true star gets the votes of all its true partners at one roll, so that the
# partners fit each other and handedness is checked by the vote itself. Two votes that agree make a hypothesis, if other
# objects have stars near them too.

FEW_LOOKED_AT = 12
"""A random object has a star near it with a probability of 1 to 3 %."""

_IN_EACH = np.uint64(0x0001_0001_0001_0001)
_VOTED = np.uint64(0x8000_8000_8000_8000)
_ROLL = np.uint64(0x7FFF_7FFF_7FFF_7FFF)
"""A star's last four votes are kept in one word, 16 bits each: that it is a vote, and a roll in 1/32,768 turn."""


_Axis = tuple[float, float, float]
_Triad = tuple[_Axis, _Axis, _Axis]


@compiled_part
def stars_near(near_star: NDArray[np.uint8], places: NDArray[np.float64], axes: _Triad) -> int:
    """How many of the places (N, 3), along axes in the sky, have any star near them."""
    (x0, y0, z0), (x1, y1, z1), (x2, y2, z2) = axes
    hits = 0
    for i in range(len(places)):
        u, v, w = places[i, 0], places[i, 1], places[i, 2]
        bit = near_bit(x0 * u + x1 * v + x2 * w, y0 * u + y1 * v + y2 * w, z0 * u + z1 * v + z2 * w)
        hits += (near_star[bit >> 3] >> (bit & 7)) & 1
    return hits


@compiled_part
def _put_places(directions: NDArray[np.float64], axes: _Triad, places: NDArray[np.float64]) -> None:
    """Put directions (N, 3) along the axes of two objects into ``places``."""
    for i in range(len(directions)):
        for j, (x, y, z) in enumerate(axes):
            places[i, j] = x * directions[i, 0] + y * directions[i, 1] + z * directions[i, 2]


@compiled_part
def hypotheses_of(
    tables: SkyTables,
    directions: NDArray[np.float64],
    alpha: int,
    step: SearchPass,
    votes: NDArray[np.uint64],
    candidates: NDArray[np.int64],
) -> int:
    """Put the hypotheses of one alpha star that the votes make into ``candidates`` (C, 4); how many.

    A candidate is: objects near a star, partner, star of the alpha, star of the partner. Those with most objects near
    a star come first; when there are more than C the others are dropped.
    """
    bright = min(len(directions), step.objects)
    faintest = min(tables.pair_stars, int(step.stars_per_object * bright))
    alpha_faintest = min(faintest, int(step.stars_per_object * (alpha + step.alpha_ranks)))
    # A vote is cast in one turn about the alpha star. Object k stands at the distance d and the position angle a; a
    # catalogue pair (s, t) of the length d stands at its own position angle b at s. If the alpha star is s, the roll of
    # the image is b - a. All true partners give the same star s and the same roll; chance gives rolls at random.
    #
    #           k                t
    #          / a              / b          roll = b - a
    #     alpha ---        s ---
    distance, azimuth = np.empty(bright), np.empty(bright, dtype=np.int64)
    partners = np.empty(bright, dtype=np.int64)
    found = _partners(directions[:bright], alpha, 8.0 * step.window_rad, distance, azimuth, partners)
    looked_at = directions[: step.first_tried]
    icrs, pairs, near_star = tables.icrs, tables.pairs, tables.near_star
    places = np.empty((len(looked_at), 3))
    least, plenty, count = _least_hits(bright, len(looked_at)), max(6, (2 * len(looked_at)) // 3), 0
    votes[:faintest] = 0
    for p in range(min(found, step.partners)):
        k = partners[p]
        # The wider apart, the more an error of the focal length moves them apart.
        half = step.window_rad + step.window_growth * distance[k]
        low = max(0, int((distance[k] - half) / tables.bucket_rad))
        high = int((distance[k] + half) / tables.bucket_rad) + 1
        if high >= len(tables.pair_start):
            break
        # The roll of a pair is known to the noise over its length; the vote before came from the nearest partner.
        roll_error = step.window_rad * (1.0 / distance[k] + 1.0 / distance[partners[0]])
        tolerance = np.uint64(int(roll_error * (0.8 * 32768.0 / (2.0 * math.pi))) + 1)
        turn = np.uint64(azimuth[k])
        _put_places(looked_at, _triad(axis(directions, alpha), axis(directions, k)), places)
        for bucket in range(low, high):
            for q in range(np.uint64(tables.pair_start[bucket]), np.uint64(tables.pair_start[bucket + 1])):
                if pairs[q, 1] >= faintest:
                    break
                for end in range(2):
                    s = np.uint64(pairs[q, end])
                    roll = ((np.uint64(pairs[q, 2 + end]) - turn) >> np.uint64(1)) & np.uint64(0x7FFF)
                    # The new vote pushes the oldest of four out of the word.
                    given = votes[s]
                    votes[s] = (given << np.uint64(16)) | np.uint64(0x8000) | roll
                    if not _agrees(given, roll, tolerance) or s >= alpha_faintest:
                        continue
                    t = np.uint64(pairs[q, 1 - end])
                    hits = stars_near(near_star, places, _triad(axis(icrs, s), axis(icrs, t)))
                    if hits >= least:
                        count = _insert(candidates, count, (hits, k, int(s), int(t)))
        if count > 0 and candidates[0, 0] >= plenty:
            break
    return count


@compiled_part
def _least_hits(bright: int, looked_at: int) -> int:
    """Objects near a star that make a hypothesis: its own two, and more than chance usually adds."""
    if bright <= 5:
        return 3
    return 4 if looked_at <= FEW_LOOKED_AT else 6


@compiled_part
def _agrees(votes: np.uint64, roll: np.uint64, tolerance: np.uint64) -> bool:
    """Whether one of a star's last four votes is for the same roll.

    All four are compared at once and without a branch, which no processor would predict; 15 bits with the 16th set
    before a difference keep each from borrowing from the next.
    """
    # |given - roll| <= tolerance, modulo a turn, is 0 <= roll + tolerance - given <= 2 tolerance in unsigned
    # arithmetic.
    difference = (((roll + tolerance) * _IN_EACH | _VOTED) - (votes & _ROLL)) & _ROLL
    near = (np.uint64(2) * tolerance * _IN_EACH | _VOTED) - difference
    return bool(near & votes & _VOTED)


@compiled_part
def _insert(candidates: NDArray[np.int64], count: int, new: tuple[int, int, int, int]) -> int:
    """Insert a candidate where its number of objects near a star puts it; the last one drops out of a full list."""
    place = count
    if count == len(candidates):
        if candidates[count - 1, 0] >= new[0]:
            return count
        place = count - 1
    else:
        count += 1
    while place > 0 and candidates[place - 1, 0] < new[0]:
        for column in range(4):  # a row at once would bring numba's texts of its errors along: two seconds to compile
            candidates[place, column] = candidates[place - 1, column]
        place -= 1
    candidates[place, 0], candidates[place, 1], candidates[place, 2], candidates[place, 3] = new
    return count


@compiled_part
def axis(vectors: NDArray[np.float64], row: np.uint64 | int) -> _Axis:
    """A row of vectors (N, 3), without an array for it, of which numba counts the references."""
    return vectors[row, 0], vectors[row, 1], vectors[row, 2]


@compiled_part
def _triad(x: _Axis, y: _Axis) -> _Triad:
    """Three axes at right angles: ``x``, the normal of ``x`` and ``y``, and the cross product of these two."""
    cx = x[1] * y[2] - x[2] * y[1]
    cy = x[2] * y[0] - x[0] * y[2]
    cz = x[0] * y[1] - x[1] * y[0]
    norm = 1.0 / math.sqrt(cx * cx + cy * cy + cz * cz + 1e-300)
    cx, cy, cz = cx * norm, cy * norm, cz * norm
    across = (x[1] * cz - x[2] * cy, x[2] * cx - x[0] * cz, x[0] * cy - x[1] * cx)
    return x, (cx, cy, cz), across


@compiled_part
def pair_rotation(
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    s: NDArray[np.float64],
    t: NDArray[np.float64],
    rotation: NDArray[np.float64],
) -> None:
    """Put the rotation that takes star ``s`` onto direction ``a`` and ``t`` towards ``b`` into ``rotation``."""
    left, right = _triad((a[0], a[1], a[2]), (b[0], b[1], b[2])), _triad((s[0], s[1], s[2]), (t[0], t[1], t[2]))
    for j in range(3):
        for k in range(3):
            rotation[j, k] = left[0][j] * right[0][k] + left[1][j] * right[1][k] + left[2][j] * right[2][k]


@compiled_part
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
    # Two axes across the alpha star: position angles in the image are counted from the one towards the other.
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


_SAME_ATTITUDE_COS = math.cos(math.radians(0.5))

MAX_HYPOTHESES = 6_000
"""A search of this length takes 10 to 50 ms."""

_MAX_CANDIDATES = 1000

_MORE_THAN_NOISE = 1.2
"""Residuals of so many times the noise assumed show that it is more."""

_LOG_MIRRORED = math.log(CHANCE_OF_EVIDENCE / 1e-5)

_MIRROR_PASSES = 2
"""A flipped image is looked for in the first passes of the search only: a refusal must not take twice as long."""


@compiled
def search_many(
    sky: tuple[Any, ...],
    directions: NDArray[np.float64],
    brightness: NDArray[np.float64],
    first: NDArray[np.int64],
    plan: NDArray[np.float64],
    known: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """``search`` for K panoramas: evidence (K, 2), mirrored (K,), ends (K + 1,), objects and stars (M,).

    Panorama k is the rows ``first[k]`` to before ``first[k + 1]`` of ``directions`` and ``brightness``; its answer is
    ``ends[k]`` to before ``ends[k + 1]`` of the objects and stars returned, from the image or, where ``mirrored``,
    from the flipped image. Evidence that comes to no answer is that of the image as it is.
    """
    count = len(first) - 1
    evidence, mirrored = np.empty((count, 2)), np.zeros(count, dtype=np.bool_)
    ends = np.zeros(count + 1, dtype=np.int64)
    objects, stars = np.empty(len(brightness), dtype=np.int64), np.empty(len(brightness), dtype=np.int64)
    for k in range(count):
        seen, bright = directions[first[k] : first[k + 1]].copy(), brightness[first[k] : first[k + 1]]
        ends[k + 1] = ends[k]
        for turn in range(2):
            passes, needed = (len(plan), LOG_ACCEPTED) if turn == 0 else (_MIRROR_PASSES, _LOG_MIRRORED)
            best, second, found, of_sky = search(sky, seen, bright, plan[:passes], known)
            if turn == 0:
                evidence[k, 0], evidence[k, 1] = best, second
            if best >= needed and (turn == 0 or best - second >= LOG_UNAMBIGUOUS):
                evidence[k, 0], evidence[k, 1], mirrored[k] = best, second, turn == 1
                for i in range(len(found)):  # a slice at once would bring numba's texts of its errors along
                    objects[ends[k] + i], stars[ends[k] + i] = found[i], of_sky[i]
                ends[k + 1] = ends[k] + len(found)
                break
            for i in range(len(seen)):
                seen[i, 0] *= -1.0
    return evidence, mirrored, ends, objects[: ends[count]], stars[: ends[count]]


@compiled_part
def search(
    sky: tuple[Any, ...],
    directions: NDArray[np.float64],
    brightness: NDArray[np.float64],
    plan: NDArray[np.float64],
    known: NDArray[np.float64],
) -> tuple[float, float, NDArray[np.int64], NDArray[np.int64]]:
    """Find the attitude with the most evidence: its logarithm, that of the second best, objects (M,), their stars (M,).

    ``directions`` (N, 3) and ``brightness`` (N,) of the objects, brightest first; stars are rows of the tables. Each
    row of ``plan`` is a pass (see ``search_plan``) with a noise of its own. ``sky`` is SkyTables and ``known`` what
    ``noise_of`` takes, as plain tuple and array: these are twice as fast to hand over. The search ends with the alpha
    star that gives strong evidence, at the end of the plan or after MAX_HYPOTHESES.
    """
    tables = SkyTables(*sky)
    objects = objects_of(directions, brightness)
    n = len(directions)
    votes = np.empty(tables.pair_stars, dtype=np.uint64)
    candidates = np.empty((_MAX_CANDIDATES, 4), dtype=np.int64)
    star_of, rotation, best_rotation = np.full(n, -1), np.empty((3, 3)), np.zeros((3, 3))
    pair = np.full(n, -1)
    best, second, tried = -np.inf, -np.inf, 0
    best_hits, best_alpha = np.int64(0), np.int64(-1)
    # Passes from the quick to the thorough: most panoramas end in the first, whose alpha stars see a few partners with
    # a small noise; what is left costs more, and the last pass is for what hardly has enough stars.
    for line in range(len(plan)):
        step = search_pass(plan[line])
        if n > step.most_objects:
            continue
        noise = noise_of(known, step.sigma_rad)
        keep = candidates[: step.hypotheses]
        for turn in range(min(n, step.alpha_stars)):
            # The brightest objects may be hot pixels or planets: their turn comes last.
            passed_over = min(n, step.objects) // (4 if step.first_tried <= FEW_LOOKED_AT else 3)
            alpha = (turn + passed_over) % n
            for c in range(hypotheses_of(tables, directions, alpha, step, votes, keep)):
                hits, k, s, t = candidates[c, 0], candidates[c, 1], candidates[c, 2], candidates[c, 3]
                # Once the evidence is strong the rest of the list is looked through only for a rival: same number of
                # hits, another star.
                if best > LOG_STRONG and (hits < best_hits - 1 or s == best_alpha):
                    continue  # Only another attitude that looks as good could make the answer ambiguous.
                tried += 1
                pair_rotation(directions[alpha], directions[k], tables.icrs[s], tables.icrs[t], rotation)
                pair[alpha], pair[k] = s, t
                attempt, started = _attempt_with(tables, rotation, pair)
                pair[alpha] = pair[k] = -1
                if started < 2:
                    continue
                # From the pair's attitude the match grows over the field, and evidence is weighed for all of it.
                value = weigh(tables, objects, attempt, noise)
                if value <= second:
                    continue
                # The same attitude is found from many pairs: only another one is the second best.
                same = _cos_between(rotation, best_rotation) > _SAME_ATTITUDE_COS
                if value > best:
                    second = second if same else best
                    best = value
                    best_hits, best_alpha = hits, s
                    _keep(attempt.rows, attempt.star_of, rotation, star_of, best_rotation)
                elif not same:
                    second = value
            if best > LOG_STRONG:
                best = _with_more_noise(tables, objects, noise, best, best_rotation, star_of)
            if best > LOG_STRONG or tried >= MAX_HYPOTHESES:
                return best, second, *named(star_of)
    return best, second, *named(star_of)


@compiled_part
def _attempt_with(tables: SkyTables, rotation: NDArray[np.float64], star_of: NDArray[np.int64]) -> tuple[Attempt, int]:
    """The attempt to verify a rotation that begins with these matches, and how many of them are in its field.

    ``star_of`` (N,) are rows of the tables, -1 for an object without a star.
    """
    attempt = attempt_at(tables, rotation, len(star_of))
    started = 0
    for i in range(len(star_of)):
        if star_of[i] >= 0:
            for f in range(len(attempt.rows)):
                if attempt.rows[f] == star_of[i]:
                    attempt.star_of[i] = f
                    started += 1
    return attempt, started


@compiled_part
def _with_more_noise(
    tables: SkyTables,
    objects: Objects,
    noise: Noise,
    best: float,
    rotation: NDArray[np.float64],
    star_of: NDArray[np.int64],
) -> float:
    """Grow the best attitude again with twice the noise where its stars lie off more than the noise; its evidence.

    The noise of the first passes leaves out the stars that err by more, and then many. ``rotation`` and ``star_of``
    (N,), rows of the tables, follow where the evidence rises.
    """
    attempt, matched = _attempt_with(tables, rotation.copy(), star_of)
    fit(tables, objects, attempt, noise)
    expected = _MORE_THAN_NOISE**2 * noise.sigma * noise.sigma * (2 * matched - 4)
    if squared_residuals(tables, objects, attempt) < expected:
        return best
    more = with_noise(noise, 2.0 * noise.sigma, noise.scale_sigma)
    value = weigh(tables, objects, attempt, more)
    if value <= best:
        return best
    _keep(attempt.rows, attempt.star_of, attempt.rotation, star_of, rotation)
    return value


@compiled_part
def _keep(
    rows: NDArray[np.int64],
    places: NDArray[np.int64],
    rotation: NDArray[np.float64],
    star_of: NDArray[np.int64],
    best_rotation: NDArray[np.float64],
) -> None:
    """Copy an attempt's stars, as rows of the tables, and its rotation."""
    for i in range(len(places)):
        star_of[i] = rows[places[i]] if places[i] >= 0 else -1
    for j in range(3):
        for k in range(3):
            best_rotation[j, k] = rotation[j, k]


@compiled_part
def _cos_between(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Cosine of the angle of the turn from one rotation to another."""
    trace = 0.0
    for j in range(3):
        for k in range(3):
            trace += a[j, k] * b[j, k]
    return 0.5 * (trace - 1.0)
