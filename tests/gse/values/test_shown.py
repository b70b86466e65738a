"""What a screen shows over time, against scipy's rotations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gse.values.attitude import Attitude
from gse.values.instant import NS_PER_S
from gse.values.screen import Screen, ScreenToSensor, Shown, ShownSky, turned_by

rate = st.floats(-5, 5)


@given(st.tuples(rate, rate, rate), st.floats(0, 100))
def test_a_turning_scene_is_the_first_attitude_turned_about_the_sensors_axes(turn, seconds):
    sky = ShownSky([Shown(10 * NS_PER_S, 83.0, -2.0, 25.0, turn)])
    utc_ns = 10 * NS_PER_S + round(seconds * NS_PER_S)
    first = Attitude.from_angles(83.0, -2.0, 25.0).icrs_to_sensor
    turned = Rotation.from_rotvec(np.radians(turn) * (utc_ns - 10 * NS_PER_S) / NS_PER_S)
    expected = turned.as_matrix().T @ first
    assert np.abs(sky.icrs_to_sensor_at(np.array([utc_ns]))[0] - expected).max() < 1e-12


def test_each_instant_has_the_scene_that_began_last_whatever_the_order_in_which_they_came():
    shown = [Shown(second * NS_PER_S, 10.0 * second, 0.0, 0.0) for second in (1, 2, 3)]
    sky = ShownSky()
    for item in (shown[1], shown[2], shown[0]):
        sky.add(item)
    instants = np.array([0, 1, 1.999, 2, 3, 99]) * NS_PER_S
    assert sky.index_at(instants.astype(np.int64)).tolist() == [0, 0, 0, 1, 2, 2]


def test_no_turn_is_no_turn():
    assert (turned_by(np.zeros((2, 3))) == np.eye(3)).all()


@pytest.mark.parametrize(("x_deg", "y_deg"), [(3.0, 0.0), (0.0, -2.0), (5.0, 4.0)])
def test_the_sensor_looks_at_the_stated_point_of_the_screen(x_deg, y_deg):
    screen = Screen(pixel_pitch_mm=0.1, columns=2000, rows=1000, focal_length_mm=500)
    rotation = ScreenToSensor(x_deg=x_deg, y_deg=y_deg, roll_deg=33.0).rotation()
    assert np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-15
    (place,) = screen.camera().pixels(rotation[2:])
    assert place == pytest.approx([999.5 + 5000 * np.tan(np.radians(x_deg)), 499.5 + 5000 * np.tan(np.radians(y_deg))])


def test_a_sensor_that_is_rolled_to_the_left_has_up_to_the_left():
    up = -ScreenToSensor(roll_deg=10.0).rotation()[1]
    assert up[:2] == pytest.approx([-np.sin(np.radians(10)), -np.cos(np.radians(10))])


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({}, "one of focal_length_mm"),
        ({"focal_length_mm": 500, "distance_mm": 1000}, "one of focal_length_mm"),
        ({"distance_mm": 1000, "brightest_magnitude": 6.5}, "the brightest star to have the smaller magnitude"),
    ],
)
def test_a_screen_that_is_none_says_what_was_expected(keys, words):
    with pytest.raises(ValueError, match=words):
        Screen(pixel_pitch_mm=0.1, columns=2000, rows=1000, **keys)


@pytest.mark.parametrize("number", [float("nan"), 1e300])
def test_numbers_of_a_damaged_file_are_no_scene(number):
    with pytest.raises(ValueError, match="no attitude"):
        Shown(0, number, 0.0, 0.0)


def test_a_corrected_record_of_the_same_instant_is_the_one_that_counts():
    sky = ShownSky([Shown(NS_PER_S, 10.0, 0.0, 0.0, within_ms=5.0)])
    sky.add(Shown(NS_PER_S, 10.0, 0.0, 0.0, within_ms=80.0))
    (index,) = sky.index_at(np.array([2 * NS_PER_S]))
    assert sky.shown[index].within_ms == 80.0
