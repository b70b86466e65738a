"""Pixels become directions, and back."""

import math

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from gse.values.camera import LEAST_SCALE, Camera

PLAIN = Camera(1024, 1024, 4170.0, (511.5, 511.5))
DISTORTED = Camera(768, 1024, 5113.75, (511.5, 383.5), (-0.0011, 0.0002))
PLACES = np.stack(np.meshgrid(np.linspace(-0.5, 1023.5, 17), np.linspace(-0.5, 767.5, 13)), axis=-1).reshape(-1, 2)
MIRRORED = Camera(768, 1024, 5113.75, (500.0, 390.0), (-0.0011, 0.0), mirrored=True)


_TERM = st.floats(-1, 1) | st.floats(-0.1, 0.1) | st.just(0.0)


@given(st.tuples(_TERM, _TERM), st.tuples(_TERM, _TERM), st.tuples(st.floats(-300, 1300), st.floats(-300, 1300)))
@example((0.5, 0.0), (0.0, 0.0), (511.5, 383.5))
@example((0.3, 0.1), (0.0, 0.0), (511.5, 383.5))
@example((1.0, -0.3), (0.0, 0.0), (511.5, 383.5))
@example((-0.5, 0.2), (0.05, -0.05), (511.5, 383.5))
def test_every_pixel_comes_back_through_every_lens_that_does_not_fold_the_detector(
    k: tuple[float, float], p: tuple[float, float], centre: tuple[float, float]
) -> None:
    camera = Camera(768, 1024, 5113.75, centre, k, tangential_distortion=p)
    assume(camera.fold() is None)
    assert np.abs(camera.pixels(camera.directions(PLACES)) - PLACES).max() < 1e-6


@pytest.mark.parametrize("k", [(-0.2, 0.0), (-0.5, 0.0), (0.1, -0.1), (-1.0, 0.4)])
def test_a_lens_that_folds_the_detector_is_told_with_the_place_where_two_pixels_look_the_same_way(k) -> None:
    camera = Camera(1024, 1024, 4170.0, (511.5, 511.5), k)
    place = camera.fold()
    assert place is not None
    x, y, scale = place
    assert scale < LEAST_SCALE
    outwards = np.array([x, y]) - 511.5
    along = camera.directions(511.5 + outwards * np.linspace(0, 1, 1000)[:, None])
    from_axis = np.hypot(along[:, 0], along[:, 1]) / along[:, 2]
    assert (np.diff(from_axis) < 0).any()


def test_a_lens_close_to_folding_in_a_corner_is_told_and_one_that_is_not_is_not() -> None:
    # 1 + 3 k1 s^2 is 0 where s^2 = 2, in the corner, for k1 = -1/6
    assert Camera(1024, 1024, 4170.0, (511.5, 511.5), (-0.1656, 0.0)).fold() is not None
    assert Camera(1024, 1024, 4170.0, (511.5, 511.5), (-0.1620, 0.0)).fold() is None


def test_a_direction_that_no_pixel_looks_in_has_none() -> None:
    # with k1 = -0.15 no offset becomes more than 1.49 * 2 / 3 half widths
    camera = Camera(1024, 1024, 512.0, (511.5, 511.5), (-0.15, 0.0))
    assert np.isnan(camera.pixels(np.array([[1.1, 0.0, 1.0], [np.nan, 0.0, 1.0], [0.1, 0.0, -1.0]]))).all()
    assert camera.pixels(np.array([[0.9, 0.0, 1.0]]))[0, 0] > 511.5


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


def opencv(ideal, k, p):
    """Measured from ideal normalised places (N, 2), as OpenCV's documentation (calib3d) has the formula."""
    x, y = ideal.T
    r2 = x * x + y * y
    radial = 1 + k[0] * r2 + k[1] * r2**2
    return np.column_stack(
        [
            x * radial + 2 * p[0] * x * y + p[1] * (r2 + 2 * x * x),
            y * radial + p[0] * (r2 + 2 * y * y) + 2 * p[1] * x * y,
        ]
    )


def test_tangential_distortion_is_opencvs_with_the_stated_change_of_units():
    focal_px, half_px, p = 4169.9, 512.0, (3e-4, -5e-4)
    ours = tuple(-value * half_px / focal_px for value in p)
    camera = Camera(1024, 1024, focal_px, (511.5, 511.5), tangential_distortion=ours)
    ideal = np.random.default_rng(1).uniform(-0.12, 0.12, (200, 2))
    measured_px = opencv(ideal, (0.0, 0.0), p) * focal_px + 511.5
    moved_px = np.abs(measured_px - ideal * focal_px - 511.5).max()
    rays = camera.directions(measured_px)
    assert moved_px > 0.05
    # one is the inverse of the other to first order: what is left is of second order
    assert np.abs(rays[:, :2] / rays[:, 2:] - ideal).max() * focal_px < 1e-3 * moved_px


def test_tangential_distortion_in_one_direction_is_opencvs_formula_to_the_digit():
    p, half_px, focal_px = (0.004, -0.003), 512.0, 4169.9
    camera = Camera(1024, 1024, focal_px, (500.0, 520.0), (0.01, -0.002), tangential_distortion=p)
    xy_px = np.random.default_rng(2).uniform(0, 1023, (200, 2))
    expected = opencv((xy_px - [500.0, 520.0]) / half_px, (0.01, -0.002), p) * half_px / focal_px
    rays = camera.directions(xy_px)
    assert np.abs(rays[:, :2] / rays[:, 2:] - expected).max() < 1e-14


@pytest.mark.parametrize("mirrored", [False, True])
def test_tangential_distortion_goes_there_and_back(mirrored):
    camera = Camera(1024, 1024, 4169.9, (500.0, 520.0), (0.02, -0.01), mirrored, (0.006, -0.004))
    xy_px = np.random.default_rng(3).uniform(0, 1023, (200, 2))
    assert np.abs(camera.pixels(camera.directions(xy_px)) - xy_px).max() < 1e-6
