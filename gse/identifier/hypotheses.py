"""Search for the attitude of a lost sensor: hypotheses are verified until one has strong evidence."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gse.identifier.attitude_fit import fit
from gse.identifier.evidence import CHANCE_OF_EVIDENCE, LOG_ACCEPTED, LOG_STRONG, LOG_UNAMBIGUOUS, weigh
from gse.identifier.robust_tables import SkyTables
from gse.identifier.search_plan import search_pass
from gse.identifier.tangent_plane import Attempt, Noise, Objects, attempt_at, noise_of, objects_of, with_noise
from gse.identifier.verify import named, squared_residuals
from gse.identifier.votes import FEW_LOOKED_AT, hypotheses_of, pair_rotation
from gse.process.jit import compiled, compiled_part

_SAME_ATTITUDE_COS = math.cos(math.radians(0.5))

MAX_HYPOTHESES = 6_000
"""A search of this length takes some 30 ms."""

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
    from the flipped image. Evidence that comes to no answer is minus infinity.
    """
    count = len(first) - 1
    evidence, mirrored = np.full((count, 2), -np.inf), np.zeros(count, dtype=np.bool_)
    ends = np.zeros(count + 1, dtype=np.int64)
    objects, stars = np.empty(len(brightness), dtype=np.int64), np.empty(len(brightness), dtype=np.int64)
    for k in range(count):
        seen, bright = directions[first[k] : first[k + 1]].copy(), brightness[first[k] : first[k + 1]]
        ends[k + 1] = ends[k]
        for turn in range(2):
            passes, needed = (len(plan), LOG_ACCEPTED) if turn == 0 else (_MIRROR_PASSES, _LOG_MIRRORED)
            best, second, found, of_sky = search(sky, seen, bright, plan[:passes], known)
            if best >= needed and (turn == 0 or best - second >= LOG_UNAMBIGUOUS):
                evidence[k, 0], evidence[k, 1], mirrored[k] = best, second, turn == 1
                for i in range(len(found)):  # a slice at once would bring numba's texts of its errors along
                    objects[ends[k] + i], stars[ends[k] + i] = found[i], of_sky[i]
                ends[k + 1] = ends[k] + len(found)
                break
            for i in range(len(seen)):
                seen[i, 0] *= -1.0
    return evidence, mirrored, ends, objects[: ends[count]], stars[: ends[count]]


@compiled
def best_evidence(
    sky: tuple[Any, ...],
    directions: NDArray[np.float64],
    brightness: NDArray[np.float64],
    plan: NDArray[np.float64],
    known: NDArray[np.float64],
) -> float:
    """The logarithm of the evidence that ``search`` finds."""
    return search(sky, directions, brightness, plan, known)[0]


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
