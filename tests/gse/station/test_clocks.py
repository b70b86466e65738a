"""Two machines' worth of clocks: the host's UTC and monotonic clocks and the sensor's, each wrong in its own way."""

import re

import numpy as np
import pytest
from devices.injected_clocks import START_NS, InjectedClocks, Sky

from gse.report import summarise
from gse.station.events import StationKind
from gse.station.exclusions import Cause
from gse.station.results import Verdict
from gse.statistics.session_statistics import statistics
from gse.values.instant import NS_PER_S, from_text
from gse.verdict.assessment import judge

YEAR_S = 365.25 * 86_400
SINCE_1970_S = START_NS / NS_PER_S
INTO_1972_S = (START_NS - from_text("1972-01-01T00:00:00Z")) / NS_PER_S
"""Truth begins there, and any mistake of the clock that is tried lies before."""
RIGHT_NS = 3_000_000
"""A frame's time is good to this."""


@pytest.fixture(scope="module")
def sky():
    return Sky()


def steps_of(session):
    return [event.text for event in session.events if event.kind == StationKind.CLOCK_STEP]


def true_ns(sky, session):
    """When each frame was taken, by its number."""
    taken = np.array([START_NS + round(true_s * NS_PER_S) for true_s, _ in sky.frames])
    return taken[session.frames.columns["frame_no"]]


def counted_and_right(sky, session):
    """The times of the frames that count, in seconds of the session; each has the right UTC."""
    counted = statistics(session).counted
    true = true_ns(sky, session)
    assert np.abs(session.frames.columns["utc_ns"] - true)[counted.used].max() < RIGHT_NS
    return (true[counted.used] - START_NS) / NS_PER_S


def test_right_clocks_leave_nothing_out(sky):
    session = sky.session(InjectedClocks())
    assert judge(session).verdict is Verdict.PASS
    assert len(counted_and_right(sky, session)) == len(sky.frames)
    assert steps_of(session) == []


EXCURSIONS = {"2038": 12 * YEAR_S, "an hour": 3600.0, "before 1972": -SINCE_1970_S, "before 1970": -426 * YEAR_S}
EXCURSIONS["past 2262"] = 300 * YEAR_S


@pytest.mark.parametrize("off_s", EXCURSIONS.values(), ids=EXCURSIONS.keys())
def test_a_clock_that_goes_far_off_and_comes_back_costs_its_own_frames_and_no_others(sky, off_s):
    session = sky.session(InjectedClocks(utc_s=lambda t: t + (off_s if 20 <= t < 40 else 0.0)), own=True)
    judge(session)
    assert len(steps_of(session)) == 2
    assert abs(float(steps_of(session)[0].split()[-2]) - off_s) < 0.01
    counted_s = counted_and_right(sky, session)
    assert not ((counted_s > 20) & (counted_s < 40)).any()
    assert (counted_s < 14.9).sum() == 75
    assert (counted_s > 45.1).sum() == 174


@pytest.mark.parametrize("off_s", EXCURSIONS.values(), ids=EXCURSIONS.keys())
def test_what_a_clock_far_off_spoils_is_neither_passed_nor_held_against_the_sensor(sky, off_s):
    assessment = judge(sky.session(InjectedClocks(utc_s=lambda t: t + (off_s if 20 <= t < 40 else 0.0))))
    assert assessment.verdict is Verdict.PASS, assessment.reasons
    assert assessment.statistics.onboard.axes["d_ra_cosde"].max_abs_arcsec < 5
    assert assessment.statistics.duration_s < 81
    assert any(line.startswith("clock step") for line in map(str, assessment.findings))
    assert not abs(assessment.statistics.clock.sensor_drift_ppm) > 100


@pytest.mark.parametrize("off_s", EXCURSIONS.values(), ids=EXCURSIONS.keys())
def test_a_clock_that_is_set_right_in_the_session_gives_truth_from_then_on(sky, off_s):
    session = sky.session(InjectedClocks(utc_s=lambda t: t + (off_s if t < 10 else 0.0)))
    assert judge(session).verdict is Verdict.PASS
    counted_s = counted_and_right(sky, session)
    assert counted_s.min() > 10
    assert len(counted_s) >= 5 * 65 - 1


@pytest.mark.parametrize("off_s", [*EXCURSIONS.values(), -INTO_1972_S], ids=[*EXCURSIONS.keys(), "into 1972"])
def test_a_clock_that_goes_far_off_and_stays_there_is_judged_too(sky, off_s):
    session = sky.session(InjectedClocks(utc_s=lambda t: t + (off_s if t >= 40 else 0.0)), own=True)
    assessment = judge(session)
    assert assessment.verdict in (Verdict.FAIL, Verdict.INCONCLUSIVE), assessment.reasons
    assert len(steps_of(session)) == 1
    assert summarise(session, assessment)["verdict"] == assessment.verdict.value


