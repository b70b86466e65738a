"""Sun and Moon over a site against astropy's high-level frames."""

import astropy.units as u
import erfa
import numpy as np
import pytest
from astropy.coordinates import AltAz, EarthLocation, get_body
from astropy.time import Time
from astropy.utils import iers

from gse.truth import EarthOrientation, SiderealTruth
from gse.truth.solar_system import bodies_icrs, icrs_to_horizon, moon_lit_share, sun_altitude_deg, sun_and_moon_horizon
from gse.values.instant import from_text
from gse.values.site import Site

SITES = [
    Site(latitude_deg=-6.53, longitude_deg=106.7, height_m=250),
    Site(latitude_deg=90.0, longitude_deg=0.0),
    Site(latitude_deg=-16.8, longitude_deg=180.0),
    Site(latitude_deg=-43.99, longitude_deg=170.46, height_m=1000),
]
TIMES = ["2026-03-20T15:00:00Z", "2026-06-21T12:00:00Z", "2026-07-01T00:00:00Z", "2026-12-24T18:00:00Z"]


@pytest.mark.parametrize("site", SITES)
def test_sun_and_moon_are_where_astropy_sees_them(site: Site) -> None:
    utc_ns = np.array([from_text(text) for text in TIMES])
    place = EarthLocation.from_geodetic(site.longitude_deg * u.deg, site.latitude_deg * u.deg, site.height_m * u.m)
    with iers.conf.set_temp("auto_download", False), iers.conf.set_temp("auto_max_age", None):
        times = Time([text[:-1] for text in TIMES], scale="utc")
        frame = AltAz(obstime=times, location=place)
        theirs = [get_body(name, times, place).transform_to(frame).cartesian.xyz.value.T for name in ("sun", "moon")]
    for ours, expected in zip(sun_and_moon_horizon(site, utc_ns), theirs, strict=True):
        expected = (expected / np.linalg.norm(expected, axis=1)[:, None])[:, [1, 0, 2]]  # astropy: x north, y east
        assert np.degrees(np.abs(ours - expected).max()) < 0.05


ARCSEC = np.pi / 180 / 3600
AU_M, LIGHT_AU_PER_DAY = 149_597_870_700.0, 299_792_458.0 * 86_400 / 149_597_870_700


@pytest.mark.parametrize("text", ["2026-03-20T15:00:00Z", "2024-10-05T03:17:11Z"])
def test_a_planet_stands_where_it_was_when_its_light_left(text: str) -> None:
    """In ERFA's numbers of the planets, with the time of light by iteration."""
    utc_ns = from_text(text)
    day, fraction = 2_440_587.5, utc_ns / 86_400e9
    earth = erfa.epv00(day, fraction)[0]["p"]
    found = bodies_icrs(SITES[0], utc_ns)
    assert found.shape == (7, 3)
    for number, seen in zip((1, 2, 4, 5, 6, 7), found, strict=False):
        away = erfa.plan94(day, fraction, number)["p"] - earth
        for _ in range(5):
            away = erfa.plan94(day, fraction - np.linalg.norm(away) / LIGHT_AU_PER_DAY, number)["p"] - earth
        assert np.linalg.norm(seen - away / np.linalg.norm(away)) < 0.05 * ARCSEC


@pytest.mark.parametrize("site", SITES)
def test_the_moon_is_seen_from_the_site_and_not_from_the_centre_of_the_earth(site: Site) -> None:
    """The horizon of the full truth, and the place of the site by WGS84; polar motion and UT1 are seconds of arc."""
    utc_ns = from_text("2026-03-20T15:00:00Z")
    truth = SiderealTruth(site, EarthOrientation.from_disk(utc_ns), {"UT1", "polar motion"}).icrs_to_horizon(utc_ns)
    moon_au = erfa.moon98(2_440_587.5, utc_ns / 86_400e9)["p"]
    longitude, latitude = np.radians([site.longitude_deg, site.latitude_deg])
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    up = np.array([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)])
    site_m = erfa.gd2gc(1, longitude, latitude, site.height_m)
    away = truth @ moon_au - np.array([east @ site_m, np.cross(up, east) @ site_m, up @ site_m]) / AU_M
    away /= np.linalg.norm(away)
    assert np.linalg.norm(truth @ bodies_icrs(site, utc_ns)[6] - away) < 0.1 * ARCSEC
    _, moon = sun_and_moon_horizon(site, np.array([utc_ns]))
    assert np.linalg.norm(moon[0] - away) < 0.1 * ARCSEC


@pytest.mark.parametrize("site", SITES)
def test_the_plain_rotation_to_the_horizon_is_the_full_one_without_ut1_and_the_pole(site: Site) -> None:
    utc_ns = np.array([from_text(text) for text in TIMES])
    for instant, rotation in zip(utc_ns.tolist(), icrs_to_horizon(site, utc_ns), strict=True):
        truth = SiderealTruth(site, EarthOrientation.from_disk(instant), {"UT1", "polar motion"})
        assert np.abs(rotation - truth.icrs_to_horizon(instant)).max() < 0.01 * ARCSEC


def test_the_sun_stands_opposite_to_the_earth() -> None:
    utc_ns = np.array([from_text(text) for text in TIMES])
    sun, _ = sun_and_moon_horizon(SITES[3], utc_ns)
    for instant, seen, rotation in zip(utc_ns.tolist(), sun, icrs_to_horizon(SITES[3], utc_ns), strict=True):
        earth = erfa.epv00(2_440_587.5, instant / 86_400e9)[0]["p"]
        assert np.abs(seen + rotation @ earth / np.linalg.norm(earth)).max() < 1e-8
        assert sun_altitude_deg(SITES[3], instant) == pytest.approx(np.degrees(np.arcsin(seen[2])), abs=1e-9)


def test_the_lit_share_of_the_moon_is_that_of_astropy() -> None:
    days = [f"2026-03-{day:02d}T15:00:00" for day in (3, 7, 11, 18, 22, 26)]
    with iers.conf.set_temp("auto_download", False), iers.conf.set_temp("auto_max_age", None):
        sun, moon = (get_body(name, Time(days, scale="utc")).cartesian.xyz.to_value("km") for name in ("sun", "moon"))
    to_sun, to_earth = sun - moon, -moon
    cosine = (to_sun * to_earth).sum(axis=0) / np.linalg.norm(to_sun, axis=0) / np.linalg.norm(to_earth, axis=0)
    lit = moon_lit_share(np.array([from_text(f"{day}Z") for day in days]))
    assert lit == pytest.approx((1 + cosine) / 2, abs=0.01)
    assert lit[0] > 0.99  # the eclipse of 3 March 2026
