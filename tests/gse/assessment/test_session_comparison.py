"""Two nights side by side, and the gate that their differences make."""

import numpy as np
import pytest
from skies.known_nights import night, unanswered

from gse.assessment.session_comparison import side_by_side
from gse.station.results import Judge


def worse(first, second, **options):
    return [row.name for row in side_by_side(first, second, **options).regressions]


def test_a_night_is_not_worse_than_itself():
    result = side_by_side(night(600), night(600))
    assert result.paired
    assert result.regressions == ()
    assert all(row.difference == 0 for row in result.rows)


def test_two_nights_of_the_same_sensor_do_not_differ():
    second = night(3000, seed=2)
    second.frames.columns["time_us"][:] += 10**12
    result = side_by_side(night(3000), second)
    assert not result.paired
    assert result.regressions == ()
    assert max(abs(row.sigmas) for row in result.rows if np.isfinite(row.sigmas)) < 3


def test_two_nights_with_the_same_numbers_and_time_tags_are_not_the_same_panoramas():
    second = night(600, seed=2)
    second.frames.columns["utc_ns"][:] += 86_400 * 10**9
    assert not side_by_side(night(600), second).paired


def test_more_noise_is_a_regression_in_noise_and_mean_error_one_way_only():
    first, second = night(3000, noise=5.0), night(3000, noise=7.0, seed=2)
    assert worse(first, second) == ["mean |dRA*|", "NEA dRA*", "mean |dDE|", "NEA dDE"]
    assert worse(second, first) == []


def test_a_small_loss_shows_where_the_panoramas_are_the_same():
    first, second = night(3000, noise=5.0), night(3000, noise=5.3)
    result = side_by_side(first, second, allowed_share=0.001)
    assert result.paired
    assert "mean |dDE|" in [row.name for row in result.regressions]


def test_a_loss_that_is_allowed_is_no_regression():
    first, second = night(3000, noise=5.0), night(3000, noise=5.3)
    assert worse(first, second, allowed_share=0.05) == []


def test_missed_frames_are_a_regression_in_availability():
    first, second = night(1000), night(950)
    for number in range(50):
        second.frames.append(unanswered(10_000 + number))
    first.frames.append(unanswered(20_000))
    assert worse(first, second) == ["availability"]
    assert worse(second, first) == []


def test_false_answers_are_a_regression_once_they_are_significant():
    first, second = night(1000), night(1000)
    second.frames.columns["judge"][:20] = list(Judge).index(Judge.FALSE)
    assert "false answers" in worse(first, second)


def test_nights_without_answers_compare_without_complaint():
    first, second = night(0), night(50)
    result = side_by_side(first, second)
    assert not any(row.worse for row in result.rows)


@pytest.mark.parametrize("sigmas", [2.0, 100.0])
def test_the_significance_that_counts_is_asked_for(sigmas):
    first, second = night(3000, noise=5.0), night(3000, noise=7.0, seed=2)
    assert bool(worse(first, second, sigmas=sigmas)) == (sigmas < 50)
