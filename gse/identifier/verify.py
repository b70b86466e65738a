"""Verification of one attitude: the full catalogue is projected, matched to the objects, and the attitude refined.

All is done on the tangent plane of the boresight. The unknowns are the small rotation vector in the sensor frame and
the scale. Each star's gate holds the noise and what the unknowns are still uncertain by at its place: a gate that grows
with the distance from the stars already matched. So a match starts where the hypothesis is sure of itself and spreads
over the field.
"""

import math

import numpy as np
from numpy.typing import NDArray

from gse.identifier.robust_tables import SkyTables
from gse.identifier.tangent_plane import SMALLEST_RANGE, U_BINS, Attempt, Noise, Objects, place
from gse.process.jit import compiled_part

# Compiled Gauss-Newton step of an attitude: a small rotation in the sensor frame, and the scale.


@compiled_part
def fit(tables: SkyTables, objects: Objects, attempt: Attempt, noise: Noise) -> None:
    """One Gauss-Newton step of rotation and scale on the matched objects, and the new covariance."""
    # Least squares for four unknowns, a small turn (x, y, z) and the scale s. A turn moves a place (u, v) on the
    # tangent plane by du = y (1 + u^2) - x u v - z v + s u, dv = -x (1 + v^2) + y u v + z u + s v: the rows ``slope_u``
    # and ``slope_v``. Normal equations are safe here, since places are of order one and the noise is not.
    information, pull, step = np.empty((4, 4)), np.empty(4), np.empty(4)
    scale, covariance = attempt.scale[0], attempt.covariance
    for j in range(4):
        pull[j] = step[j] = 0.0
        for k in range(4):
            information[j, k] = 0.0
    weight = 1.0 / (noise.sigma * noise.sigma)
    for i in range(len(objects.uv)):
        if attempt.star_of[i] < 0:
            continue
        u, v = place(tables, attempt, attempt.star_of[i])
        du, dv = objects.uv[i, 0] - u * scale, objects.uv[i, 1] - v * scale
        slope_u = (-u * v, 1.0 + u * u, -v, u)
        slope_v = (-1.0 - v * v, u * v, u, v)
        for j in range(4):
            pull[j] += weight * (slope_u[j] * du + slope_v[j] * dv)
            for k in range(j + 1):
                information[j, k] += weight * (slope_u[j] * slope_u[k] + slope_v[j] * slope_v[k])
    # A camera's focal length is known beforehand: that is one more measurement, of the scale, with its own sigma.
    prior = 1.0 / (noise.scale_sigma * noise.scale_sigma)
    information[3, 3] += prior
    pull[3] -= prior * (scale - 1.0)
    _invert(information, covariance)
    for j in range(4):
        for k in range(4):
            step[j] += covariance[j, k] * pull[k]
    _turn(attempt.rotation, step[0], step[1], step[2])
    attempt.scale[0] += step[3]


@compiled_part
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


@compiled_part
def _turn(rotation: NDArray[np.float64], x: float, y: float, z: float) -> None:
    """Turn the sensor's side of ``rotation`` by a small rotation vector, exactly orthogonal (Cayley's form)."""
    # (1 - S/2)^-1 (1 + S/2) with S the cross product matrix is a rotation to the last digit whatever the step, so that
    # many steps leave no shear; to first order it is 1 + S.
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


GATE_CHI2 = 13.0
"""Squared gate in sigmas of a two-dimensional normal: 0.15 % of true stars fall outside."""

_MAX_ROUNDS = 10

_MAX_GATE_SHARE = 0.02
"""A gate that covers more than this share of the field (times the objects in it) decides nothing: it is skipped for
now."""


@compiled_part
def _place_covariance(c: NDArray[np.float64], u: float, v: float) -> tuple[float, float, float]:
    """Variance of u, of v, and their covariance at a place, from the covariance (4, 4) of rotation and scale.

    With du = y - v z + u s and dv = -x + u z + v s; terms of second order in u and v do not matter to a gate.
    """
    uu = c[1, 1] + v * v * c[2, 2] + u * u * c[3, 3] + 2.0 * (u * c[1, 3] - v * c[1, 2] - u * v * c[2, 3])
    vv = c[0, 0] + u * u * c[2, 2] + v * v * c[3, 3] + 2.0 * (u * v * c[2, 3] - u * c[0, 2] - v * c[0, 3])
    uv = u * v * (c[3, 3] - c[2, 2]) + (u * u - v * v) * c[2, 3]
    return uu, vv, uv + u * (c[1, 2] - c[0, 3]) + v * (c[1, 3] + c[0, 2]) - c[0, 1]


