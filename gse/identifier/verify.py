"""Verification of one attitude: the full catalogue is projected, matched to the objects, and the attitude refined.

All is done on the tangent plane of the boresight: u = x / z and v = y / z of the sensor frame, where the noise of a
pixel is the same everywhere. Measured places are ``scale`` times those of the camera, where its focal length is a
little wrong. The unknowns are the small rotation vector in the sensor frame and that scale. Each star's gate holds the
noise and what the unknowns are still uncertain by at its place: a gate that grows with the distance from the stars
already matched. So a match starts where the hypothesis is sure of itself and spreads over the field.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gse.identifier.robust_tables import MAX_FIELD_STARS, SkyTables
from gse.process.jit import compiled, compiled_part

U_BINS = 64

SMALLEST_RANGE = 1e-9
"""Smallest range of the objects' u, for objects that all lie in one column."""


class Objects(NamedTuple):
    """The objects of a panorama: ``directions`` (N, 3), ``uv`` (N, 2), ``magnitude`` (N,) on the sensor's scale.

    ``order`` (N,) sorts them by u, and ``first`` (65,) are the places in it where each 64th of their range begins.
    """

    directions: NDArray[np.float64]
    uv: NDArray[np.float64]
    magnitude: NDArray[np.float64]
    order: NDArray[np.int64]
    first: NDArray[np.int64]


class Attempt(NamedTuple):
    """One attitude under verification: ``rotation`` (3, 3) ICRS to sensor, ``scale`` (1,), and their covariance (4, 4).

    ``rows`` (F,) are the stars of the field, brightest first, as rows of the tables; ``star_of`` (N,) is for each
    object the place of its star in ``rows``, or -1.
    """

    rotation: NDArray[np.float64]
    scale: NDArray[np.float64]
    covariance: NDArray[np.float64]
    rows: NDArray[np.int64]
    star_of: NDArray[np.int64]


class Noise(NamedTuple):
    """What is known of the sensor's errors, as standard deviations.

    A place in u and v errs by ``sigma`` at most; evidence is averaged over ``sigma_steps`` values upwards from
    ``smallest_sigma``. The scale errs by ``scale_sigma``, a magnitude by ``magnitude_sigma``; ``zero_point`` is the
    magnitude of index value 1, NaN where it is not known.
    """

    sigma: float
    smallest_sigma: float
    sigma_steps: int
    scale_sigma: float
    zero_point: float
    magnitude_sigma: float


@compiled_part
def noise_of(known: NDArray[np.float64], sigma: float) -> Noise:
    """What is known of a sensor, given as an array (5,) without the noise of a place, with that noise."""
    return Noise(sigma, known[0], int(known[1]), known[2], known[3], known[4])


@compiled_part
def with_noise(noise: Noise, sigma: float, scale_sigma: float) -> Noise:
    """The same with another noise of a place and another error of the scale."""
    return Noise(sigma, noise.smallest_sigma, noise.sigma_steps, scale_sigma, noise.zero_point, noise.magnitude_sigma)


@compiled_part
def outside_field(directions: NDArray[np.float64], field: NDArray[np.float64]) -> int:
    """The first object that no pixel of the detector can be, a hundredth of its width allowed; -1 where all can."""
    left, right, top, bottom, radius2, _ = field
    margin = 0.01 * (right - left)
    for i in range(len(directions)):
        x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
        inside = z > 0.0 and (left - margin) * z < x < (right + margin) * z
        inside = inside and (top - margin) * z < y < (bottom + margin) * z
        if not (inside and x * x + y * y < 1.03 * radius2 * z * z):
            return i
    return -1


@compiled
def outside_fields(
    directions: NDArray[np.float64], first: NDArray[np.int64], field: NDArray[np.float64], outside: NDArray[np.int64]
) -> None:
    """Put the ``outside_field`` of each of K panoramas, parts of the directions, into ``outside`` (K,)."""
    for k in range(len(outside)):
        outside[k] = outside_field(directions[first[k] : first[k + 1]], field)


