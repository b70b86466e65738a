"""The objects of a panorama, and the stars expected for an attitude, on the tangent plane of the boresight.

u = x / z and v = y / z of the sensor frame, where the noise of a pixel is the same everywhere. Measured places are
``scale`` times those of the camera, where its focal length is a little wrong.
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
