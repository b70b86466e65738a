"""Planets and the Moon as a sensor sees them, by ERFA's own ephemerides (plan94, moon98): good to 2 arcmin.

The same that astropy calls "builtin". Neglected: aberration and the deflection of light (20 arcsec), and the 69 s
between UTC and TT, in which the Moon moves 0.6 arcmin.
"""

import math

import erfa
import numpy as np
from numpy.typing import NDArray

from gse.constants import AU_M, DAY_S, LIGHT_M_PER_S
from gse.instant import to_julian_date
from gse.site import Site

PLANETS = ("Mercury", "Venus", "Mars", "Jupiter", "Saturn", "Uranus")
"""Those that a star sensor sees."""

BODIES = (*PLANETS, "Moon")
_NUMBERS = np.array([1, 2, 4, 5, 6, 7])
"""Of PLANETS, as plan94 counts them."""

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
    day, fraction = to_julian_date(utc_ns)
    sun_icrs = -erfa.ufunc.epv00(day, fraction)[0]["p"]
    longitude, latitude = math.radians(site.longitude_deg), math.radians(site.latitude_deg)
    up_earth = np.array(
        [math.cos(latitude) * math.cos(longitude), math.cos(latitude) * math.sin(longitude), math.sin(latitude)]
    )
    up_icrs = up_earth @ erfa.ufunc.c2t06a(day, fraction, day, fraction, 0.0, 0.0)
    return math.degrees(math.asin(float(up_icrs @ sun_icrs) / float(np.linalg.norm(sun_icrs))))


def _site_icrs_au(site: Site, day: float, fraction: float) -> NDArray[np.float64]:
    """Geocentric position (3,) of a site: the Moon is a degree elsewhere from the Earth's other side."""
    longitude, latitude = math.radians(site.longitude_deg), math.radians(site.latitude_deg)
    position_m, _ = erfa.ufunc.gd2gc(_WGS84, longitude, latitude, site.height_m)
    icrs_to_earth = erfa.ufunc.c2t06a(day, fraction, day, fraction, 0.0, 0.0)
    icrs_au: NDArray[np.float64] = position_m @ icrs_to_earth / AU_M
    return icrs_au