@compiled_part
def objects_of(directions: NDArray[np.float64], brightness: NDArray[np.float64]) -> Objects:
    """The objects of unit vectors (N, 3) and brightness (N,)."""
    n = len(directions)
    uv, magnitude = np.empty((n, 2)), np.empty(n)
    order, first = np.empty(n, dtype=np.int64), np.empty(U_BINS + 1, dtype=np.int64)
    for i in range(n):
        uv[i, 0] = directions[i, 0] / directions[i, 2]
        uv[i, 1] = directions[i, 1] / directions[i, 2]
        magnitude[i] = -2.5 * math.log10(max(brightness[i], 1e-3))
        # Sorted by insertion: quick for thirty objects, and there is no sort to compile.
        j = i
        while j > 0 and uv[order[j - 1], 0] > uv[i, 0]:
            order[j] = order[j - 1]
            j -= 1
        order[j] = i
    low = uv[order[0], 0]
    width = max(uv[order[n - 1], 0] - low, SMALLEST_RANGE) / U_BINS
    position = 0
    for b in range(U_BINS):
        while position < n and uv[order[position], 0] < low + b * width:
            position += 1
        first[b] = position
    first[U_BINS] = n
    return Objects(directions, uv, magnitude, order, first)


@compiled_part
def attempt_at(tables: SkyTables, rotation: NDArray[np.float64], objects: int) -> Attempt:
    """The attempt to verify ``rotation``, with the brightest catalogue stars in (and a little around) the field."""
    rows = np.empty(min(MAX_FIELD_STARS, 2 * objects + 16), dtype=np.int64)
    left, right, top, bottom, radius2, _ = tables.field
    margin = 0.01 * (right - left)
    left, right, top, bottom = left - margin, right + margin, top - margin, bottom + margin
    # Each cell of the sky lists the stars that any boresight in it can see, brightest first: no search over the
    # catalogue, and when the list is cut at the number of objects it is the faint end that goes.
    cell = _cell_of(tables, rotation)
    count = 0
    for k in range(tables.cell_start[cell], tables.cell_start[cell + 1]):
        star = tables.cell_stars[k]
        x, y, z = tables.icrs[star, 0], tables.icrs[star, 1], tables.icrs[star, 2]
        pz = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z
        px = rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z
        py = rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z
        inside = (left * pz < px) & (px < right * pz) & (top * pz < py) & (py < bottom * pz)
        # No branch on whether a star is inside, which no processor predicts: always written, counted only if inside.
        rows[count] = star
        count += (pz > 0.0) & inside & (px * px + py * py < 1.03 * radius2 * pz * pz)
        if count == len(rows):
            break
    star_of = np.empty(objects, dtype=np.int64)
    for i in range(objects):
        star_of[i] = -1
    scale = np.empty(1)
    scale[0] = 1.0
    return Attempt(rotation, scale, np.empty((4, 4)), rows[:count], star_of)


@compiled_part
def _cell_of(tables: SkyTables, rotation: NDArray[np.float64]) -> int:
    """The sky cell of the boresight."""
    colatitude = math.acos(min(1.0, max(-1.0, rotation[2, 2])))
    ring = min(int(colatitude / tables.ring_rad), len(tables.ring_start) - 2)
    cells = int(tables.ring_start[ring + 1] - tables.ring_start[ring])
    turn = math.atan2(rotation[2, 1], rotation[2, 0]) / (2.0 * math.pi)
    return int(tables.ring_start[ring]) + min(int((turn - math.floor(turn)) * cells), cells - 1)


@compiled_part
def place(tables: SkyTables, attempt: Attempt, f: int) -> tuple[float, float]:
    """Where star f of the field is expected, u and v, before the scale."""
    r, star = attempt.rotation, attempt.rows[f]
    x, y, z = tables.icrs[star, 0], tables.icrs[star, 1], tables.icrs[star, 2]
    pz = r[2, 0] * x + r[2, 1] * y + r[2, 2] * z
    return (r[0, 0] * x + r[0, 1] * y + r[0, 2] * z) / pz, (r[1, 0] * x + r[1, 1] * y + r[1, 2] * z) / pz


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
