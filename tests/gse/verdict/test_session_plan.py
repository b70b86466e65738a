"""What is left of a session, and the plan of another one."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from skies.synthetic_night import synthetic_night

from gse.station.results import Subject, Verdict
from gse.statistics.availability import available_share
from gse.statistics.axis_statistics import MIN_S
from gse.statistics.decision import (
    Criterion,
    Figure,
    Outcome,
    Row,
    further_share,
    how_long,
    judge_figure,
    judge_share,
    lengths_to_pass,
    minutes_more,
    share_of,
    share_outcome,
    share_times,
)
from gse.statistics.sampling import MIN_FRAMES, Bounds
from gse.values.axis import D_DE, D_RA_COSDE
from gse.values.limits import Decision, Limits
from gse.verdict.assessment import Assessment, judge
from gse.verdict.planning import NEVER, Expected, availability_frames, figure_length, figure_times
from gse.verdict.requirements import HOST_TIME, AxisQuestion, ExpectedSession, RowPlan, requirement_of
from gse.verdict.session_plan import SessionPlan, minutes_left, plan_like, rows_left, session_plan


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
    asked = Criterion(Subject.ONBOARD, "mean |dDE|", 60.0, Decision.GUARDED, "arcsec")
    row = judge_figure(asked, figure, truth_uncertainty=2.0)
    (left,) = rows_left(replace(few, rows=(row,)))
    assert left.minutes == pytest.approx(minutes_more(figure, 60.0, 2.0))
    assert 1 < left.minutes < 30


def test_nothing_is_left_of_a_row_that_is_decided(few) -> None:
    assert all(item.minutes == 0 for item in rows_left(few) if item.row.outcome is Outcome.PASS)


def test_the_minutes_left_are_those_of_the_slowest_row(few) -> None:
    left = [item.minutes for item in rows_left(few)]
    found = minutes_left(few)
    assert math.isnan(found) if any(map(math.isnan, left)) else found == (max(left) or NEVER)


def test_another_session_is_planned_from_the_figures_of_one_that_was_judged(few) -> None:
    plan = plan_like(few, Subject.ONBOARD, Limits())
    assert plan.frames_per_s == pytest.approx(10.0)
    assert [(row.name, row.frames) for row in plan.rows[:3]] == [
        (label, 1 + 10 * MIN_S) for label in ("dRA*", "dDE", "roll")
    ]
    assert [row.name for row in plan.rows[3:]] == ["availability", "false answers"]
    assert 240 < plan.rows[3].frames < 2400  # 97 % of 240 frames leave it open
    assert plan.rows[4].frames == 299
    assert plan.minutes(plan.frames) == pytest.approx(plan.rows[3].frames / 600)


def test_a_session_of_many_frames_a_second_is_planned_for_the_ten_seconds_that_bounds_need() -> None:
    axis = AxisQuestion(D_RA_COSDE, Expected(0.0, 5.0, 0.0, 100.0), 60.0, 0.0)
    plan = session_plan(ExpectedSession((axis,), Limits(), 1.0, 100.0))
    assert plan.rows[0].frames == 1 + 100 * MIN_S


def test_a_session_of_one_frame_plans_nothing() -> None:
    assert plan_like(judge(synthetic_night(1)), Subject.ONBOARD, Limits()) is None


def test_a_plan_with_a_row_that_cannot_pass_has_no_length() -> None:
    rows = (RowPlan("dRA*", 60.0, "arcsec", 600), RowPlan("dDE", 60.0, "arcsec", None))
    assert SessionPlan(rows, 10.0).frames is None
    assert SessionPlan(rows[:1], 10.0).minutes(600) == pytest.approx(1.0)


def test_noise_beyond_the_limit_never_passes() -> None:
    axis = AxisQuestion(D_RA_COSDE, Expected(0.0, 100.0, 1.0, 10.0), 60.0, 1.0)
    assert session_plan(ExpectedSession((axis,), Limits(), 1.0, 10.0)).rows[0].frames is None


def test_answers_are_planned_as_independent_where_nothing_is_said_of_their_runs():
    alone = session_plan(ExpectedSession((), Limits(), 0.99, 10.0))
    in_runs = session_plan(ExpectedSession((), Limits(), 0.99, 10.0, frames_per_answer=3.0))
    assert alone.rows[0].frames == availability_frames(0.99, 0.95)
    assert in_runs.rows[0].frames == availability_frames(0.99, 0.95, frames_per_value=3.0)


# By hand


@pytest.mark.parametrize("hz", [1.0, 2.9, 3.0, 4.96, 10.0])
def test_a_plan_has_a_row_of_each_axis_and_share_of_the_time_that_bounds_need_at_least(hz):
    """Far within its limit an axis takes MIN_FRAMES, and MIN_S end with one more frame than they have steps."""
    frames = 1 + math.ceil(MIN_S * hz)
    limits = Limits(availability=0.9, false_share=0.05)
    axes = (
        AxisQuestion(D_RA_COSDE, Expected(0.0, 1.0, 0.0, hz), 1000.0, 0.0),
        AxisQuestion(D_DE, Expected(70.0, 0.0, 0.0, hz), 60.0, 0.0),
    )
    plan = session_plan(ExpectedSession(axes, limits, 1.0, hz))
    assert plan.rows == (
        RowPlan("dRA*", 1000.0, "arcsec", max(MIN_FRAMES, frames)),
        RowPlan("dDE", 60.0, "arcsec", None),
        RowPlan("availability", 0.9, "", 29),  # 0.9 ** 29 is below 5 %
        RowPlan("false answers", 0.05, "", 59),
    )
    assert plan.frames_per_s == hz
    assert plan.frames is None
    assert replace(plan, rows=plan.rows[2:]).frames == 59
    assert replace(plan, rows=()).frames is None
    assert plan.minutes(None) is None
    assert plan.minutes(600) == pytest.approx(10 / hz)


@pytest.mark.parametrize(
    ("share", "limit", "at_least", "expected"),
    [
        (share_of(0, 100), 0.01, False, math.log(0.05) / math.log(0.99) / 100 - 1),
        (share_of(0, 100, 50.0), 0.01, False, math.log(0.05) / math.log(0.99) / 50 - 1),
        (share_of(50, 50), 0.95, True, math.log(0.05) / math.log(0.95) / 50 - 1),
        (share_of(100, 100), 0.95, True, 0.0),
    ],
)
def test_a_share_that_never_or_always_happened_is_decided_when_its_bound_has_come_to_the_limit(
    share, limit, at_least, expected
):
    assert share_times(share, limit, at_least=at_least) == pytest.approx(expected, rel=1e-5, abs=1e-6)


@pytest.mark.parametrize(
    ("share", "words"),
    [
        (share_of(0, 298), "a session 1.1 times as long decides"),
        (share_of(0, 100), "a session 3.0 times as long decides"),
        (share_of(0, 25), "a session 12 times as long decides"),
        (share_of(0, 25, 0.5), "no length can be named that decides"),
    ],
)
def test_an_undecided_share_says_which_session_decides(share, words):
    asked = Criterion(Subject.ONBOARD, "false answers", 0.01, Decision.GUARDED)
    assert how_long(share, 0.01, at_least=False) == words
    assert judge_share(asked, share, at_least=False).reason.endswith(f"the limit is 1.00 %: {words}")


def test_one_frame_without_an_answer_is_told_of_a_second_frame_and_not_of_a_tenth():
    asked = Criterion(Subject.ONBOARD, "availability", 0.95, Decision.GUARDED)
    reason = judge_share(asked, share_of(0, 1), at_least=True).reason
    assert reason.endswith("0 of 1 frame (0.00 %), the limit is 95.00 %: a session 2.0 times as long decides")


@pytest.mark.parametrize(("frames", "in_outages_of", "least_told"), [(600, 1, 15), (3600, 10, 15), (3600, 30, 15)])
def test_four_of_five_sessions_are_decided_when_they_go_on_as_long_as_they_were_told(frames, in_outages_of, least_told):
    """Of sensors that miss 1 to 9 % of the answers, at a limit of 5 %; more than ten are not simulated."""
    rng, told, decided = np.random.default_rng(2), 0, 0
    for _ in range(150):
        absent = rng.uniform(0.01, 0.09)
        first = rng.random(11 * frames) < absent / in_outages_of
        good = np.convolve(first, np.ones(in_outages_of))[: len(first)] == 0
        share = available_share(good[:frames])[0]
        times = share_times(share, 0.95, at_least=True)
        if times < 1e-6 or times > 10:
            continue
        told += 1
        longer = available_share(good[: math.ceil(frames * (1 + times))])[0]
        decided += share_outcome(longer, 0.95, at_least=True, decision=Decision.GUARDED) is not Outcome.INCONCLUSIVE
    assert told >= least_told
    assert decided >= 0.8 * told


def test_one_outage_names_no_length_and_says_why():
    """Their number may be several times as large: 2 % that is missing, at a limit of 5 %, says nothing of an hour."""
    good = np.ones(3600, dtype=bool)
    good[1000:1072] = False
    share, outages = available_share(good)
    asked = Criterion(Subject.ONBOARD, "availability", 0.95, Decision.GUARDED)
    assert judge_share(asked, share, at_least=True).outcome is Outcome.INCONCLUSIVE
    assert math.isinf(share_times(share, 0.95, at_least=True))
    words = judge_share(asked, share, at_least=True, events=str(outages)).reason
    assert words.endswith("the limit is 95.00 %: 1 outage of 72 frames, too few events to tell")


def test_no_session_of_hundreds_of_nights_is_named():
    """Three outages in a night of 6,094 frames: a session 241 times as long would be most of a year."""
    good = np.ones(6094, dtype=bool)
    good[1000:1090], good[2000:2008], good[3000:3004] = False, False, False
    share, outages = available_share(good)
    assert math.isinf(share_times(share, 0.95, at_least=True))
    asked = Criterion(Subject.ONBOARD, "availability", 0.95, Decision.GUARDED)
    words = judge_share(asked, share, at_least=True, events=str(outages)).reason
    assert words.endswith("3 outages of 4 to 90 frames, too few events to tell")


def test_outages_that_are_many_enough_say_which_session_decides():
    good = np.ones(3600, dtype=bool)
    good[(np.arange(12) * 300)[:, None] + np.arange(10)] = False
    share, outages = available_share(good)
    asked = Criterion(Subject.ONBOARD, "availability", 0.95, Decision.GUARDED)
    words = judge_share(asked, share, at_least=True, events=str(outages)).reason
    assert words.endswith(f"the limit is 95.00 %: 12 outages of 10 frames; {how_long(share, 0.95, at_least=True)}")
    assert " times as long decides" in words


def row_of(name, outcome=Outcome.INCONCLUSIVE, *, unit="", limit=0.01, value=0.0, **more):
    return Row(Subject.ONBOARD, name, value, unit, limit, outcome, **more)


TIME = HOST_TIME.name
SUBJECT = SimpleNamespace(available=share_of(50, 50), false_answers=share_of(0, 100), slow=share_of(0, 150))


def test_a_figure_is_decided_and_another_like_it_passes_after_the_lengths_that_its_row_says():
    """A U of 15 of which truth has 9 leaves 12 to sampling; another session has as much to pass with."""
    row = row_of("mean |dDE|", unit="arcsec", limit=60.0, value=50.0, uncertainty=15.0, truth_uncertainty=9 / 1.645)
    row = replace(row, n_eff=40.0)
    assert requirement_of(row).times_left(row, SUBJECT) == further_share(10.0, 12.0, 9 / 1.645, 40.0) > 0
    assert figure_length(row) == lengths_to_pass(10.0, 12.0, 9 / 1.645, 40.0) > 1
    assert math.isnan(figure_times(replace(row, uncertainty=math.nan)))


@pytest.mark.parametrize(
    ("row", "times"),
    [
        (row_of("availability", limit=0.95), 58.4040 / 50 - 1),
        (row_of("false answers", limit=0.02), 148.2837 / 100 - 1),
        (row_of(TIME, limit=0.5), 298.0729 / 150 - 1),  # 1 %, whatever the time that is allowed
        (row_of("availability", Outcome.PASS, limit=0.95), 0.0),
        (row_of("mean |dDE|", Outcome.FAIL, unit="arcsec", limit=10.0, uncertainty=20.0), 0.0),
    ],
)
def test_each_row_is_decided_by_its_own_share_or_figure(row, times):
    """0.95, 0.98 and 0.99 to these powers are 5 %."""
    assert requirement_of(row).times_left(row, SUBJECT) == pytest.approx(times, abs=1e-5)


def judged(*rows, verdict=Verdict.INCONCLUSIVE):
    statistics = SimpleNamespace(judged_s=600.0, subjects={Subject.ONBOARD: SUBJECT})
    return SimpleNamespace(verdict=verdict, statistics=statistics, rows=rows, reasons=())


FALSE, SLOW = row_of("false answers", limit=0.02), row_of(TIME)
UNKNOWN = row_of("mean |dDE|", unit="arcsec", limit=10.0)


@pytest.mark.parametrize(
    ("assessment", "minutes"),
    [
        (judged(FALSE, SLOW), 10 * (298.0729 / 150 - 1)),
        (judged(SLOW, FALSE), 10 * (298.0729 / 150 - 1)),
        (judged(FALSE), 10 * (148.2837 / 100 - 1)),
        (judged(FALSE, row_of(TIME, Outcome.NOT_TESTED)), 10 * (148.2837 / 100 - 1)),
        (judged(FALSE, UNKNOWN), math.nan),
        (judged(), NEVER),
        (judged(row_of("false answers", Outcome.PASS)), NEVER),  # what is not a row stands against it
        (judged(FALSE, verdict=Verdict.PASS), 0.0),
        (judged(FALSE, verdict=Verdict.FAIL), 0.0),
    ],
)
def test_a_session_has_its_verdict_after_the_minutes_of_its_slowest_row(assessment, minutes):
    assert minutes_left(assessment) == pytest.approx(minutes, abs=1e-4, nan_ok=True)


def test_rows_that_were_not_tested_are_left_out():
    rows = (FALSE, row_of(TIME, Outcome.NOT_TESTED), row_of("availability", Outcome.PASS))
    left = rows_left(judged(*rows))
    assert [item.row for item in left] == [rows[0], rows[2]]
    assert [item.minutes for item in left] == pytest.approx([10 * (148.2837 / 100 - 1), 0.0], abs=1e-4)


def seen(*, available, u=1.0, duration_s=600.0, frames=1201):
    subject = SimpleNamespace(subject=Subject.ONBOARD, available=available)
    statistics = SimpleNamespace(
        duration_s=duration_s, judged_s=duration_s, frames=frames, subjects={Subject.ONBOARD: subject}
    )
    figures = {"dRA*": (900.0, 1.0), "dDE": (1000.0, 1.0), "roll": (1100.0, u)}
    rows = [
        row_of(
            f"{name}|{axis}|",
            Outcome.PASS,
            unit="arcsec",
            limit=limit,
            value=4.0,
            uncertainty=of,
            truth_uncertainty=0.0,
        )
        for axis, (limit, of) in figures.items()
        for name in ("mean ", "95 % of ")
    ]
    return SimpleNamespace(statistics=statistics, rows=[replace(row, n_eff=900.0) for row in rows])


WIDE = Limits(d_ra_cosde_arcsec=900.0, d_de_arcsec=1000.0, d_roll_arcsec=1100.0)


def test_a_session_like_another_has_its_rate_its_axes_and_its_runs_of_answers():
    """1201 frames in 600 s are two a second; 2.5 of them tell as much as one that is independent."""
    plan = plan_like(seen(available=share_of(1000, 1000, 400.0)), Subject.ONBOARD, WIDE)
    assert plan.frames_per_s == 2.0
    assert plan.rows == (
        RowPlan("dRA*", 900.0, "arcsec", MIN_FRAMES),
        RowPlan("dDE", 1000.0, "arcsec", MIN_FRAMES),
        RowPlan("roll", 1100.0, "arcsec", MIN_FRAMES),
        RowPlan("availability", 0.95, "", 148),  # 59 runs of 2.5 are 147.5
        RowPlan("false answers", 0.01, "", 299),
    )


def test_the_longer_of_two_rows_is_the_length_of_an_axis_and_unknown_truth_never_passes():
    judged = seen(available=share_of(1000, 1000))
    judged.rows[4] = replace(judged.rows[4], uncertainty=2000.0)
    wide = plan_like(judged, Subject.ONBOARD, WIDE)
    assert wide.rows[2].frames == math.ceil(1201 * lengths_to_pass(1096.0, 2000.0, 0.0, 900.0)) > 1201
    assert wide.rows[1].frames == MIN_FRAMES
    unknown = plan_like(seen(available=share_of(1000, 1000), u=math.inf), Subject.ONBOARD, WIDE)
    assert unknown.rows[2].frames is None


@pytest.mark.parametrize("changes", [{"u": math.nan}, {"duration_s": 0.0}, {"duration_s": -1.0}])
def test_a_session_that_says_too_little_plans_no_other(changes):
    assert plan_like(seen(available=share_of(9, 9), **changes), Subject.ONBOARD, WIDE) is None


def test_short_sessions_and_those_without_answers_are_planned_too():
    short = plan_like(seen(available=share_of(9, 9), duration_s=0.5, frames=2), Subject.ONBOARD, WIDE)
    assert short.frames_per_s == 2.0
    none = plan_like(seen(available=share_of(0, 1000)), Subject.ONBOARD, WIDE)
    assert none.rows[3].frames is None
    assert plan_like(seen(available=share_of(0, 0)), Subject.ONBOARD, WIDE) is None
