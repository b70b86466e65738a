"""Attitude of the sensor from identified stars: Wahba's problem, solved by Davenport's method."""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gse.process.jit import compiled, compiled_part
from gse.values.matrices import length, product

# Davenport's q method: the rotation that best takes stars to directions, compiled.
#
# The quaternion that minimises sum |b_i - A r_i|^2 / sigma_i^2 is the eigenvector of the greatest eigenvalue of a
# symmetric 4 x 4 matrix. Its eigenvectors come from Jacobi rotations and not from the characteristic polynomial of
# QUEST, because these stay exact for turns of 180 deg and for stars close to each other.

_MIN_SEPARATION_RAD = 1e-7
"""Directions closer than this (0.02 arcsec) to one line do not fix the roll."""
_JACOBI_SWEEPS = 20
"""Convergence is quadratic: 4 or 5 sweeps do, the rest is a cap."""


@compiled_part
def davenport(
    measured: NDArray[np.float64],
    stars: NDArray[np.float64],
    weights: NDArray[np.float64],
    rotation: NDArray[np.float64],
) -> bool:
    """Put the rotation (3, 3) that best takes ``stars`` (N, 3) to ``measured`` (N, 3) into ``rotation``.

    False, and nothing put, where something is not finite.
    """
    # The attitude profile matrix B = sum w_i b_i r_i^T: all that Wahba's problem needs of the stars is in these nine
    # sums.
    b = np.zeros((3, 3))
    total = 0.0
    for i in range(len(measured)):
        total += weights[i]
        for j in range(3):
            for k in range(3):
                b[j, k] += weights[i] * measured[i, j] * stars[i, k]
    if not (total > 0.0 and total < np.inf):
        return False
    # Davenport's K: a quadratic form in the quaternion whose value is the gain to maximise. Divided by the sum of
    # weights its greatest eigenvalue is near 1, whatever the weights, so that one threshold serves for convergence.
    #
    #     K = [ B + B^T - 1 tr B    z    ]      z = (B12 - B21, B20 - B02, B01 - B10)
    #         [        z^T         tr B  ]
    k4 = np.empty((4, 4))
    trace = (b[0, 0] + b[1, 1] + b[2, 2]) / total
    for j in range(3):
        for k in range(3):
            k4[j, k] = (b[j, k] + b[k, j]) / total
        k4[j, j] -= trace
    k4[3, 3] = trace
    k4[0, 3] = (b[1, 2] - b[2, 1]) / total
    k4[1, 3] = (b[2, 0] - b[0, 2]) / total
    k4[2, 3] = (b[0, 1] - b[1, 0]) / total
    for j in range(3):
        k4[3, j] = k4[j, 3]
    for j in range(4):
        for k in range(4):
            if not np.isfinite(k4[j, k]):
                return False
    # The best quaternion is the eigenvector of the greatest eigenvalue, which stands on the diagonal after Jacobi's
    # turns.
    vectors = np.eye(4)
    _jacobi(k4, vectors)
    best = 0
    for j in range(1, 4):
        if k4[j, j] > k4[best, best]:
            best = j
    _rotation_of(vectors[:, best], rotation)
    return True


@compiled_part
def _jacobi(matrix: NDArray[np.float64], vectors: NDArray[np.float64]) -> None:
    """Turn a symmetric matrix (4, 4) diagonal in place; the columns of ``vectors`` become its eigenvectors."""
    for _ in range(_JACOBI_SWEEPS):
        off = 0.0
        for p in range(3):
            for q in range(p + 1, 4):
                off += matrix[p, q] ** 2
        if off < 1e-34:
            return
        for p in range(3):
            for q in range(p + 1, 4):
                if matrix[p, q] != 0.0:
                    _jacobi_rotation(matrix, vectors, p, q)


@compiled_part
def _jacobi_rotation(matrix: NDArray[np.float64], vectors: NDArray[np.float64], p: int, q: int) -> None:
    """One rotation in the plane of p and q that makes matrix[p, q] zero (Golub & Van Loan, section 8.5)."""
    # Of the two angles that make the element zero the smaller one is taken: it disturbs what is diagonal already least.
    theta = (matrix[q, q] - matrix[p, p]) / (2.0 * matrix[p, q])
    t = 1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0))
    if theta < 0.0:
        t = -t
    c = 1.0 / math.sqrt(t * t + 1.0)
    s = t * c
    for k in range(4):
        a, b = matrix[k, p], matrix[k, q]
        matrix[k, p], matrix[k, q] = c * a - s * b, s * a + c * b
    for k in range(4):
        a, b = matrix[p, k], matrix[q, k]
        matrix[p, k], matrix[q, k] = c * a - s * b, s * a + c * b
        a, b = vectors[k, p], vectors[k, q]
        vectors[k, p], vectors[k, q] = c * a - s * b, s * a + c * b