def test_minutes_of_a_wrong_clock_are_too_many_to_pass(sky):
    long = Sky(duration_s=400.0, rate_hz=1.0)
    assessment = judge(long.session(InjectedClocks(utc_s=lambda t: t + (3600.0 if 20 <= t < 120 else 0.0))))
    assert assessment.verdict is Verdict.INCONCLUSIVE
    assert any("left out for steps of the clock" in reason for reason in assessment.reasons)


def test_a_small_step_that_put_the_clock_right_bounds_how_well_it_was_known(sky):
    stats = statistics(sky.session(InjectedClocks(utc_s=lambda t: t - (2.0 if t < 20 else 0.0))))
    assert stats.clock.error_bound_s == pytest.approx(2.0)


# Leap seconds


def test_a_second_that_ntp_repeats_is_told_and_moves_no_frame(sky):
    def elapsed_s(true_s):
        return true_s + (1.0 if true_s >= 30 else 0.0)

    session = sky.session(InjectedClocks(mono_s=elapsed_s, tag_s=elapsed_s))
    assert steps_of(session) == ["the host's UTC clock stepped by -1.000 s"]
    counted_s = counted_and_right(sky, session)
    assert len(counted_s) > 5 * 68
    assert {item.cause for item, _ in statistics(session).exclusions} == {Cause.CLOCK_STEP}


def test_a_smear_is_no_step_but_a_drift_that_is_told(sky):
    assessment = judge(sky.session(InjectedClocks(utc_s=lambda t: t * (1 - 1e-3))))
    assert assessment.statistics.clock.steps == ()
    assert assessment.statistics.clock.sensor_drift_ppm == pytest.approx(-1000, abs=2)
    (finding,) = assessment.findings
    assert finding.cause == "clock drift"
    ppm, expanded = map(float, re.search(r"runs (\d+) ppm slow \(\+- ([\d.e+]+)\)", finding.size).groups())
    assert ppm == pytest.approx(1000, abs=expanded)


def test_a_smear_under_which_the_kernel_lost_its_source_is_no_sound_clock(sky):
    session = sky.session(InjectedClocks(utc_s=lambda t: t * (1 - 5e-4), readings=((0.0, True), (30.0, False))))
    assessment = judge(session)
    assert not assessment.statistics.clock.synchronised
    assert assessment.statistics.clock.error_bound_s == float("inf")
    assert assessment.verdict is Verdict.INCONCLUSIVE


# A laptop that is closed and opened


def suspended(sky, step_s=0.0, *, slept_s=15.0):
    return sky.session(
        InjectedClocks(
            mono_s=lambda t: t - (slept_s if t >= 40 else 0.0),
            utc_s=lambda t: t + (step_s if t >= 40 else 0.0),
            asleep_s=(25.0, 40.0),
        )
    )


def test_a_host_that_was_suspended_is_told_as_such_and_its_utc_is_right(sky):
    session = suspended(sky)
    (text,) = steps_of(session)
    assert text.startswith("the host was suspended: its monotonic clock stood still for 15.000 s")
    assessment = judge(session)
    assert assessment.verdict is Verdict.PASS
    assert [(found.cause, found.next_step.partition(" during")[0]) for found in assessment.findings] == [
        ("monotonic clock", "keep this computer awake")
    ]
    assert assessment.statistics.clock.error_bound_s == pytest.approx(0.001)
    counted_s = counted_and_right(sky, session)
    assert (counted_s < 19.9).sum() == 100
    assert (counted_s > 45.1).sum() == 174


def test_a_monotonic_clock_that_counts_the_suspension_shows_only_silence(sky):
    session = suspended(sky, slept_s=0.0)
    assert steps_of(session) == []
    assert "STALE" in [event.kind for event in session.events]
    assert len(counted_and_right(sky, session)) == 5 * 65


def test_a_monotonic_clock_that_leaps_moves_no_frame(sky):
    session = sky.session(InjectedClocks(mono_s=lambda t: t + (600.0 if t >= 30 else 0.0)))
    assert steps_of(session) == ["the host's monotonic clock leapt by +600.000 s; UTC and the sensor's clock did not"]
    assert len(counted_and_right(sky, session)) >= 5 * 69


def test_a_monotonic_clock_that_begins_anew_moves_no_frame(sky):
    session = sky.session(InjectedClocks(mono_s=lambda t: t - (900.0 if t >= 30 else 0.0)))
    assert len(counted_and_right(sky, session)) >= 5 * 69
