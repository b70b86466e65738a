"""Two nights side by side, and the gate that their differences make."""

import functools
import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.stats
from skies.known_nights import START_NS, frame, session, unanswered
from skies.one_by_one import add_frame, add_frames
from skies.own_answers import with_answers, without_error

from gse.diagnosis.field_content import SeenStars, share_error
from gse.station.results import AnswerCheck, AttitudeError, Subject
from gse.statistics.decision import share_of
from gse.statistics.metrics import metrics
from gse.statistics.session_statistics import statistics
from gse.values.axis import D_DE
from gse.values.instant import NS_PER_S
from gse.values.limits import Limits
from gse.values.star_influence import attitude_operators
from gse.verdict.compared_rows import (
    ComparedRow,
    SideBySide,
    _more_often,
    _paired_change,
    false_answers,
    good_answers,
    slow_answers,
)
from gse.verdict.session_comparison import SessionComparison, _judged, _pairs, _time, session_comparison

night = functools.cache(session)
"""One that no test changes."""


def worse(first, second, **options):
    return [row.name for row in session_comparison(first, second, **options).regressions]


def test_a_night_is_not_worse_than_itself():
    result = session_comparison(night(600), night(600))
    assert result.paired
    assert result.regressions == ()
    assert all(row.difference == 0 for row in result.rows)


def test_panoramas_are_compared_with_themselves_though_one_session_begins_later():
    """Errors that grow: a panorama beside another one would differ."""
    first, second = session(0), session(0)
    for made, begin in ((first, 0), (second, 40)):
        errors = {number: AttitudeError(number, -number, 0.0, number, number) for number in range(begin, 140)}
        results = [frame(START_NS + number * NS_PER_S, number, error) for number, error in errors.items()]
        add_frames(made.frames, results)
    means = [row for row in session_comparison(first, second).rows if row.name.startswith("mean |d")]
    assert len(means) >= 2
    assert all(row.difference == 0 for row in means)


def test_two_nights_of_the_same_sensor_do_not_differ():
    second = session(3000, seed=2)
    second.frames.columns["time_us"][:] += 10**12
    result = session_comparison(night(3000), second)
    assert not result.paired
    assert result.regressions == ()
    assert max(abs(row.sigmas) for row in result.rows if np.isfinite(row.sigmas)) < 3


def test_two_nights_with_the_same_numbers_and_time_tags_are_not_the_same_panoramas():
    second = session(600, seed=2)
    second.frames.columns["utc_ns"][:] += 86_400 * 10**9
    assert not session_comparison(session(600), second).paired


def test_more_noise_is_a_regression_in_noise_and_mean_error_one_way_only():
    first, second = night(3000), night(3000, noise=7.0, seed=2)
    assert worse(first, second) == ["mean |dRA*|", "NEA dRA*", "mean |dDE|", "NEA dDE"]
    assert worse(second, first) == []


def test_a_small_loss_shows_where_the_panoramas_are_the_same():
    first, second = night(3000), night(3000, noise=5.3)
    result = session_comparison(first, second, allowed_share=0.001)
    assert result.paired
    assert "mean |dDE|" in [row.name for row in result.regressions]


def test_the_metrics_of_both_nights_stand_side_by_side_and_are_not_judged():
    second = session(3000, noise=7.0, seed=2)
    second.frames.columns["time_us"][:] += 10**12
    result = session_comparison(night(3000), second)
    noise = next(row for row in result.metrics if row.name == "onboard noise equivalent angle, x")
    assert (noise.first, noise.second) == pytest.approx((5.0, 7.0), rel=0.05)
    assert noise.sigmas > 5
    assert not any(row.worse or row.gate for row in result.metrics)
    assert all(np.isfinite([row.first, row.second]).all() for row in result.metrics)
    assert {"onboard bias, roll", "onboard time to first fix, median"} <= {row.name for row in result.metrics}


