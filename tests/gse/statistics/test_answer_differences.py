"""How far a sensor's answers lie from those here, against rotations of scipy's kind made one by one."""

import math

import numpy as np
import pytest

from gse.station.columns import FRAME
from gse.station.own_answers import SensorAnswers
from gse.statistics.onboard_equivalence import answer_differences
from gse.values.attitude import Attitude

ARCSEC_PER_RAD = 180 * 3600 / math.pi


def apart(here, sensor):
    """Answers here, RA, DE and roll in deg, and RA and DE of the sensor."""
    frames = np.zeros(len(here), dtype=FRAME)
    for name, column in zip(("ra_deg", "de_deg", "roll_deg"), np.array(here, dtype=float).T, strict=True):
        frames[name] = column
    own = {name: np.full(len(here), np.nan) for name in SensorAnswers.__slots__}
    own["ra_deg"], own["de_deg"] = np.array(sensor, dtype=float).T
    return answer_differences(SensorAnswers(**own), frames)


@pytest.mark.parametrize("ra_deg", [10.0, 70.0, 200.0])
@pytest.mark.parametrize("de_deg", [-60.0, 5.0, 40.0])
def test_the_boresight_of_the_sensor_is_seen_from_that_here(ra_deg, de_deg):
    sensor = (ra_deg + 0.02, de_deg - 0.01)
    ra, de = np.radians(sensor)
    star = np.array([math.cos(de) * math.cos(ra), math.cos(de) * math.sin(ra), math.sin(de)])
    by_hand = Attitude.from_angles(ra_deg, de_deg, 25.0).icrs_to_sensor @ star * ARCSEC_PER_RAD
    (found,) = apart([(ra_deg, de_deg, 25.0)], [sensor])
    assert found == pytest.approx(by_hand[:2], abs=1e-4)
    assert math.hypot(*found) == pytest.approx(math.hypot(72 * math.cos(math.radians(de_deg)), 36), rel=1e-2)


@pytest.mark.parametrize("sensor", [(190.0, -20.0), (190.0, 20.0), (101.0, 0.0)])
def test_what_lies_behind_is_as_far_as_can_be(sensor):
    assert apart([(10.0, 0.0, 0.0)], [sensor])[0] == pytest.approx([ARCSEC_PER_RAD] * 2)


def test_where_one_has_no_answer_there_is_no_number():
    nan = math.nan
    here = [(10.0, 20.0, 30.0), (nan, 20.0, 30.0), (10.0, nan, 30.0), (10.0, 20.0, nan), (10.0, 20.0, 30.0)]
    found = apart(here, [(10.0, 20.0), (10.0, 20.0), (10.0, 20.0), (10.0, 20.0), (nan, 20.0)])
    assert np.isfinite(found).tolist() == [[True, True]] + [[False, False]] * 4
    assert found[0] == pytest.approx([0.0, 0.0], abs=1e-6)


def test_each_of_many_answers_is_seen_from_its_own_panorama():
    """More than are turned at once."""
    count = 35_000
    rng = np.random.default_rng(1)
    here = np.column_stack([rng.uniform(0, 360, count), rng.uniform(-80, 80, count), rng.uniform(0, 360, count)])
    found = apart(here, here[:, :2] + np.column_stack([np.zeros(count), np.linspace(0.0, 100.0, count) / 3600]))
    assert np.hypot(*found.T) == pytest.approx(np.linspace(0.0, 100.0, count), abs=1e-4)
