"""Verification of one attitude: the full catalogue is projected, matched to the objects, and the attitude refined.

All is done on the tangent plane of the boresight, u = x / z and v = y / z of the sensor frame, where the noise of a
pixel is the same everywhere. The unknowns are the small rotation vector in the sensor frame and the relative error of
the focal length. Each star's gate holds the noise and what the unknowns are still uncertain by at its place: a gate
that grows with the distance from the stars already matched. So a match starts where the hypothesis is sure of itself
and spreads over the field.
"""

import math

import numpy as np
from numpy.typing import NDArray

from gse.compiled import compiled
from gse.identifier.robust_tables import SkyTables

GATE_CHI2 = 13.0
"""Squared gate in sigmas of a two-dimensional normal: 0.15 % of true stars fall outside."""

_MAX_ROUNDS = 10

_OBJECT_BUCKETS = 64

_SMALLEST_RANGE = 1e-9
"""Of the objects' u, where all lie in one column."""

_MAX_GATE_SHARE = 0.02
"""A gate that covers more than this share of the field (times the objects in it) says nothing: it waits."""

FIELD_LEFT, FIELD_RIGHT, FIELD_TOP, FIELD_BOTTOM, FIELD_RADIUS2, FIELD_AREA = range(6)
"""Places in a field's description: limits in u and v, squared radius of a round stop, area; tangent plane units."""


@compiled
def sort_objects(uv: NDArray[np.float64], order: NDArray[np.int64], first: NDArray[np.int64]) -> None:
    """Sort objects (N, 2) by u into ``order`` (N,); ``first`` (65,) points at where each 64th of their range begins."""
    n = len(uv)
    low, high = uv[0, 0], uv[0, 0]
    for i in range(n):
        low, high = min(low, uv[i, 0]), max(high, uv[i, 0])
        j = i
        while j > 0 and uv[order[j - 1], 0] > uv[i, 0]:
            order[j] = order[j - 1]
            j -= 1
        order[j] = i
    width = max(high - low, _SMALLEST_RANGE) / _OBJECT_BUCKETS
    position = 0
    for b in range(_OBJECT_BUCKETS):
        while position < n and uv[order[position], 0] < low + b * width:
            position += 1
        first[b] = position
    first[_OBJECT_BUCKETS] = n


@compiled
def gather_field(
    tables: SkyTables, rotation: NDArray[np.float64], field: NDArray[np.float64], rows: NDArray[np.int64]
) -> int:
    """Put the brightest catalogue stars in the field (and a little around it) into ``rows``; how many there are."""
    z = min(1.0, max(-1.0, rotation[2, 2]))
    ring = min(int(math.acos(z) / tables.ring_rad), len(tables.ring_start) - 2)
    cells = tables.ring_start[ring + 1] - tables.ring_start[ring]
    turn = math.atan2(rotation[2, 1], rotation[2, 0]) / (2.0 * math.pi)
    turn -= math.floor(turn)
    cell = tables.ring_start[ring] + min(int(turn * cells), cells - 1)
    margin = 0.01 * (field[FIELD_RIGHT] - field[FIELD_LEFT])
    left, right = field[FIELD_LEFT] - margin, field[FIELD_RIGHT] + margin
    top, bottom = field[FIELD_TOP] - margin, field[FIELD_BOTTOM] + margin
    count = 0
    for k in range(tables.cell_start[cell], tables.cell_start[cell + 1]):
        row = tables.cell_stars[k]
        a, b, c = tables.icrs[row, 0], tables.icrs[row, 1], tables.icrs[row, 2]
        pz = rotation[2, 0] * a + rotation[2, 1] * b + rotation[2, 2] * c
        px = rotation[0, 0] * a + rotation[0, 1] * b + rotation[0, 2] * c
        py = rotation[1, 0] * a + rotation[1, 1] * b + rotation[1, 2] * c
        inside = pz > 0.0 and left * pz < px < right * pz and top * pz < py < bottom * pz
        if inside and px * px + py * py < 1.03 * field[FIELD_RADIUS2] * pz * pz:
            rows[count] = row
            count += 1
            if count == len(rows):
                break
    return count


