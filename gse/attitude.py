"""Attitude of the sensor from identified stars: Wahba's problem, solved by Davenport's method (gse.davenport)."""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gse.davenport import attitude_covariance, davenport
from gse.matrices import length, product
from gse.process.jit import compiled


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
