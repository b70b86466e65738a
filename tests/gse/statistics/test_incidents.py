"""What a reader must know of: jumps, false answers, faults, and how far off the answers in excluded stretches were."""

import numpy as np
import pytest
from skies.known_nights import START_NS, session

from gse.report.summary import summarise
from gse.report.terminal import exclusion_line, facts, incident_line
from gse.station.columns import ANSWER_CHECKS, STATUSES
from gse.station.exclusions import Cause, Exclusion
from gse.station.results import AnswerCheck, Status, Subject
from gse.statistics.incidents import MOST_OF_A_KIND, pauses
from gse.statistics.session_statistics import statistics
from gse.values.instant import NS_PER_S
from gse.verdict.assessment import judge


def moved(made, rows, *, east=0.0, north=0.0):
    """Frames whose answers, which the reference identifier confirms, lie off as after a jolt."""
    frames = made.frames.columns
    for name, by in (("d_ra_cosde_arcsec", east), ("cross_x_arcsec", east), ("d_de_arcsec", north)):
        frames[name][rows] += by
    frames["cross_y_arcsec"][rows] -= north
    return made


def incidents(made):
    return [(one.what.split(" ")[0], one.frames, one.stretches) for one in statistics(made).incidents]


def test_a_clear_night_has_none():
    assert statistics(session(2000)).incidents == ()


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("side", ["east", "north"])
@pytest.mark.parametrize(("arcsec", "is_told"), [(50.0, False), (70.0, True)])
def test_answers_that_jump_by_more_than_a_limit_are_told_with_when_and_how_far(sign, side, arcsec, is_told):
    made = moved(session(2000, noise=0.5), slice(700, 800), **{side: sign * arcsec})
    found = statistics(made).incidents
    assert bool(found) is is_told
    for one in found:
        assert (one.subject, one.frames, one.stretches) == (Subject.ONBOARD, 100, 1)
        assert (one.from_ns - START_NS, one.until_ns - START_NS) == (70 * NS_PER_S, 799 * NS_PER_S // 10)
        assert one.worst_arcsec == pytest.approx(arcsec, abs=4)


def test_a_mount_that_drifts_does_not_jump():
    assert incidents(session(20_000, step_s=1.0, noise=1.0, drift_per_h=(100.0, 0.0))) == []


@pytest.mark.parametrize(("jumps", "lines"), [(MOST_OF_A_KIND, MOST_OF_A_KIND), (MOST_OF_A_KIND + 1, 1)])
def test_many_stretches_of_a_kind_have_one_line(jumps, lines):
    made = session(4000, noise=0.5)
    for row in range(100, 100 + 200 * jumps, 200):
        moved(made, slice(row, row + 5), north=200.0)
    found = statistics(made).incidents
    assert len(found) == lines
    assert sum(one.frames for one in found) == 5 * jumps
    assert sum(one.stretches for one in found) == jumps


def test_a_fault_bit_and_false_answers_are_told():
    made = session(600)
    frames = made.frames.columns
    frames["status"][::10] = STATUSES.index(Status.SENSOR_FAULT)
    frames["answer_check"][301:305] = ANSWER_CHECKS.index(AnswerCheck.FALSE)
    frames["d_de_arcsec"][::10] = frames["d_ra_cosde_arcsec"][::10] = np.nan
    assert incidents(made) == [("false", 4, 1), ("the", 60, 1)]
    lines = [incident_line(item) for item in summarise(made, judge(made))["incidents"]]
    assert lines[1].startswith(
        "onboard: the sensor reports a fault, or sends impossible values in 60 frames, 2026-03-20T"
    )
    assert [line.startswith("seen: ") for line in facts(summarise(made, judge(made)))].count(True) == 2


@pytest.mark.parametrize("cause", list(Cause))
def test_a_stretch_that_is_left_out_tells_how_far_off_the_answers_in_it_were(cause):
    made = moved(session(600, noise=0.1), slice(100, 200), north=300.0)
    made.excluded = (Exclusion(START_NS + 10 * NS_PER_S, START_NS + 30 * NS_PER_S, "so", cause),)
    (of_stretch,) = statistics(made).answers_excluded
    (found,) = of_stretch
    assert (found.subject, found.answers, found.compared) == (Subject.ONBOARD, 200, 200)
    assert found.mean_arcsec == pytest.approx(150.0, abs=1)
    assert found.worst_arcsec == pytest.approx(300.0, abs=1)
    (item,) = summarise(made, judge(made))["exclusions"]
    unknown_time = (Cause.CLOCK_STEP, Cause.BACKLOG)
    unknown_truth = (Cause.MOUNT, Cause.SCENE_CHANGE, Cause.SCREEN_LOST)
    of_another_test = (Cause.FASTER, Cause.STEP)
    taken = cause in unknown_time + unknown_truth + of_another_test
    words = "taken out" if taken else "judged all the same"
    assert f"200 answers of onboard in it are {words}, 150." in exclusion_line(item)


def test_a_stretch_without_an_answer_says_nothing_of_answers():
    made = session(600)
    made.frames.columns["status"][100:200] = STATUSES.index(Status.NO_MATCH)
    made.excluded = (Exclusion(START_NS + 10 * NS_PER_S, START_NS + 20 * NS_PER_S, "cloud", Cause.OPERATOR),)
    assert statistics(made).answers_excluded == ((),)
    (item,) = summarise(made, judge(made))["exclusions"]
    assert exclusion_line(item) == "100 frames from 2026-03-20T18:30:10Z, operator: cloud"


@pytest.mark.parametrize(
    ("numbers", "why"),
    [
        (0, "the sensor made none"),
        (108_000, "its numbers went on by 108001: lost on the way, or not recorded"),
        (-1100, "its numbers begin anew"),
    ],
)
def test_a_pause_of_three_hours_has_a_line_with_when_how_long_and_why(numbers, why):
    made = session(2000)
    frames = made.frames.columns
    frames["utc_ns"][1000:] += 10_800 * NS_PER_S
    frames["frame_no"] = np.maximum(2000 + np.arange(2000) + numbers * (np.arange(2000) >= 1000), 0)
    (found,) = statistics(made).incidents
    assert (found.subject, found.frames, found.stretches) == (Subject.ONBOARD, 0, 1)
    assert (found.from_ns, found.until_ns) == (frames["utc_ns"][999], frames["utc_ns"][1000])
    assert found.what == f"no frame came for 10800.1 s ({why})"
    (line,) = [line for line in facts(summarise(made, judge(made))) if line.startswith("seen: ")]
    assert line == f"seen: onboard: {found.what}, 2026-03-20T18:31:39Z to 2026-03-20T21:31:40Z"


@pytest.mark.parametrize(
    ("step_s", "pause_s", "lines"), [(0.1, 59.0, 0), (0.1, 61.0, 1), (20.0, 150.0, 0), (20.0, 250.0, 1)]
)
def test_a_pause_is_a_minute_and_ten_times_as_long_as_the_usual_one(step_s, pause_s, lines):
    made = session(200, step_s=step_s)
    made.frames.columns["utc_ns"][100:] += round(pause_s * NS_PER_S)
    assert len(statistics(made).incidents) == lines


@pytest.mark.parametrize("cause", [Cause.LINK, Cause.CLOCK_STEP])
def test_a_pause_that_is_left_out_already_has_no_second_line(cause):
    made = session(2000)
    frames = made.frames.columns
    frames["utc_ns"][1000:] += 10_800 * NS_PER_S
    gap = int(frames["utc_ns"][999]), int(frames["utc_ns"][1000])
    assert list(pauses(Subject.ONBOARD, frames, [Exclusion(*gap, "", cause)])) == []
    assert len(list(pauses(Subject.ONBOARD, frames, [Exclusion(*gap, "", Cause.NO_SKY)]))) == 1


def test_many_pauses_have_one_line():
    made = session(2000)
    for row in range(100, 100 * (MOST_OF_A_KIND + 2), 100):
        made.frames.columns["utc_ns"][row:] += 100 * NS_PER_S
    (found,) = statistics(made).incidents
    assert found.stretches == MOST_OF_A_KIND + 1
    assert found.what == "no frame came for 1101.1 s in all"
