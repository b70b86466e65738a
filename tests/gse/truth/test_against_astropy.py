"""Sidereal truth against astropy's own high-level frames (ICRS to AltAz and back)."""

import astropy.units as u
import astropy_iers_data
import numpy as np
import pytest
from astropy.coordinates import AltAz, EarthLocation, SkyCoord, get_body
from astropy.time import Time, TimeDelta
from astropy.utils import iers

from gse.truth import EarthOrientation, SiderealTruth
from gse.truth.solar_system import BODIES, bodies_icrs
from gse.values.instant import NS_PER_DAY, NS_PER_S, UNIX_EPOCH_MJD, from_text
from gse.values.site import Site

ARCSEC = np.pi / 180 / 3600
CASES = 2000
FIRST_NS, LAST_NS = from_text("1973-01-02T00:00:00Z"), from_text("2027-06-01T00:00:00Z")


def angle(a, b):
    return 2 * np.arcsin(np.minimum(np.linalg.norm(a - b, axis=-1) / 2, 1))


def astropy_time(utc_ns):
    days, ns = np.divmod(np.asarray(utc_ns), 86_400 * NS_PER_S)
    # Midnight, then SI seconds: a fraction of a day of 86,401 s would be off by up to a second.
    return (Time(days + 40587.0, format="mjd", scale="utc").tai + TimeDelta(ns / NS_PER_S, format="sec")).utc


def altaz_frame(utc_ns, sites, *, air):
    location = EarthLocation.from_geodetic(
        [s.longitude_deg for s in sites] * u.deg, [s.latitude_deg for s in sites] * u.deg, [s.height_m for s in sites]
    )
    if not air:
        return AltAz(obstime=astropy_time(utc_ns), location=location)
    return AltAz(
        obstime=astropy_time(utc_ns),
        location=location,
        pressure=[s.air_pressure_hpa for s in sites] * u.hPa,
        temperature=[s.air_temperature_c for s in sites] * u.deg_C,
        relative_humidity=[s.relative_humidity for s in sites],
        obswl=0.6 * u.micron,
    )


def unit(coordinate):
    """Rows east, north, up of astropy's azimuth and altitude."""
    az, alt = coordinate.az.rad, coordinate.alt.rad
    return np.column_stack([np.cos(alt) * np.sin(az), np.cos(alt) * np.cos(az), np.sin(alt)])


@pytest.fixture(scope="module")
def cases():
    return random_cases(np.random.default_rng(6), CASES)


def random_cases(rng, count):
    """Instants, sites with their air, and directions above 10 deg of altitude (count, 3) in the horizon frame."""
    utc_ns = np.sort(rng.integers(FIRST_NS, LAST_NS, count))
    sites = [
        Site(
            latitude_deg=float(np.degrees(np.arcsin(rng.uniform(-1, 1)))),
            longitude_deg=rng.uniform(-180, 180),
            height_m=rng.uniform(0, 4000),
            pressure_hpa=rng.uniform(600, 1050),
            temperature_c=rng.uniform(-20, 40),
            relative_humidity=rng.uniform(0, 1),
        )
        for _ in range(count)
    ]
    sin_alt = rng.uniform(np.sin(np.radians(10)), 1, count)
    azimuth = rng.uniform(0, 2 * np.pi, count)
    level = np.sqrt(1 - sin_alt**2)
    seen = np.column_stack([level * np.sin(azimuth), level * np.cos(azimuth), sin_alt])
    return utc_ns, sites, seen


@pytest.fixture(scope="module")
def truths(cases):
    return truths_of(cases)


def truths_of(cases):
    utc_ns, sites, _ = cases
    tables = [EarthOrientation.from_disk(int(ns), days=2) for ns in utc_ns]
    return [SiderealTruth(site, table) for site, table in zip(sites, tables, strict=True)]


def observed_star(coordinate, cases, *, air):
    """The ICRS direction of the star that astropy says is seen there."""
    utc_ns, sites, seen = cases
    az, alt = np.arctan2(seen[:, 0], seen[:, 1]), np.arcsin(seen[:, 2])
    star = SkyCoord(az=az * u.rad, alt=alt * u.rad, frame=altaz_frame(utc_ns, sites, air=air)).icrs
    return np.asarray(star.cartesian.xyz.value.T)


@pytest.mark.parametrize("air", [False, True])
def test_stars_are_seen_where_astropy_sees_them(cases, truths, air):
    assert worst_rad(cases, truths, air=air) < 0.01 * ARCSEC


def worst_rad(cases, truths, *, air):
    """The greatest angle between a star's place and astropy's."""
    utc_ns, _, seen = cases
    stars_icrs = observed_star("icrs", cases, air=air)
    zenith = np.array([0.0, 0.0, 1.0])
    worst = 0.0
    for ns, truth, direction, star in zip(utc_ns.tolist(), truths, seen, stars_icrs, strict=True):
        ours = truth.icrs_to_horizon(ns) @ truth.apparent(star[None], ns)[0]
        measured = truth.unrefracted(direction[None], zenith)[0] if air else direction
        worst = max(worst, angle(ours, measured))
    return worst


def test_earth_orientation_is_what_astropy_reads_from_the_same_table():
    table = iers.earth_orientation_table.get()
    rng = np.random.default_rng(7)
    for ns in rng.integers(FIRST_NS, LAST_NS, 200).tolist():
        here = EarthOrientation.from_disk(ns).at(ns)
        time = astropy_time(ns)
        ut1, _ = table.ut1_utc(time, return_status=True)
        x, y, _ = table.pm_xy(time, return_status=True)
        assert here.ut1_minus_utc_s == pytest.approx(ut1.to_value(u.s), abs=2e-6)
        assert here.x_pole_rad == pytest.approx(x.to_value(u.rad), abs=1e-4 * ARCSEC)
        assert here.y_pole_rad == pytest.approx(y.to_value(u.rad), abs=1e-4 * ARCSEC)


def test_days_are_measured_or_predicted_with_the_errors_that_astropy_reads_from_finals2000a():
    finals = iers.IERS_A.read(astropy_iers_data.IERS_A_FILE)
    mjd, flags = finals["MJD"].to_value(u.day), np.asarray(finals["UT1Flag_A"]).astype(str)
    last_measured = int(mjd[flags == "I"][-1])
    table = EarthOrientation.from_disk((last_measured - UNIX_EPOCH_MJD) * NS_PER_DAY)
    assert set(table.kind) == {"measured", "predicted"}
    for day, kind, error_s in zip(table.mjd, table.kind, table.ut1_error_s, strict=True):
        row = int(np.searchsorted(mjd, day))
        assert kind == {"I": "measured", "P": "predicted"}[flags[row]]
        assert error_s == pytest.approx(finals["e_UT1_UTC_A"][row].to_value(u.s), abs=1e-9)


def test_planets_and_the_moon_stand_where_astropy_has_them():
    rng = np.random.default_rng(8)
    for ns in rng.integers(from_text("1995-01-01T00:00:00Z"), LAST_NS, 20).tolist():
        site = Site(latitude_deg=rng.uniform(-80, 80), longitude_deg=rng.uniform(-180, 180), height_m=100)
        place = EarthLocation.from_geodetic(site.longitude_deg * u.deg, site.latitude_deg * u.deg, 100 * u.m)
        for body, found in zip(BODIES, bodies_icrs(site, ns), strict=True):
            there = get_body(body.lower(), astropy_time(ns), place, ephemeris="builtin").cartesian.xyz.value
            assert angle(found, there / np.linalg.norm(there)) < 60 * ARCSEC
