"""Atmospheric refraction about the zenith: ERFA's A tan z + B tan^3 z."""

import math
from dataclasses import dataclass
from typing import Self

import erfa
import numpy as np
from numpy.typing import NDArray

from gse.process.jit import compiled
from gse.values.site import Site

WAVELENGTH_UM = 0.6
"""Where a silicon detector sees stars: Gaia's G band, which is one, has its mean at 0.62 um; from 0.5 to 0.7 um the
refraction at 45 deg changes by 0.5 arcsec."""

_INVERSE_ROUNDS = 5
"""Each gains a factor of 100 or more above 10 deg of altitude."""
_MIN_COS_ZENITH = 0.05
"""Below 3 deg of altitude the formula is held, as eraAtoiq does."""


@dataclass(frozen=True, slots=True)
class Refraction:
    """Refraction constants in radians, for the observed (refracted) zenith distance."""

    a_rad: float
    b_rad: float

    @classmethod
    def at(cls, site: Site, wavelength_um: float = WAVELENGTH_UM) -> Self:
        """The constants for the air of a site; a pressure of 0 means none."""
        air = site.air_pressure_hpa, site.air_temperature_c, site.relative_humidity
        a, b = erfa.ufunc.refco(*air, wavelength_um)
        return cls(float(a), float(b))

    def removed(
        self, directions_sensor: NDArray[np.float64], zenith_sensor: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """The directions (N, 3) that light had before it entered the air.

        ``zenith_sensor`` is a unit vector, (3,) for all or (N, 3).
        """
        removed = np.empty((len(directions_sensor), 3))
        # Copies: for each other layout of an array, or one that is read-only, the function would be compiled anew.
        directions, zenith = np.array(directions_sensor, dtype=float, order="C"), np.empty(removed.shape)
        zenith[:] = zenith_sensor
        _remove(directions, zenith, self.a_rad, self.b_rad, removed)
        return removed

    def added(self, directions_sensor: NDArray[np.float64], zenith_sensor: NDArray[np.float64]) -> NDArray[np.float64]:
        """The directions (N, 3) in which light arrives: the inverse of ``removed``, above some 5 deg of altitude."""
        # Fixed point: what ``removed`` takes too much or too little is added back, and once more.
        seen = directions_sensor
        for _ in range(_INVERSE_ROUNDS):
            seen = seen + (directions_sensor - self.removed(seen, zenith_sensor))
            seen = seen / np.linalg.norm(seen, axis=1)[:, None]
        return seen

    def bend_rad(self, zenith_distance_rad: float) -> float:
        """By how much an object at an observed zenith distance is lifted."""
        tan_z = min(float(np.tan(zenith_distance_rad)), 20.0) if zenith_distance_rad < np.pi / 2 else 20.0
        return (self.a_rad + self.b_rad * tan_z**2) * tan_z


@compiled
def _remove(
    directions: NDArray[np.float64],
    zenith: NDArray[np.float64],
    a_rad: float,
    b_rad: float,
    removed: NDArray[np.float64],
) -> None:
    """Put each direction (N, 3), turned away from its zenith (N, 3) by the refraction, into ``removed``."""
    for i in range(len(directions)):
        x, y, z = directions[i]
        up_x, up_y, up_z = zenith[i]
        cos_z = x * up_x + y * up_y + z * up_z
        held = max(cos_z, _MIN_COS_ZENITH)
        # A direction d and the zenith up span a plane; refraction lifts the star in it by ``shift``, so we turn d back,
        # away from up, by as much. In that plane the turned vector is
        #
        #     d cos(shift) + (d cos z - up) sin(shift) / sin z
        #
        # written so that nothing is divided by sin z, which is zero at the zenith: ``per_sine`` is the refraction over
        # sin z, for tan z / sin z does not vanish there.
        per_sine = (a_rad + b_rad * (1.0 / held**2 - 1.0)) / held
        shift = per_sine * math.sqrt(max(1.0 - cos_z**2, 0.0))
        away = per_sine * (math.sin(shift) / shift if shift > 0.0 else 1.0)
        along = math.cos(shift) + away * cos_z
        removed[i, 0] = along * x - away * up_x
        removed[i, 1] = along * y - away * up_y
        removed[i, 2] = along * z - away * up_z
