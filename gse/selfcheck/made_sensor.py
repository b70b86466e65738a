"""A made sensor on a made mount: directions in the horizon frame to pixels.

Written from the words of docs/station-file.md, not from gse.camera or gse.truth, so that either can be tested by it.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

_ROUNDS = 30
_BORDER_PX = 12.0


@dataclass(frozen=True, slots=True, eq=False)
class MadeSensor:
    """A square detector behind a pinhole; ``axes`` (3, 3) are right, up and out of the boresight, in rows.

    ``radial_distortion`` is k1 alone.
    """

    axes: NDArray[np.float64]
    focal_length_px: float
    size_px: int
    radial_distortion: float = 0.0
    mirrored: bool = False

    def turned(self, axis: NDArray[np.float64], angle_rad: float) -> "MadeSensor":
        """The sensor after a right-handed turn about a direction (3,) of the horizon frame."""
        turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle_rad)
        return replace(self, axes=turn.apply(self.axes))

    def pixels(self, directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Pixels (..., 2) of directions (..., 3): x to the right, y down."""
        right, up, out = self.axes
        plane = np.stack([directions @ right, -(directions @ up)], axis=-1) / (directions @ out)[..., None]
        plane = plane * self.focal_length_px
        if self.radial_distortion:
            plane = self._distorted(plane)
        if self.mirrored:
            plane = plane * [-1, 1]
        xy_px: NDArray[np.float64] = plane + (self.size_px - 1) / 2
        return xy_px

    def sees(self, directions: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which directions (..., 3) fall well inside the detector."""
        xy_px = self.pixels(directions)
        inside = (xy_px > _BORDER_PX) & (xy_px < self.size_px - 1 - _BORDER_PX)
        return np.asarray(inside.all(axis=-1) & (directions @ self.axes[2] > 0), dtype=bool)

    def _distorted(self, undistorted: NDArray[np.float64]) -> NDArray[np.float64]:
        distorted = undistorted
        for _ in range(_ROUNDS):
            s2 = (distorted**2).sum(axis=-1, keepdims=True) / (self.size_px / 2) ** 2
            distorted = undistorted / (1 + self.radial_distortion * s2)
        return distorted


def mounted(azimuth_deg: float, altitude_deg: float, roll_deg: float) -> NDArray[np.float64]:
    """The axes of a sensor on a mount; the roll turns image up counter-clockwise, as seen in the sky."""
    a, h, roll = np.radians([azimuth_deg, altitude_deg, roll_deg])
    out = np.array([np.cos(h) * np.sin(a), np.cos(h) * np.cos(a), np.sin(h)])
    zenithwards = np.array([-np.sin(h) * np.sin(a), -np.sin(h) * np.cos(a), np.cos(h)])
    rightwards = np.array([np.cos(a), -np.sin(a), 0.0])
    up = np.cos(roll) * zenithwards - np.sin(roll) * rightwards
    right = np.cos(roll) * rightwards + np.sin(roll) * zenithwards
    return np.array([right, up, out])
