"""Truth without a turning Earth: the direction that a star simulator or a screen shows.

Its stars stand where the catalogue has them: no aberration, no refraction, and no site. The sensor's frame is the only
frame of the stand, so the rotation that is the horizon's elsewhere is that of the stated direction here, and such a
mount is the identity.
"""

import numpy as np
from numpy.typing import NDArray

from gse.truth.orientation import EarthOrientation
from gse.truth.refraction import Refraction
from gse.truth.sidereal import SiderealTruth
from gse.values.attitude_convention import from_angles
from gse.values.instant import NS_PER_S
from gse.values.mount import InertialDirection, Mount
from gse.values.screen import ShownSky
from gse.values.site import Site


class InertialTruth(SiderealTruth):
    """The stars before a star simulator: in a stated direction, or as a screen showed them (``sky``)."""

    def __init__(self, shown: InertialDirection, sky: ShownSky | None = None) -> None:
        self.refraction = Refraction(0.0, 0.0)
        self._shown, self._sky = shown, sky

    def icrs_to_horizon(self, utc_ns: int) -> NDArray[np.float64]:
        """The rotation (3, 3) from ICRS axes to the stand."""
        rotation: NDArray[np.float64] = self.icrs_to_horizon_at(np.array([utc_ns]))[0]
        return rotation

    def icrs_to_horizon_at(self, utc_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """The rotations (M, 3, 3) at many instants (M,)."""
        if self._sky is not None and self._sky.shown:
            return self._sky.icrs_to_sensor_at(utc_ns)
        shown = self._shown
        since_h = (utc_ns - shown.at_utc_ns) / NS_PER_S / 3600  # arcsec/s are deg/h
        angles = (shown.ra_deg, shown.de_deg, shown.roll_deg)
        moved = (start + rate * since_h for start, rate in zip(angles, shown.rates_arcsec_per_s, strict=True))
        return from_angles(*moved)

    def apparent_at(
        self,
        stars_icrs: NDArray[np.float64],
        utc_ns: NDArray[np.int64],
        icrs_to_horizon: NDArray[np.float64],
        instant_of: NDArray[np.int64],
    ) -> NDArray[np.float64]:
        """The stars as they are: nothing moves them."""
        return np.asarray(stars_icrs, dtype=np.float64)

    def apparent(self, stars_icrs: NDArray[np.float64], utc_ns: int) -> NDArray[np.float64]:
        """The stars as they are: nothing moves them."""
        return np.asarray(stars_icrs, dtype=np.float64)

    def unrefracted(
        self, directions_sensor: NDArray[np.float64], zenith_sensor: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """The directions as they are measured."""
        return np.asarray(directions_sensor, dtype=np.float64)


def truth_of(
    site: Site, mount: Mount, earth_orientation: EarthOrientation | None, sky: ShownSky | None = None
) -> SiderealTruth | None:
    """The truth of a mount: of the stars that are shown to it, or of the sky; None without Earth orientation."""
    if mount.inertial is not None:
        return InertialTruth(mount.inertial, sky)
    return None if earth_orientation is None else SiderealTruth(site, earth_orientation)
