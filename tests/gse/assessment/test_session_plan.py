"""What is left of a session, and bad input to ``gse plan`` in words."""

import math

import pytest
from devices.command_line import runner
from skies.synthetic_night import synthetic_night

from gse.assessment.decision import Outcome
from gse.assessment.session_plan import NEVER, RowPlan, SessionPlan, minutes_left, rows_left
from gse.assessment.verdict import judge
from gse.station.results import Verdict


def test_a_row_is_decided_after_the_minutes_that_were_said() -> None:
    few = judge(synthetic_night(240))
    left = {item.row.name: item.minutes for item in rows_left(few)}
    assert few.verdict is Verdict.INCONCLUSIVE
    assert 0 < left["false answers"] < NEVER
    more = math.ceil(240 * (1 + left["false answers"] / (few.statistics.duration_s / 60)))
    outcomes = [
        next(row.outcome for row in judge(synthetic_night(count)).rows if row.name == "false answers")
        for count in (more - 5, more + 5)
    ]
    assert outcomes == [Outcome.INCONCLUSIVE, Outcome.PASS]


def test_nothing_is_left_of_a_row_that_is_decided() -> None:
    assert all(item.minutes == 0 for item in rows_left(judge(synthetic_night(240))) if item.row.outcome is Outcome.PASS)


def test_the_minutes_left_are_those_of_the_slowest_row() -> None:
    assessment = judge(synthetic_night(240))
    left = [item.minutes for item in rows_left(assessment)]
    found = minutes_left(assessment)
    assert math.isnan(found) if any(map(math.isnan, left)) else found == (max(left) or NEVER)


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
