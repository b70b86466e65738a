"""Objects as an ideal pinhole sees them: the same directions as the station's camera model gives."""

import numpy as np
import pytest

from gse.camera import Camera
from gse.external.panoramas import SensorDescription, WireUnit
from gse.external.pinhole import brightest_first
from gse.panorama import Panorama


@pytest.mark.parametrize("mirrored", [False, True])
def test_distortion_is_taken_out_as_the_camera_does_it(mirrored):
    camera = Camera(768, 1024, 4000.0, (500.0, 390.0), (0.004, -0.002), mirrored, (0.0011, -0.0007))
    sensor = SensorDescription("made", camera, 4096, WireUnit(1 / 32), WireUnit(1 / 32, 0.5))
    random = np.random.default_rng(1)
    xy_px = np.column_stack([0.5 + random.integers(0, 1024 * 32, 20) / 32, random.integers(0, 768 * 32, 20) / 32])
    brightness = np.arange(20, 0, -1.0)
    panorama = Panorama(0, xy_px, brightness, wire_rows=random.permutation(20))
    counts = sensor.counts([panorama]).values.tolist()
    places, seen = brightest_first(sensor.document(), counts)
    assert [counts[place][2] for place in places] == brightness.tolist()
    expected = camera.directions(xy_px)
    assert np.allclose(seen[:, :2] / camera.focal_length_px, expected[:, :2] / expected[:, 2:], rtol=0, atol=1e-12)
