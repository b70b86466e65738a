"""The camera model: pixels to directions in the sensor frame, and back."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_UNDISTORTED_WITHIN_PX = 1e-9


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
        k1, k2 = self.radial_distortion
        aside_px = self._tangential(offset) if any(self.tangential_distortion) else None
        if k1 or k2:
            s2 = (offset**2).sum(axis=1) / (self.columns / 2) ** 2
            offset *= (1 + s2 * (k1 + s2 * k2))[:, None]
        if aside_px is not None:
            offset += aside_px
        if self.mirrored:
            offset[:, 0] = -offset[:, 0]
        vectors /= np.sqrt(np.einsum("ij,ij->i", vectors, vectors))[:, None]
        return vectors

    def pixels(self, directions_sensor: NDArray[np.float64]) -> NDArray[np.float64]:
        """Pixels (N, 2) of directions (N, 3) in the sensor frame; NaN behind the camera."""
        v = np.asarray(directions_sensor, dtype=np.float64).reshape(-1, 3)
        z = np.where(v[:, 2] > 0, v[:, 2], np.nan)
        undistorted = v[:, :2] / z[:, None] * self.focal_length_px
        if self.mirrored:
            undistorted[:, 0] = -undistorted[:, 0]
        return self._distorted(undistorted) + self.principal_point_px

    def _distorted(self, undistorted: NDArray[np.float64]) -> NDArray[np.float64]:
        k1, k2 = self.radial_distortion
        offset = undistorted.copy()
        tangential = any(self.tangential_distortion)
        if k1 == 0 and k2 == 0 and not tangential:
            return offset
        for _ in range(50):
            s2 = (offset**2).sum(axis=1) / (self.columns / 2) ** 2
            straight = undistorted - self._tangential(offset) if tangential else undistorted
            step = straight / (1 + s2 * (k1 + s2 * k2))[:, None] - offset
            offset += step
            if not (np.abs(step) > _UNDISTORTED_WITHIN_PX).any():
                break
        return offset

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
