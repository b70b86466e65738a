"""Images to panoramas: what the paper's rules and the centres of light give on images whose stars are known."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from skies.night_pictures import drawn

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
    stars = [(60.3, 80.4, 60_000.0), (200.2, 150.7, 500.0)]
    for width in (1.5, 3.0):
        xy_px, index = extract_sub_pixel(image_of(stars, width=width))
        assert xy_px == pytest.approx(np.array(stars)[:, :2], abs=0.1)
        assert index[0] > 3 * index[1]


def test_a_slope_of_the_background_is_no_object() -> None:
    image = image_of([(100, 100, 300)], shape=(512, 512))
    sloping = image + np.linspace(0, 1500, 512).astype(np.uint16)[None, :]
    xy_px, _ = extract_sub_pixel(sloping)
    assert xy_px[0] == pytest.approx([100, 100], abs=0.1)
    assert len(xy_px) == 1


def eight_bits(stars: NDArray[np.float64], smoothing_px: float, noise: float) -> NDArray[np.uint16]:
    """Stars (N, 3) as x, y, peak on a quiet sky in 8 bits, whose noise may be as smooth as compression leaves it."""
    shape, random = (480, 640), np.random.default_rng(3)
    grain = random.standard_normal(shape)
    grain = gaussian_filter(grain, smoothing_px) if smoothing_px else grain
    light = drawn(shape, stars[:, :2], stars[:, 2] * 2 * np.pi * 1.1**2, 1.1) + 40.3 + noise * grain / grain.std()
    return np.clip(np.rint(light), 0, 255).astype(np.uint16) << 4


@pytest.mark.parametrize(("smoothing_px", "noise", "rms_px"), [(0.0, 0.4, 0.01), (2.0, 1.2, 0.06), (0.0, 0.0, 0.01)])
def test_all_stars_of_a_picture_of_8_bits_are_found(smoothing_px: float, noise: float, rms_px: float) -> None:
    """Most neighbouring pixels are equal there, and what noise is left is smooth."""
    stars = np.array([(x, y, peak / 8) for x, y, peak in scattered(30, (470, 640))])
    xy_px, _ = extract_sub_pixel(eight_bits(stars, smoothing_px, noise), step=16)
    off_px = np.linalg.norm(xy_px[:, None] - stars[:, :2], axis=2).min(axis=0)
    assert np.sqrt((off_px**2).mean() / 2) < rms_px


def test_of_thousands_of_objects_the_brightest_are_kept_wherever_they_are() -> None:
    random = np.random.default_rng(8)
    faint = [(x, y, random.uniform(60, 90)) for x in range(10, 1190, 12) for y in range(10, 900, 12)]
    bright = [(40.0 + 38 * k, 985.0 - 2 * k, 400.0 + 10 * k) for k in range(30)]
    table = np.array(faint + bright)
    light = drawn((1000, 1200), table[:, :2], table[:, 2] * 2 * np.pi, 1.0) + 50
    xy_px, _ = extract_sub_pixel(np.rint(light).astype(np.uint16))
    assert np.sort(xy_px[:, 0]) == pytest.approx(np.array(bright)[:, 0], abs=0.1)
    assert xy_px[0] == pytest.approx(bright[-1][:2], abs=0.1)


def test_stars_in_a_glow_rank_by_their_own_light() -> None:
    """The glow of a town, as bright as 1,600 of 4,096: what stands in it looks brighter by as much."""
    stars = [(60.0 + 50 * k, 60.0 + 40 * k, 700.0 - 100 * k) for k in range(5)]
    image = image_of(stars, shape=(400, 400))
    y, x = np.indices(image.shape)
    glow = 1600 * np.exp(-((x - 200) ** 2 + (y - 150) ** 2) / (2 * 200**2))
    xy_px, index = extract_sub_pixel(image + glow.astype(np.uint16))
    assert xy_px[:5] == pytest.approx(np.array(stars)[:, :2], abs=0.2)
    assert index[:5] == pytest.approx([700, 600, 500, 400, 300], rel=0.15)
    assert (index[5:] < 200).all()


def test_two_stars_that_touch_are_two_objects() -> None:
    xy_px, _ = extract_sub_pixel(image_of([(100, 100, 2000), (105.5, 101, 1200)]))
    assert xy_px == pytest.approx(np.array([[100, 100], [105.5, 101]]), abs=0.15)


def test_the_centre_of_a_faint_star_stays_its_own_beside_a_bright_one() -> None:
    xy_px, _ = extract_sub_pixel(image_of([(100, 100, 3900), (106, 101, 390)]))
    assert xy_px == pytest.approx(np.array([[100, 100], [106, 101]]), abs=0.05)


def test_of_saturated_stars_too_one_is_the_brightest() -> None:
    stars = [(40.0, 30.0 + 60 * k, 20_000.0 * (k + 1)) for k in range(3)]
    usual = [(200.0, 20.0 + 20 * k, 500.0) for k in range(10)]
    xy_px, index = extract_sub_pixel(image_of(stars + usual))
    assert index[:3].tolist() == [4096, 4095, 4094]
    assert xy_px[:3] == pytest.approx(np.array(stars)[::-1, :2], abs=0.1)


def test_a_single_step_of_a_picture_of_8_bits_is_no_object() -> None:
    image = np.full((200, 300), 640, dtype=np.uint16)
    image[40:200:40, 30:300:30] = image[41:200:40, 30:300:30] = image[40:200:40, 31:300:30] = 640 + 16
    assert len(extract_sub_pixel(image, step=16)[1]) == 0


@pytest.mark.parametrize(
    ("width_px", "ratio"), [(0.5, 30), (0.5, 100), (0.8, 22), (0.8, 100), (1.2, 22), (1.2, 100), (2.5, 30), (2.5, 100)]
)
def test_centres_reach_the_bound_of_cramer_and_rao(width_px: float, ratio: float) -> None:
    """sqrt(2) times the width / signal-to-noise on each axis, in white noise; plus what pixels cost a narrow star."""
    random = np.random.default_rng(4)
    places = [(40.0 + 75 * (k % 6), 40.0 + 90 * (k // 6)) for k in range(30)]
    xy_px = places + random.uniform(-0.5, 0.5, (30, 2))
    light = np.full(30, ratio * 3.0 * np.sqrt(4 * np.pi) * width_px)
    image = drawn((450, 480), xy_px, light, width_px) + 200 + 3 * random.standard_normal((450, 480))
    seen_px, _ = extract_sub_pixel(np.rint(image).astype(np.uint16))
    off_px = np.linalg.norm(seen_px[:, None] - xy_px, axis=2).min(axis=0)
    rms_px = np.sqrt((off_px[off_px < 1] ** 2).mean() / 2)
    assert (off_px < 1).sum() >= 28
    assert rms_px < 1.25 * np.hypot(np.sqrt(2) * width_px / ratio, 0.03)


@pytest.mark.parametrize("level", [0, 4080])
@pytest.mark.parametrize("shape", [(1, 1), (1, 200), (200, 1), (90, 130)])
def test_an_even_picture_holds_nothing(level: int, shape: tuple[int, int]) -> None:
    assert len(extract_sub_pixel(np.full(shape, level, dtype=np.uint16))[1]) == 0


def test_a_picture_full_of_dots_or_of_torn_light_ends_in_time() -> None:
    """The limits of sep, which raises beyond them: then less of the faint is looked at."""
    random = np.random.default_rng(6)
    dots = np.where(random.random((1500, 1500)) < 0.02, random.uniform(0, 3000, (1500, 1500)), 0)
    torn = gaussian_filter(random.standard_normal((1500, 1500)), 2) * 7 * 500 + 2500
    y, x = np.indices(torn.shape)
    torn[np.hypot(y - 750, x - 750) > 600] = 50
    for image in (dots, torn):
        assert len(extract_sub_pixel(np.clip(image, 0, 4096).astype(np.uint16))[1]) <= 30


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
