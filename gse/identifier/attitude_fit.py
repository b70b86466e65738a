"""Compiled Gauss-Newton step of an attitude: a small rotation in the sensor frame, and the scale."""

import math

import numpy as np
from numpy.typing import NDArray

from gse.identifier.robust_tables import SkyTables
from gse.identifier.tangent_plane import Attempt, Noise, Objects, place
from gse.process.jit import compiled_part


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