def test_a_metric_that_one_of_the_nights_lacks_is_not_shown():
    long, short = night(3000), night(20, seed=2)
    names = [{row.name for row in session_comparison(*pair).metrics} for pair in ((long, short), (short, long))]
    assert names[0] == names[1]
    assert "onboard low-frequency error, x" not in names[0]


def test_a_loss_that_is_allowed_is_no_regression():
    first, second = night(3000), night(3000, noise=5.3)
    assert worse(first, second, allowed_share=0.05) == []


def test_missed_frames_are_a_regression_in_availability():
    first, second = session(1000), session(950)
    for number in range(50):
        add_frame(second.frames, unanswered(10_000 + number))
    add_frame(first.frames, unanswered(20_000))
    assert worse(first, second) == ["availability"]
    assert worse(second, first) == []


def test_false_answers_are_a_regression_once_they_are_significant():
    first, second = session(1000), session(1000)
    second.frames.columns["answer_check"][:20] = list(AnswerCheck).index(AnswerCheck.FALSE)
    assert "false answers" in worse(first, second)


def test_nights_without_answers_compare_without_complaint():
    first, second = session(0), session(50)
    result = session_comparison(first, second)
    assert not any(row.worse for row in result.rows)


def test_three_sigmas_are_asked_for_where_nothing_is_said():
    pair = night(1000), night(1000, noise=5.28, seed=2)
    rows = session_comparison(*pair, allowed_share=1e-4).rows
    assert 2.5 < max(row.sigmas for row in rows if np.isfinite(row.sigmas)) < 3
    assert not any(row.worse for row in rows)
    assert worse(*pair, allowed_share=1e-4, sigmas=2.0)


@pytest.mark.parametrize("sigmas", [2.0, 100.0])
def test_the_significance_that_counts_is_asked_for(sigmas):
    first, second = night(3000), night(3000, noise=7.0, seed=2)
    assert bool(worse(first, second, sigmas=sigmas)) == (sigmas < 50)


def test_a_bias_that_changed_is_a_regression_where_that_is_asked_for():
    first, second = night(3000), night(3000, bias=(0.0, -3.0, 0.0), seed=2)
    assert "bias dDE" not in worse(first, second)
    assert "bias dDE" in worse(first, second, bias_is_regression=True)
    assert "bias dDE" in worse(second, first, bias_is_regression=True)


def test_the_loss_that_is_allowed_stands_in_each_row():
    rows = {row.name: row for row in session_comparison(session(100), session(100)).rows}
    assert rows["NEA dDE"].allowed == pytest.approx(0.6)


