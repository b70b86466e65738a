"""Reference frames of sensors against skyfield, whose matrices are its own."""

import erfa
import numpy as np
import pytest
from astropy.coordinates import FK5, CartesianRepresentation, FK4NoETerms, SkyCoord
from skyfield.api import load

from gse.truth.frames import icrs_to_frame
from gse.values.instant import NS_PER_S, from_text

ARCSEC = np.pi / 180 / 3600
MILLIARCSEC = ARCSEC / 1000
INSTANTS = ("1995-02-03T04:05:06Z", "2016-12-31T23:59:59Z", "2026-03-20T18:30:00Z", "2026-03-20T18:34:00Z")


def apart_rad(one, other):
    """The greatest angle between the axes of two rotations."""
    return float(np.abs(one @ other.T - np.eye(3)).max())


def test_the_axes_of_date_are_those_of_skyfield():
    scale = load.timescale(builtin=True)
    instants = np.array([from_text(text) for text in INSTANTS])
    rotations = icrs_to_frame("date", instants)
    for rotation, utc_ns in zip(rotations, instants.tolist(), strict=True):
        days, ns = divmod(utc_ns, 86_400 * NS_PER_S)
        matrix = scale.utc(1970, 1, 1 + days, 0, 0, ns / NS_PER_S).M
        assert apart_rad(rotation, matrix) < 2 * MILLIARCSEC


def test_the_axes_of_j2000_are_the_bias_away_from_icrs():
    j2000, icrs = (icrs_to_frame(frame, np.zeros(2, dtype=np.int64)) for frame in ("J2000", "ICRS"))
    assert j2000.shape == icrs.shape == (2, 3, 3)
    assert np.array_equal(icrs[1], np.eye(3))
    bias = np.array([j2000[1][1, 0], j2000[1][2, 0], j2000[1][2, 1]]) / ARCSEC
    assert bias == pytest.approx([0.0146, -0.016617, -0.0068192], abs=2e-4)  # IERS Conventions 2010, 5.4.4


def test_the_axes_of_date_are_those_of_the_middle_of_five_minutes_of_utc():
    """From the full minute on, a nanosecond before the next; the middle is that of the IAU 2006 and 2000A theories."""
    first = from_text("2026-03-20T18:30:00Z")
    instants = [first - 1, first, first + 299 * NS_PER_S, first + 300 * NS_PER_S - 1, first + 300 * NS_PER_S]
    before, *inside, after = icrs_to_frame("date", np.array(instants))
    expected = erfa.pnm06a(2_461_119.5, (18 * 3600 + 32 * 60 + 30) / 86_400)
    for rotation in inside:
        assert np.abs(rotation - expected).max() < 1e-15
    for rotation in (before, after):
        assert 1e-10 < np.abs(rotation - expected).max() < 1e-8


def test_instants_in_any_order_have_the_axes_of_their_own_date():
    instants = np.array([from_text(INSTANTS[place]) for place in (2, 0, 3, 2, 1)])
    together = icrs_to_frame("date", instants)
    assert together.shape == (5, 3, 3)
    for rotation, utc_ns in zip(together, instants, strict=True):
        assert np.array_equal(rotation, icrs_to_frame("date", np.array([utc_ns]))[0])


def test_the_axes_of_b1950_are_those_of_astropy_without_the_terms_of_aberration():
    rotations = icrs_to_frame("B1950", np.zeros(3, dtype=np.int64))
    assert rotations.shape == (3, 3, 3)
    stars = SkyCoord(CartesianRepresentation(np.eye(3)), frame=FK5(equinox="J2000"))
    seen = stars.transform_to(FK4NoETerms(equinox="B1950", obstime="B1950")).cartesian.xyz.value
    for rotation in rotations:
        assert np.abs(rotation - seen).max() < 0.01 * MILLIARCSEC
        assert np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-13


def test_the_pole_of_b1950_stands_where_half_a_century_of_precession_had_it():
    """Lieske 1977 from 2000 to 1950: theta is 1002.3 arcsec, zeta and z together 2305 arcsec."""
    rotation = icrs_to_frame("B1950", np.zeros(1, dtype=np.int64))[0]
    assert rotation[0, 2] / ARCSEC == pytest.approx(1002.26, abs=0.05)
    assert rotation[0, 1] / ARCSEC == pytest.approx(2306.37, abs=0.05)
