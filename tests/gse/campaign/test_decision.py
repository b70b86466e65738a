"""The verdict over nights: nights are the sample."""

import numpy as np
import pytest
from scipy import stats

from gse.campaign.decision import ONE_NIGHT, campaign_rows, campaign_share, reasons_of, verdict_of
from gse.campaign.document import _WORST_FIRST, _deciding
from gse.campaign.hot_pixels import COLUMN, hot_pixels
from gse.campaign.nights import COLUMNS, Session, _reasons, by_night, without_copies
from gse.campaign.page import with_digits_of
from gse.campaign.trends import trend
from gse.report.sessions_table import sessions_schema
from gse.station.exclusions import Cause
from gse.station.results import Verdict
from gse.statistics.decision import Outcome
from gse.statistics.sampling import MIN_FRAMES
from gse.verdict.requirements import AVAILABILITY


def night(number, value, *, limit=60.0, truth=0.0, count=990, of=1000, left_out="", name="mean |dDE|", unit="arcsec"):
    item = {
        "subject": "onboard", "name": name, "value": value, "unit": unit, "limit": limit, "outcome": "PASS",
        "uncertainty": 0.1, "truth_uncertainty": truth,
    }  # fmt: skip
    row = {
        "night": f"2026-03-{number:02d}", "frames": 1000, "measurements": [item], "limit_decision": "guarded",
        "onboard_available_count": count, "onboard_available_of": of, "onboard_available_n_eff": float(of),
    }  # fmt: skip
    return Session(row, left_out)


def one_row(sessions):
    (row,) = campaign_rows(by_night(sessions))
    return row


def test_a_figure_is_bounded_by_students_t_over_nights():
    values = [50.0, 55.0, 52.0, 57.0, 49.0]
    row = one_row(night(number, value) for number, value in enumerate(values, 1))
    expected = stats.ttest_1samp(values, 0).confidence_interval(0.9)  # its upper end is the one-sided bound of 95 %
    assert row.value + row.uncertainty == pytest.approx(expected.high)
    assert (row.outcome, row.worst, row.worst_night) == (Outcome.PASS, 57.0, "2026-03-04")


def test_nights_that_differ_decide_less_than_each_of_them_says():
    row = one_row(night(number, value) for number, value in enumerate([20.0, 90.0, 30.0], 1))
    assert row.outcome is Outcome.INCONCLUSIVE
    assert "more nights would decide" in row.reason
    assert verdict_of([row]) is Verdict.INCONCLUSIVE


def test_one_night_says_nothing_of_how_nights_differ():
    assert one_row([night(1, 1.0)]).reason == ONE_NIGHT


def test_what_fails_is_named_first_and_one_reason_once():
    single = one_row([night(1, 1.0)])
    failed = one_row(night(number, 99.0 + number % 2) for number in range(1, 9))
    passed = one_row(night(number, 9.0 + number % 2) for number in range(1, 9))
    first, second = reasons_of([single, passed, single, failed])
    assert first.startswith("FAIL: onboard mean |dDE| is 99.5 arcsec")
    assert second == f"INCONCLUSIVE: {ONE_NIGHT}"


@pytest.mark.parametrize(("count", "outcome"), [(900, Outcome.FAIL), (1000, Outcome.PASS)])
def test_the_uncertainty_of_a_share_reaches_towards_its_limit(count, outcome):
    nights = [night(number, 0.0, name="availability", limit=0.95, count=count) for number in range(1, 9)]
    row, share = one_row(nights), campaign_share(by_night(nights), "onboard", AVAILABILITY)
    assert row.outcome is outcome
    bound = share.upper if outcome is Outcome.FAIL else share.lower
    assert row.uncertainty == pytest.approx(abs(share.value - bound), rel=1e-9)


WHOLE = {
    "sensor": "A", "sensor_serial": 7, "source": "whole.mcap", "truncated": False, "first_utc": 100, "last_utc": 900,
}  # fmt: skip