@compiled_part
def _rotation_of(quaternion: NDArray[np.float64], rotation: NDArray[np.float64]) -> None:
    """The rotation (3, 3) of a unit quaternion (4,), scalar last, that turns axes (not vectors)."""
    x, y, z, w = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    rotation[0, 0] = w * w + x * x - y * y - z * z
    rotation[1, 1] = w * w - x * x + y * y - z * z
    rotation[2, 2] = w * w - x * x - y * y + z * z
    rotation[0, 1] = 2.0 * (x * y + w * z)
    rotation[1, 0] = 2.0 * (x * y - w * z)
    rotation[0, 2] = 2.0 * (x * z - w * y)
    rotation[2, 0] = 2.0 * (x * z + w * y)
    rotation[1, 2] = 2.0 * (y * z + w * x)
    rotation[2, 1] = 2.0 * (y * z - w * x)


@compiled_part
def attitude_covariance(
    measured: NDArray[np.float64], weights: NDArray[np.float64], covariance: NDArray[np.float64]
) -> bool:
    """Put the covariance (3, 3) of the rotation vector in the sensor frame into ``covariance``.

    The inverse of the Fisher information sum w_i (1 - b_i b_i^T), which Wahba's solution reaches. False where the
    directions (N, 3) lie on one line, and then one angle is not known at all.
    """
    # A star tells nothing of a turn about itself: hence 1 - b b^T, the plane across it. Stars of a small field all
    # leave nearly the same turn open, the roll, which is why roll is 1 / (width of the field) times worse than the
    # others.
    f = np.zeros((3, 3))
    total = 0.0
    for i in range(len(measured)):
        total += weights[i]
        for j in range(3):
            for k in range(3):
                f[j, k] -= weights[i] * measured[i, j] * measured[i, k]
    for j in range(3):
        f[j, j] += total
    for j in range(3):
        # Inverse by cofactors: indices that go round give each cofactor its sign.
        j1, j2 = (j + 1) % 3, (j + 2) % 3
        for k in range(3):
            k1, k2 = (k + 1) % 3, (k + 2) % 3
            covariance[k, j] = f[j1, k1] * f[j2, k2] - f[j1, k2] * f[j2, k1]
    determinant = f[0, 0] * covariance[0, 0] + f[0, 1] * covariance[1, 0] + f[0, 2] * covariance[2, 0]
    if not determinant > _MIN_SEPARATION_RAD**2 * total**3:
        return False
    for j in range(3):
        for k in range(3):
            covariance[j, k] /= determinant
    return True


@dataclass(frozen=True, slots=True, eq=False)
class Attitude:
    """A rotation from ICRS axes to the sensor frame; RA, DE and roll are what it answers.

    ``icrs_to_sensor`` is (3, 3), v_sensor = icrs_to_sensor @ v_icrs, so its rows are the sensor's axes in ICRS.
    ``covariance_rad2`` is (3, 3), of the small rotation vector in the sensor frame (x, y across the boresight, z
    about it).
    """

    icrs_to_sensor: NDArray[np.float64]
    covariance_rad2: NDArray[np.float64]

    @classmethod
    def from_angles(cls, ra_deg: float, de_deg: float, roll_deg: float) -> Self:
        """The attitude that answers these angles, with zero covariance."""
        ra, de, roll = math.radians(ra_deg), math.radians(de_deg), math.radians(roll_deg)
        cos_ra, sin_ra, cos_de, sin_de = math.cos(ra), math.sin(ra), math.cos(de), math.sin(de)
        cos_roll, sin_roll = math.cos(roll), math.sin(roll)
        x, y, z = cos_de * cos_ra, cos_de * sin_ra, sin_de
        up_x = cos_roll * -sin_de * cos_ra + sin_roll * -sin_ra
        up_y = cos_roll * -sin_de * sin_ra + sin_roll * cos_ra
        up_z = cos_roll * cos_de
        right = (-up_y * z + up_z * y, -up_z * x + up_x * z, -up_x * y + up_y * x)  # columns: down x boresight
        return cls(np.array([*right, -up_x, -up_y, -up_z, x, y, z]).reshape(3, 3), np.zeros((3, 3)))

    @property
    def boresight_icrs(self) -> NDArray[np.float64]:
        """Unit vector of the boresight in ICRS axes."""
        boresight: NDArray[np.float64] = self.icrs_to_sensor[2]
        return boresight

    @property
    def ra_deg(self) -> float:
        """Right ascension of the boresight, 0 <= RA < 360."""
        return float(angles_deg(self.icrs_to_sensor[None])[0, 0])

    @property
    def de_deg(self) -> float:
        """Declination of the boresight."""
        return float(angles_deg(self.icrs_to_sensor[None])[0, 1])

    @property
    def roll_deg(self) -> float:
        """Position angle of image up (towards row 0) at the boresight, from north through east, 0 <= roll < 360."""
        return float(angles_deg(self.icrs_to_sensor[None])[0, 2])