def starry(stars, *, seed, per_star=20.0, count=600):
    """A session whose frames' errors are those that the noise of so many stars gives, anywhere on the detector."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, 1023, (stars, 2)).tolist()
    made, results = session(0), []
    for number in range(count):
        errors = rng.normal(0, per_star, (stars, 2))
        right, down = -errors.mean(axis=0)
        left = (errors - errors.mean(axis=0)).tolist()
        matches = [(*place, *error) for place, error in zip(xy, left, strict=True)]
        error = AttitudeError(-right, -down, 0.0, right, down)
        results.append(frame(START_NS + number * NS_PER_S, number + 10_000 * seed, error, matches=matches))
    add_frames(made.frames, results)
    return made


def test_a_field_of_fewer_stars_is_no_regression():
    result = session_comparison(starry(28, seed=1), starry(9, seed=2))
    noise = next(row for row in result.rows if row.name == "NEA dDE")
    assert noise.second > 1.5 * noise.first
    assert noise.alike == pytest.approx(noise.first, rel=0.15)
    assert abs(noise.sigmas) < 3
    assert result.regressions == ()


def test_a_star_noise_that_grew_is_a_regression_under_other_stars_too():
    assert "NEA dDE" in worse(starry(28, seed=1), starry(28, seed=2, per_star=28.0))


def test_the_scatter_of_white_noise_is_found_in_the_residuals_of_few_stars():
    random, frames, stars = np.random.default_rng(6), 400, 5
    directions = np.tile(random.normal([0, 0, 1], 0.07, (stars, 3)), (frames, 1))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    seen = SeenStars(directions, np.tile(np.arange(stars), frames), np.repeat(np.arange(frames), stars))
    operators = attitude_operators(directions, seen.frames)
    errors = random.normal(0, 5, (len(directions), 2))
    solve = np.hstack(list(operators[:stars]))  # the pseudo-inverse of what a turn does to the stars
    fitted = errors.reshape(frames, -1) @ solve.T @ np.linalg.pinv(solve).T
    share = share_error(operators[:, 0], errors - fitted.reshape(-1, 2), seen)
    assert share == pytest.approx(1 / np.sqrt(2 * frames), rel=0.25)


def test_equal_sensors_under_other_stars_differ_by_one_sigma():
    sessions = [starry(20, seed=seed, count=200) for seed in range(1, 7)]
    rows = [row for one, two in itertools.combinations(sessions, 2) for row in session_comparison(one, two).rows]
    sigmas = np.array([row.sigmas for row in rows if row.name.startswith("NEA")])
    assert 0.6 < np.sqrt((sigmas**2).mean()) < 1.4


@functools.cache
def sensor_night(*, off_deg=0.0, lost=0, slow=0, seed=1):
    """A night whose sensor answers with noise of 3 arcsec, ``off_deg`` north; some answers lost, some slow."""
    made = night(600)
    angles = without_error(made, whole_field=True)
    angles[:, 1] += off_deg + np.random.default_rng(seed).normal(0, 3 / 3600, len(angles))
    angles[:lost] = np.nan
    made = with_answers(made, angles, np.full(len(angles), 9))
    made.sensor_attitudes.columns["latency_ms"][:slow] = 350.0
    return made


@pytest.mark.parametrize(
    ("second", "found"),
    [
        ({}, []),
        ({"seed": 2}, []),
        ({"off_deg": 120 / 3600}, ["sensor mean |dDE|"]),
        ({"lost": 60}, ["sensor availability"]),
        ({"slow": 60}, ["sensor slow answers"]),
    ],
)
def test_a_sensor_whose_own_answers_are_worse_is_a_regression_one_way_only(second, found):
    assert worse(sensor_night(), sensor_night(**second)) == found
    assert worse(sensor_night(**second), sensor_night()) == []


def test_own_answers_that_are_the_same_in_both_are_not_compared():
    names = [row.name for row in session_comparison(sensor_night(), sensor_night()).rows]
    assert names[0] == "mean |dRA*|"
    assert not any(name.startswith("sensor") for name in names)


def test_own_answers_of_another_night_are_compared():
    second = sensor_night.__wrapped__(off_deg=120 / 3600, seed=2)
    second.frames = session(600, seed=3).frames
    second.frames.columns["time_us"][:] += 10**12
    second.sensor_attitudes.columns["time_us"][:] += 10**12
    result = session_comparison(sensor_night(), second)
    assert not result.paired
    assert [row.name for row in result.regressions] == ["sensor mean |dDE|"]


def test_own_answers_in_hours_instead_of_degrees_are_not_called_worse():
    second = sensor_night.__wrapped__(seed=2)
    second.sensor_attitudes.columns["ra_deg"][:] /= 15
    result = session_comparison(sensor_night(), second)
    rows = {row.name: row for row in result.rows}
    assert np.isnan(rows["sensor mean |dRA*|"].second)
    assert result.regressions == ()


def test_slow_answers_of_a_sensor_that_sends_no_panoramas_are_a_regression():
    first, second = session(600), session(600)
    first.subject = second.subject = Subject.SENSOR
    second.frames.columns["elapsed_us"][:60] = 350_000.0
    assert worse(first, second) == ["slow answers"]
    assert worse(second, first) == []


def answered(made, seed):
    """The night with a sensor that answers with noise of 3 arcsec, whatever its stars."""
    angles = without_error(made, whole_field=True)
    angles[:, 1] += np.random.default_rng(seed).normal(0, 3 / 3600, len(angles))
    return with_answers(made, angles, np.full(len(angles), 9))


def test_a_richer_field_does_not_blame_the_sensor_and_a_poorer_one_excuses_it():
    few, many = answered(starry(9, seed=1), 1), answered(starry(28, seed=2), 2)
    for first, second in ((few, many), (many, few)):
        result = session_comparison(first, second)
        noise = next(row for row in result.rows if row.name == "sensor NEA dDE")
        assert noise.alike == (noise.second if second is many else pytest.approx(noise.second * 0.57, rel=0.25))
        assert result.regressions == ()


@pytest.mark.parametrize(
    ("side", "difference", "sigmas", "gate", "is_worse"),
    [
        ({}, 1.0, 3.1, True, True),
        ({}, 1.0, 3.0, True, False),
        ({}, 0.6, 9.0, True, False),
        ({}, 0.7, 9.0, True, True),
        ({}, -1.0, -9.0, True, False),
        ({}, 1.0, math.nan, True, False),
        ({}, 1.0, 9.0, False, False),
        ({"at_least": True}, -1.0, 9.0, True, True),
        ({"at_least": True}, 1.0, 9.0, True, False),
        ({"either_way": True}, -1.0, -3.1, True, True),
        ({"either_way": True}, -1.0, -3.0, True, False),
        ({"either_way": True}, -0.6, -9.0, True, False),
        ({"either_way": True}, 1.0, 9.0, True, True),
        ({"either_way": True}, 1.0, 9.0, False, False),
    ],
)
def test_a_value_is_worse_beyond_the_sigmas_and_beyond_what_is_allowed(side, difference, sigmas, gate, is_worse):
    row = ComparedRow("a row", "", 0.0, difference, difference, difference, sigmas, 0.6, gate=gate, **side)
    assert _judged(row, 3.0).worse is is_worse


def happened(*rows):
    return np.isin(np.arange(100), rows)


@pytest.mark.parametrize(
    ("first", "second", "p", "sign"),
    [
        ((), (), 0.5, 1),
        ((1, 2), (1, 2), 0.5, 1),
        ((1,), (1, 2, 3, 4, 5), 0.5**4, 1),
        ((1, 2, 3, 4, 5), (1,), 0.5**4, -1),
        ((1,), (2,), 0.5, 1),
        ((1,), (2, 3, 4), 5 / 16, 1),
    ],
)
def test_pairs_of_frames_that_differ_are_heads_and_tails(first, second, p, sign):
    """McNemar's exact test: of those in which one of both happened, how many."""
    every = np.arange(100)
    found = _more_often([happened(*first), happened(*second)], (every, every), (0, 100), (0, 100))
    assert found == pytest.approx(sign * scipy.stats.norm.isf(p))


