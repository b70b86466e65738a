"""The light of named stars, and the Moon's glare, by numbers made by hand."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from gse.identifier import Answers, Identification
from gse.parts import Parts
from gse.station.results import NO_STARLIGHT, Starlight, Starlights
from gse.station.sky_condition import Lights, SkyEvidence, glared
from gse.station.starlight import starlights

CATALOG = SimpleNamespace(magnitude=np.array([1.0, 2.0, 3.0, 5.0, 6.5]))


def light(brightness, stars):
    named = Identification(np.arange(len(stars)), np.array(stars), 1e-9)
    return starlights(np.array(brightness), Parts.of_counts(np.array([len(brightness)])), Answers.of([named]), CATALOG)


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


@pytest.mark.parametrize(
    ("altitude_deg", "separation_deg", "glares"), [(1.0, 16.9, True), (1.0, 17.1, False), (0.0, 5.0, False)]
)
def test_the_moon_glares_until_ten_degrees_beyond_the_edge_of_the_field(altitude_deg, separation_deg, glares):
    lights = Lights(-40.0, altitude_deg, 120.0, separation_deg)
    seen = SkyEvidence(lights, 20.0, 0.5, math.nan, math.nan, 20.0, 0.0, True, False, 0.05)
    assert glared(seen, 7.0).moon_glares == glares


def test_the_light_of_panoramas_one_by_one_is_that_of_all_of_them():
    lights = [Starlight(7, 14.5, 5.5, 30.0), NO_STARLIGHT, Starlight(9, 13.5, 4.5, 40.0)]
    made = Starlights.of(lights)
    assert (made.stars.tolist(), made.faintest_index.tolist()) == ([7, 0, 9], [30.0, math.inf, 40.0])
    assert made.zero_point_mag == pytest.approx([14.5, math.nan, 13.5], nan_ok=True)
    assert made.limiting_mag == pytest.approx([5.5, math.nan, 4.5], nan_ok=True)
