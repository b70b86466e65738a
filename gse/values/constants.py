"""Constants of nature, time, angle and the normal distribution, each with its source."""

import math

ARCSEC_RAD = math.pi / (180 * 3600)
"""One arcsecond, in radians."""

ARCSEC_PER_RAD = 180 * 3600 / math.pi
"""Arcseconds in a radian."""

MAD_TO_SIGMA = 1.4826
"""Standard deviation of a normal distribution whose median absolute deviation is 1."""

DAY_S = 86_400.0
"""Seconds in a day of UT1, TT or TAI."""

EARTH_TURNS_PER_UT1_DAY = 1.00273781191135448
"""Rate of the Earth rotation angle (Capitaine, Guinot & McCarthy 2000; IERS Conventions 2010, eq. 5.15)."""

EARTH_RATE_RAD_PER_S = 2 * math.pi * EARTH_TURNS_PER_UT1_DAY / DAY_S
"""Rate of the Earth rotation angle, in radians per second of UT1."""

EARTH_RATE_ARCSEC_PER_S = EARTH_RATE_RAD_PER_S * ARCSEC_PER_RAD
"""The same in arcsec per second: 15.041067."""

EARTH_RADIUS_M = 6_371_000.0
"""Mean radius of the Earth."""

AU_M = 149_597_870_700.0
"""Astronomical unit (IAU 2012 resolution B2)."""

LIGHT_M_PER_S = 299_792_458.0
"""Speed of light (SI)."""

J2000_NS = 946_728_000_000_000_000
"""2000-01-01T12:00:00Z, in nanoseconds since 1970: J2000.0 to within the 64 s between TT and UTC."""
