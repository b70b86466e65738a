"""The decision rule as a table: what each side of each limit gives."""

import math

import pytest
import scipy.stats

from gse.station.results import Subject
from gse.statistics.axis_statistics import MIN_S
from gse.statistics.decision import (
    Criterion,
    Figure,
    Outcome,
    Share,
    amount,
    judge_figure,
    judge_share,
    minutes_more,
    share_of,
    share_outcome,
)
from gse.statistics.sampling import MIN_FRAMES, NO_BOUNDS, Bounds
from gse.values.limits import Decision

LIMIT = 60.0


def row(value, half_width, *, truth=0.0, limit=LIMIT, decision=Decision.GUARDED, frames=600, duration_s=600.0):
    bounds = Bounds(value - 2, value + 2, value - half_width, value + half_width) if half_width else NO_BOUNDS
    figure = Figure(value, bounds, 100.0, frames, duration_s)
    asked = Criterion(Subject.ONBOARD, "mean |dDE|", limit, decision, "arcsec")
    return judge_figure(asked, figure, truth_uncertainty=truth)


@pytest.mark.parametrize(
    ("value", "half_width", "truth", "expected"),
    [
        (50.0, 10.0, 0.0, "PASS"),  # the bound is at the limit itself
        (50.0, 10.001, 0.0, "INCONCLUSIVE"),
        (59.0, 3.0, 0.0, "INCONCLUSIVE"),
        (61.0, 3.0, 0.0, "INCONCLUSIVE"),
        (70.0, 10.0, 0.0, "INCONCLUSIVE"),  # at the limit itself nothing is shown
        (70.0, 9.999, 0.0, "FAIL"),
        (50.0, 1.0, 7.0, "INCONCLUSIVE"),  # 1.645 x 7 = 11.5
        (50.0, 1.0, 6.0, "PASS"),  # hypot(1, 9.87) = 9.92
        (70.0, 1.0, 7.0, "INCONCLUSIVE"),
        (70.0, 1.0, 5.0, "FAIL"),
        (5.0, 1.0, math.inf, "INCONCLUSIVE"),
        (5000.0, 1.0, math.inf, "INCONCLUSIVE"),
        (5.0, 0.0, 0.0, "INCONCLUSIVE"),  # no bounds: too short to tell
        (5000.0, 0.0, 0.0, "INCONCLUSIVE"),
    ],
)
def test_a_figure_is_decided_only_where_its_uncertainty_leaves_no_doubt(value, half_width, truth, expected):
    assert row(value, half_width, truth=truth).outcome == expected


def test_a_row_without_frames_or_without_a_limit_is_not_tested():
    assert row(math.nan, 0.0, frames=0).outcome is Outcome.NOT_TESTED
    assert row(50.0, 1.0, limit=math.nan).outcome is Outcome.NOT_TESTED


@pytest.mark.parametrize(("frames", "expected"), [(MIN_FRAMES - 1, "INCONCLUSIVE"), (MIN_FRAMES, "PASS")])
def test_so_many_frames_are_needed(frames, expected):
    assert row(5.0, 1.0, frames=frames).outcome == expected


@pytest.mark.parametrize(("value", "expected"), [(60.0, "PASS"), (60.001, "FAIL")])
def test_simple_acceptance_knows_no_doubt_but_states_its_risk(value, expected):
    decided = row(value, 16.45, decision=Decision.SIMPLE)
    assert decided.outcome == expected
    assert decided.false_pass_risk == pytest.approx(0.5, abs=1e-3)
    assert row(60 - 16.45, 16.45, decision=Decision.SIMPLE).false_pass_risk == pytest.approx(0.05, abs=1e-3)


def test_an_undecided_row_says_how_much_longer_would_have_decided():
    undecided = row(50.0, 20.0, duration_s=600.0)
    minutes = minutes_more(Figure(50.0, Bounds(0, 0, 30.0, 70.0), 100.0, 600, 600.0), LIMIT, 0.0)
    assert 30 < minutes < 300  # 10 of room: four times as long would do if the figure stayed
    assert f"{math.ceil(minutes)} more minutes would have decided" in undecided.reason
    assert "a longer session cannot decide" in row(50.0, 20.0, truth=7.0).reason
    assert "it lies too near the limit for a longer session to decide" in row(58.0, 10.0, truth=1.0).reason


