"""The simulated sky against astropy asked directly, and the station's truth against the simulated sky."""

import math

import astropy.units as u
import numpy as np
import pytest
from astropy.coordinates import AltAz, EarthLocation, SkyCoord
from astropy.time import Time
from astropy.utils import iers

from gse.catalog import load_catalog
from gse.simulator.scene import horizon_to_sensor
from gse.simulator.sky import AstropySite, Sky, orientation_table
from gse.truth import EarthOrientation, SiderealTruth
from gse.truth.frames import horizon_to_sensor as horizon_to_sensor_of_truth
from gse.values.instant import NS_PER_S, from_text, to_text
from gse.values.mount import Mount
from gse.values.site import Site

ARCSEC = math.radians(1 / 3600)
SITE = Site(
    latitude_deg=-6.53, longitude_deg=106.7, height_m=250, pressure_hpa=985, temperature_c=25, relative_humidity=0.8
)
START_NS = from_text("2026-03-20T15:00:00Z")
MOUNTS = [
    Mount(),
    Mount(azimuth_deg=140, altitude_deg=45, roll_deg=30),
    Mount(azimuth_deg=-60, altitude_deg=30, roll_deg=-170),
]


@pytest.mark.parametrize("seconds", [0, 17.3, 151, 299.9])
def test_between_the_anchors_stars_are_where_astropy_sees_them(seconds: float) -> None:
    utc_ns = START_NS + round(seconds * NS_PER_S)
    catalog = load_catalog()
    cell = Sky(AstropySite(SITE), catalog).cell(utc_ns, horizon_to_sensor(Mount())[2], math.radians(10), 5.0)
    location = EarthLocation.from_geodetic(106.7 * u.deg, -6.53 * u.deg, 250 * u.m)
    frame = AltAz(
        obstime=Time(to_text(utc_ns, 9)[:-1], scale="utc"),
        location=location,
        pressure=985 * u.hPa,
        temperature=25 * u.deg_C,
        relative_humidity=0.8,
        obswl=0.6 * u.um,
    )
    bright = catalog.icrs[catalog.magnitude < 5.0]
    stars = SkyCoord(*bright.T, representation_type="cartesian", frame="icrs")
    stars = SkyCoord(ra=stars.spherical.lon, dec=stars.spherical.lat)
    with (
        iers.earth_orientation_table.set(iers.IERS_A.open(iers.IERS_A_FILE)),
        iers.conf.set_temp("auto_download", False),
    ):
        seen = stars.transform_to(frame).cartesian.xyz.value.T
    seen = seen[:, [1, 0, 2]]  # astropy's horizon is north, east, up
    nearest = np.linalg.norm(cell.track.directions(utc_ns)[:, None] - seen[None], axis=2).min(axis=1)
    assert len(nearest) > 5
    assert nearest.max() < 1e-3 * ARCSEC


@pytest.mark.parametrize("mount", MOUNTS)
def test_the_truth_puts_stars_where_the_simulated_sky_has_them(mount: Mount) -> None:
    catalog = load_catalog().rows(slice(0, 3000))
    truth = SiderealTruth(SITE, EarthOrientation.from_disk(START_NS))
    sky = Sky(AstropySite(SITE), catalog)
    to_sensor = horizon_to_sensor(mount)
    for seconds in (3, 160, 4000, 40_000):
        utc_ns = START_NS + seconds * NS_PER_S
        seen_sensor = sky.cell(utc_ns, to_sensor[2], math.radians(7), 9.0).track.directions(utc_ns) @ to_sensor.T
        measured = truth.unrefracted(seen_sensor, to_sensor[:, 2])
        true = truth.apparent(catalog.icrs, utc_ns) @ truth.icrs_to_horizon(utc_ns).T @ to_sensor.T
        apart = np.linalg.norm(measured[:, None] - true[None], axis=2).min(axis=1)
        assert len(apart) > 5
        assert np.degrees(np.arccos(seen_sensor[:, 2])).min() < 7
        assert apart.max() < 0.01 * ARCSEC


@pytest.mark.parametrize("mount", [*MOUNTS, Mount(azimuth_deg=33, altitude_deg=89.9, roll_deg=123)])
def test_both_readings_of_the_mount_are_the_same(mount: Mount) -> None:
    assert np.abs(horizon_to_sensor(mount) - horizon_to_sensor_of_truth(mount)).max() < 1e-15


def test_no_star_is_seen_below_the_horizon() -> None:
    cell = Sky(AstropySite(SITE), load_catalog()).cell(
        START_NS, horizon_to_sensor(Mount(altitude_deg=0))[2], math.radians(10), 7.0
    )
    assert len(cell.magnitude) > 20
    assert cell.track.nodes[:, :, 2].min() > 0


def test_an_instant_past_the_iers_tables_has_a_sky_too() -> None:
    sky = Sky(AstropySite(SITE), load_catalog().rows(slice(0, 3000)))
    cell = sky.cell(from_text("2055-01-01T00:00:00Z"), horizon_to_sensor(Mount())[2], math.radians(10), 6.0)
    assert len(cell.magnitude) > 5


def test_stars_closer_than_the_footprint_are_one_with_the_light_of_both() -> None:
    catalog = load_catalog()
    boresight = horizon_to_sensor(Mount())[2]
    single = Sky(AstropySite(SITE), catalog).cell(START_NS, boresight, math.radians(10), 9.0)
    merged = Sky(AstropySite(SITE), catalog, math.radians(100 / 3600)).cell(START_NS, boresight, math.radians(10), 9.0)
    assert len(merged.magnitude) < len(single.magnitude)
    assert (10 ** (-0.4 * merged.magnitude)).sum() == pytest.approx((10 ** (-0.4 * single.magnitude)).sum(), rel=1e-9)


def test_the_earth_turns_as_in_astropys_own_table() -> None:
    ours, astropys = orientation_table(), iers.IERS_A.open(iers.IERS_A_FILE)
    for column in ("MJD", "UT1_UTC", "PM_x", "PM_y"):
        assert ours[column].unit == astropys[column].unit
        np.testing.assert_array_equal(ours[column].value, astropys[column].value)