@pytest.mark.parametrize(
    ("other", "counts"),
    [
        ({"truncated": True, "last_utc": 500}, False),
        ({"truncated": True, "first_utc": 300, "sensor_serial": None}, False),
        ({"truncated": True, "last_utc": 901}, True),
        ({"truncated": True, "first_utc": 99}, True),
        ({"truncated": True, "sensor_serial": 8}, True),
        ({"truncated": True, "sensor": "B"}, True),
        ({}, True),
    ],
)
def test_only_a_damaged_session_at_the_times_of_another_of_its_sensor_is_a_copy(other, counts):
    _, copy = without_copies([Session(WHOLE, ""), Session(WHOLE | other, "")])
    assert bool(copy.left_out) != counts
    assert counts or copy.left_out == "damaged, and whole.mcap has the same times"


def test_of_two_damaged_copies_one_counts_and_what_is_left_out_covers_nothing():
    first, second = (Session(WHOLE | {"truncated": True}, "") for _ in range(2))
    assert [bool(one.left_out) for one in without_copies([first, second])] == [True, False]
    assert [bool(one.left_out) for one in without_copies([Session(WHOLE, "no sky"), second])] == [True, False]


def test_truth_that_all_nights_share_does_not_average_out():
    many = [night(number, 50.0 + number % 2, truth=20.0) for number in range(1, 29)]
    row = one_row(many)
    assert row.outcome is Outcome.INCONCLUSIVE
    assert row.uncertainty > 1.6 * 20


def test_a_sensor_at_its_limit_passes_in_at_most_5_percent_of_the_campaigns():
    rng = np.random.default_rng(1)
    outcomes = [
        one_row(night(number, value) for number, value in enumerate(rng.normal(60.0, 3.0, 6), 1)).outcome
        for _ in range(400)
    ]
    assert 0.02 < outcomes.count(Outcome.PASS) / 400 < 0.08
    assert 0.02 < outcomes.count(Outcome.FAIL) / 400 < 0.08


def test_nights_of_unequal_availability_count_as_few_frames():
    alike = by_night(night(number, 0.99, name="availability", count=990) for number in range(1, 9))
    unlike = by_night(
        night(number, 0.99, name="availability", count=1000 if number % 2 else 980) for number in range(1, 9)
    )
    assert campaign_share(unlike, "onboard", AVAILABILITY).n_eff < 1000
    assert campaign_share(alike, "onboard", AVAILABILITY).n_eff == 8000


def test_the_worst_known_truth_of_the_nights_counts():
    row = one_row(night(number, 50.0 + number % 2, truth=truth) for number, truth in enumerate([0.1, 8.0, 0.1, 0.1], 1))
    assert row.uncertainty > 1.645 * 8.0


@pytest.mark.parametrize(("decisions", "outcome"), [(["simple", "guarded"], "INCONCLUSIVE"), (["simple"] * 2, "PASS")])
def test_nights_are_decided_simply_where_each_of_them_was(decisions, outcome):
    nights = [night(1, 58.0), night(2, 61.0)]
    for one, decision in zip(nights, decisions, strict=True):
        one.row["limit_decision"] = decision
    assert one_row(nights).outcome == outcome


def test_different_limits_are_not_decided():
    row = one_row([night(1, 1.0), night(2, 1.0, limit=30.0)])
    assert (row.outcome, "2 different limits" in row.reason) == (Outcome.INCONCLUSIVE, True)


def test_a_session_that_is_left_out_does_not_count():
    assert one_row([night(1, 1.0), night(2, 2.0), night(3, 500.0, left_out="no sky")]).nights == 2


def test_a_trend_is_significant_where_its_interval_leaves_zero_out():
    rng = np.random.default_rng(1)
    rising = trend("bias", "arcsec", {f"2026-03-{day:02d}": 0.3 * day + rng.normal(0, 0.2) for day in range(1, 29)})
    assert rising.significant
    assert rising.low < 9.0 < rising.high
    assert not trend("bias", "arcsec", {f"2026-03-{day:02d}": rng.normal(0, 0.2) for day in range(1, 29)}).significant