@pytest.mark.parametrize(("above", "below"), [(70.0, 50.0), (74.0, 46.0)])
def test_a_figure_above_its_limit_takes_as_long_to_decide_as_one_below(above, below):
    def minutes(value):
        return minutes_more(Figure(value, Bounds(0, 0, value - 20, value + 20), math.inf, 600, 600.0), LIMIT, 1.0)

    assert minutes(above) == pytest.approx(minutes(below), rel=1e-9)
    assert minutes(above) > 5


def test_a_minute_is_told_in_minutes():
    words = row(50.0, 12.0, frames=600, duration_s=10.0).reason.partition("U ")[2]
    assert ": 1 more minute would have decided" in words


@pytest.mark.parametrize(
    ("hours", "words"), [(23.9, ": 1434 more minutes would"), (24.1, ": more than a day more would")]
)
def test_more_than_a_day_is_not_counted_in_minutes(hours, words):
    per_second = minutes_more(Figure(50.0, Bounds(0, 0, 30.0, 70.0), 100.0, 600, 1.0), LIMIT, 0.0)
    assert words in row(50.0, 20.0, duration_s=hours * 60 / per_second - 1e-6).reason


def test_degrees_are_printed_where_degrees_are_meant():
    assert "is 90.00 deg, the limit is 60.0 arcsec" in row(90 * 3600.0, 1.0).reason


# Shares


@pytest.mark.parametrize(("count", "of"), [(0, 30), (0, 300), (1, 600), (57, 60), (600, 600), (3, 57)])
def test_the_bounds_of_a_share_are_those_of_the_binomial_test(count, of):
    share = share_of(count, of)
    below = scipy.stats.binomtest(count, of, alternative="less").proportion_ci(0.95, method="exact")
    above = scipy.stats.binomtest(count, of, alternative="greater").proportion_ci(0.95, method="exact")
    assert (share.lower, share.upper) == pytest.approx((above.low, below.high), abs=1e-9)


@pytest.mark.parametrize(
    ("count", "limit", "at_least", "reason"),
    [
        (0, 0.05, False, ""),
        (90, 0.05, False, "onboard false answers: 90 of 600 frames (15.00 %), the limit is 5.00 %"),
        (28, 0.05, False, "(4.67 %) show at most 6.34 % with 95 % confidence, the limit is 5.00 %: no length can be"),
        (572, 0.95, True, "(95.33 %) show at least 93.66 % with 95 % confidence, the limit is 95.00 %: no length can"),
    ],
)
def test_a_share_says_why_it_does_not_pass(count, limit, at_least, reason):
    share = share_of(count, 600)
    asked = Criterion(Subject.ONBOARD, "false answers", limit, Decision.GUARDED)
    found = judge_share(asked, share, at_least=at_least).reason
    assert reason in found
    assert bool(found) == bool(reason)


def false_answers(count, of, decision=Decision.GUARDED):
    share = share_of(count, of)
    return judge_share(Criterion(Subject.ONBOARD, "false answers", 0.01, decision), share, at_least=False).outcome


@pytest.mark.parametrize(
    ("count", "of", "expected"),
    [
        (0, 30, "INCONCLUSIVE"),
        (0, 298, "INCONCLUSIVE"),
        (0, 299, "PASS"),
        (0, 300, "PASS"),
        (1, 300, "INCONCLUSIVE"),
        (1, 30, "INCONCLUSIVE"),
        (3, 30, "FAIL"),
        (30, 30, "FAIL"),
        (0, 0, "not tested"),
    ],
)
def test_false_answers_are_decided_by_their_exact_bounds(count, of, expected):
    assert false_answers(count, of) == expected


@pytest.mark.parametrize(("count", "expected"), [(3, "PASS"), (4, "FAIL")])
def test_simple_acceptance_of_a_share_takes_the_limit_itself(count, expected):
    assert false_answers(count, 300, Decision.SIMPLE) == expected


def available(count, of, n_eff=None, decision=Decision.GUARDED, limit=0.95):
    share = share_of(count, of, n_eff)
    return judge_share(Criterion(Subject.ONBOARD, "availability", limit, decision), share, at_least=True).outcome


