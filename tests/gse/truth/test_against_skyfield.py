"""Sidereal truth against skyfield, which is given the same UT1 and pole."""

import numpy as np
import pytest
from astropy.coordinates import EarthLocation, get_body_barycentric_posvel
from astropy.time import Time
from skyfield import relativity
from skyfield.api import load, wgs84
from skyfield.earthlib import refraction

from gse.truth import EarthOrientation, Refraction, SiderealTruth
from gse.values.instant import NS_PER_S, from_text
from gse.values.site import Site

ARCSEC = np.pi / 180 / 3600
CASES = 300
AU_M, DAY_S = 149_597_870_700.0, 86_400.0


def random_cases(rng, count):
    """Instant, site and Earth orientation of so many cases."""
    first, last = from_text("1990-01-01T00:00:00Z"), from_text("2027-06-01T00:00:00Z")
    return [
        (
            utc_ns,
            Site(
                latitude_deg=float(np.degrees(np.arcsin(rng.uniform(-1, 1)))),
                longitude_deg=rng.uniform(-180, 180),
                height_m=rng.uniform(0, 4000),
            ),
            EarthOrientation.from_disk(utc_ns, days=2),
        )
        for utc_ns in rng.integers(first, last, count).tolist()
    ]


def skyfield_time(utc_ns, table):
    """The instant in skyfield with the UT1 and pole of ``table``: its own are up to 0.17 s off."""
    here = table.at(utc_ns)
    days, ns = divmod(utc_ns, 86_400 * NS_PER_S)
    tai_minus_utc = here.tai_minus_utc_s
    scale = load.timescale(builtin=True, delta_t=32.184 + tai_minus_utc - here.ut1_minus_utc_s)
    arcsec = np.degrees([here.x_pole_rad, here.y_pole_rad]) * 3600
    scale.polar_motion_table = (np.array([0.0, 1e7]), np.repeat(arcsec[0], 2), np.repeat(arcsec[1], 2))
    return scale.tt_jd(2440587.5 + days, (ns / NS_PER_S + tai_minus_utc + 32.184) / DAY_S)


def test_the_horizon_stands_where_skyfield_has_it():
    assert worst_rad(random_cases(np.random.default_rng(8), CASES)) < 0.01 * ARCSEC


def worst_rad(cases):
    """The greatest difference of an axis of the horizon from skyfield's."""
    worst = 0.0
    for utc_ns, site, table in cases:
        ours = SiderealTruth(site, table).icrs_to_horizon(utc_ns)
        place = wgs84.latlon(site.latitude_deg, site.longitude_deg, site.height_m)
        north_east_up = place.rotation_at(skyfield_time(utc_ns, table))  # skyfield: x north, y east, z up
        theirs = north_east_up[[1, 0, 2]]
        worst = max(worst, np.linalg.norm(ours - theirs, axis=1).max())
    return worst


def test_aberration_is_that_of_skyfield_for_the_velocity_that_astropy_gives():
    utc_ns = from_text("2026-03-20T18:30:00Z")
    site = Site(latitude_deg=-6.5, longitude_deg=106.7)
    truth = SiderealTruth(site, EarthOrientation.from_disk(utc_ns), {"light deflection"})
    time = Time("2026-03-20T18:30:00", scale="utc")
    earth = get_body_barycentric_posvel("earth", time)[1].xyz.to_value("AU/day")
    place = EarthLocation.from_geodetic(site.longitude_deg, site.latitude_deg).get_gcrs_posvel(time)[1]
    velocity_au_per_day = earth + place.xyz.to_value("AU/day")
    rng = np.random.default_rng(9)
    stars = rng.normal(size=(100, 3))
    stars /= np.linalg.norm(stars, axis=1)[:, None]
    far_au = stars.T * 1e9
    light_days = np.full(100, 1e9 * AU_M / 299_792_458.0 / DAY_S)
    relativity.add_aberration(far_au, np.repeat(velocity_au_per_day[:, None], 100, axis=1), light_days)
    theirs = (far_au / np.linalg.norm(far_au, axis=0)).T
    assert np.linalg.norm(theirs - stars, axis=1).max() > 15 * ARCSEC
    assert np.linalg.norm(theirs - truth.apparent(stars, utc_ns), axis=1).max() < 0.01 * ARCSEC


def test_refraction_is_that_of_bennett_within_its_rounding():
    # skyfield has Bennett 1982, whose leading constant is a rounded minute of arc: 3 % above a silicon detector's.
    site = Site(latitude_deg=0, longitude_deg=0, pressure_hpa=1010, temperature_c=10, relative_humidity=0)
    air = Refraction.at(site)
    for altitude_deg in (15.0, 30.0, 45.0, 60.0, 80.0):
        theirs = refraction(altitude_deg, temperature_C=10, pressure_mbar=1010) * 3600
        ours = air.bend_rad(np.radians(90 - altitude_deg)) / ARCSEC
        assert ours == pytest.approx(theirs, rel=0.035)
