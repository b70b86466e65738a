"""Two nights side by side, and the gate that their differences make."""

import numpy as np
import pytest
from skies.known_nights import session, unanswered

from gse.assessment.session_comparison import session_comparison
from gse.station.results import AnswerCheck


def worse(first, second, **options):
    return [row.name for row in session_comparison(first, second, **options).regressions]


def test_a_night_is_not_worse_than_itself():
    result = session_comparison(session(600), session(600))
    assert result.paired
    assert result.regressions == ()
    assert all(row.difference == 0 for row in result.rows)


def test_two_nights_of_the_same_sensor_do_not_differ():
    second = session(3000, seed=2)
    second.frames.columns["time_us"][:] += 10**12
    result = session_comparison(session(3000), second)
    assert not result.paired
    assert result.regressions == ()
    assert max(abs(row.sigmas) for row in result.rows if np.isfinite(row.sigmas)) < 3


def test_two_nights_with_the_same_numbers_and_time_tags_are_not_the_same_panoramas():
    second = session(600, seed=2)
    second.frames.columns["utc_ns"][:] += 86_400 * 10**9
    assert not session_comparison(session(600), second).paired


def test_more_noise_is_a_regression_in_noise_and_mean_error_one_way_only():
    first, second = session(3000, noise=5.0), session(3000, noise=7.0, seed=2)
    assert worse(first, second) == ["mean |dRA*|", "NEA dRA*", "mean |dDE|", "NEA dDE"]
    assert worse(second, first) == []


def test_a_small_loss_shows_where_the_panoramas_are_the_same():
    first, second = session(3000, noise=5.0), session(3000, noise=5.3)
    result = session_comparison(first, second, allowed_share=0.001)
    assert result.paired
    assert "mean |dDE|" in [row.name for row in result.regressions]


def test_a_loss_that_is_allowed_is_no_regression():
    first, second = session(3000, noise=5.0), session(3000, noise=5.3)
    assert worse(first, second, allowed_share=0.05) == []


def test_missed_frames_are_a_regression_in_availability():
    first, second = session(1000), session(950)
    for number in range(50):
        second.frames.append(unanswered(10_000 + number))
    first.frames.append(unanswered(20_000))
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


@pytest.mark.parametrize("sigmas", [2.0, 100.0])
def test_the_significance_that_counts_is_asked_for(sigmas):
    first, second = session(3000, noise=5.0), session(3000, noise=7.0, seed=2)
    assert bool(worse(first, second, sigmas=sigmas)) == (sigmas < 50)