@pytest.mark.parametrize(
    ("count", "of", "n_eff", "expected"),
    [
        (58, 58, None, "INCONCLUSIVE"),
        (59, 59, None, "PASS"),
        (590, 600, None, "PASS"),
        (590, 600, 40.0, "INCONCLUSIVE"),  # one outage of a second is not ten independent frames
        (540, 600, None, "FAIL"),
        (540, 600, 20.0, "INCONCLUSIVE"),
        (0, 600, None, "FAIL"),
    ],
)
def test_availability_is_decided_on_its_effective_number(count, of, n_eff, expected):
    assert available(count, of, n_eff) == expected


def test_simple_acceptance_of_availability_takes_the_limit_itself():
    assert available(95, 100, decision=Decision.SIMPLE) == "PASS"
    assert available(94, 100, decision=Decision.SIMPLE) == "FAIL"


def test_simple_acceptance_of_a_share_states_the_risk_that_the_true_one_is_beyond_the_limit():
    """After 0 of 30 with nothing known before: 0.99 to the power of 31 are above 1 %."""
    asked = Criterion(Subject.ONBOARD, "false answers", 0.01, Decision.SIMPLE)
    assert judge_share(asked, share_of(0, 30), at_least=False).false_pass_risk == pytest.approx(0.99**31)
    assert math.isnan(judge_share(asked, share_of(0, 0), at_least=False).false_pass_risk)
    asked = Criterion(Subject.ONBOARD, "availability", 0.95, Decision.SIMPLE)
    assert judge_share(asked, share_of(30, 30), at_least=True).false_pass_risk == pytest.approx(0.95**31)


def test_simple_acceptance_needs_a_truth_to_compare_with():
    decided = row(5.0, 1.0, truth=math.inf, decision=Decision.SIMPLE)
    assert decided.outcome == "INCONCLUSIVE"
    assert "the error of truth is not known" in decided.reason


JUST = 1e-9


@pytest.mark.parametrize(
    ("at_least", "lower", "upper", "expected"),
    [
        (True, 0.9, 0.99, "PASS"),  # the lower bound reaches the limit
        (True, 0.9 - JUST, 0.99, "INCONCLUSIVE"),
        (True, 0.8, 0.9, "INCONCLUSIVE"),  # the limit itself may be true
        (True, 0.8, 0.9 - JUST, "FAIL"),
        (False, 0.8, 0.9, "PASS"),
        (False, 0.8, 0.9 + JUST, "INCONCLUSIVE"),
        (False, 0.9, 0.99, "INCONCLUSIVE"),
        (False, 0.9 + JUST, 0.99, "FAIL"),
    ],
)
def test_a_share_is_decided_by_its_bounds_and_the_limit_itself_keeps_it(at_least, lower, upper, expected):
    share = Share(85, 100, 0.85, 100.0, lower, upper)
    assert share_outcome(share, 0.9, at_least=at_least, decision=Decision.GUARDED) == expected


@pytest.mark.parametrize(
    ("value", "outcome", "uncertainty", "words"),
    [
        (40.0, "PASS", 7.0, ""),
        (80.0, "FAIL", 3.0, "is 80.0 arcsec, the limit is 60.0 arcsec (U 3.0 arcsec)"),
        (58.0, "INCONCLUSIVE", 7.0, "is 58.0 arcsec with U 7.0 arcsec, the limit is 60.0 arcsec"),
        (61.0, "INCONCLUSIVE", 7.0, "is 61.0 arcsec with U 3.0 arcsec, the limit is 60.0 arcsec"),
    ],
)
def test_a_row_has_the_uncertainty_towards_its_limit(value, outcome, uncertainty, words):
    """Bounds 3 arcsec below and 7 above."""
    figure = Figure(value, Bounds(value - 4, value + 8, value - 3, value + 7), 100.0, 600, 600.0)
    asked = Criterion(Subject.ONBOARD, "mean |dDE|", LIMIT, Decision.GUARDED, "arcsec")
    found = judge_figure(asked, figure, truth_uncertainty=0.0)
    assert (found.outcome, found.uncertainty) == (outcome, pytest.approx(uncertainty))
    assert words in found.reason
    assert bool(found.reason) == bool(words)