@compiled
def match_field(
    tables: SkyTables,
    uv: NDArray[np.float64],
    order: NDArray[np.int64],
    first: NDArray[np.int64],
    field: NDArray[np.float64],
    rows: NDArray[np.int64],
    rotation: NDArray[np.float64],
    covariance: NDArray[np.float64],
    scale: float,
    sigma: float,
    star_of: NDArray[np.int64],
) -> int:
    """Give each object the place in ``rows`` of the star it lies nearest to, or -1, in ``star_of``; how many matched.

    An object goes to one star and a star to one object, nearest in sigmas first.
    """
    n = len(uv)
    chi2 = np.empty(n)
    for i in range(n):
        star_of[i] = -1
        chi2[i] = GATE_CHI2
    low = uv[order[0], 0]
    per_u = _OBJECT_BUCKETS / max(uv[order[n - 1], 0] - low, _SMALLEST_RANGE)
    c = covariance
    matched = 0
    for f in range(len(rows)):
        a, b, d = tables.icrs[rows[f], 0], tables.icrs[rows[f], 1], tables.icrs[rows[f], 2]
        pz = rotation[2, 0] * a + rotation[2, 1] * b + rotation[2, 2] * d
        u = (rotation[0, 0] * a + rotation[0, 1] * b + rotation[0, 2] * d) / pz * scale
        v = (rotation[1, 0] * a + rotation[1, 1] * b + rotation[1, 2] * d) / pz * scale
        # Covariance of the place: du = y - v z + u s, dv = -x + u z + v s (second-order terms do not matter to a gate).
        suu = c[1, 1] + v * v * c[2, 2] + u * u * c[3, 3] + 2.0 * (u * c[1, 3] - v * c[1, 2] - u * v * c[2, 3])
        svv = c[0, 0] + u * u * c[2, 2] + v * v * c[3, 3] + 2.0 * (u * v * c[2, 3] - u * c[0, 2] - v * c[0, 3])
        suv = u * v * (c[3, 3] - c[2, 2]) + (u * u - v * v) * c[2, 3]
        suv += u * (c[1, 2] - c[0, 3]) + v * (c[1, 3] + c[0, 2]) - c[0, 1]
        suu += sigma * sigma
        svv += sigma * sigma
        determinant = suu * svv - suv * suv
        if math.pi * GATE_CHI2 * math.sqrt(determinant) * n > _MAX_GATE_SHARE * field[FIELD_AREA]:
            continue
        reach = math.sqrt(GATE_CHI2 * suu)
        bucket = int((u - reach - low) * per_u)
        if bucket >= _OBJECT_BUCKETS:
            continue
        best, best_chi2 = -1, GATE_CHI2
        for k in range(first[max(bucket, 0)], n):
            i = order[k]
            du = uv[i, 0] - u
            if du > reach:
                break
            dv = uv[i, 1] - v
            distance = (svv * du * du - 2.0 * suv * du * dv + suu * dv * dv) / determinant
            if distance < best_chi2:
                best, best_chi2 = i, distance
        if best >= 0 and best_chi2 < chi2[best]:
            if star_of[best] < 0:
                matched += 1
            star_of[best] = f
            chi2[best] = best_chi2
    return matched


@compiled
def fit(
    tables: SkyTables,
    uv: NDArray[np.float64],
    rows: NDArray[np.int64],
    star_of: NDArray[np.int64],
    rotation: NDArray[np.float64],
    covariance: NDArray[np.float64],
    scale_and_prior: tuple[float, float],
    sigma: float,
) -> float:
    """One Gauss-Newton step on the matched objects: turns ``rotation`` in place, puts the new (4, 4) covariance.

    ``scale_and_prior`` is the scale in use and the standard deviation that it is expected to have about 1. Returns the
    new scale.
    """
    scale, scale_sigma = scale_and_prior
    information, pull = np.zeros((4, 4)), np.zeros(4)
    weight = 1.0 / (sigma * sigma)
    for i in range(len(uv)):
        if star_of[i] < 0:
            continue
        row = rows[star_of[i]]
        a, b, d = tables.icrs[row, 0], tables.icrs[row, 1], tables.icrs[row, 2]
        pz = rotation[2, 0] * a + rotation[2, 1] * b + rotation[2, 2] * d
        u = (rotation[0, 0] * a + rotation[0, 1] * b + rotation[0, 2] * d) / pz
        v = (rotation[1, 0] * a + rotation[1, 1] * b + rotation[1, 2] * d) / pz
        du, dv = uv[i, 0] - u * scale, uv[i, 1] - v * scale
        slope_u = (-u * v, 1.0 + u * u, -v, u)
        slope_v = (-1.0 - v * v, u * v, u, v)
        for j in range(4):
            pull[j] += weight * (slope_u[j] * du + slope_v[j] * dv)
            for k in range(j + 1):
                information[j, k] += weight * (slope_u[j] * slope_u[k] + slope_v[j] * slope_v[k])
    information[3, 3] += 1.0 / (scale_sigma * scale_sigma)
    pull[3] -= (scale - 1.0) / (scale_sigma * scale_sigma)
    _invert(information, covariance)
    x, y, z, s = 0.0, 0.0, 0.0, 0.0
    for k in range(4):
        x += covariance[0, k] * pull[k]
        y += covariance[1, k] * pull[k]
        z += covariance[2, k] * pull[k]
        s += covariance[3, k] * pull[k]
    turn(rotation, x, y, z)
    return scale + s


