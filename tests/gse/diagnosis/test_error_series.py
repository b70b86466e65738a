"""The errors of a session over time: what a long session keeps of them when neighbours are taken together."""

import numpy as np
import pytest

from gse.diagnosis.error_series import MOST_INSTANTS, ErrorSeries, often_answered


def series_of(count: int, errors_arcsec: np.ndarray, *, frame_s: float = 0.1) -> ErrorSeries:
    return ErrorSeries(np.arange(count), np.arange(count) * frame_s, errors_arcsec)


def test_a_short_session_is_left_as_it_is():
    series = series_of(MOST_INSTANTS, np.random.default_rng(1).normal(0, 5, (MOST_INSTANTS, 3)))
    shortened = series.shortened()
    np.testing.assert_array_equal(shortened.errors_arcsec, series.errors_arcsec)
    np.testing.assert_array_equal(shortened.rows, series.rows)


@pytest.mark.parametrize("count", [MOST_INSTANTS + 1, 3 * MOST_INSTANTS, 100_003])
def test_a_long_session_keeps_its_mean_its_drift_and_the_time_of_a_step(count):
    time_s = np.arange(count) * 0.1
    step_s = float(time_s[count // 3])
    errors = np.column_stack([np.full(count, 7.0), 0.01 * time_s, 20.0 * (time_s >= step_s)])
    shortened = series_of(count, errors).shortened()
    assert len(shortened.rows) == MOST_INSTANTS
    steps = np.diff(shortened.rows)
    assert shortened.rows[0] == 0
    assert 0 <= steps.max() - steps.min() <= 1
    np.testing.assert_allclose(shortened.errors_arcsec[:, 0], 7.0)
    np.testing.assert_allclose(shortened.errors_arcsec[:, 1], 0.01 * shortened.time_s)
    within_s = shortened.time_s[np.flatnonzero(shortened.errors_arcsec[:, 2] > 10)[0]]
    assert abs(within_s - step_s) <= 2 * count / MOST_INSTANTS * 0.1
    assert shortened.duration_s == pytest.approx(time_s[-1], rel=2 / MOST_INSTANTS * count / MOST_INSTANTS + 1e-4)


def test_a_slow_cause_stands_out_of_the_noise_as_before():
    count = 5 * MOST_INSTANTS
    rng = np.random.default_rng(2)
    slow = 3.0 * np.cos(np.pi * 4 * (np.arange(count) + 0.5) / count)
    series = series_of(count, np.column_stack([slow, slow, slow]) + rng.normal(0, 10, (count, 3)))
    for one in (series, series.shortened()):
        cosines = one.cosines(one.errors_arcsec)
        noise = cosines[64:].std(axis=0)
        np.testing.assert_allclose(cosines[3] / noise, 3.0 / 10 * np.sqrt(count / 2), rtol=0.25)


def test_frames_that_are_answered_now_and_then_are_left_out_after_a_stretch_of_answers():
    used = np.concatenate([np.ones(200, dtype=bool), np.arange(100) % 5 == 0])
    kept = often_answered(used)
    assert kept[:190].all()
    assert not kept[215:].any()


@pytest.mark.parametrize("used", [np.arange(300) % 5 == 0, np.zeros(0, dtype=bool), np.ones(8, dtype=bool)])
def test_a_session_that_is_answered_now_and_then_throughout_keeps_what_it_has(used):
    assert often_answered(used).tolist() == used.tolist()


def test_weights_against_cosines_are_their_transpose():
    rng = np.random.default_rng(5)
    series = series_of(700, rng.normal(0, 5, (700, 3)))
    ordinates = rng.normal(0, 1, (series.ordinates, 2))
    expected = np.einsum("kp,ka->pa", ordinates, series.cosines(series.errors_arcsec))
    weights = series.against_cosines(ordinates)
    assert np.einsum("mp,ma->pa", weights, series.errors_arcsec) == pytest.approx(expected, abs=1e-9)
