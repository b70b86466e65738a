"""The camera model: pixels to directions in the sensor frame, and back."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_UNDISTORTED_WITHIN_PX = 1e-9
_MOST_STEPS = 60
"""Newton's method takes 3 to 6 for the lenses of sensors, 20 where the map hardly grows; more only where it fails."""
_MOST_HALVINGS = 12
LEAST_SCALE = 0.02
"""Least scale of the map of pixels to undistorted pixels, against that at the principal point: near 0 it folds."""
_GRID = 129
"""Places along each side of the detector at which the scale is looked at: between two it changes by less than 0.002."""


@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole with radial and tangential distortion (Brown 1966).

    The sensor frame is x along columns, y along rows (down), z out of the boresight.

    Pixels are 0-based at pixel centres. ``radial_distortion`` (k1, k2):
    r_undistorted = r (1 + k1 s^2 + k2 s^4) with s = r / (columns / 2), r from the principal point.
    ``tangential_distortion`` (p1, p2) adds 2 p1 u v + p2 (s^2 + 2 u^2) to u and p1 (s^2 + 2 v^2) + 2 p2 u v to v, where
    (u, v) is the measured offset in units of columns / 2: OpenCV's terms in OpenCV's order. OpenCV has them from ideal
    to measured places, in units of the focal length: p1 and p2 here are -columns / (2 focal_length_px) times OpenCV's.
    A ``mirrored`` image has its x flipped, so that directions are right-handed again.
    """

    rows: int
    columns: int
    focal_length_px: float
    principal_point_px: tuple[float, float]
    radial_distortion: tuple[float, float] = (0.0, 0.0)
    mirrored: bool = False
    tangential_distortion: tuple[float, float] = (0.0, 0.0)

    def directions(self, xy_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Unit vectors (N, 3) in the sensor frame of pixels (N, 2)."""
        pixels = np.asarray(xy_px, dtype=np.float64).reshape(-1, 2)
        vectors = np.empty((len(pixels), 3))
        vectors[:, 2] = self.focal_length_px
        offset = vectors[:, :2]
        np.subtract(pixels, self.principal_point_px, out=offset)
        if self._is_distorted:
            offset[:] = self._undistorted(offset)
        if self.mirrored:
            offset[:, 0] = -offset[:, 0]
        vectors /= np.sqrt(np.einsum("ij,ij->i", vectors, vectors))[:, None]
        return vectors

    def pixels(self, directions_sensor: NDArray[np.float64]) -> NDArray[np.float64]:
        """Pixels (N, 2) of directions (N, 3) in the sensor frame; NaN behind the camera, and where no pixel looks."""
        v = np.asarray(directions_sensor, dtype=np.float64).reshape(-1, 3)
        z = np.where(v[:, 2] > 0, v[:, 2], np.nan)
        undistorted = v[:, :2] / z[:, None] * self.focal_length_px
        if self.mirrored:
            undistorted[:, 0] = -undistorted[:, 0]
        return self._distorted(undistorted) + self.principal_point_px

    def fold(self) -> tuple[float, float, float] | None:
        """The place (x, y) where the distortion folds the detector, or nearly so, and the scale there; None if nowhere.

        The map from offsets to undistorted ones is the gradient of a function (all of Brown's terms are), so it is
        one-to-one on a rectangle where the smaller eigenvalue of its derivative, the least scale, is positive.
        """
        if not self._is_distorted:
            return None
        x, y = self.principal_point_px
        across = np.linspace(min(x, -0.5), max(x, self.columns - 0.5), _GRID)
        down = np.linspace(min(y, -0.5), max(y, self.rows - 0.5), _GRID)
        places = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
        by_x, by_both, by_y = self._derivative(places - self.principal_point_px)
        scales = (by_x + by_y) / 2 - np.hypot((by_x - by_y) / 2, by_both)
        least = int(scales.argmin())
        return None if scales[least] >= LEAST_SCALE else (*places[least].tolist(), float(scales[least]))

    @property
    def _is_distorted(self) -> bool:
        return any(self.radial_distortion) or any(self.tangential_distortion)

    def _undistorted(self, offset_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Undistorted offsets (N, 2) from the principal point of measured ones."""
        k1, k2 = self.radial_distortion
        undistorted = offset_px
        if k1 or k2:
            s2 = (offset_px**2).sum(axis=1) / (self.columns / 2) ** 2
            undistorted = offset_px * (1 + s2 * (k1 + s2 * k2))[:, None]
        if any(self.tangential_distortion):
            undistorted = undistorted + self._tangential(offset_px)
        return undistorted

    def _derivative(self, offset_px: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """Derivatives (N,) of the undistorted offsets: of x by x, of x by y, which is that of y by x, and of y by y."""
        (k1, k2), (p1, p2) = self.radial_distortion, self.tangential_distortion
        u, v = (offset_px / (self.columns / 2)).T
        s2 = u * u + v * v
        stretch, bend = 1 + s2 * (k1 + s2 * k2), 2 * (k1 + 2 * k2 * s2)
        by_x = stretch + bend * u * u + 2 * p1 * v + 6 * p2 * u
        by_y = stretch + bend * v * v + 6 * p1 * v + 2 * p2 * u
        return by_x, bend * u * v + 2 * p1 * u + 2 * p2 * v, by_y

    def _distorted(self, undistorted: NDArray[np.float64]) -> NDArray[np.float64]:
        """Measured offsets (N, 2) of undistorted ones, by Newton's method; NaN where there is none.

        It begins no farther out than the detector reaches: beyond, a map that is one-to-one here may fold.
        """
        if not self._is_distorted:
            return undistorted.copy()
        (x, y), half = self.principal_point_px, 0.5
        reach_px = math.hypot(max(x + half, self.columns - half - x), max(y + half, self.rows - half - y))
        with np.errstate(all="ignore"):
            far = np.sqrt((undistorted**2).sum(axis=1)) / reach_px
            offset: NDArray[np.float64] = undistorted / np.maximum(far, 1.0)[:, None]
            active = np.flatnonzero(np.isfinite(far))
            for _ in range(_MOST_STEPS):
                step = self._step(offset[active], undistorted[active])
                offset[active] += step
                active = active[np.abs(step).max(axis=1) > _UNDISTORTED_WITHIN_PX]
                if not len(active):
                    break
            missed_px = np.abs(self._undistorted(offset) - undistorted).max(axis=1)
            offset[~(missed_px < 10 * _UNDISTORTED_WITHIN_PX * np.maximum(far, 1.0))] = np.nan
        return np.asarray(offset)

    def _step(self, offset: NDArray[np.float64], wanted: NDArray[np.float64]) -> NDArray[np.float64]:
        """Steps (N, 2) of Newton's method, each halved until it brings its place nearer to what is wanted."""
        missing = wanted - self._undistorted(offset)
        by_x, by_both, by_y = self._derivative(offset)
        determinant = by_x * by_y - by_both * by_both
        step_x = (by_y * missing[:, 0] - by_both * missing[:, 1]) / determinant
        step_y = (by_x * missing[:, 1] - by_both * missing[:, 0]) / determinant
        step = np.column_stack([step_x, step_y])
        before_px2 = (missing**2).sum(axis=1)
        for _ in range(_MOST_HALVINGS):
            left_px2 = ((wanted - self._undistorted(offset + step)) ** 2).sum(axis=1)
            worse = ~(left_px2 <= before_px2)
            if not worse.any():
                break
            step[worse] /= 2
        return step

    def _tangential(self, offset_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """By how much tangential distortion moves offsets (N, 2) from the principal point, in pixels."""
        half = self.columns / 2
        p1, p2 = self.tangential_distortion
        u, v = (offset_px / half).T
        s2 = u * u + v * v
        return half * np.column_stack([2 * p1 * u * v + p2 * (s2 + 2 * u * u), p1 * (s2 + 2 * v * v) + 2 * p2 * u * v])

    def contains(self, xy_px: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which pixels (N, 2) lie on the detector, its border pixels' outer edges included; NaN does not."""
        x, y = xy_px[:, 0], xy_px[:, 1]
        return (x >= -0.5) & (x <= self.columns - 0.5) & (y >= -0.5) & (y <= self.rows - 0.5)

    @property
    def pixel_rad(self) -> float:
        """Angle of one pixel at the boresight."""
        return math.atan2(1.0, self.focal_length_px)

    @property
    def diagonal_rad(self) -> float:
        """Greatest angle between two objects on the detector (of the undistorted pinhole)."""
        return 2 * math.atan2(math.hypot(self.rows, self.columns) / 2, self.focal_length_px)

    @property
    def solid_angle_sr(self) -> float:
        """Solid angle of the detector (of the undistorted pinhole with a central principal point)."""
        a, b = self.columns / 2 / self.focal_length_px, self.rows / 2 / self.focal_length_px
        return 4 * math.atan2(a * b, math.sqrt(1 + a * a + b * b))