def test_hot_pixels_are_born_and_gone():
    old, new = {"x_px": 5, "y_px": 7, "frames": 9}, {"x_px": 8, "y_px": 2, "frames": 9}
    first, second = hot_pixels([("2026-03-01", [old]), ("2026-03-02", [old, new]), ("2026-03-03", [new])])
    assert (first.x_px, first.born, first.gone, first.nights) == (5, False, True, 2)
    assert (second.x_px, second.born, second.gone, second.first_night) == (8, True, False, "2026-03-02")


def test_every_column_that_the_report_reads_is_in_the_table_of_sessions():
    assert set(COLUMNS) - {COLUMN.name} <= set(sessions_schema().names)


@pytest.mark.parametrize(
    ("verdict", "outcome", "counts"),
    [
        ("INCONCLUSIVE", "PASS", False),
        ("INCONCLUSIVE", "INCONCLUSIVE", True),
        ("PASS", "PASS", True),
        ("FAIL", "FAIL", True),
    ],
)
def test_a_session_that_is_doubted_as_a_whole_is_left_out_and_a_short_one_is_not(verdict, outcome, counts):
    row = night(1, 1.0).row | {"error": None, "exclusions": [], "verdict": verdict, "reasons": ["the clock stepped"]}
    row |= {"onboard_d_de_n": 1000, "sensor_d_de_n": None}
    row["measurements"] = [{**row["measurements"][0], "outcome": outcome}]
    reasons = list(_reasons(row))
    assert (not reasons) == counts
    assert counts or "the clock stepped" in reasons[0]


@pytest.mark.parametrize(("no_sky", "no_objects", "other", "counts"), [(300, 200, 900, True), (300, 201, 0, False)])
def test_a_session_is_left_out_for_its_sky_where_that_was_away_in_more_than_half_of_it(
    no_sky, no_objects, other, counts
):
    frames = {Cause.NO_SKY: no_sky, Cause.NO_OBJECTS: no_objects, Cause.OPERATOR: other}
    row = night(1, 1.0).row | {
        "error": None,
        "verdict": "PASS",
        "reasons": [],
        "onboard_d_de_n": MIN_FRAMES,
        "sensor_d_de_n": 0,
    }
    row["exclusions"] = [{"cause": cause.value, "frames": of, "reason": "cloud"} for cause, of in frames.items()]
    assert list(_reasons(row)) == ([] if counts else ["no sky in 501 of 1000 panoramas: cloud"])


@pytest.mark.parametrize(
    ("value", "scatter", "text"),
    [
        (-0.153672, 0.411, "-0.15"),
        (4170.02, 0.324, "4170.02"),
        (-1.89, 64.7, "-2"),
        (100.0, 0.0, "100"),
        (None, 1.0, "–"),
    ],
)
def test_a_mean_is_given_to_the_second_digit_of_its_scatter(value, scatter, text):
    assert with_digits_of(value, scatter) == text


@pytest.mark.parametrize(
    ("sensors", "headline"),
    [
        ([("PASS", 9), ("INCONCLUSIVE", 1)], "PASS"),
        ([("PASS", 9), ("INCONCLUSIVE", 0)], "PASS"),
        ([("PASS", 9), ("INCONCLUSIVE", 2)], "INCONCLUSIVE"),
        ([("PASS", 9), ("FAIL", 1)], "FAIL"),
        ([("INCONCLUSIVE", 1)], "INCONCLUSIVE"),
    ],
)
def test_a_foreign_or_broken_session_does_not_turn_the_headline_of_a_campaign(sensors, headline) -> None:
    deciding = _deciding([{"verdict": verdict, "nights": nights} for verdict, nights in sensors])
    assert next(word for word in _WORST_FIRST if word in deciding) == headline