@pytest.mark.parametrize(("at_least", "uncertainty"), [(True, 0.05), (False, 0.02)])
def test_a_share_has_the_uncertainty_towards_its_limit(at_least, uncertainty):
    asked = Criterion(Subject.ONBOARD, "availability", 0.9, Decision.GUARDED)
    found = judge_share(asked, Share(90, 100, 0.9, 100.0, 0.85, 0.92), at_least=at_least)
    assert found.uncertainty == pytest.approx(uncertainty)


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (3599.0, "arcsec", "3599 arcsec"),
        (3600.0, "arcsec", "1.00 deg"),
        (-7200.0, "arcsec", "-2.00 deg"),
        (999.94, "arcsec", "999.9 arcsec"),
        (4000.0, "ms", "4000 ms"),
        (0.25, "", "0.2"),
    ],
)
def test_an_amount_is_told_in_degrees_from_one_degree_on(value, unit, text):
    assert amount(value, unit) == text


# Words and sides

NEEDED = f"compared with truth, {MIN_FRAMES} are needed"


def undecided(figure, *, decision=Decision.GUARDED, truth=0.0, limit=LIMIT, **options):
    asked = Criterion(Subject.ONBOARD, "mean |dDE|", limit, decision, "arcsec")
    return judge_figure(asked, figure, truth_uncertainty=truth, **options)


@pytest.mark.parametrize(
    ("figure", "words"),
    [
        (Figure(5.0, NO_BOUNDS, math.nan, MIN_FRAMES - 1, 600.0), f": {MIN_FRAMES - 1} frames {NEEDED}"),
        (Figure(5.0, NO_BOUNDS, math.nan, 1, 600.0), f": 1 frame {NEEDED}"),
        (
            Figure(5.0, NO_BOUNDS, math.nan, MIN_FRAMES, MIN_S),
            ": every answer has the same error, which tells nothing of its scatter",
        ),
        (Figure(5.0, NO_BOUNDS, math.nan, MIN_FRAMES, MIN_S - 0.01), ": the session is too short to tell"),
        (Figure(5.0, NO_BOUNDS, 3.4, MIN_FRAMES, 600.0), ": the session is too short to tell (n_eff 3)"),
        (Figure(5.0, NO_BOUNDS, 3.6, MIN_FRAMES, 5.0), ": the session is too short to tell (n_eff 4)"),
    ],
)
def test_what_a_figure_lacks_is_its_reason(figure, words):
    assert undecided(figure).reason == f"onboard mean |dDE|{words}"


def test_what_truth_leaves_open_is_told():
    """1.645 times 10 arcsec are 16.4 (of 16.45, to even); hypot(3, 16.45) are 16.7."""
    figure = Figure(50.0, Bounds(46.0, 54.0, 47.0, 53.0), 100.0, 600, 600.0)
    asked = "onboard mean |dDE| is 50.0 arcsec with U 16.7 arcsec, the limit is 60.0 arcsec: truth leaves 16.4 arcsec, "
    assert undecided(figure, truth=10.0).reason == f"{asked}a longer session cannot decide"


def test_a_row_without_a_test_says_what_is_missing():
    assert row(math.nan, 0.0, frames=0).reason == "onboard mean |dDE|: no frame has it"
    assert row(50.0, 1.0, frames=1, limit=math.nan).reason == "onboard mean |dDE|: no limit is stated"
    assert row(50.0, 1.0, limit=math.nan).reason == "onboard mean |dDE|: no limit is stated"


def test_a_row_keeps_what_it_was_judged_by():
    figure = Figure(50.0, Bounds(46.0, 54.0, 47.0, 57.0), 80.0, 600, 600.0)
    found = undecided(figure, truth=1.0)
    assert (found.subject, found.name, found.unit, found.label) == (
        Subject.ONBOARD,
        "mean |dDE|",
        "arcsec",
        "onboard mean |dDE|",
    )
    assert (found.value, found.limit, found.n_eff, found.truth_uncertainty) == (50.0, 60.0, 80.0, 1.0)
    assert found.uncertainty == pytest.approx(math.hypot(7.0, 1.645))
    assert found.false_pass_risk == 0.05
    assert not found.relative
    assert undecided(figure, relative=True).relative
    assert not judge_share(
        Criterion(Subject.ONBOARD, "availability", 0.9, Decision.GUARDED), share_of(9, 10), at_least=True
    ).relative


