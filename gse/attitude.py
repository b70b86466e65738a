"""Attitude of the sensor from identified stars (Wahba's problem)."""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray


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
        ra, de, roll = np.radians([ra_deg, de_deg, roll_deg])
        east = np.array([-math.sin(ra), math.cos(ra), 0.0])
        north = np.array([-math.sin(de) * math.cos(ra), -math.sin(de) * math.sin(ra), math.cos(de)])
        boresight = np.array([math.cos(de) * math.cos(ra), math.cos(de) * math.sin(ra), math.sin(de)])
        up = math.cos(roll) * north + math.sin(roll) * east
        return cls(np.array([np.cross(-up, boresight), -up, boresight]), np.zeros((3, 3)))

    @property
    def boresight_icrs(self) -> NDArray[np.float64]:
        """Unit vector of the boresight in ICRS axes."""
        boresight: NDArray[np.float64] = self.icrs_to_sensor[2]
        return boresight

    @property
    def ra_deg(self) -> float:
        """Right ascension of the boresight, 0 <= RA < 360."""
        x, y, _ = self.icrs_to_sensor[2]
        return math.degrees(math.atan2(y, x)) % 360.0

    @property
    def de_deg(self) -> float:
        """Declination of the boresight."""
        x, y, z = self.icrs_to_sensor[2]
        return math.degrees(math.atan2(z, math.hypot(x, y)))

    @property
    def roll_deg(self) -> float:
        """Position angle of image up (towards row 0) at the boresight, from north through east, 0 <= roll < 360."""
        x, y, _ = self.icrs_to_sensor[2]
        ra = math.atan2(y, x)
        up = -self.icrs_to_sensor[1]
        east = -math.sin(ra) * up[0] + math.cos(ra) * up[1]
        north = math.hypot(x, y) * up[2] - self.icrs_to_sensor[2, 2] * (math.cos(ra) * up[0] + math.sin(ra) * up[1])
        return math.degrees(math.atan2(east, north)) % 360.0