def test_each_frame_is_compared_with_its_own_pair():
    """The first frame of the one is the last of the other: one pair happened in both, three in the second alone."""
    every, both = np.arange(100), [happened(0), happened(96, 97, 98, 99)]
    for pairs in ((every, every[::-1]), (every[::-1], every)):
        assert _more_often(both, pairs, (0, 100), (0, 100)) == pytest.approx(scipy.stats.norm.isf(0.5**3))
    assert _more_often(both[::-1], (every, every[::-1]), (0, 100), (0, 100)) == pytest.approx(
        -scipy.stats.norm.isf(0.5**3)
    )


@pytest.mark.parametrize(("first", "second", "sign"), [((1, 50), (9, 60), 1), ((9, 60), (1, 50), -1)])
def test_what_has_no_pair_is_compared_by_fishers_test(first, second, sign):
    """The hypergeometric tail of nine or more among ten."""
    p = scipy.stats.hypergeom(110, 10, 60).sf(8)
    assert _more_often([], None, first, second) == pytest.approx(sign * scipy.stats.norm.isf(p))


def test_equal_shares_do_not_differ_and_nothing_compares_with_nothing():
    assert _more_often([], None, (5, 100), (5, 100)) == 0.0
    assert math.isnan(_more_often([], None, (0, 0), (5, 100)))
    assert math.isnan(_more_often([], None, (5, 100), (0, 0)))