def test_a_figure_at_its_limit_is_undecided_on_its_upper_side():
    """Bounds 3 arcsec below and 7 above; they come closer for ever."""
    figure = Figure(60.0, Bounds(56.0, 68.0, 57.0, 67.0), 100.0, 600, 600.0)
    found = undecided(figure)
    assert found.outcome is Outcome.INCONCLUSIVE
    assert "is 60.0 arcsec with U 7.0 arcsec, the limit" in found.reason


@pytest.mark.parametrize(("minutes", "words"), [(0.2, "1 more minute would"), (1.4, "2 more minutes would")])
def test_minutes_are_counted_up(minutes, words):
    bounds = Bounds(0.0, 0.0, 30.0, 70.0)
    per_second = minutes_more(Figure(50.0, bounds, math.inf, 600, 1.0), LIMIT, 0.0)
    figure = Figure(50.0, bounds, math.inf, 600, minutes / per_second)
    assert f": {words} have decided" in undecided(figure).reason


@pytest.mark.parametrize(
    ("value", "above", "risk"),
    [
        (50.0, 16.45, scipy.stats.norm.cdf(-1.0)),
        (50.0, 5.0, scipy.stats.norm.cdf(-3.29)),
        (50.0, 0.5, scipy.stats.norm.cdf(-32.9)),
        (55.0, 16.45, scipy.stats.norm.cdf(-0.5)),
        (50.0, 0.0, math.nan),
    ],
)
def test_simple_acceptance_states_the_share_of_a_normal_uncertainty_beyond_the_limit(value, above, risk):
    figure = Figure(value, Bounds(value, value, value, value + above), 100.0, 600, 600.0)
    found = undecided(figure, decision=Decision.SIMPLE)
    assert found.outcome is Outcome.PASS
    assert found.false_pass_risk == pytest.approx(risk, nan_ok=True)


@pytest.mark.parametrize(
    ("value", "text"), [(1000.0, "1000 ms"), (1000.6, "1001 ms"), (999.96, "1000.0 ms"), (-1500.4, "-1500 ms")]
)
def test_an_amount_has_a_decimal_below_a_thousand(value, text):
    assert amount(value, "ms") == text


def test_a_share_of_nothing_is_not_known():
    found = share_of(0, 0)
    assert (found.count, found.of, found.n_eff) == (0, 0, 0.0)
    assert all(math.isnan(value) for value in (found.value, found.lower, found.upper))
    asked = Criterion(Subject.ONBOARD, "availability", 0.9, Decision.GUARDED)
    assert judge_share(asked, found, at_least=True).reason == "onboard availability: no frame has it"


@pytest.mark.parametrize(("count", "lower", "upper"), [(0, 0.0, 0.95), (1, 0.05, 1.0)])
def test_one_frame_bounds_a_share_by_the_risk_itself(count, lower, upper):
    share = share_of(count, 1)
    assert (share.lower, share.upper) == pytest.approx((lower, upper))
    assert (share.value, share.n_eff) == (count, 1.0)
    asked = Criterion(Subject.ONBOARD, "false answers", 0.5, Decision.SIMPLE)
    risk = judge_share(asked, share, at_least=False).false_pass_risk
    assert risk == pytest.approx(0.25 if count == 0 else 0.75)  # half of a triangle that falls, or grows


def test_an_effective_number_is_no_more_than_the_frames():
    assert share_of(5, 10, 40.0) == share_of(5, 10)
    few = share_of(5, 10, 4.0)
    assert (few.count, few.of, few.value, few.n_eff) == (5, 10, 0.5, 4.0)
    assert few.lower == pytest.approx(scipy.stats.beta.ppf(0.05, 2, 3))
    assert few.upper == pytest.approx(scipy.stats.beta.ppf(0.95, 3, 2))


def test_a_reason_of_a_share_has_what_stands_beside_it():
    asked = Criterion(Subject.SENSOR, "availability", 0.95, Decision.GUARDED)
    found = judge_share(asked, share_of(540, 600), at_least=True, beside=" of the sky")
    assert found.reason == "sensor availability: 540 of 600 frames of the sky (90.00 %), the limit is 95.00 %"
    assert found.n_eff == 600.0
    assert found.false_pass_risk == 0.05
