"""A mount that moves, and a host whose clock is wrong, as a scenario says them."""

import numpy as np
import pytest

from gse.simulator.scenario import Host, Motion, parse_scenario
from gse.simulator.scene import horizon_to_sensor, moved_by
from gse.values.mount import Mount

ARCSEC = np.pi / 648000
REST = horizon_to_sensor(Mount(azimuth_deg=130, altitude_deg=60, roll_deg=25))


def boresight_moved_px_axes(motion, since_start_s):
    """How far the boresight lies along columns and rows of the mount at rest, and how far it is rolled, in arcsec."""
    moved = moved_by(motion, since_start_s) @ REST
    return (*(REST[:2] @ moved[2] / ARCSEC), np.arctan2(moved[0] @ REST[1], moved[0] @ REST[0]) / ARCSEC)


def test_a_mount_stands_still_unless_it_is_told_to_move():
    assert np.array_equal(moved_by(Motion(), 1000.0), np.eye(3))


def test_a_slip_is_for_good_from_its_time_on():
    motion = Motion(slips=((30, 12, -16, 0), (40, 0, 1, 0)))
    assert boresight_moved_px_axes(motion, 29.9) == pytest.approx((0, 0, 0), abs=1e-6)
    assert boresight_moved_px_axes(motion, 30.0) == pytest.approx((12, -16, 0), abs=1e-2)
    assert boresight_moved_px_axes(motion, 50.0) == pytest.approx((12, -15, 0), abs=1e-2)


def test_drift_sinusoid_and_vibration_follow_time():
    drifting = Motion(drift_arcsec_per_h=(36, 0, 72))
    assert boresight_moved_px_axes(drifting, 100.0)[0] == pytest.approx(1.0, abs=1e-3)
    assert abs(boresight_moved_px_axes(drifting, 100.0)[2]) == pytest.approx(2.0, abs=1e-3)
    swinging = Motion(sinusoid_arcsec=(20, 0), sinusoid_period_s=400)
    assert boresight_moved_px_axes(swinging, 100.0) == pytest.approx((20, 0, 0), abs=1e-2)
    shaking = Motion(vibration_arcsec=(0, 5), vibration_hz=2)
    assert boresight_moved_px_axes(shaking, 10.125) == pytest.approx((0, 5, 0), abs=1e-2)


def test_a_host_clock_is_fast_drifts_and_steps():
    host = Host(clock_s=-2.0, clock_drift_ppm=100, clock_steps=((60, 1.5),))
    assert host.fast_s(0) == -2.0
    assert host.fast_s(50) == pytest.approx(-1.995)
    assert host.fast_s(100) == pytest.approx(-0.49)


def test_a_scenario_says_either_in_one_line():
    scenario = parse_scenario("text: A slip.\nmotion: {slips: [[30, 10, 0, 0]]}\nhost: {clock_s: 25200}\n", "here")
    assert scenario.motion.slips == ((30, 10, 0, 0),)
    assert scenario.host.clock_s == 25200
