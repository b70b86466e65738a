"""How long a session must be: what is expected of a sensor, against scipy's distributions."""

import numpy as np
import pytest
import scipy.stats

from gse.assessment.planning import Expected, _true_statistics, accuracy_frames, availability_frames, simulated_errors


@pytest.mark.parametrize(
    ("tau_s", "frames_per_s", "frames"), [(0.0, 10.0, 1.0), (0.05, 10.0, 1.0), (4.0, 10.0, 40.0), (40.0, 0.5, 20.0)]
)
def test_an_independent_value_takes_the_frames_of_its_correlation_time(tau_s, frames_per_s, frames):
    assert Expected(0.0, 1.0, tau_s, frames_per_s).frames_per_value == frames


@pytest.mark.parametrize(
    ("bias", "noise"), [(0.0, 5.0), (3.0, 5.0), (-3.0, 5.0), (20.0, 5.0), (1.0, 0.1), (7.0, 0.0), (-7.0, 0.0)]
)
def test_mean_and_95th_percentile_are_those_of_a_folded_normal_distribution(bias, noise):
    found = _true_statistics(Expected(bias, noise, 0.0, 1.0))
    folded = scipy.stats.foldnorm(abs(bias) / noise, scale=noise) if noise else None
    expected = (folded.mean(), folded.ppf(0.95)) if folded else (7.0, 7.0)
    assert found == pytest.approx(expected, rel=1e-9)


def test_the_same_minutes_decide_at_any_rate_of_frames_where_errors_hang_together():
    """Twenty seconds make a value, of 20 frames or of 100."""
    slow, fast = (accuracy_frames(Expected(0.0, 20.0, 20.0, hz), 60.0, truth_arcsec=0.0) for hz in (1.0, 5.0))
    assert fast == pytest.approx(5 * slow, abs=5)


@pytest.mark.parametrize(("bias", "truth", "can_pass"), [(59.9, 0.0, True), (60.0, 0.0, False), (50.0, 6.1, False)])
def test_what_truth_and_bias_leave_no_room_for_never_passes(bias, truth, can_pass):
    """1.645 times 6.1 arcsec are 10.03."""
    found = accuracy_frames(Expected(bias, 0.0, 0.0, 1.0), 60.0, truth_arcsec=truth)
    assert (found is not None) is can_pass


@pytest.mark.parametrize("tau_s", [0.0, 10.0])
def test_errors_are_made_with_their_bias_scatter_and_correlation(tau_s):
    made = simulated_errors(Expected(-2.0, 3.0, tau_s, 1.0), 4000, 50, np.random.default_rng(5))
    assert made.shape == (50, 4000)
    assert made.mean() == pytest.approx(-2.0, abs=0.1)
    assert made.std() == pytest.approx(3.0, rel=0.02)
    left = made + 2.0
    lag = (left[:, 1:] * left[:, :-1]).mean() / (left**2).mean()
    share = (tau_s - 1) / (tau_s + 1) if tau_s else 0.0  # whose sum over all lags, (1 + share) / (1 - share), is tau
    assert lag == pytest.approx(share, abs=0.01)


@pytest.mark.parametrize(("expected", "limit"), [(0.99, 0.95), (0.97, 0.95), (0.999, 0.99)])
def test_nine_of_ten_sessions_of_the_planned_length_have_their_lower_bound_above_the_limit(expected, limit):
    frames = availability_frames(expected, limit)

    def passes(count):
        missing = int(scipy.stats.binom.ppf(0.9, count, 1 - expected))
        return scipy.stats.beta.ppf(0.05, count - missing, missing + 1) >= limit

    assert passes(frames)
    assert not passes(round(0.97 * frames)) or not passes(round(0.94 * frames))
    assert availability_frames(expected, limit, frames_per_value=2.5) == pytest.approx(2.5 * frames, abs=1)
    assert availability_frames(limit, limit) is None
