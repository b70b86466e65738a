"""Sun and Moon over a site against astropy's high-level frames."""

import astropy.units as u
import numpy as np
import pytest
from astropy.coordinates import AltAz, EarthLocation, get_body
from astropy.time import Time
from astropy.utils import iers

from gse.instant import from_text
from gse.site import Site
from gse.truth.solar_system import icrs_to_horizon, sun_altitude_deg, sun_and_moon_horizon

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


def test_the_altitude_of_one_instant_is_that_of_many() -> None:
    utc_ns = np.array([from_text(text) for text in TIMES])
    sun, _ = sun_and_moon_horizon(SITES[0], utc_ns)
    alone = [sun_altitude_deg(SITES[0], int(value)) for value in utc_ns]
    np.testing.assert_allclose(np.sin(np.radians(alone)), sun[:, 2], atol=1e-12)


def test_the_rotation_to_the_horizon_is_proper() -> None:
    rotations = icrs_to_horizon(SITES[0], np.array([from_text(TIMES[0])]))
    np.testing.assert_allclose(rotations[0] @ rotations[0].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotations[0]) > 0
