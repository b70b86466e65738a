"""Axes of the horizon frame about which a set-up can be wrong, against mounts that are turned by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gse.diagnosis.turns import VERTICAL, about, all_turns, level_axis, pole, size_rad
from gse.truth import horizon_to_sensor
from gse.values.mount import Mount
from gse.values.site import Site

MOUNT = Mount(azimuth_deg=130.0, altitude_deg=35.0, roll_deg=25.0)
SMALL_DEG = 0.01


def turned(axis, degrees):
    """The measured mount where the horizon frame is turned about one of its axes."""
    return horizon_to_sensor(MOUNT) @ Rotation.from_rotvec(np.radians(degrees) * np.asarray(axis)).as_matrix()


def test_the_boresight_looks_along_azimuth_and_altitude_and_the_axes_are_at_right_angles():
    across, up, boresight = all_turns(MOUNT)
    azimuth, altitude = math.radians(130.0), math.radians(35.0)
    east, north = math.cos(altitude) * math.sin(azimuth), math.cos(altitude) * math.cos(azimuth)
    assert boresight == pytest.approx([east, north, math.sin(altitude)])
    axes = np.array([across, up, boresight])
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-12)


def test_a_turn_about_up_raises_the_boresight_and_one_across_moves_it_on():
    across, up, boresight = all_turns(MOUNT)
    higher, aside = turned(up, SMALL_DEG)[2], turned(across, SMALL_DEG)[2]
    assert math.degrees(math.asin(higher[2])) == pytest.approx(35.0 + SMALL_DEG)
    assert aside[2] == pytest.approx(boresight[2], abs=1e-7)
    azimuth_deg = math.degrees(math.atan2(aside[0], aside[1]))
    assert azimuth_deg == pytest.approx(130.0 + SMALL_DEG / math.cos(math.radians(35.0)), abs=1e-4)


def test_a_mount_is_lowered_about_its_level_axis():
    lower = horizon_to_sensor(replace(MOUNT, altitude_deg=35.0 - SMALL_DEG))
    assert turned(level_axis(MOUNT), SMALL_DEG) == pytest.approx(lower, abs=1e-9)


@pytest.mark.parametrize("latitude_deg", [48.0, 0.0, -35.0])
def test_the_pole_stands_in_the_north_at_the_latitude(latitude_deg):
    axis = pole(Site(latitude_deg=latitude_deg, longitude_deg=0.0))
    assert np.degrees([math.atan2(axis[0], axis[1]), math.asin(axis[2])]) == pytest.approx([0.0, latitude_deg])


@pytest.mark.parametrize("degrees", [-170.0, -3.0, 0.5, 120.0])
def test_the_part_of_a_turn_about_an_axis_is_found_with_what_is_left(degrees):
    tilt = Rotation.from_rotvec([math.radians(0.2), 0.0, 0.0])
    turn = tilt * Rotation.from_rotvec(math.radians(degrees) * VERTICAL)
    angle, left = about(VERTICAL, turn.as_matrix())
    assert math.degrees(angle) == pytest.approx(degrees, abs=1e-3)
    assert math.degrees(left) == pytest.approx(0.2, abs=1e-6)


@pytest.mark.parametrize("degrees", [0.0, 1e-6, 3.0, 120.0, 179.9999, 180.0])
def test_the_size_of_a_turn_is_its_angle_up_to_half_a_turn(degrees):
    turn = Rotation.from_rotvec(math.radians(degrees) * np.array([0.6, 0.0, -0.8])).as_matrix()
    assert math.degrees(size_rad(turn)) == pytest.approx(degrees, rel=1e-9)