@compiled
def _invert(lower: NDArray[np.float64], inverse: NDArray[np.float64]) -> None:
    """Put the inverse of a positive definite matrix (n, n), given by its lower triangle, into ``inverse``.

    By Cholesky's decomposition, which replaces ``lower``; an unknown that nothing fixes gets a huge variance.
    """
    n = len(lower)
    for j in range(n):
        floor = 1e-13 * lower[j, j] + 1e-300
        for k in range(j):
            lower[j, j] -= lower[j, k] * lower[j, k]
        lower[j, j] = math.sqrt(max(lower[j, j], floor))
        for i in range(j + 1, n):
            for k in range(j):
                lower[i, j] -= lower[i, k] * lower[j, k]
            lower[i, j] /= lower[j, j]
    for j in range(n):
        lower[j, j] = 1.0 / lower[j, j]
        for i in range(j + 1, n):
            total = 0.0
            for k in range(j, i):
                total -= lower[i, k] * lower[k, j]
            lower[i, j] = total / lower[i, i]
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, n):
                total += lower[k, i] * lower[k, j]
            inverse[i, j] = inverse[j, i] = total


@compiled
def turn(rotation: NDArray[np.float64], x: float, y: float, z: float) -> None:
    """Turn the sensor's side of ``rotation`` by a small rotation vector, exactly orthogonal (Cayley's form)."""
    a, b, c = 0.5 * x, 0.5 * y, 0.5 * z
    norm = 1.0 / (1.0 + a * a + b * b + c * c)
    r00, r11, r22 = 1 + a * a - b * b - c * c, 1 - a * a + b * b - c * c, 1 - a * a - b * b + c * c
    r01, r10, r02 = 2 * (a * b - c), 2 * (a * b + c), 2 * (a * c + b)
    r20, r12, r21 = 2 * (a * c - b), 2 * (b * c - a), 2 * (b * c + a)
    for k in range(3):
        p, q, r = rotation[0, k], rotation[1, k], rotation[2, k]
        rotation[0, k] = (r00 * p + r01 * q + r02 * r) * norm
        rotation[1, k] = (r10 * p + r11 * q + r12 * r) * norm
        rotation[2, k] = (r20 * p + r21 * q + r22 * r) * norm


@compiled
def grow(
    tables: SkyTables,
    uv: NDArray[np.float64],
    order: NDArray[np.int64],
    first: NDArray[np.int64],
    field: NDArray[np.float64],
    rows: NDArray[np.int64],
    rotation: NDArray[np.float64],
    covariance: NDArray[np.float64],
    star_of: NDArray[np.int64],
    sigma: float,
    scale_sigma: float,
) -> tuple[int, float]:
    """Match and fit in turn until the matches stay the same; how many there are, and the scale.

    ``star_of`` (N,) comes with the matches that the hypothesis stands on and leaves with all of them; ``rotation`` and
    ``covariance`` (4, 4) follow.
    """
    before = np.empty_like(star_of)
    matched = 0
    scale = fit(tables, uv, rows, star_of, rotation, covariance, (1.0, scale_sigma), sigma)
    for _ in range(_MAX_ROUNDS):
        before[:] = star_of
        matched = match_field(tables, uv, order, first, field, rows, rotation, covariance, scale, sigma, star_of)
        if matched < 3:
            return matched, scale
        same = True
        for i in range(len(uv)):
            same = same and before[i] == star_of[i]
        if same:
            break
        scale = fit(tables, uv, rows, star_of, rotation, covariance, (scale, scale_sigma), sigma)
    return matched, scale


@compiled
def squared_residuals(
    tables: SkyTables,
    uv: NDArray[np.float64],
    rows: NDArray[np.int64],
    star_of: NDArray[np.int64],
    rotation: NDArray[np.float64],
    scale: float,
) -> float:
    """Sum of the squared distances of the matched objects from the places of their stars."""
    total = 0.0
    for i in range(len(uv)):
        if star_of[i] < 0:
            continue
        row = rows[star_of[i]]
        a, b, d = tables.icrs[row, 0], tables.icrs[row, 1], tables.icrs[row, 2]
        pz = rotation[2, 0] * a + rotation[2, 1] * b + rotation[2, 2] * d
        u = (rotation[0, 0] * a + rotation[0, 1] * b + rotation[0, 2] * d) / pz
        v = (rotation[1, 0] * a + rotation[1, 1] * b + rotation[1, 2] * d) / pz
        total += (uv[i, 0] - u * scale) ** 2 + (uv[i, 1] - v * scale) ** 2
    return total
