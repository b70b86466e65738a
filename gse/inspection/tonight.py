"""The night to come over a station: twilight, Sun and Moon, and the stars that its field will hold."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.camera import Camera
from gse.catalog import StarCatalog
from gse.instant import NS_PER_S
from gse.matrices import product
from gse.mount import Mount
from gse.panorama import MAX_OBJECTS
from gse.site import Site
from gse.station.sky_condition import SUN_LIMIT_DEG
from gse.station.sky_watch import stars_in_field
from gse.truth.mounting import horizon_to_sensor
from gse.truth.solar_system import icrs_to_horizon, sun_and_moon_horizon

STEP_NS = 300 * NS_PER_S
_DAY_STEPS = 288
SUNSET_DEG = -0.833
"""The Sun's upper limb on the horizon, lifted by refraction."""
_STARS_EVERY = 6
"""Half an hour: a field of 14 deg has moved by half of itself."""


@dataclass(frozen=True, slots=True)
class StarCount:
    """How many catalogue stars are in the field at an instant, at most as many as a panorama holds."""

    utc_ns: int
    stars: int


@dataclass(frozen=True, slots=True)
class Tonight:
    """The next 24 hours; instants are None where there is no such thing, angles NaN.

    ``dark_from_ns`` to ``dark_until_ns`` is the first stretch with the Sun below -12 deg. ``moon_up_share`` is the
    share of it with the Moon above the horizon, ``moon_lit`` the lit share of the Moon. The nearest Sun (above the
    horizon) and Moon (in the dark) to the boresight have their instants. ``stars`` are counted in the dark.
    """

    begins_ns: int
    sunset_ns: int | None
    dark_from_ns: int | None
    dark_until_ns: int | None
    moon_up_share: float
    moon_lit: float
    sun_nearest_deg: float
    sun_nearest_ns: int
    moon_nearest_deg: float
    moon_nearest_ns: int
    stars: tuple[StarCount, ...]


def tonight(site: Site, mount: Mount | None, camera: Camera, catalog: StarCatalog, begins_ns: int) -> Tonight:
    """From an instant on; without a ``mount`` nothing is said of the field."""
    utc_ns = begins_ns + STEP_NS * np.arange(_DAY_STEPS + 1)
    sun, moon = sun_and_moon_horizon(site, utc_ns)
    sun_deg, moon_deg = np.degrees(np.arcsin(sun[:, 2])), np.degrees(np.arcsin(moon[:, 2]))
    dark = _first_stretch(sun_deg < SUN_LIMIT_DEG)
    middle = (dark.start + dark.stop) // 2 if dark is not None else 0
    boresight = None if mount is None else horizon_to_sensor(mount)[2]
    sun_off = _separations_deg(sun, boresight, sun_deg > SUNSET_DEG)
    moon_off = _separations_deg(moon, boresight, (moon_deg > 0) & (sun_deg < SUN_LIMIT_DEG))
    set_at = np.flatnonzero((sun_deg[:-1] > SUNSET_DEG) & (sun_deg[1:] <= SUNSET_DEG))
    return Tonight(
        begins_ns=begins_ns,
        sunset_ns=int(utc_ns[set_at[0] + 1]) if len(set_at) else None,
        dark_from_ns=int(utc_ns[dark.start]) if dark is not None else None,
        dark_until_ns=int(utc_ns[dark.stop - 1]) if dark is not None else None,
        moon_up_share=float((moon_deg[dark] > 0).mean()) if dark is not None else math.nan,
        moon_lit=float(1 - product(sun[middle], moon[middle])) / 2,
        sun_nearest_deg=_least(sun_off),
        sun_nearest_ns=int(utc_ns[np.argmin(sun_off)]),
        moon_nearest_deg=_least(moon_off),
        moon_nearest_ns=int(utc_ns[np.argmin(moon_off)]),
        stars=() if mount is None or dark is None else _stars(site, mount, camera, catalog, utc_ns[dark]),
    )


def _stars(
    site: Site, mount: Mount, camera: Camera, catalog: StarCatalog, utc_ns: NDArray[np.int64]
) -> tuple[StarCount, ...]:
    shown = utc_ns[::_STARS_EVERY]
    rotations = product(horizon_to_sensor(mount), icrs_to_horizon(site, shown))
    counts = [min(stars_in_field(catalog, camera, rotation), MAX_OBJECTS) for rotation in rotations]
    return tuple(StarCount(at, count) for at, count in zip(shown.tolist(), counts, strict=True))


def _first_stretch(mask: NDArray[np.bool_]) -> slice | None:
    """The first run of true values (N,)."""
    rows = np.flatnonzero(mask)
    if not len(rows):
        return None
    ends = np.flatnonzero(np.diff(rows) > 1)
    return slice(int(rows[0]), int(rows[ends[0]] if len(ends) else rows[-1]) + 1)


def _separations_deg(
    bodies: NDArray[np.float64], boresight: NDArray[np.float64] | None, counts: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Of unit vectors (N, 3) from the boresight, infinite where they do not count."""
    if boresight is None:
        return np.full(len(bodies), np.inf)
    apart = np.degrees(np.arctan2(np.linalg.norm(np.cross(bodies, boresight), axis=1), product(bodies, boresight)))
    return np.where(counts, apart, np.inf)


def _least(separations_deg: NDArray[np.float64]) -> float:
    least = float(separations_deg.min())
    return least if math.isfinite(least) else math.nan