@dataclass(frozen=True, slots=True, eq=False)
class Attitudes:
    """Attitudes of K panoramas as columns, NaN where there is none; ``attitudes[k]`` is a view of one, or None.

    ``icrs_to_sensor`` and ``covariance_rad2`` are (K, 3, 3).
    """

    icrs_to_sensor: NDArray[np.float64]
    covariance_rad2: NDArray[np.float64]

    @classmethod
    def none(cls, count: int) -> Self:
        """No attitude for so many panoramas."""
        return cls(np.full((count, 3, 3), np.nan), np.full((count, 3, 3), np.nan))

    def __len__(self) -> int:
        return len(self.icrs_to_sensor)

    def __getitem__(self, k: int) -> Attitude | None:
        rotation = self.icrs_to_sensor[k]
        return None if math.isnan(rotation[2, 2]) else Attitude(rotation, self.covariance_rad2[k])

    def __setitem__(self, k: int, attitude: Attitude) -> None:
        self.icrs_to_sensor[k], self.covariance_rad2[k] = attitude.icrs_to_sensor, attitude.covariance_rad2

    def part(self, begin: int, end: int) -> Self:
        """The attitudes from ``begin`` to before ``end``."""
        return type(self)(self.icrs_to_sensor[begin:end], self.covariance_rad2[begin:end])

    @property
    def boresights_icrs(self) -> NDArray[np.float64]:
        """Unit vectors (K, 3) of the boresights in ICRS axes."""
        boresights: NDArray[np.float64] = self.icrs_to_sensor[:, 2]
        return boresights

    def among(self, places: NDArray[np.bool_]) -> Self:
        """These attitudes at the places that are true, none at the others."""
        if len(self) == len(places):
            return self
        made = self.none(len(places))
        made.icrs_to_sensor[places], made.covariance_rad2[places] = self.icrs_to_sensor, self.covariance_rad2
        return made


def angles_deg(icrs_to_sensor: NDArray[np.float64]) -> NDArray[np.float64]:
    """RA, DE and roll (K, 3) of rotations (K, 3, 3), as ``Attitude`` gives them one by one; NaN of NaN."""
    angles = np.empty((len(icrs_to_sensor), 3))
    _angles(np.ascontiguousarray(icrs_to_sensor, dtype=np.float64), angles)
    return angles


def solve_attitude(
    directions_sensor: NDArray[np.float64], stars_icrs: NDArray[np.float64], sigma_rad: ArrayLike
) -> Attitude:
    """The attitude that turns stars (N, 3) in ICRS into measured directions (N, 3), all unit vectors, N >= 2.

    ``sigma_rad`` is the standard deviation of a direction on each of its two axes, one for all or (N,): it weighs the
    stars and gives the covariance (the inverse of the Fisher information). ValueError where the directions do not fix
    an attitude.
    """
    measured, stars = _rows_of_three(directions_sensor), _rows_of_three(stars_icrs)
    if len(measured) != len(stars):
        raise ValueError(f"{len(measured)} directions came with {len(stars)} stars: expected one star per direction")
    if len(measured) < 2:
        raise ValueError(f"{len(measured)} direction(s) do not fix an attitude: expected at least 2")
    sigma = sigma_rad if isinstance(sigma_rad, float) else np.asarray(sigma_rad, dtype=np.float64)
    if not (0 < sigma < np.inf if isinstance(sigma, float) else ((sigma > 0) & (sigma < np.inf)).all()):
        raise ValueError(f"sigma_rad is {sigma_rad!r:.60}: expected positive angles in radians")
    weights = np.empty(len(measured))
    weights[:] = sigma**-2.0
    attitude = np.empty((2, 3, 3))
    if not _solve(measured, stars, weights, attitude):
        raise ValueError("the directions are parallel or not finite: they do not fix an attitude")
    return Attitude(attitude[0], attitude[1])


