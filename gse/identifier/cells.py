"""Cells of the sky, pivot paper, section 3.2: zones of declination, each cut into equal parts of right ascension.

With every bracket a floor, and eqs 7-9 mended (as printed they put few stars into the right cell): zone k counts from
the north pole in steps of D = 2 pi / (2N + 1), its order is n = 2k, or 2N + 1 - 2k once 2k > N, it has 2n + 1 cells,
and cell j of it, counted so that j = 0 is centred on right ascension 0, has the index n^2 + j in 0 .. (N + 1)^2 - 1.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Cells:
    """The cells for a field: each at least as high as the field is wide (``order`` is N of eq 6)."""

    order: int

    @classmethod
    def for_field(cls, diameter_rad: float) -> "Cells":
        """Eq 6. A field of more than 120 deg has one cell."""
        return cls(max(0, math.floor(0.5 * (2 * math.pi / diameter_rad - 1))))

    def __len__(self) -> int:
        return (self.order + 1) ** 2

    def zones_deg(self) -> list[tuple[float, float, int]]:
        """Each zone from the north: lowest and highest declination in degrees, and its number of cells."""
        height_deg = math.degrees(self._height_rad)
        zones = []
        for zone in range(self.order + 1):
            n = 2 * zone if 2 * zone <= self.order else 2 * self.order + 1 - 2 * zone
            middle_deg = 90 - zone * height_deg
            zones.append((max(middle_deg - height_deg / 2, -90.0), min(middle_deg + height_deg / 2, 90.0), 2 * n + 1))
        return zones

    def index(self, icrs: NDArray[np.float64]) -> NDArray[np.int64]:
        """Cell of each unit vector (N, 3), eqs 7-9 as mended."""
        ra = np.arctan2(icrs[:, 1], icrs[:, 0])
        colatitude = np.arctan2(np.hypot(icrs[:, 0], icrs[:, 1]), icrs[:, 2])
        zone = np.minimum(self.order, np.floor(colatitude / self._height_rad + 0.5).astype(np.int64))
        n = np.where(2 * zone <= self.order, 2 * zone, 2 * self.order + 1 - 2 * zone)
        width = 2 * n + 1
        j = np.floor(ra * width / (2 * math.pi) + 0.5).astype(np.int64) % width
        cells: NDArray[np.int64] = n**2 + j
        return cells

    def around(self) -> NDArray[np.bool_]:
        """Which cells (C, C) touch which: each itself, and those that share an edge or a corner with it."""
        n = np.floor(np.sqrt(np.arange(len(self)))).astype(np.int64)
        zone = np.where(n % 2 == 0, n // 2, (2 * self.order + 1 - n) // 2)
        width = 2 * n + 1
        centre = (np.arange(len(self)) - n**2) / width
        separation = np.abs((centre[:, None] - centre[None] + 0.5) % 1 - 0.5)
        reach = 0.5 / width
        touching = separation <= reach[:, None] + reach[None] + 1e-9
        nearby: NDArray[np.bool_] = (np.abs(zone[:, None] - zone[None]) <= 1) & touching
        return nearby

    @property
    def _height_rad(self) -> float:
        return 2 * math.pi / (2 * self.order + 1)
