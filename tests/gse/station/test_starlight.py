"""The light of named stars, and the Moon's glare, by numbers made by hand."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from skies.one_by_one import DARK, Light, lights_of

from gse.identifier import Answers, Identification, Reason, Unidentified
from gse.station.shown_stars import rows_of, starlights
from gse.values.panorama import Parts

CATALOG = SimpleNamespace(magnitude=np.array([1.0, 2.0, 3.0, 5.0, 6.5]))


def light(brightness, stars):
    named = Identification(np.arange(len(stars)), np.array(stars), 1e-9)
    return starlights(
        np.array(brightness), Parts.of_counts(np.array([len(brightness)])), Answers.from_answers([named]), CATALOG
    )


def test_the_zero_point_is_the_magnitude_of_one_index_value_and_no_catalogue_star_is_a_magnitude_fainter():
    found = light([10 ** (0.4 * (14 - CATALOG.magnitude[star])) for star in (0, 1, 3)], [0, 1, 3])
    assert (found.stars[0], found.limiting_mag[0]) == (3, 5.0)
    assert found.zero_point_mag[0] == pytest.approx(14.0)
    assert found.faintest_index[0] == pytest.approx(10 ** (0.4 * (14.0 - 6.5 + 1.0)))


def test_an_index_value_of_nothing_counts_as_one():
    assert light([0.0, 100.0], [2, 1]).zero_point_mag[0] == pytest.approx((3.0 + 2.0 + 5.0) / 2)


def test_a_sensor_that_sends_no_brightness_has_no_zero_point():
    found = light([7.0, 7.0, 7.0], [0, 1, 2])
    assert math.isnan(found.zero_point_mag[0])
    assert found.faintest_index[0] == math.inf


def test_the_light_of_panoramas_one_by_one_is_that_of_all_of_them():
    lights = [Light(7, 14.5, 5.5, 30.0), DARK, Light(9, 13.5, 4.5, 40.0)]
    made = lights_of(lights)
    assert (made.stars.tolist(), made.faintest_index.tolist()) == ([7, 0, 9], [30.0, math.inf, 40.0])
    assert made.zero_point_mag == pytest.approx([14.5, math.nan, 13.5], nan_ok=True)
    assert made.limiting_mag == pytest.approx([5.5, math.nan, 4.5], nan_ok=True)


NO_MATCH = Unidentified(Reason.NO_MATCH, "")


def named(objects, stars):
    return Identification(np.array(objects, dtype=np.int64), np.array(stars, dtype=np.int64), 1e-9)


def test_the_light_of_many_panoramas_stands_at_those_with_named_stars():
    """Of five panoramas two have an answer: the second names both of its objects, the fourth two of its three."""
    answers = Answers.from_answers([NO_MATCH, named([1, 0], [3, 0]), NO_MATCH, named([2, 0], [2, 4]), named([], [])])
    brightness = np.array([50.0, 100.0, 10.0, 7.0, 1000.0, 5.0, 100.0, 4.0])
    found = starlights(brightness, Parts.of_counts([1, 2, 1, 3, 1]), answers, CATALOG)
    assert found.stars.tolist() == [0, 2, 0, 2, 0]
    # 2.5 log10 of the index values: 10 -> 2.5, 100 -> 5, 1000 -> 7.5.
    zero_points = [math.nan, ((5.0 + 2.5) + (1.0 + 5.0)) / 2, math.nan, ((3.0 + 5.0) + (6.5 + 7.5)) / 2, math.nan]
    assert found.zero_point_mag == pytest.approx(zero_points, nan_ok=True)
    assert found.limiting_mag == pytest.approx([math.nan, 5.0, math.nan, 6.5, math.nan], nan_ok=True)
    faintest = [10 ** (0.4 * (zero - 6.5 + 1.0)) if zero == zero else math.inf for zero in zero_points]
    assert found.faintest_index == pytest.approx(faintest)


def test_one_named_star_shows_a_magnitude_and_no_zero_point():
    found = light([300.0, 7.0], [3])
    assert (found.stars[0], found.limiting_mag[0], found.faintest_index[0]) == (1, 5.0, math.inf)
    assert math.isnan(found.zero_point_mag[0])


@pytest.mark.parametrize("count", [0, 1, 3])
def test_without_an_answer_there_is_no_light(count):
    found = starlights(np.ones(count), Parts.of_counts([1] * count), Answers.from_answers([NO_MATCH] * count), CATALOG)
    assert (found.stars.tolist(), found.faintest_index.tolist()) == ([0] * count, [math.inf] * count)


def test_rows_of_all_panoramas_are_those_of_each_behind_the_ones_before():
    answers = Answers.from_answers([named([1], [0]), NO_MATCH, named([2, 0], [1, 2])])
    assert rows_of(Parts.of_counts([2, 4, 3]), answers).tolist() == [1, 8, 6]


def test_the_zero_point_of_each_panorama_is_the_median_of_its_stars():
    counts, rng = [2, 5, 3, 4, 1], np.random.default_rng(2)
    parts = [rng.uniform(10, 4000, count) for count in counts]
    answers = Answers.from_answers([named(range(count), range(count)) for count in counts])
    found = starlights(np.concatenate(parts), Parts.of_counts(counts), answers, CATALOG)
    medians = [np.median(CATALOG.magnitude[: len(part)] + 2.5 * np.log10(part)) for part in parts[:-1]]
    assert found.zero_point_mag[:-1] == pytest.approx(medians)
