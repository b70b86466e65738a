"""The mount's angles and its rotation: axes by hand, and the angles back from the rotation."""

import math

import numpy as np
import pytest

from gse.truth.frames import horizon_to_sensor, mount_of
from gse.values.mount import InertialDirection, Mount

ARCSEC_DEG = 1 / 3600
EAST, NORTH, UP = np.eye(3)


@pytest.mark.parametrize(
    ("angles_deg", "boresight", "image_up"),
    [
        # At the zenith image up is away from the azimuth: the direction of the zenith just before the boresight.
        ((0, 90, 0), UP, -NORTH),
        ((90, 90, 0), UP, -EAST),
        ((0, 0, 0), NORTH, UP),
        ((90, 0, 0), EAST, UP),
        ((180, 0, 0), -NORTH, UP),
        ((0, -90, 0), -UP, NORTH),
        # A roll turns image up towards smaller azimuth: looking north to the west, looking east to the north.
        ((0, 0, 90), NORTH, -EAST),
        ((90, 0, 90), EAST, NORTH),
        ((0, 0, 180), NORTH, -UP),
        ((0, 0, 270), NORTH, EAST),
        ((0, 45, 0), (NORTH + UP) / math.sqrt(2), (UP - NORTH) / math.sqrt(2)),
        ((30, 0, 0), EAST / 2 + NORTH * math.sqrt(0.75), UP),
        ((30, 0, 90), EAST / 2 + NORTH * math.sqrt(0.75), -EAST * math.sqrt(0.75) + NORTH / 2),
    ],
)
def test_the_boresight_and_image_up_are_where_the_angles_say(angles_deg, boresight, image_up):
    """Rows run down the image, and x, y, z are right-handed."""
    azimuth_deg, altitude_deg, roll_deg = angles_deg
    rotation = horizon_to_sensor(Mount(azimuth_deg=azimuth_deg, altitude_deg=altitude_deg, roll_deg=roll_deg))
    assert rotation[2] == pytest.approx(boresight, abs=1e-15)
    assert -rotation[1] == pytest.approx(image_up, abs=1e-15)
    assert rotation[0] == pytest.approx(np.cross(rotation[1], rotation[2]), abs=1e-15)


@pytest.mark.parametrize(
    "angles_deg",
    [(0, 0, 0), (40, 50, 20), (123.4, 41, 200), (359.9, -30, 359), (250, -89, 90), (180, 89.999, 5), (10, 0.001, 270)],
)
def test_the_angles_of_a_rotation_are_those_that_made_it(angles_deg):
    names = ("azimuth_deg", "altitude_deg", "roll_deg")
    found = mount_of(horizon_to_sensor(Mount(**dict(zip(names, map(float, angles_deg), strict=True)))))
    assert [getattr(found, name) for name in names] == pytest.approx(angles_deg, abs=1e-9)


@pytest.mark.parametrize(
    ("from_zenith_arcsec", "is_known"), [(0.0, False), (0.0100, False), (0.0106, True), (0.02, True)]
)
@pytest.mark.parametrize("sign", [1, -1])
def test_within_a_hundredth_of_an_arcsecond_of_zenith_or_nadir_azimuth_is_called_0(from_zenith_arcsec, is_known, sign):
    """5e-8 of a circle's radius are 0.0103 arcsec. The image is turned the same, by azimuth or by roll."""
    altitude_deg = sign * (90 - from_zenith_arcsec * ARCSEC_DEG)
    rotation = horizon_to_sensor(Mount(azimuth_deg=70.0, altitude_deg=altitude_deg, roll_deg=30.0))
    found = mount_of(rotation)
    assert found.azimuth_deg == pytest.approx(70.0 if is_known else 0.0, abs=1e-5)
    # Looking up, azimuth turns the image the way that roll does, looking down the other way.
    whole_deg = 30.0 if is_known else 30.0 + sign * 70.0
    assert math.remainder(found.roll_deg - whole_deg, 360.0) == pytest.approx(0.0, abs=1e-5)
    assert np.abs(horizon_to_sensor(found) - rotation).max() < 1e-7


def test_a_rotation_is_kept_and_nobody_may_write_into_it():
    assert not horizon_to_sensor(Mount(azimuth_deg=1.0)).flags.writeable
    assert not horizon_to_sensor(Mount(inertial=InertialDirection(ra_deg=1.0, de_deg=2.0))).flags.writeable
