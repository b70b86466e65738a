"""What is left of a session, and bad input to ``gse plan`` in words."""

import json
import math
from dataclasses import replace

import pytest
from devices.command_line import runner
from skies.synthetic_night import synthetic_night

from gse.assessment.planning import availability_frames
from gse.assessment.session_plan import (
    NEVER,
    RowPlan,
    SessionPlan,
    minutes_left,
    plan_like,
    rows_left,
    session_plan,
)
from gse.assessment.verdict import Assessment, judge
from gse.limits import Decision, Limits
from gse.station.results import Subject, Verdict
from gse.statistics.decision import Figure, Outcome, Requirement, judge_figure, minutes_more
from gse.statistics.sampling import Bounds


@pytest.fixture(scope="module")
def few() -> Assessment:
    return judge(synthetic_night(240))


def test_a_row_is_decided_after_the_minutes_that_were_said(few) -> None:
    left = {item.row.name: item.minutes for item in rows_left(few)}
    assert few.verdict is Verdict.INCONCLUSIVE
    assert 0 < left["false answers"] < NEVER
    more = math.ceil(240 * (1 + left["false answers"] / (few.statistics.duration_s / 60)))
    outcomes = [
        next(row.outcome for row in judge(synthetic_night(count)).rows if row.name == "false answers")
        for count in (more - 5, more + 5)
    ]
    assert outcomes == [Outcome.INCONCLUSIVE, Outcome.PASS]


def test_a_figure_is_decided_after_the_minutes_that_its_reason_says(few) -> None:
    figure = Figure(50.0, Bounds(0.0, 0.0, 30.0, 70.0), 100.0, 240, few.statistics.duration_s)
    asked = Requirement(Subject.ONBOARD, "mean |dDE|", 60.0, Decision.GUARDED, "arcsec")
    row = judge_figure(asked, figure, truth_uncertainty=2.0)
    (left,) = rows_left(replace(few, rows=(row,)))
    assert left.minutes == pytest.approx(minutes_more(figure, 60.0, 2.0))
    assert 1 < left.minutes < 3


def test_nothing_is_left_of_a_row_that_is_decided(few) -> None:
    assert all(item.minutes == 0 for item in rows_left(few) if item.row.outcome is Outcome.PASS)


def test_the_minutes_left_are_those_of_the_slowest_row(few) -> None:
    left = [item.minutes for item in rows_left(few)]
    found = minutes_left(few)
    assert math.isnan(found) if any(map(math.isnan, left)) else found == (max(left) or NEVER)


def test_another_session_is_planned_from_the_figures_of_one_that_was_judged(few) -> None:
    plan = plan_like(few, Subject.ONBOARD, Limits())
    assert plan.frames_per_s == pytest.approx(10.0)
    assert [(row.name, row.frames) for row in plan.rows[:3]] == [("dRA*", 101), ("dDE", 101), ("roll", 101)]
    assert [row.name for row in plan.rows[3:]] == ["availability", "false answers"]
    assert 240 < plan.rows[3].frames < 2400  # 97 % of 240 frames leave it open
    assert plan.rows[4].frames == 299
    assert plan.minutes(plan.frames) == pytest.approx(plan.rows[3].frames / 600)


def test_a_session_of_many_frames_a_second_is_planned_for_the_ten_seconds_that_bounds_need(capsys) -> None:
    done = runner(capsys)("plan", "--noise", "5arcsec", "--tau", "0s", "--rate", "100Hz", "--json")
    plan = json.loads(done.out)
    assert [row["frames"] for row in plan["rows"][:3]] == [1001] * 3
    assert plan["frames"] == 1001


def test_a_session_of_one_frame_plans_nothing() -> None:
    assert plan_like(judge(synthetic_night(1)), Subject.ONBOARD, Limits()) is None


def test_a_plan_with_a_row_that_cannot_pass_has_no_length() -> None:
    rows = (RowPlan("dRA*", 60.0, "arcsec", 600), RowPlan("dDE", 60.0, "arcsec", None))
    assert SessionPlan(rows, 10.0).frames is None
    assert SessionPlan(rows[:1], 10.0).minutes(600) == pytest.approx(1.0)


@pytest.mark.parametrize(
    "arguments",
    [
        ("--noise", "10"),
        ("--noise", "10parsec"),
        ("--noise", "-1arcsec"),
        ("--noise", "0arcsec"),
        ("--roll-noise", "0arcsec"),
        ("--noise", "1e999arcsec"),
        ("--limit", "0arcsec"),
        ("--tau", "nan s"),
        ("--rate", "0Hz"),
        ("--truth", ""),
    ],
)
def test_bad_input_gets_a_word_with_an_example(capsys, arguments) -> None:
    done = runner(capsys)("plan", *arguments)
    assert done.code == 2
    assert arguments[0] in done.err
    assert "for example" in done.err


def test_a_session_and_options_together_are_refused(capsys, tmp_path) -> None:
    done = runner(capsys)("plan", tmp_path / "session.mcap", "--noise", "10arcsec")
    assert done.code == 2
    assert "not both" in done.err


def test_noise_beyond_the_limit_never_passes(capsys) -> None:
    done = runner(capsys)("plan", "--noise", "100arcsec", "--roll-noise", "1000arcsec", "--truth", "1arcsec")
    assert done.code == 1
    assert "no length of session gives a PASS: dRA* and dDE and roll" in done.out


def test_answers_are_planned_as_independent_where_nothing_is_said_of_their_runs():
    alone = session_plan((), Limits(), availability=0.99, frames_per_s=10.0)
    in_runs = session_plan((), Limits(), availability=0.99, frames_per_s=10.0, frames_per_answer=3.0)
    assert alone.rows[0].frames == availability_frames(0.99, 0.95)
    assert in_runs.rows[0].frames == availability_frames(0.99, 0.95, frames_per_value=3.0)
