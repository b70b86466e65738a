"""Hot pixels, limit by limit: how often seen, how often a star, how far the sky moved."""

import numpy as np
import pytest

from gse.imaging.session_fit import hot_pixels

NO_STAR, STAR = np.empty(0, dtype=np.int64), np.array([0])
ELSEWHERE = np.array([[900.0, 900.0]])


def found(*, seen, of=40, stars=0, moved_px=100.0, at=(100.0, 200.0)):
    """The hot pixels where ``seen`` of some panoramas show one object, which is named a star in some of them."""
    panoramas = [np.array([at]) if number < seen else np.empty((0, 2)) for number in range(of)]
    return hot_pixels(panoramas, [STAR if number < stars else NO_STAR for number in range(of)], moved_px)


@pytest.mark.parametrize(("seen", "of", "hot"), [(12, 40, True), (11, 40, False), (6, 20, True), (5, 20, False)])
def test_a_hot_pixel_is_seen_in_three_panoramas_of_ten(seen, of, hot):
    assert found(seen=seen, of=of) == (((100, 200),) if hot else ())


@pytest.mark.parametrize(("seen", "stars", "hot"), [(40, 19, True), (40, 20, False), (40, 40, False), (20, 9, True)])
def test_an_object_that_is_a_star_half_of_the_time_is_not_a_hot_pixel(seen, stars, hot):
    assert bool(found(seen=seen, stars=stars)) is hot


@pytest.mark.parametrize(("of", "hot"), [(20, True), (19, False)])
def test_nothing_is_said_on_fewer_than_twenty_panoramas(of, hot):
    assert bool(found(seen=of, of=of)) is hot


@pytest.mark.parametrize(("moved_px", "hot"), [(8.0, True), (7.9, False), (0.0, False)])
def test_nothing_is_said_before_the_sky_has_moved_by_eight_pixels(moved_px, hot):
    assert bool(found(seen=40, moved_px=moved_px)) is hot


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