# Parts, by hand


def frames_of(numbers, *, off_ns=0, tag_off=0):
    """Rows of frames with these numbers, one a second."""
    numbers = np.array(numbers, dtype=np.int64)
    found = np.zeros(len(numbers), dtype=[("time_us", np.int64), ("frame_no", np.int64), ("utc_ns", np.int64)])
    found["time_us"], found["frame_no"] = numbers * 10**6, numbers + tag_off
    found["utc_ns"] = START_NS + numbers * NS_PER_S + off_ns
    return found


@pytest.mark.parametrize(
    ("first", "second", "rows"),
    [
        (range(10), range(10), (range(10), range(10))),
        (range(10), range(1, 11), (range(1, 10), range(9))),  # nine of ten
        (range(10), range(2, 12), None),  # eight
        (range(10), range(1, 101), (range(1, 10), range(9))),  # nine of the shorter one's ten
        (range(1, 101), range(10), (range(9), range(1, 10))),
        (range(10), range(20, 30), None),
        ([], range(10), None),
        ([], [], None),
    ],
)
def test_sessions_are_paired_where_nine_tenths_of_the_shorter_are_in_both(first, second, rows):
    found = _pairs(frames_of(first), frames_of(second))
    assert (found is None) is (rows is None)
    if rows is not None:
        assert [part.tolist() for part in found] == [list(part) for part in rows]


@pytest.mark.parametrize(("off_ns", "is_same"), [(0, True), (999_999_999, True), (NS_PER_S, False)])
def test_panoramas_are_the_same_within_a_second_either_way(off_ns, is_same):
    plain, moved = frames_of(range(10)), frames_of(range(10), off_ns=off_ns)
    assert (_pairs(plain, moved) is not None) is is_same
    assert (_pairs(moved, plain) is not None) is is_same


def test_panoramas_of_other_numbers_are_not_the_same():
    assert _pairs(frames_of(range(10)), frames_of(range(10), tag_off=1)) is None


def compared(one, two, pairs):
    return SideBySide((one, two), pairs, Limits(), 0.25, bias_is_regression=False)


def subject_of(errors, good):
    return SimpleNamespace(errors={"d_de_arcsec": np.array(errors)}, good=np.array(good))


def test_the_change_of_each_panorama_counts_where_both_answered_well():
    """Sizes grow by 1, 3 and 5: by 3 in the mean, with a scatter of 2."""
    one = subject_of([9.0, -1.0, 2.0, 3.0, 4.0], [True, True, True, True, False])
    two = subject_of([2.0, -5.0, 8.0, 1.0, 7.0], [True, True, True, True, True])
    pairs = np.array([1, 2, 3, 4]), np.array([0, 1, 2, 3])
    change = _paired_change(D_DE, compared(one, two, pairs))
    assert change.mean == pytest.approx(3.0)
    assert change.error == pytest.approx(2 / math.sqrt(3))
    assert _paired_change(D_DE, compared(one, two, None)) is None
    for good in ((True, False), (False, True)):
        once = [subject_of([1.0], [was_good]) for was_good in good]
        assert _paired_change(D_DE, compared(*once, (pairs[1][:1],) * 2)) is None


def counted(available, false, slow, p99):
    """A subject of 100 frames with so many answers, false and slow ones."""
    statistics = SimpleNamespace(
        available=share_of(available, 100),
        false_answers=share_of(false, 100),
        slow=share_of(slow, 100),
        time_ms=SimpleNamespace(p99=p99),
        time_is_stated=True,
    )
    rows = np.arange(100)
    return SimpleNamespace(statistics=statistics, missed=rows >= available, false=rows < false, slow=rows < slow)


