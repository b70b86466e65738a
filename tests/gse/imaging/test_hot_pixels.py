"""Hot pixels, limit by limit: how often seen, how often a star, how far the sky moved."""

import numpy as np
import pytest

from gse.imaging.session_fit import MIN_MOTION_PX, MIN_PANORAMAS, MIN_SHARE, hot_pixels

NO_STAR, STAR = np.empty(0, dtype=np.int64), np.array([0])
ELSEWHERE = np.array([[900.0, 900.0]])


def found(*, seen, of=40, stars=0, moved_px=100.0, at=(100.0, 200.0)):
    """The hot pixels where ``seen`` of some panoramas show one object, which is named a star in some of them."""
    panoramas = [np.array([at]) if number < seen else np.empty((0, 2)) for number in range(of)]
    return hot_pixels(panoramas, [STAR if number < stars else NO_STAR for number in range(of)], moved_px)


@pytest.mark.parametrize("of", [40, 20])
def test_a_hot_pixel_is_seen_in_a_share_of_the_panoramas(of):
    enough = round(MIN_SHARE * of)
    assert found(seen=enough, of=of) == ((100, 200),)
    assert found(seen=enough - 1, of=of) == ()


@pytest.mark.parametrize(("seen", "stars", "hot"), [(40, 19, True), (40, 20, False), (40, 40, False), (20, 9, True)])
def test_an_object_that_is_a_star_half_of_the_time_is_not_a_hot_pixel(seen, stars, hot):
    assert bool(found(seen=seen, stars=stars)) is hot


def test_nothing_is_said_on_few_panoramas():
    assert found(seen=MIN_PANORAMAS, of=MIN_PANORAMAS)
    assert not found(seen=MIN_PANORAMAS - 1, of=MIN_PANORAMAS - 1)


def test_nothing_is_said_before_the_sky_has_moved():
    assert found(seen=40, moved_px=MIN_MOTION_PX)
    assert not found(seen=40, moved_px=MIN_MOTION_PX - 0.1)


def test_an_object_belongs_to_the_nearest_pixel_and_pixels_are_sorted():
    assert found(seen=40, at=(99.6, 200.4)) == ((100, 200),)
    panoramas = [np.array([[7.0, 3.0], [5.0, 9.0], [5.0, 2.0]])] * 30
    assert hot_pixels(panoramas, [NO_STAR] * 30, 100.0) == ((5, 2), (5, 9), (7, 3))


def test_two_objects_on_one_pixel_are_seen_once():
    twice = [np.array([[10.0, 10.0], [10.2, 9.9]])] * 11 + [ELSEWHERE] * 29
    assert hot_pixels(twice, [NO_STAR] * 40, 100.0) == ((900, 900),)


def test_a_star_on_a_row_of_its_own_does_not_excuse_another_object():
    both = [np.array([[10.0, 10.0], [20.0, 20.0]])] * 40
    assert hot_pixels(both, [np.array([1])] * 40, 100.0) == ((10, 10),)
