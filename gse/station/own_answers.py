"""The sensor's own answers against the truth: what an errorless sensor would send, and how far off it is.

A sensor answers from the catalogue places of the stars that it sees: it knows no air, and a simple one no aberration.
So truth is brought to the same: the geometric direction of the mount, less what refraction, and aberration where it is
left in, move it by. Air bends what is lower by more, and a fit of stars over the field takes the mean of that: over 14
deg at an altitude of 22 deg it lies 12 arcsec from the bend at the boresight.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gse.attitude_convention import AttitudeConvention, read_angles, read_quaternions
from gse.camera import Camera
from gse.constants import ARCSEC_PER_RAD
from gse.instant import NS_PER_S
from gse.mount import Mount
from gse.station.attitude_table import ANGLES, QUATERNION
from gse.truth import SiderealTruth, horizon_to_sensor
from gse.truth.frames import icrs_to_frame

_CELL_NS = 60 * NS_PER_S
"""Aberration and refraction of the boresight change by 0.01 arcsec in this time."""
_CELLS_KEPT = 4096
_NEAR = np.array([[0.0, 0.0, 1.0], [1e-3, 0.0, 1.0], [0.0, 1e-3, 1.0]]) / np.sqrt([[1.0], [1.000001], [1.000001]])
_LOWEST = 0.05
"""Sine of 3 deg: stars below are seen by no sensor."""
_GRID = 9


def measured_rotations(
    answers: NDArray[np.void], utc_ns: NDArray[np.int64], convention: AttitudeConvention
) -> NDArray[np.float64]:
    """Rotations (M, 3, 3) from ICRS to the sensor that rows of OWN_ANSWER state for instants (M,).

    Angles count where a row has RA and DE, else its quaternion.
    """
    angles = np.column_stack([answers[name] for name in ANGLES])
    by_angle = np.isfinite(angles[:, :2]).all(axis=1)
    read = np.empty((len(answers), 3, 3))
    read[by_angle] = read_angles(angles[by_angle], convention)
    quaternions = np.column_stack([answers[name][~by_angle] for name in QUATERNION])
    read[~by_angle] = read_quaternions(quaternions, convention)
    return read @ icrs_to_frame(convention.frame, utc_ns)


def field_of(camera: Camera) -> NDArray[np.float64]:
    """Directions (N, 3) evenly over the detector of a camera."""
    x, y = ((np.arange(_GRID) + 0.5) * size / _GRID - 0.5 for size in (camera.columns, camera.rows))
    return camera.directions(np.stack(np.meshgrid(x, y), axis=-1))


@dataclass(slots=True)
class OwnAnswerTruth:
    """What a sensor on a mount answers that makes no error; ``aberration_corrected`` as its convention says.

    ``field_sensor`` (N, 3) are directions over its field; without them it is taken as small.
    """

    truth: SiderealTruth
    mount: Mount
    aberration_corrected: bool = False
    field_sensor: NDArray[np.float64] | None = None
    _shifts: dict[int, NDArray[np.float64]] = field(default_factory=dict)

    def expected(self, utc_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Rotations (M, 3, 3) from ICRS to the sensor at instants (M,)."""
        geometric = horizon_to_sensor(self.mount) @ self.truth.icrs_to_horizon_at(utc_ns)
        return self.shifts(utc_ns) @ geometric

    def shifts(self, utc_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Rotations (M, 3, 3) in the sensor frame from the geometric attitude to the one that the sensor answers."""
        cells, of_cell = np.unique(utc_ns // _CELL_NS, return_inverse=True)
        return np.array([self._shift(cell) for cell in cells.tolist()]).reshape(-1, 3, 3)[of_cell]

    def uneven_arcsec(self, utc_ns: int) -> float:
        """How far (rms) air and aberration part the stars of the field, so that a few of them have another mean."""
        if self.field_sensor is None:
            return 0.0
        seen, stars = self._stars(utc_ns)
        left = seen - stars @ _fitted(seen, stars).T
        return math.sqrt(float((left**2).sum(axis=1).mean())) * ARCSEC_PER_RAD

    def _shift(self, cell: int) -> NDArray[np.float64]:
        shift = self._shifts.get(cell)
        if shift is None:
            if len(self._shifts) >= _CELLS_KEPT:
                self._shifts.clear()
            shift = self._shifts[cell] = self._computed(cell * _CELL_NS + _CELL_NS // 2)
        return shift

    def _computed(self, utc_ns: int) -> NDArray[np.float64]:
        seen, stars = self._stars(utc_ns)
        # of a small field the boresight by its star, the turn about it by the stars beside it
        return _triad(seen) @ _triad(stars).T if seen is _NEAR else _fitted(seen, stars)

    def _stars(self, utc_ns: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Directions (N, 3) of the field, and where the mount has the stars seen there, in the sensor frame."""
        geometric = self.truth.attitude_true(utc_ns, self.mount).icrs_to_sensor
        zenith_sensor = geometric @ self.truth.icrs_to_horizon(utc_ns)[2]
        seen = _NEAR if self.field_sensor is None else self.field_sensor
        up = seen @ zenith_sensor > _LOWEST
        if not up.all():
            seen = seen[up] if up.sum() >= len(_NEAR) else _NEAR
        stars = self.truth.unrefracted(seen, zenith_sensor) @ geometric
        if not self.aberration_corrected:
            stars = self._catalogue_places(stars, utc_ns)
        return seen, stars @ geometric.T

    def _catalogue_places(self, apparent: NDArray[np.float64], utc_ns: int) -> NDArray[np.float64]:
        stars = apparent.copy()
        for _ in range(3):
            stars -= self.truth.apparent(stars, utc_ns) - apparent
            stars /= np.linalg.norm(stars, axis=1)[:, None]
        return stars


def _fitted(seen: NDArray[np.float64], true: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rotation (3, 3) that turns true directions (N, 3) into those that are seen, by Wahba's least squares."""
    u, _, vt = np.linalg.svd(seen.T @ true)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)


def _triad(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Axes in columns: z along the first direction (3,), x by the mean of what two beside it, along x and y, show.

    Refraction shears the field: by either of the two alone the turn would be some arcsec off, one way or the other.
    """
    z = vectors[0] / np.linalg.norm(vectors[0])
    beside = vectors[1:] - (vectors[1:] @ z)[:, None] * z
    along_x, along_y = beside / np.linalg.norm(beside, axis=1)[:, None]
    x = along_x + np.cross(along_y, z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
