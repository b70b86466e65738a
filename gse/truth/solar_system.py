"""Planets, Moon and Sun as a sensor sees them, by ERFA's own ephemerides (plan94, moon98): good to 2 arcmin.

The same that astropy calls "builtin". Neglected: aberration and the deflection of light (20 arcsec), and the 69 s
between UTC and TT, in which the Moon moves 0.6 arcmin.
"""

import functools
import math

import erfa
import numpy as np
from numpy.typing import NDArray

from gse.truth.frames import horizon_axes
from gse.values.constants import AU_M, DAY_S, LIGHT_M_PER_S
from gse.values.instant import NS_PER_DAY, UNIX_EPOCH_JD, to_julian_date
from gse.values.matrices import product
from gse.values.site import Site

PLANETS = ("Mercury", "Venus", "Mars", "Jupiter", "Saturn", "Uranus")
"""The planets that a star sensor sees."""

BODIES = (*PLANETS, "Moon")
_NUMBERS = np.array([1, 2, 4, 5, 6, 7])
"""The numbers by which plan94 knows PLANETS."""

_WGS84 = 1


def bodies_icrs(site: Site, utc_ns: int) -> NDArray[np.float64]:
    """Unit vectors (7, 3) from a site to BODIES, in ICRS axes."""
    day, fraction = to_julian_date(utc_ns)
    earth_au = erfa.ufunc.epv00(day, fraction)[0]["p"]
    planets_au = erfa.ufunc.plan94(day, fraction, _NUMBERS)[0]["p"] - earth_au
    light_days = np.linalg.norm(planets_au, axis=1) * AU_M / (LIGHT_M_PER_S * DAY_S)
    planets_au = erfa.ufunc.plan94(day, fraction - light_days, _NUMBERS)[0]["p"] - earth_au
    moon_au = erfa.ufunc.moon98(day, fraction)["p"] - _site_icrs_au(site, day, fraction)
    vectors = np.vstack([planets_au, moon_au])
    unit: NDArray[np.float64] = vectors / np.linalg.norm(vectors, axis=1)[:, None]
    return unit


def sun_altitude_deg(site: Site, utc_ns: int) -> float:
    """Geometric altitude of the Sun's centre over a site, good to 0.02 deg: for twilight, not for pointing."""
    sun_horizon, _ = sun_and_moon_horizon(site, np.array([utc_ns]))
    return math.degrees(math.asin(float(sun_horizon[0, 2])))


def sun_and_moon_horizon(site: Site, utc_ns: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit vectors (M, 3) to the Sun and to the Moon at instants (M,), x east, y north, z up, without refraction.

    Good to 0.02 deg: for twilight and moonlight, not for pointing.
    """
    day, fraction = _julian_dates(utc_ns)
    icrs_to_horizon = _icrs_to_horizon(site, day, fraction)
    sun_au = -erfa.ufunc.epv00(day, fraction)[0]["p"]
    moon_au = erfa.ufunc.moon98(day, fraction)["p"]
    sun_horizon, moon_horizon = (np.einsum("mij,mj->mi", icrs_to_horizon, part) for part in (sun_au, moon_au))
    moon_horizon -= _site_horizon_au(site)
    return _unit(sun_horizon), _unit(moon_horizon)


def moon_lit_share(utc_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """The lit share (M,) of the Moon's disc seen from the Earth's centre at instants (M,), good to 0.01."""
    day, fraction = _julian_dates(utc_ns)
    sun = _unit(-erfa.ufunc.epv00(day, fraction)[0]["p"])
    moon = _unit(erfa.ufunc.moon98(day, fraction)["p"])
    return np.asarray((1 - (sun * moon).sum(axis=1)) / 2)


def icrs_to_horizon(site: Site, utc_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Rotations (M, 3, 3) from ICRS axes to the horizon frame at instants (M,), with UTC for UT1: good to 15 arcsec.

    For what must be known without Earth orientation: which stars are in the field, and where the Moon is.
    """
    return _icrs_to_horizon(site, *_julian_dates(utc_ns))


def _julian_dates(utc_ns: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    days, ns = np.divmod(np.asarray(utc_ns, dtype=np.int64), NS_PER_DAY)
    return UNIX_EPOCH_JD + days, ns / NS_PER_DAY


def _icrs_to_horizon(site: Site, day: NDArray[np.float64], fraction: NDArray[np.float64]) -> NDArray[np.float64]:
    # Nutation to a milliarcsecond (2000B) takes a twentieth of the time of the full series.
    rotations: NDArray[np.float64] = product(
        _earth_to_horizon(site), erfa.ufunc.c2t00b(day, fraction, day, fraction, 0.0, 0.0)
    )
    return rotations


@functools.lru_cache(maxsize=16)
def _site_horizon_au(site: Site) -> NDArray[np.float64]:
    """Geocentric position (3,) of a site, along its own east, north and up; not to be written to."""
    position_m, _ = erfa.ufunc.gd2gc(_WGS84, *np.radians([site.longitude_deg, site.latitude_deg]), site.height_m)
    return np.asarray(product(_earth_to_horizon(site), position_m) / AU_M)


@functools.lru_cache(maxsize=16)
def _earth_to_horizon(site: Site) -> NDArray[np.float64]:
    """The rotation (3, 3) from Earth-fixed axes to east, north and up of a site; not to be written to."""
    return horizon_axes(math.radians(site.longitude_deg), math.radians(site.latitude_deg))


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1)[:, None], dtype=np.float64)


def _site_icrs_au(site: Site, day: float, fraction: float) -> NDArray[np.float64]:
    """Geocentric position (3,) of a site: the Moon is a degree elsewhere from the Earth's other side."""
    longitude, latitude = math.radians(site.longitude_deg), math.radians(site.latitude_deg)
    position_m, _ = erfa.ufunc.gd2gc(_WGS84, longitude, latitude, site.height_m)
    icrs_to_earth = erfa.ufunc.c2t06a(day, fraction, day, fraction, 0.0, 0.0)
    icrs_au: NDArray[np.float64] = product(position_m, icrs_to_earth) / AU_M
    return icrs_au
