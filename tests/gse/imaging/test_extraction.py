"""Images to panoramas: what the paper's rules and the centres of light give on images whose stars are known."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from gse.imaging.extraction import extract, extract_sub_pixel, without_hot_pixels

LEVEL = 100


def image_of(
    stars: list[tuple[float, float, float]], shape: tuple[int, int] = (256, 320), noise: float = 3.0, width: float = 1.0
) -> NDArray[np.uint16]:
    """Gaussian stars (x, y, peak) on a level of 100 with noise, cut at 4096."""
    y, x = np.indices(shape)
    light = np.full(shape, float(LEVEL))
    for star_x, star_y, peak in stars:
        light += peak * np.exp(-((x - star_x) ** 2 + (y - star_y) ** 2) / (2 * width**2))
    light += np.random.default_rng(5).normal(0, noise, shape)
    return np.clip(np.rint(light), 0, 4096).astype(np.uint16)


def scattered(count: int, shape: tuple[int, int] = (256, 320)) -> list[tuple[float, float, float]]:
    """Stars at least 6 rows apart, so that none hides another."""
    random = np.random.default_rng(2)
    rows = 6 + 8 * np.arange(count) + random.random(count)
    return [(random.uniform(5, shape[1] - 6), y, 200 * 1.1 ** random.uniform(0, 20)) for y in rows]


def test_each_star_gives_one_object_at_its_brightest_pixel() -> None:
    stars = scattered(30)
    xy_px, index = extract(image_of(stars))
    assert len(index) == 30
    assert (np.diff(index) <= 0).all()
    for x, y, peak in stars:
        nearest = np.argmin(np.linalg.norm(xy_px - (x, y), axis=1))
        assert np.abs(xy_px[nearest] - (x, y)).max() < 0.75
        assert 0.7 * peak < index[nearest] - LEVEL < 1.1 * peak + 10


def test_of_two_stars_in_the_same_rows_only_the_brighter_is_seen() -> None:
    xy_px, index = extract(image_of([(50, 100, 2000), (200, 100, 1000)]))
    assert xy_px[0].tolist() == [50, 100]
    assert index[1] < 200


def test_a_saturated_star_is_one_object_in_the_middle_of_its_plateau() -> None:
    xy_px, index = extract(image_of([(60, 80, 60_000), (200, 150, 500)], width=1.5))
    assert index[0] == 4096
    assert abs(xy_px[0, 1] - 80) <= 1
    assert xy_px[1].tolist() == [200, 150]


def test_the_brightest_objects_come_first_and_at_most_30() -> None:
    xy_px, index = extract(image_of([], noise=20))
    assert len(index) == len(xy_px) == 30
    assert (np.diff(index) <= 0).all()


def test_nothing_is_found_in_a_black_image() -> None:
    black = np.zeros((64, 64), dtype=np.uint16)
    assert len(extract(black)[1]) == 0
    assert len(extract_sub_pixel(black)[1]) == 0


def test_centres_of_light_are_good_to_a_tenth_of_a_pixel() -> None:
    stars = scattered(30)
    xy_px, index = extract_sub_pixel(image_of(stars))
    assert len(index) == 30
    off_px = [np.linalg.norm(xy_px - (x, y), axis=1).min() for x, y, _ in stars]
    assert np.median(off_px) < 0.05
    assert max(off_px) < 0.2


def test_centres_of_light_see_two_stars_in_one_row() -> None:
    xy_px, _ = extract_sub_pixel(image_of([(50.3, 100, 2000), (200.6, 100, 1000)]))
    assert xy_px == pytest.approx(np.array([[50.3, 100], [200.6, 100]]), abs=0.05)


def test_the_centre_of_a_saturated_star_is_the_centre_of_its_plateau() -> None:
    xy_px, _ = extract_sub_pixel(image_of([(60.3, 80.4, 60_000)], width=1.5))
    assert xy_px[0] == pytest.approx([60.3, 80.4], abs=0.1)


def test_a_slope_of_the_background_is_no_object() -> None:
    image = image_of([(100, 100, 300)], shape=(512, 512))
    sloping = image + np.linspace(0, 1500, 512).astype(np.uint16)[None, :]
    xy_px, _ = extract_sub_pixel(sloping)
    assert xy_px[0] == pytest.approx([100, 100], abs=0.1)
    assert len(xy_px) == 1


def test_a_hot_pixel_is_an_object_until_the_map_names_it() -> None:
    image = image_of([(100, 100, 300)])
    image[33, 44] = image[0, 0] = image[0, 1] = 4000
    assert extract(image)[0][0].tolist() in ([0, 0], [44, 33])
    repaired = without_hot_pixels(image, [(44, 33), (0, 0), (1, 0), (999, 999)])
    assert extract(repaired)[0][0].tolist() == [100, 100]
    assert abs(int(repaired[33, 44]) - LEVEL) < 10
    assert image[33, 44] == 4000


def test_a_lone_bright_pixel_has_no_centre_of_light() -> None:
    image = image_of([(100, 100, 300)])
    image[33, 44] = 4000
    assert len(extract_sub_pixel(image)[1]) == 1


@settings(max_examples=30)
@given(st.integers(1, 70), st.integers(1, 70), st.integers(0, 2**32 - 1), st.sampled_from([0, 1, 4096, 65535]))
@example(rows=17, columns=1, seed=0, brightest=4096)
def test_any_image_gives_objects_inside_it(rows: int, columns: int, seed: int, brightest: int) -> None:
    image = np.random.default_rng(seed).integers(0, brightest + 1, (rows, columns)).astype(np.uint16)
    for xy_px, index in (extract(image), extract_sub_pixel(image)):
        assert xy_px.shape == (len(index), 2)
        assert len(index) <= 30
        assert (np.diff(index) <= 0).all()
        assert ((xy_px >= -0.5) & (xy_px <= (columns - 0.5, rows - 0.5))).all()