BOTH = counted(99, 1, 2, 40.0), counted(90, 3, 9, 70.0)


@pytest.mark.parametrize("paired", [False, True])
@pytest.mark.parametrize(
    ("row_of", "values", "counts", "more"),
    [
        (good_answers, (0.99, 0.9, -0.09, 0.25), (1, 10), 9),
        (false_answers, (1, 3, 2, 0.0), (1, 3), 2),
        (slow_answers, (2, 9, 7, 0.0), (2, 9), 7),
    ],
    ids=["availability", "false", "slow"],
)
def test_what_happens_more_often_is_compared_with_how_often_it_happened(row_of, values, counts, more, paired):
    """Paired, all that are more are heads of a coin."""
    (row,) = row_of(compared(*BOTH, (np.arange(100), np.arange(100)) if paired else None))
    p = 0.5**more if paired else scipy.stats.hypergeom(200, sum(counts), 100).sf(counts[1] - 1)
    first, second, difference, allowed = values
    assert (row.first, row.second, row.alike) == (first, second, second)
    assert (row.difference, row.allowed) == pytest.approx((difference, allowed))
    assert row.sigmas == pytest.approx(scipy.stats.norm.isf(p))
    assert row.gate


def test_pairs_that_leave_frames_out_are_compared_as_different_ones():
    (row,) = slow_answers(compared(*BOTH, (np.arange(99), np.arange(99))))
    assert row.sigmas == pytest.approx(scipy.stats.norm.isf(scipy.stats.hypergeom(200, 11, 100).sf(8)))


def test_times_of_hosts_are_shown_and_never_judged():
    row = _time(BOTH)
    assert (row.first, row.second, row.alike, row.difference, row.unit) == (40.0, 70.0, 70.0, 30.0, "ms")
    assert (row.allowed, row.gate) == (math.inf, False)
    assert math.isnan(row.sigmas)


@pytest.mark.parametrize(
    ("rows", "is_open"),
    [
        ([(math.nan, True), (math.nan, True)], True),
        ([(math.nan, True), (0.0, True)], False),
        ([(math.nan, True), (5.0, False)], True),
        ([], True),
    ],
)
def test_a_comparison_is_open_where_no_judged_row_has_a_difference(rows, is_open):
    made = [ComparedRow("name", "", 0.0, 0.0, 0.0, 0.0, sigmas, 0.0, gate=gate) for sigmas, gate in rows]
    assert SessionComparison(tuple(made), False, ()).is_open is is_open


def test_metrics_differ_by_the_sigmas_of_both_intervals_where_the_panoramas_are_others():
    second = session(3000, noise=7.0, seed=2)
    second.frames.columns["time_us"][:] += 10**12
    pairs = [[(one.name, one.axis, one) for one in metrics(statistics(made))] for made in (night(3000), second)]
    one, two = ({(name, axis): metric for name, axis, metric in made} for made in pairs)
    rows = {row.name: row for row in session_comparison(night(3000), second).metrics}
    for name, axis, text in (("bias", "cross_y", "onboard bias, y"), ("drift", "d_roll", "onboard drift, roll")):
        a, b = one[name, axis], two[name, axis]
        if math.isnan(a.value) or math.isnan(b.value):
            assert text not in rows
            continue
        error = math.hypot(a.high - a.low, b.high - b.low) / 2 / 1.96
        assert (rows[text].first, rows[text].second, rows[text].alike) == (a.value, b.value, b.value)
        assert rows[text].difference == b.value - a.value
        assert rows[text].sigmas == pytest.approx((b.value - a.value) / error)
        assert rows[text].allowed == math.inf


def test_metrics_of_the_same_panoramas_have_no_sigmas():
    rows = session_comparison(night(600), night(600)).metrics
    assert rows
    assert all(math.isnan(row.sigmas) or row.difference == 0.0 for row in rows)