def solve_attitudes(
    directions_sensor: NDArray[np.float64], stars_icrs: NDArray[np.float64], ends: NDArray[np.int64], sigma_rad: float
) -> Attitudes:
    """``solve_attitude`` for K panoramas: panorama k has the rows from ``ends[k - 1]`` (or 0) to ``ends[k]``."""
    measured, stars = _rows_of_three(directions_sensor), _rows_of_three(stars_icrs)
    attitudes = np.empty((len(ends), 2, 3, 3))
    if _solve_each(measured, stars, ends, sigma_rad**-2.0, attitudes) < len(ends):
        raise ValueError("the directions are parallel or not finite: they do not fix an attitude")
    return Attitudes(attitudes[:, 0], attitudes[:, 1])


def paper_mean(attitude: Attitude, directions_sensor: NDArray[np.float64], stars_icrs: NDArray[np.float64]) -> Attitude:
    """The attitude whose boresight is the mean of the sensor centres that each identified star gives by itself.

    The mean of RA and DE about the sensor centre of the LAPAN paper, section 1: for each star the attitude is turned by
    the smallest rotation that puts the star exactly on its direction; the unit vectors of the centres are added, so
    that poles and RA 0 are not special. Roll and covariance stay those of ``attitude``.
    """
    measured, stars = _rows_of_three(directions_sensor), _rows_of_three(stars_icrs)
    boresight = np.array([0.0, 0.0, 1.0])
    centres_sensor = _turned(boresight, measured, product(stars, attitude.icrs_to_sensor.T))
    mean = centres_sensor.sum(axis=0)
    mean /= length(mean)
    to_mean = np.array([_turned(axis, mean[None], boresight[None])[0] for axis in np.eye(3)]).T
    return Attitude(product(to_mean, attitude.icrs_to_sensor), attitude.covariance_rad2)


def _turned(vector: NDArray[np.float64], start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.float64]:
    """A vector (3,) under each of the smallest rotations that take ``start`` (N, 3) to ``end`` (N, 3)."""
    axis = np.cross(start, end)
    cosine = (start * end).sum(axis=1)[:, None]
    turned: NDArray[np.float64] = (
        cosine * vector + np.cross(axis, vector) + axis * product(axis, vector)[:, None] / (1.0 + cosine)
    )
    return turned


def _rows_of_three(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    rows = np.ascontiguousarray(vectors, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise ValueError(f"unit vectors came with the shape {rows.shape}: expected (N, 3)")
    return rows


@compiled
def _angles(rotations: NDArray[np.float64], angles: NDArray[np.float64]) -> None:
    """Put RA, DE and roll of rotations (K, 3, 3), in degrees, into ``angles`` (K, 3)."""
    for k in range(len(rotations)):
        up_x, up_y, up_z = -rotations[k, 1, 0], -rotations[k, 1, 1], -rotations[k, 1, 2]
        x, y, z = rotations[k, 2, 0], rotations[k, 2, 1], rotations[k, 2, 2]
        ra, level = math.atan2(y, x), math.hypot(x, y)
        east = -math.sin(ra) * up_x + math.cos(ra) * up_y
        north = level * up_z - z * (math.cos(ra) * up_x + math.sin(ra) * up_y)
        angles[k, 0] = math.degrees(ra) % 360.0
        angles[k, 1] = math.degrees(math.atan2(z, level))
        angles[k, 2] = math.degrees(math.atan2(east, north)) % 360.0


@compiled
def _solve(
    measured: NDArray[np.float64],
    stars: NDArray[np.float64],
    weights: NDArray[np.float64],
    attitude: NDArray[np.float64],
) -> bool:
    """Put rotation and covariance, (2, 3, 3), into ``attitude``; False where the directions do not fix one."""
    return davenport(measured, stars, weights, attitude[0]) and attitude_covariance(measured, weights, attitude[1])


@compiled
def _solve_each(
    measured: NDArray[np.float64],
    stars: NDArray[np.float64],
    ends: NDArray[np.int64],
    weight: float,
    attitudes: NDArray[np.float64],
) -> int:
    """Put an attitude (2, 3, 3) for each part of the rows into ``attitudes``; how many parts fixed one."""
    begin = 0
    for k in range(len(ends)):
        weights = np.full(ends[k] - begin, weight)
        if not _solve(measured[begin : ends[k]], stars[begin : ends[k]], weights, attitudes[k]):
            return k
        begin = ends[k]
    return len(ends)
