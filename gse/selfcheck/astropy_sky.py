"""The sky over a site by astropy's high-level frames alone: SkyCoord to AltAz and back.

Nothing here comes from gse.truth or gse.simulator, so that either can be tested by it.
"""

import contextlib
import functools
from collections.abc import Iterator
from typing import Any

import astropy.units as u
import numpy as np
from astropy.coordinates import AltAz, EarthLocation, SkyCoord
from astropy.time import Time, TimeDelta
from astropy.utils import iers
from numpy.typing import NDArray

from gse.values.instant import NS_PER_DAY, NS_PER_S, UNIX_EPOCH_MJD
from gse.values.site import Site

_NEAR = 1e-3
_WAVELENGTH_UM = 0.6
"""Where a silicon detector sees stars."""


class AstropySky:
    """The sky over a site; horizon directions are unit vectors, x east, y north, z up."""

    def __init__(self, site: Site) -> None:
        self._location = EarthLocation.from_geodetic(
            site.longitude_deg * u.deg, site.latitude_deg * u.deg, site.height_m * u.m
        )
        self._air = {
            "pressure": site.pressure_hpa * u.hPa,
            "temperature": site.temperature_c * u.deg_C,
            "relative_humidity": site.relative_humidity,
            "obswl": _WAVELENGTH_UM * u.um,
        }

    def seen(self, stars_icrs: NDArray[np.float64], utc_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Directions (M, N, 3) in which stars (N, 3) are seen at instants (M,): aberrated and refracted."""
        with installed_tables():
            stars = SkyCoord(*np.asarray(stars_icrs).T, representation_type="cartesian", frame="icrs").spherical
            seen = SkyCoord(stars.lon[None], stars.lat[None], frame="icrs").transform_to(
                self._horizon(np.asarray(utc_ns)[:, None], self._air)
            )
            azimuth, altitude = seen.az.rad, seen.alt.rad
        level = np.cos(altitude)
        return np.stack([level * np.sin(azimuth), level * np.cos(azimuth), np.sin(altitude)], axis=-1)

    def boresight_and_up(
        self, axes: NDArray[np.float64], utc_ns: NDArray[np.int64], *, air: bool = False
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """ICRS directions (M, 3) of sensors' axes (M, 3, 3), which are right, up and out.

        Up is taken close to the boresight: aberration keeps angles there, and 90 deg away it does not. It is the mean
        of what up and right show: refraction shears the field, and a shear is not a turn.
        """
        right, up, out = np.moveaxis(axes, 1, 0)
        near = np.stack([out, out + _NEAR * up, out + _NEAR * right], axis=1)
        boresight, above, beside = np.moveaxis(self._icrs(near, utc_ns, self._air if air else {}), 1, 0)
        upwards = _unit(above - boresight * (above * boresight).sum(axis=1)[:, None])
        rightwards = _unit(beside - boresight * (beside * boresight).sum(axis=1)[:, None])
        return boresight, _unit(upwards + np.cross(rightwards, boresight))

    def fitted_boresight_and_up(
        self, axes: NDArray[np.float64], field: NDArray[np.float64], utc_ns: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """As ``boresight_and_up`` through the air, by Wahba's least squares over the stars of a field.

        ``field`` (N, 3) are directions in components along right, up and out. What is low is lifted by more, so that
        the whole field has another mean than its middle.
        """
        stars = self._icrs(field @ axes, utc_ns, self._air)
        u, _, vt = np.linalg.svd(np.einsum("mni,nj->mij", stars, field))
        u[:, :, 2] *= (np.linalg.det(u @ vt) * np.linalg.det(axes))[:, None]  # right, up and out are left-handed
        rotations = u @ vt
        return rotations[:, :, 2], rotations[:, :, 1]

    def _icrs(
        self, directions: NDArray[np.float64], utc_ns: NDArray[np.int64], air: dict[str, Any]
    ) -> NDArray[np.float64]:
        east, north, up = np.moveaxis(np.asarray(directions), -1, 0)
        with installed_tables():
            frame = self._horizon(np.asarray(utc_ns)[:, None], air)
            looked = SkyCoord(
                az=np.arctan2(east, north) * u.rad, alt=np.arctan2(up, np.hypot(east, north)) * u.rad, frame=frame
            )
            return np.moveaxis(looked.icrs.cartesian.xyz.value, 0, -1)

    def _horizon(self, utc_ns: NDArray[np.int64], air: dict[str, Any]) -> AltAz:
        """Midnight plus SI seconds, since a day may have 86,401."""
        days, ns = np.divmod(utc_ns, NS_PER_DAY)
        midnight = Time((days + UNIX_EPOCH_MJD).astype(np.float64), format="mjd", scale="utc")
        return AltAz(
            obstime=(midnight.tai + TimeDelta(ns / NS_PER_S, format="sec")).utc, location=self._location, **air
        )


def east_and_north(directions: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """East and north (M, 3) at ICRS directions (M, 3), away from the poles."""
    east = _unit(np.cross([0.0, 0.0, 1.0], directions))
    return east, np.cross(directions, east)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    unit: NDArray[np.float64] = vectors / np.linalg.norm(vectors, axis=1)[:, None]
    return unit


@contextlib.contextmanager
def installed_tables() -> Iterator[None]:
    """The IERS tables that are installed: never a download, and no question for the host's date."""
    with (
        iers.conf.set_temp("auto_download", False),
        iers.conf.set_temp("auto_max_age", None),
        iers.earth_orientation_table.set(_table()),
    ):
        yield


@functools.lru_cache(maxsize=1)
def _table() -> iers.IERS_A:
    return iers.IERS_A.read(iers.IERS_A_FILE)