@compiled_part
def _match(tables: SkyTables, objects: Objects, attempt: Attempt, sigma: float) -> int:
    """Give each object the star it lies nearest to in sigmas, if in its gate; how many have one.

    A star goes to one object only, and an object to one star.
    """
    uv, star_of = objects.uv, attempt.star_of
    n = len(uv)
    chi2 = np.empty(n)
    for i in range(n):
        star_of[i] = -1
        chi2[i] = GATE_CHI2
    low = uv[objects.order[0], 0]
    bins_per_u = U_BINS / max(uv[objects.order[n - 1], 0] - low, SMALLEST_RANGE)
    # Where the attitude is still so uncertain that the gates of all objects would cover most of the field, a match
    # means nothing: such a star is passed over until the fit knows more.
    widest = (_MAX_GATE_SHARE * tables.field[5] / (math.pi * GATE_CHI2 * n)) ** 2
    matched = 0
    for f in range(len(attempt.rows)):
        u, v = place(tables, attempt, f)
        u, v = u * attempt.scale[0], v * attempt.scale[0]
        suu, svv, suv = _place_covariance(attempt.covariance, u, v)
        suu, svv = suu + sigma * sigma, svv + sigma * sigma
        determinant = suu * svv - suv * suv
        # The gate is an ellipse: noise of a place plus what the attitude leaves open there. Objects are sorted by u, so
        # only those within its width in u are measured.
        reach = math.sqrt(GATE_CHI2 * suu)
        start = int((u - reach - low) * bins_per_u)
        if not determinant < widest or start >= U_BINS:
            continue
        best, best_chi2 = -1, GATE_CHI2
        for k in range(objects.first[max(start, 0)], n):
            i = objects.order[k]
            du, dv = uv[i, 0] - u, uv[i, 1] - v
            if du > reach:
                break
            distance = (svv * du * du - 2.0 * suv * du * dv + suu * dv * dv) / determinant
            if distance < best_chi2:
                best, best_chi2 = i, distance
        if best >= 0 and best_chi2 < chi2[best]:
            matched += star_of[best] < 0
            star_of[best] = f
            chi2[best] = best_chi2
    return matched


@compiled_part
def grow(tables: SkyTables, objects: Objects, attempt: Attempt, noise: Noise) -> int:
    """Match and fit in turn until the matches stay the same; how many there are, 0 where it comes to nothing.

    ``attempt.star_of`` comes with the matches that the hypothesis stands on and leaves with all of them; rotation,
    scale and covariance follow.
    """
    n = len(objects.uv)
    before = np.empty(n, dtype=np.int64)
    matched = 0
    # As in an iterated closest point: a better attitude has smaller gates, finds more stars, and is better still.
    fit(tables, objects, attempt, noise)
    for _ in range(_MAX_ROUNDS):
        same = True
        for i in range(n):
            before[i] = attempt.star_of[i]
        matched = _match(tables, objects, attempt, noise.sigma)
        if matched < 3:
            return 0
        for i in range(n):
            same = same and before[i] == attempt.star_of[i]
        if same:
            break
        fit(tables, objects, attempt, noise)
    return matched


@compiled_part
def squared_residuals(tables: SkyTables, objects: Objects, attempt: Attempt) -> float:
    """Sum of the squared distances of the matched objects from the places of their stars."""
    total = 0.0
    for i in range(len(objects.uv)):
        if attempt.star_of[i] >= 0:
            u, v = place(tables, attempt, attempt.star_of[i])
            total += (objects.uv[i, 0] - u * attempt.scale[0]) ** 2 + (objects.uv[i, 1] - v * attempt.scale[0]) ** 2
    return total


@compiled_part
def named(star_of: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The objects that have a star, and their stars."""
    objects, stars = np.empty(len(star_of), dtype=np.int64), np.empty(len(star_of), dtype=np.int64)
    count = 0
    for i in range(len(star_of)):
        if star_of[i] >= 0:
            objects[count], stars[count] = i, star_of[i]
            count += 1
    return objects[:count], stars[:count]
