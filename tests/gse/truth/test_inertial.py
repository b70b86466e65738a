"""Truth before a star simulator: the shown direction, moved by its rates, and stars that nothing moves."""

import numpy as np
import pytest

from gse.truth import EarthOrientation, InertialTruth, SiderealTruth, horizon_to_sensor, truth_of
from gse.values.instant import NS_PER_S, from_text
from gse.values.mount import InertialDirection, Mount
from gse.values.site import Site

AT = "2026-03-20T18:30:00Z"
AT_NS = from_text(AT)
ROOF = Site(latitude_deg=-6.53, longitude_deg=106.7, height_m=250)
MOVING = InertialDirection(
    ra_deg=50.0,
    de_deg=-20.0,
    roll_deg=30.0,
    ra_rate_arcsec_per_s=36.0,
    de_rate_arcsec_per_s=-72.0,
    roll_rate_arcsec_per_s=18.0,
    at=AT,
)


def angles_of(rotation):
    """RA, DE and the position angle of image up, from north through east, of a rotation from ICRS to the sensor."""
    up, (x, y, z) = -rotation[1], rotation[2]
    ra, de = np.arctan2(y, x), np.arcsin(z)
    east = np.array([-np.sin(ra), np.cos(ra), 0.0])
    north = np.array([-np.sin(de) * np.cos(ra), -np.sin(de) * np.sin(ra), np.cos(de)])
    return np.degrees([ra, de, np.arctan2(up @ east, up @ north)])


@pytest.mark.parametrize(
    ("since_s", "expected"),
    [
        (0.0, (50.0, -20.0, 30.0)),
        (100.0, (51.0, -22.0, 30.5)),
        (-100.0, (49.0, -18.0, 29.5)),
        (1800.0, (68.0, -56.0, 39.0)),
    ],
)
def test_a_moving_direction_is_the_stated_one_and_its_rates_since_its_instant(since_s, expected):
    """36 arcsec/s are a degree in 100 s."""
    truth, utc_ns = InertialTruth(MOVING), AT_NS + round(since_s * NS_PER_S)
    rotation = truth.icrs_to_horizon(utc_ns)
    assert rotation.shape == (3, 3)
    assert angles_of(rotation) == pytest.approx(expected, abs=1e-9)
    assert np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-14
    many = truth.icrs_to_horizon_at(np.array([AT_NS, utc_ns]))
    assert angles_of(many[0]) == pytest.approx((50.0, -20.0, 30.0), abs=1e-9)
    assert np.array_equal(many[1], rotation)


def test_a_direction_that_stands_still_is_that_of_all_times():
    truth = InertialTruth(InertialDirection(ra_deg=200.0, de_deg=70.0, roll_deg=-10.0))
    for utc_ns in (0, AT_NS, 2 * AT_NS):
        assert angles_of(truth.icrs_to_horizon(utc_ns)) == pytest.approx((-160.0, 70.0, -10.0), abs=1e-9)


def test_the_mount_of_a_stand_is_the_identity_and_cannot_be_written_to():
    rotation = horizon_to_sensor(Mount(inertial=MOVING))
    assert np.array_equal(rotation, np.eye(3))
    with pytest.raises(ValueError, match="read-only"):
        rotation[0, 0] = 2.0
    truth = InertialTruth(MOVING)
    attitude = truth.attitude_true(AT_NS, Mount(inertial=MOVING))
    assert np.array_equal(attitude.icrs_to_sensor, truth.icrs_to_horizon(AT_NS))
    assert np.array_equal(attitude.covariance_rad2, np.zeros((3, 3)))


def test_neither_aberration_nor_air_moves_the_stars_of_a_simulator():
    truth, stars = InertialTruth(MOVING), np.eye(3)
    utc_ns = np.array([AT_NS])
    assert np.array_equal(truth.apparent(stars, AT_NS), stars)
    assert np.array_equal(truth.apparent_at(stars, utc_ns, np.eye(3)[None], np.zeros(3, dtype=np.int64)), stars)
    assert np.array_equal(truth.unrefracted(stars, np.array([0.0, 0.0, 1.0])), stars)
    assert (truth.refraction.a_rad, truth.refraction.b_rad) == (0.0, 0.0)
    assert np.array_equal(truth.refraction.removed(stars, np.array([0.6, 0.0, 0.8])), stars)


def test_the_truth_is_of_the_stand_of_the_sky_or_of_nothing():
    table = EarthOrientation.from_disk(AT_NS)
    stand = truth_of(ROOF, Mount(inertial=MOVING), table)
    assert isinstance(stand, InertialTruth)
    assert isinstance(truth_of(ROOF, Mount(inertial=MOVING), None), InertialTruth)
    sky = truth_of(ROOF, Mount(), table)
    assert type(sky) is SiderealTruth
    assert (sky.site, sky.earth_orientation) == (ROOF, table)
    assert truth_of(ROOF, Mount(), None) is None
