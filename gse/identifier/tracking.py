"""Tracking: the stars of a panorama near the attitude of the one before.

The whole pattern has moved by one small shift: the offsets of all objects from the catalogue stars around them are
compared, and the shift that most of them share gives the first matches. Verification and evidence are those of the lost
sensor, so that a wrong previous attitude can lead to no answer, never to a false one.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gse.identifier.evidence import weigh
from gse.identifier.robust_tables import SkyTables
from gse.identifier.tangent_plane import (
    SMALLEST_RANGE,
    U_BINS,
    Attempt,
    Objects,
    attempt_at,
    noise_of,
    objects_of,
    place,
)
from gse.identifier.verify import named
from gse.jit import compiled, compiled_part

_MAX_OFFSETS = 256
"""Offsets compared with each other; the brightest stars come first."""


@compiled
def follow(
    sky: tuple[Any, ...],
    directions: NDArray[np.float64],
    brightness: NDArray[np.float64],
    previous: NDArray[np.float64],
    reach: float,
    known: NDArray[np.float64],
) -> tuple[float, NDArray[np.int64], NDArray[np.int64]]:
    """Verify the attitude near ``previous`` (3, 3): the logarithm of the evidence, objects (M,), and their stars (M,).

    Objects are looked for within ``reach`` (tangent plane) of their stars; stars are rows of the tables.
    ``sky`` is SkyTables and ``known`` is Noise, as plain tuple and array: these are twice as fast to hand over.
    """
    tables = SkyTables(*sky)
    noise = noise_of(known, known[0])
    objects = objects_of(directions, brightness)
    n = len(directions)
    rotation = np.empty((3, 3))
    for j in range(3):
        for k in range(3):
            rotation[j, k] = previous[j, k]
    attempt = attempt_at(tables, rotation, n)
    value = -np.inf
    if _common_shift(tables, objects, attempt, reach, 4.0 * noise.sigma) >= 3:
        value = weigh(tables, objects, attempt, noise)
    for i in range(n):
        if attempt.star_of[i] >= 0:
            attempt.star_of[i] = attempt.rows[attempt.star_of[i]]
    found, stars = named(attempt.star_of)
    return value, found, stars


@compiled_part
def _common_shift(tables: SkyTables, objects: Objects, attempt: Attempt, reach: float, tolerance: float) -> int:
    """Match the objects whose offset from a star is the most common one, within a tolerance; how many."""
    offsets = np.empty((_MAX_OFFSETS, 2))
    pairs = np.empty((_MAX_OFFSETS, 2), dtype=np.int64)
    count = _offsets(tables, objects, attempt, reach, offsets, pairs)
    best, best_votes = 0, 0
    for a in range(count):
        votes = 0
        for b in range(count):
            votes += abs(offsets[a, 0] - offsets[b, 0]) < tolerance and abs(offsets[a, 1] - offsets[b, 1]) < tolerance
        if votes > best_votes:
            best, best_votes = a, votes
        if 2 * best_votes > count:
            break  # Most of all share it.
    matched = 0
    for b in range(count):
        du, dv = abs(offsets[best, 0] - offsets[b, 0]), abs(offsets[best, 1] - offsets[b, 1])
        if du < tolerance and dv < tolerance and attempt.star_of[pairs[b, 0]] < 0:
            attempt.star_of[pairs[b, 0]] = pairs[b, 1]
            matched += 1
    return matched


@compiled_part
def _offsets(
    tables: SkyTables,
    objects: Objects,
    attempt: Attempt,
    reach: float,
    offsets: NDArray[np.float64],
    pairs: NDArray[np.int64],
) -> int:
    """Offsets (M, 2) of objects from the stars within reach, and which (object, star) they belong to; how many."""
    uv, n = objects.uv, len(objects.uv)
    low = uv[objects.order[0], 0]
    bins_per_u = U_BINS / max(uv[objects.order[n - 1], 0] - low, SMALLEST_RANGE)
    count = 0
    for f in range(len(attempt.rows)):
        u, v = place(tables, attempt, f)
        start = int((u - reach - low) * bins_per_u)
        if start >= U_BINS:
            continue
        for k in range(objects.first[max(start, 0)], n):
            i = objects.order[k]
            if uv[i, 0] - u > reach:
                break
            if abs(uv[i, 0] - u) < reach and abs(uv[i, 1] - v) < reach and count < len(offsets):
                offsets[count, 0], offsets[count, 1] = uv[i, 0] - u, uv[i, 1] - v
                pairs[count, 0], pairs[count, 1] = i, f
                count += 1
    return count
