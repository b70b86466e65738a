"""Statistics of one axis on series whose answer is known."""

import math

import numpy as np
import pytest

from gse.assessment.axis_statistics import WINDOW_S, axis_statistics
from gse.instant import NS_PER_S


def axis(error, step_s=0.1):
    return axis_statistics(np.arange(len(error)) * round(step_s * NS_PER_S), np.asarray(error, dtype=float))


def test_the_figures_of_four_errors_by_hand():
    figures = axis([1.0, -2.0, 3.0, -6.0], step_s=30.0)
    assert figures.bias_arcsec == -1.0
    assert figures.std_arcsec == pytest.approx(math.sqrt((4 + 1 + 16 + 25) / 3))  # of a sample: by one less than four
    assert figures.three_sigma_arcsec == pytest.approx(3 * math.sqrt(46 / 3))
    assert figures.rms_arcsec == pytest.approx(math.sqrt((1 + 4 + 9 + 36) / 4))
    assert (figures.mean_abs_arcsec, figures.max_abs_arcsec) == (3.0, 6.0)
    assert figures.p95_abs_arcsec == pytest.approx(3 + 3 * 0.85)  # the 2.85th of 0 to 3, between its neighbours


def test_white_noise_is_found_as_the_noise_equivalent_angle_both_ways():
    figures = axis(np.random.default_rng(2).normal(3.0, 5.0, 36_000))
    assert figures.nea_arcsec == pytest.approx(5.0, rel=0.02)
    assert figures.nea_successive_arcsec == pytest.approx(5.0, rel=0.02)
    assert figures.nea_low_arcsec < 5.0 < figures.nea_high_arcsec
    assert abs(figures.bias_arcsec - 3.0) < figures.bias_error_arcsec < 0.2
    assert figures.three_sigma_arcsec == pytest.approx(3 * figures.std_arcsec)
    assert figures.rms_arcsec == pytest.approx(math.hypot(3.0, 5.0), rel=0.02)
    assert figures.p95_abs_arcsec < figures.p99_abs_arcsec < figures.max_abs_arcsec


def test_a_slow_wave_is_low_frequency_error_and_no_noise():
    time_s = np.arange(36_000) * 0.1
    figures = axis(np.random.default_rng(3).normal(0, 2.0, 36_000) + 10 * np.sin(2 * np.pi * time_s / 600))
    assert figures.nea_arcsec == pytest.approx(2.0, rel=0.03)
    assert figures.low_frequency_arcsec == pytest.approx(10 / math.sqrt(2), rel=0.05)
    assert figures.std_arcsec == pytest.approx(math.hypot(2, 10 / math.sqrt(2)), rel=0.03)


@pytest.mark.parametrize(("windows", "is_known"), [(1.5, False), (2.0, False), (2.1, True)])
def test_low_frequency_error_needs_more_than_two_of_its_windows(windows, is_known):
    figures = axis(np.random.default_rng(3).normal(0, 2.0, round(windows * WINDOW_S) + 1), step_s=1.0)
    assert math.isfinite(figures.low_frequency_arcsec) == is_known


def test_a_drift_is_found_among_outliers():
    rng = np.random.default_rng(4)
    error = rng.normal(0, 3.0, 18_000) + 40.0 * np.arange(18_000) * 0.1 / 3600
    error[rng.random(18_000) < 0.01] += 500
    figures = axis(error)
    assert figures.drift_low_arcsec_per_h < 40.0 < figures.drift_high_arcsec_per_h
    assert figures.drift_high_arcsec_per_h - figures.drift_low_arcsec_per_h < 3


def test_gaps_do_not_enter_the_successive_differences():
    utc_ns = np.concatenate([np.arange(500), 10_000 + np.arange(500)]) * 100_000_000
    error = np.random.default_rng(5).normal(0, 1.0, 1000)
    error[500:] += 1000
    assert axis_statistics(utc_ns, error).nea_successive_arcsec == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_very_few_frames_give_no_figure_instead_of_a_wrong_one(count):
    figures = axis([1.0] * count)
    assert figures.n == count
    assert math.isnan(figures.drift_arcsec_per_h)


@pytest.mark.parametrize(
    ("count", "seconds", "words"),
    [
        (29, 60, "too few frames to tell (29, 30 are needed)"),
        (30, 60, ""),
        (30, 9.9, "too short to tell (9.9 s"),
        (30, 10, ""),
    ],
)
def test_a_session_says_what_it_lacks(count, seconds, words):
    utc_ns = np.linspace(0, seconds * 1e9, count).astype(np.int64)
    found = axis_statistics(utc_ns, np.random.default_rng(2).normal(0, 1, count)).too_short
    assert found.startswith(words)
    assert bool(found) == bool(words)
