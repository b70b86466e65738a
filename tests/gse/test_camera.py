"""Pixels become directions, and back."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gse.camera import Camera

PLAIN = Camera(1024, 1024, 4170.0, (511.5, 511.5))
DISTORTED = Camera(768, 1024, 5113.75, (511.5, 383.5), (-0.0011, 0.0002))
MIRRORED = Camera(768, 1024, 5113.75, (500.0, 390.0), (-0.0011, 0.0), mirrored=True)


@given(st.sampled_from([PLAIN, DISTORTED, MIRRORED]), st.floats(-0.5, 1023.5), st.floats(-0.5, 767.5))
def test_a_pixel_comes_back_from_its_direction(camera: Camera, x: float, y: float) -> None:
    pixel = np.array([[x, y]])
    assert camera.pixels(camera.directions(pixel)) == pytest.approx(pixel, abs=1e-6)


def test_the_principal_point_looks_along_the_boresight() -> None:
    assert PLAIN.directions(np.array([[511.5, 511.5]])).tolist() == [[0.0, 0.0, 1.0]]


def test_x_runs_along_columns_and_y_down_the_rows() -> None:
    right, below = PLAIN.directions(np.array([[600.0, 511.5], [511.5, 600.0]]))
    assert right[0] > 0
    assert right[1] == 0
    assert below[1] > 0
    assert below[0] == 0


def test_a_mirrored_image_has_its_x_flipped() -> None:
    right = MIRRORED.directions(np.array([[600.0, 390.0]]))[0]
    assert right[0] < 0


def test_distortion_is_as_the_station_file_defines_it() -> None:
    direction = DISTORTED.directions(np.array([[1023.5, 383.5]]))[0]
    assert direction[0] / direction[2] == pytest.approx(512 * (1 - 0.0011 + 0.0002) / 5113.75, rel=1e-12)


def test_what_is_behind_the_camera_has_no_pixel() -> None:
    assert np.isnan(PLAIN.pixels(np.array([[0.1, 0.0, -1.0]]))).all()


def test_the_solid_angle_is_that_of_the_field() -> None:
    square = Camera(1024, 1024, 512 / math.tan(math.radians(7)), (511.5, 511.5))
    assert square.solid_angle_sr == pytest.approx(4 * math.asin(math.sin(math.radians(7)) ** 2), rel=1e-12)
