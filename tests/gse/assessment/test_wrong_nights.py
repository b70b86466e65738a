"""Nights by astropy alone with one thing wrong, judged: the word and what it is named for."""

from dataclasses import replace

import pytest
from skies.wrong_night import Plan, World, session

from gse.assessment.verdict import judge
from gse.site import Site
from gse.station.results import Verdict

SITE = Site(latitude_deg=48.2, longitude_deg=11.6, height_m=500.0, pressure_hpa=955.0, temperature_c=8.0)
WORLD = World(SITE, azimuth_deg=130.0, altitude_deg=60.0, roll_deg=30.0)
PLAN = Plan("2026-03-20T21:30:00Z", 60.0, 2.0, seed=6)


@pytest.mark.parametrize(("clock_s", "scale"), [(18.0, "GPS time"), (37.0, "TAI")])
def test_a_clock_of_another_time_scale_is_a_mistake_of_the_set_up(clock_s, scale):
    judged = judge(session(WORLD, replace(WORLD, clock_s=clock_s), PLAN))
    assert judged.verdict is Verdict.INCONCLUSIVE
    assert judged.reasons[0].startswith(f"set-up: clock set to {scale}: ")
    assert any("by the set-up (clock set to" in reason for reason in judged.reasons)


def test_an_offset_that_is_no_time_scale_may_be_the_sensors():
    judged = judge(session(WORLD, replace(WORLD, clock_s=20.0), PLAN))
    assert judged.findings[0].cause == "clock offset"
    assert judged.verdict is Verdict.FAIL


def test_a_sensor_that_sends_no_brightness_fails_with_the_reason():
    judged = judge(session(WORLD, replace(WORLD, brightness=False), PLAN))
    assert judged.verdict is Verdict.FAIL
    (finding,) = judged.findings
    assert finding.cause == "faulty panoramas"
    assert "the same for all objects" in finding.size
