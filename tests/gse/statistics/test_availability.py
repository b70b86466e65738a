"""Exposures that never came, and what absences say of the share: by hand, against scipy, and by simulation."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats as scipy_stats

from gse.station.columns import FRAME
from gse.statistics.availability import Outages, available_share, never_sent


def frames(numbers, *, step_us=100_000):
    made = np.zeros(len(numbers), dtype=FRAME)
    made["frame_no"] = numbers
    made["time_us"] = np.asarray(numbers, dtype=np.int64) * step_us
    return made


# What never came


def test_every_third_exposure_that_is_never_sent_is_missing():
    numbers = [number for number in range(900) if number % 3]
    assert never_sent(frames(numbers)).sum() == 299


@pytest.mark.parametrize("step", [1, 2, 3, 7])
def test_a_constant_step_is_the_output_rate_and_an_irregular_one_a_missing_frame(step):
    numbers = step * np.arange(100)
    assert never_sent(frames(numbers)).sum() == 0
    few = np.delete(numbers, [30, 50, 51])
    assert np.flatnonzero(never_sent(frames(few))).tolist() == [30, 49]
    assert never_sent(frames(few))[[30, 49]].tolist() == [1, 2]


def test_a_rate_that_start_changes_is_the_rate_from_then_on():
    numbers = np.concatenate([np.arange(200), 200 + 5 * np.arange(200)])
    assert never_sent(frames(numbers)).sum() <= 4
    assert never_sent(frames(np.delete(numbers, 300)))[300] == 1


@pytest.mark.parametrize(
    "numbers", [np.zeros(100), np.arange(100) % 30, np.full(100, 7), np.arange(15) * 2 + (np.arange(15) > 7), [], [3]]
)
def test_numbers_that_say_nothing_miss_nothing(numbers):
    assert never_sent(frames(np.asarray(numbers, dtype=np.int64))).sum() == 0


def test_frames_that_came_while_the_number_stood_still_are_not_missing_when_it_goes_on():
    numbers = np.concatenate([np.full(64, 5), np.arange(70, 200)])
    assert never_sent(frames(numbers)).sum() == 1
    assert never_sent(frames(np.delete(numbers, np.s_[10:20]))).sum() == 11


def test_a_frame_that_comes_late_is_not_missing():
    numbers = np.arange(200)
    numbers[[43, 44]] = [44, 43]
    assert never_sent(frames(numbers)).sum() == 0
    numbers = np.delete(numbers, 120)
    assert np.flatnonzero(never_sent(frames(numbers))).tolist() == [120]


def test_a_sensor_that_starts_anew_misses_what_is_missing_in_each_life():
    numbers = np.concatenate([np.arange(100), np.delete(np.arange(100), 50)])
    assert np.flatnonzero(never_sent(frames(numbers))).tolist() == [150]


def test_a_number_that_leaps_while_the_time_does_not_misses_nothing():
    made = frames(np.arange(100) + 1000 * (np.arange(100) >= 50))
    made["time_us"] = np.arange(100) * 100_000
    assert never_sent(made).sum() == 0


# What absences say


def absences(*runs, of):
    """Good answers, with runs of absences that lie far from each other."""
    good = np.ones(of, dtype=bool)
    for first, length in zip(np.linspace(0, of, len(runs), endpoint=False).astype(int), runs, strict=True):
        good[first : first + length] = False
    return good


@pytest.mark.parametrize(("absent", "of"), [(0, 30), (0, 20_000), (30, 30), (1, 600), (12, 600)])
def test_single_absences_have_the_bounds_of_clopper_and_pearson(absent, of):
    share, outages = available_share(absences(*[1] * absent, of=of) if absent < of else np.zeros(of, dtype=bool))
    assert (share.count, share.of, outages) == (of - absent, of, Outages())
    interval = scipy_stats.binomtest(of - absent, of).proportion_ci(0.90, "exact")
    assert (share.lower, share.upper) == pytest.approx((interval.low, interval.high), abs=1e-9)
    assert share.n_eff == pytest.approx(of)


@pytest.mark.parametrize(("outages", "length"), [(1, 100), (3, 40), (8, 500)])
def test_outages_are_events_of_poisson(outages, length):
    """An outage of 100 s in three hours at 1 Hz is at most 4.74 of them: 4.4 %."""
    share, found = available_share(absences(*[length] * outages, of=10_800))
    assert found == Outages(outages, length, length, outages * length)
    most = scipy_stats.chi2.ppf(0.95, 2 * (outages + 1)) / 2
    least = scipy_stats.chi2.ppf(0.05, 2 * outages) / 2
    other = 1 - 0.05 ** (1 / 10_800)  # what no single absence leaves open
    assert 1 - share.lower == pytest.approx(most * length / 10_800 + other, rel=1e-6)
    assert 1 - share.upper == pytest.approx(least * length / 10_800, rel=1e-6)


def test_both_bounds_add():
    together, found = available_share(absences(*[1] * 50, 100, *[1] * 50, of=10_800))
    outage, _ = available_share(absences(100, of=10_800))
    single, _ = available_share(absences(*[1] * 100, of=10_800))
    no_more = 1 - 0.05 ** (1 / 10_800)
    assert found == Outages(1, 100, 100, 100)
    assert 1 - together.lower == pytest.approx(2 - outage.lower - single.lower - no_more, rel=1e-3)


def test_one_more_outage_is_taken_to_be_as_long_as_the_longest():
    """Two of 300 and three of 10: (630)^2 / (180,000 + 300) = 2.201 equal ones, with one of 300 that did not come."""
    share, found = available_share(absences(300, 10, 10, 10, of=10_800))
    assert found == Outages(4, 10, 300, 330)
    number = 630**2 / (2 * 300**2 + 3 * 10**2)
    most = scipy_stats.gamma.ppf(0.95, number) / number * 630 / 10_800
    assert 1 - share.lower == pytest.approx(most + 1 - 0.05 ** (1 / 10_800), rel=1e-6)


def test_runs_that_follow_each_other_closely_are_one():
    good = np.ones(10_800, dtype=bool)
    good[1000:1200] = False
    good[1000:1200:20] = True
    assert available_share(good)[1] == Outages(1, 190, 190, 190)


def test_frames_that_never_came_are_in_the_run_where_they_are_missing():
    good, missing = absences(50, 50, of=10_000), np.zeros(10_000, dtype=np.int64)
    missing[5050] = 25
    share, found = available_share(good, missing=missing)
    assert (share.count, share.of, found) == (9900, 10_025, Outages(2, 50, 75, 125))


def test_frames_that_were_lost_nobody_knows_when_leave_as_much_open_as_one_outage_or_as_each_alone():
    unknown, _ = available_share(np.ones(900, dtype=bool), unplaced=100)
    alone, _ = available_share(absences(*[1] * 100, of=1000))
    together, _ = available_share(absences(100, of=1000))
    assert (unknown.count, unknown.of) == (900, 1000)
    assert unknown.upper == pytest.approx(alone.upper)
    assert unknown.lower == pytest.approx(together.lower)
    assert alone.upper < together.upper
    assert together.lower < alone.lower


def test_nothing_has_no_share_and_what_never_came_is_absent():
    assert math.isnan(available_share(np.zeros(0, dtype=bool))[0].value)
    assert available_share(np.zeros(0, dtype=bool), unplaced=40)[0].upper == pytest.approx(1 - 0.05 ** (1 / 40))


@given(st.lists(st.booleans(), min_size=1, max_size=300))
def test_bounds_enclose_the_share_and_a_number_of_frames_gives_the_same_lower_one(good):
    share, _ = available_share(np.array(good))
    assert share.lower <= share.value <= share.upper
    assert 0 < share.n_eff <= share.of


@pytest.mark.parametrize(
    ("seconds", "share", "passes"),
    [((12,) * 20, 0.989, True), ((30,) * 4, 0.989, True), ((100,), 0.9537, True), ((240,), 0.989, False)],
)
def test_of_three_hours_at_two_hertz(seconds, share, passes):
    """98.9 % in spells of 12 or 30 s keep 95 %; one outage of four minutes is too few to tell."""
    found, _ = available_share(absences(*[2 * length for length in seconds], of=21_600))
    assert (found.lower >= 0.95) is passes


@pytest.mark.parametrize("hours", [1, 6])
def test_a_sixth_missing_in_every_minute_fails(hours):
    rng = np.random.default_rng(hours)
    assert available_share(rng.random(hours * 7200) < 0.84)[0].upper < 0.95


def in_spells(rng, n, absent, length):
    """Spells of absence of random length and distance, as a sensor that falls out and comes back."""
    good = np.ones(n, dtype=bool)
    places = np.cumsum(rng.geometric(absent / length / (1 - absent), 2 * n // length))
    lengths = rng.geometric(1 / length, len(places))
    for first, spell in zip(places + np.concatenate([[0], np.cumsum(lengths)[:-1]]), lengths, strict=True):
        good[first : first + spell] = False
    return good


@pytest.mark.parametrize(
    ("made", "n"),
    [
        (lambda rng, n: rng.random(n) >= 0.05, 3600),
        (lambda rng, n: in_spells(rng, n, 0.05, 4), 3600),
        (lambda rng, n: in_spells(rng, n, 0.05, 30), 20_000),
    ],
    ids=["independent", "spells of 4", "spells of 30"],
)
def test_a_sensor_at_its_limit_passes_in_one_of_twenty_sessions(made, n):
    """Of 300, with three standard deviations of that count."""
    rng = np.random.default_rng(7)
    passed = sum(available_share(made(rng, n))[0].lower >= 0.95 for _ in range(300))
    assert passed <= 15 + 3 * math.sqrt(15)


@pytest.mark.parametrize("number", [10, 30, 100])
def test_outages_of_very_different_lengths_pass_at_the_limit_as_seldom(number):
    """Lengths of a logarithmic standard deviation of 1: of 1000 sessions, with three standard deviations."""
    rng, n, passed = np.random.default_rng(8), 36_000, 0
    risk = 0.06 if number >= 30 else 0.1
    for _ in range(1000):
        lengths = np.rint(rng.lognormal(math.log(0.05 * n / number) - 0.5, 1.0, rng.poisson(number))).astype(int)
        good = np.ones(n, dtype=bool)
        for first, length in zip(rng.integers(0, n, len(lengths)).tolist(), lengths.tolist(), strict=True):
            good[first : first + length] = False
        passed += available_share(good)[0].lower >= 0.95
    assert passed <= 1000 * risk + 3 * math.sqrt(1000 * risk * (1 - risk))
