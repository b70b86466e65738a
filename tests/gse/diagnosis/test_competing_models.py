"""The likelihood by which causes compete, against scipy's densities and sums of its own shapes."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_t

from gse.diagnosis.competing_models import (
    PENALTY,
    Observed,
    Predictions,
    _shapes,
    by_its_noise,
    exponential_spectrum,
    fitted,
    white_precision,
)
from gse.diagnosis.fine_causes import FineHypothesis, _without_idle

K = 40
NOISE = np.random.default_rng(1).normal(size=(K, 3))
SLOW = NOISE * np.sqrt(exponential_spectrum(3.0, np.arange(K + 1))[1:, None] * 1e4 + 1)
NOTHING = Predictions(np.zeros((3, 0)), np.zeros((K, 3, 0)), np.zeros((2, 0)))
SURE = np.diag([1e4, 4e4, 9e4])
"""Of what stars keep: so much that the noise of the mean is nothing beside it."""
NORMAL = np.array([[400.0, 30.0], [30.0, 25.0]])


def observed(*, mean=(0.0, 0.0, 0.0), lasting=SURE, cosines=NOISE, parameters=(0.0, 0.0), freedom=0.0):
    return Observed(600, np.array(mean), lasting, cosines, NORMAL, NORMAL @ np.array(parameters), freedom)


def twice_log(**what):
    return fitted(observed(**what), NOTHING).twice_log_likelihood


@pytest.mark.parametrize("time", [0.5, 5.0, 50.0])
def test_the_spectrum_of_correlated_noise_is_the_sum_over_its_covariance(time):
    places, s = np.arange(33), (np.arange(400) + 0.5) / 400
    covariance = np.exp(-time * np.abs(s[:, None] - s)) * time / 2
    cosines = np.sqrt(np.where(places == 0, 1.0, 2.0))[:, None] * np.cos(np.pi * places[:, None] * s) / len(s)
    assert exponential_spectrum(time, places) == pytest.approx(
        np.einsum("ki,ij,kj->k", cosines, covariance, cosines), abs=2e-3
    )


@pytest.mark.parametrize("mean", [(150.0, 0.0, 0.0), (30.0, -400.0, 800.0)])
def test_the_mean_is_a_students_t_of_as_many_degrees_as_ordinates(mean):
    expected = 2 * (multivariate_t(shape=SURE, df=K).logpdf(mean) - multivariate_t(shape=SURE, df=K).logpdf([0, 0, 0]))
    assert twice_log(mean=mean) - twice_log() == pytest.approx(expected, rel=1e-3)


def test_what_stars_keep_makes_each_mean_less_likely():
    other = np.array([[9e4, 1e4, 0.0], [1e4, 2e4, 0.0], [0.0, 0.0, 8e5]])
    mean = (150.0, 20.0, -80.0)
    densities = [multivariate_t(shape=shape, df=K).logpdf(mean) for shape in (other, SURE)]
    found = twice_log(mean=mean, lasting=other) - twice_log(mean=mean)
    assert found == pytest.approx(2 * (densities[0] - densities[1]), rel=1e-3)


@pytest.mark.parametrize("freedom", [5.0, 300.0])
def test_the_field_is_a_students_t_of_its_stars(freedom):
    density = multivariate_t(shape=np.linalg.inv(NORMAL), df=freedom)
    parameters = (0.2, -0.9)
    found = twice_log(parameters=parameters, freedom=freedom) - twice_log(freedom=freedom)
    assert found == pytest.approx(2 * (density.logpdf(parameters) - density.logpdf([0, 0])), rel=1e-6)


def test_slow_noise_is_weighed_over_all_shapes_with_their_scale_left_open():
    _, inverses, _, _, prior = _shapes(K)
    logs = prior[:, None] + 0.5 * np.log(inverses).sum(axis=1)[:, None]
    of = [logs - K / 2 * np.log(inverses @ cosines**2) for cosines in (SLOW, NOISE)]
    expected = 2 * (logsumexp(of[0], axis=0) - logsumexp(of[1], axis=0)).sum()
    assert twice_log(cosines=SLOW) - twice_log() == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("errors", [SLOW, NOISE])
def test_slow_noise_that_a_cause_leaves_is_believed_without_the_cause_too(errors):
    _, inverses, _, _, prior = _shapes(K)
    left, without = (
        0.5 * np.log(inverses).sum(axis=1)[:, None] - K / 2 * np.log(inverses @ cosines**2)
        for cosines in (errors, SLOW)
    )
    posterior = prior[:, None] + left - logsumexp(prior[:, None] + left, axis=0)
    believed = np.maximum(prior[:, None], posterior)
    expected = 2 * (logsumexp(believed + without, axis=0) - logsumexp(prior[:, None] + without, axis=0)).sum()
    assert by_its_noise(SLOW, errors) == pytest.approx(expected, rel=1e-4)


def test_only_slow_noise_that_is_left_speaks_against_a_cause():
    """Three axes have a shape of some dozen likely ones each."""
    assert by_its_noise(SLOW, SLOW) > 12
    assert by_its_noise(SLOW, NOISE) < 1


def test_half_of_the_belief_is_in_white_noise_and_the_rest_is_shared_evenly():
    first, inverses, _, logs, prior = _shapes(K)
    assert first[0] == 1
    assert (inverses[0] == 1).all()
    assert np.exp(prior) == pytest.approx([0.5, *[0.5 / (len(prior) - 1)] * (len(prior) - 1)])
    assert logs == pytest.approx(-np.log(inverses).sum(axis=1))


def test_one_column_in_white_noise_is_fitted_as_least_squares_do():
    rng = np.random.default_rng(2)
    column = Predictions(np.zeros((3, 1)), rng.normal(size=(K, 3, 1)), np.zeros((2, 1)))
    cosines = NOISE + 2.5 * column.cosines[:, :, 0]
    found = fitted(observed(cosines=cosines), column)
    design = column.cosines.reshape(-1)
    expected = float(design @ cosines.reshape(-1) / (design @ design))
    assert found.coefficients[0] == pytest.approx(expected, abs=0.02)
    assert np.sqrt(found.covariance[0, 0]) == pytest.approx(NOISE.std() / np.sqrt(design @ design), rel=0.2)


@pytest.mark.parametrize("mean", [200.0, 900.0])
def test_a_column_that_the_mean_and_the_course_see_differently_is_fitted_where_both_together_are_likeliest(mean):
    of_course = np.random.default_rng(5).normal(scale=0.1, size=(K, 3, 1))
    column = Predictions(np.array([[100.0], [0.0], [0.0]]), of_course, np.zeros((2, 1)))

    def left(size):
        return twice_log(mean=(mean - 100 * size, 0.0, 0.0), cosines=NOISE - size * of_course[:, :, 0])

    found = float(fitted(observed(mean=(mean, 0.0, 0.0)), column).coefficients[0])
    sizes = np.linspace(-2, 10, 601)
    assert found == pytest.approx(sizes[np.argmax([left(size) for size in sizes])], abs=0.03)


def test_a_parameter_of_the_field_alone_is_what_the_stars_say():
    column = Predictions(np.zeros((3, 2)), np.zeros((K, 3, 2)), np.eye(2))
    found = fitted(observed(parameters=(0.7, -2.0), freedom=1e6), column)
    assert found.coefficients == pytest.approx([0.7, -2.0], rel=1e-6)
    assert found.covariance == pytest.approx(np.linalg.inv(NORMAL), rel=1e-3)


def test_a_column_costs_the_bayesian_information_criterion_of_150_values():
    assert abs(PENALTY - np.log(150)) < 0.02


def test_white_noise_is_judged_by_the_upper_half_of_the_ordinates():
    cosines = np.vstack([1000 * NOISE, [2.0, 20.0, 200.0] * np.random.default_rng(3).normal(size=(K, 3))])
    found = white_precision(cosines)
    assert found.shape == (2 * K, 3)
    assert found == pytest.approx(np.tile(1 / np.mean(cosines[K:] ** 2, axis=0), (2 * K, 1)))


@pytest.mark.parametrize(("also", "is_kept"), [(0.0, False), (5.0, True)])
def test_an_earlier_cause_is_dropped_where_a_later_one_explains_what_it_did(also, is_kept):
    """The first is nine tenths of the second, and something of its own that is there or is not."""
    rng = np.random.default_rng(6)
    second, own = (rng.normal(size=(K, 3, 1)) for _ in range(2))

    def cause(cosines):
        return FineHypothesis("cause", "kind", Predictions(np.zeros((3, 1)), cosines, np.zeros((2, 1))))

    first, later = cause(0.9 * second + 0.3 * own), cause(second)
    seen = observed(cosines=NOISE + 4 * second[:, :, 0] + also * own[:, :, 0])
    assert _without_idle(seen, [first], later) == ([first] if is_kept else [])


def test_slow_noise_has_sixteen_correlation_times_and_twelve_strengths():
    """From a third of the session's length to three sessions, and from a third of the white noise to a million times.

    The spectrum at zero is 1 and the strength times the variance of a session's mean.
    """
    first, inverses, _, logs, _ = _shapes(8)
    assert [len(one) for one in (first, inverses, logs)] == [1 + 16 * 12] * 3
    assert inverses.shape[1] == 8
    of_mean = (first[1:, 0] - 1).reshape(16, 12)
    strengths = [0.3, 1, 3, 10, 30, 100, 300, 1000, 3000, 1e4, 1e5, 1e6]
    for row, time in ((0, 0.3), (7, 0.3 * 2000 ** (7 / 15)), (15, 600.0)):
        mean = 1 - (1 - np.exp(-time)) / time
        assert of_mean[row] == pytest.approx(mean * np.array(strengths), rel=1e-9)


@pytest.mark.parametrize(("errors", "at_zero"), [(NOISE, 1.0), (SLOW, 1 + 1e4 * (1 - (1 - np.exp(-3)) / 3))])
def test_the_mean_of_frames_scatters_by_their_spectrum_at_zero_over_their_number(errors, at_zero):
    """Of 600 frames whose stars keep nothing: the Student t of three axes, each with that variance."""
    mean = np.sqrt(30 * at_zero / 600)
    nothing = np.eye(3) * 1e-12
    found = twice_log(mean=(mean,) * 3, lasting=nothing, cosines=errors) - twice_log(lasting=nothing, cosines=errors)
    variance = (K + 3) / K  # of its square
    assert found == pytest.approx(-(K + 3) * np.log1p(3 * 30 / K), rel=0.25 * variance)


def test_weights_are_the_inverse_of_the_spectrum_that_noise_shows():
    column = Predictions(np.zeros((3, 1)), np.random.default_rng(4).normal(size=(K, 3, 1)), np.zeros((2, 1)))
    spectrum = exponential_spectrum(3.0, np.arange(K + 1))[1:, None] * 1e4 + 1
    for cosines, expected in (
        (NOISE, np.ones((K, 3))),
        (SLOW, np.tile(1 / spectrum, 3)),
        (7 * NOISE, np.ones((K, 3)) / 49),
    ):
        for columns in (NOTHING, column):
            found = fitted(observed(cosines=cosines), columns).precision
            assert np.exp(np.abs(np.log(found / expected)).mean()) < 1.6


@pytest.mark.parametrize("size", [1.5, 6.0])
def test_a_column_that_field_and_course_see_differently_is_fitted_where_both_together_are_likeliest(size):
    of_course = np.random.default_rng(5).normal(scale=0.1, size=(K, 3, 1))
    column = Predictions(np.zeros((3, 1)), of_course, np.array([[0.1], [0.4]]))

    def left(by):
        parameters = (0.1 * (size - by), 0.4 * (size - by))
        return twice_log(parameters=parameters, freedom=6.0, cosines=NOISE - by * of_course[:, :, 0])

    found = fitted(observed(parameters=(0.1 * size, 0.4 * size), freedom=6.0), column)
    sizes = np.linspace(-2, 10, 601)
    assert float(found.coefficients[0]) == pytest.approx(sizes[np.argmax([left(by) for by in sizes])], abs=0.03)
    assert found.twice_log_likelihood == pytest.approx(left(float(found.coefficients[0])), abs=1e-6)


def test_two_columns_that_are_the_same_share_what_one_of_them_has():
    one = Predictions(np.zeros((3, 1)), np.random.default_rng(2).normal(size=(K, 3, 1)), np.ones((2, 1)))
    both = one + one
    assert (one.count, both.count, (both + one).count, NOTHING.count) == (1, 2, 3, 0)
    assert [part.shape for part in (both.mean, both.cosines, both.field)] == [(3, 2), (K, 3, 2), (2, 2)]
    cosines = NOISE + 3 * one.cosines[:, :, 0]
    alone, twice = (fitted(observed(cosines=cosines), columns) for columns in (one, both))
    assert twice.coefficients.sum() == pytest.approx(alone.coefficients[0], rel=1e-3)
    assert twice.covariance.sum() == pytest.approx(alone.covariance[0, 0], rel=1e-3)
    assert twice.twice_log_likelihood == pytest.approx(alone.twice_log_likelihood, abs=1e-3)


def test_without_columns_nothing_is_fitted():
    found = fitted(observed(), NOTHING)
    assert (found.coefficients.shape, found.covariance.shape) == ((0,), (0, 0))
    assert found.precision.shape == (K, 3)


def test_ordinates_that_are_all_zero_have_a_weight_nevertheless():
    assert white_precision(np.zeros((4, 3))) == pytest.approx(np.full((4, 3), 1e12))


def test_a_slow_column_in_slow_noise_is_known_worse_than_one_in_white_noise():
    """By the root of the spectrum of the ordinate that it stands in."""
    cosines = np.zeros((K, 3, 1))
    cosines[1, 0] = 1.0
    column = Predictions(np.zeros((3, 1)), cosines, np.zeros((2, 1)))
    spectrum = 1 + 1e4 * exponential_spectrum(3.0, np.arange(3))[2]
    errors = [np.sqrt(fitted(observed(cosines=noise), column).covariance[0, 0]) for noise in (SLOW, NOISE)]
    assert errors[0] / errors[1] == pytest.approx(np.sqrt(spectrum), rel=0.5)


def test_columns_in_units_a_million_million_times_apart_are_both_fitted():
    """As they are in like units: coefficients and errors are in those of each."""
    rng = np.random.default_rng(7)
    like = Predictions(np.zeros((3, 2)), rng.normal(size=(K, 3, 2)), np.zeros((2, 2)))
    units = np.array([1e6, 1e-6])
    unlike = replace(like, cosines=like.cosines * units)
    cosines = NOISE + like.cosines @ [3.0, -2.0]
    one, other = (fitted(observed(cosines=cosines), columns) for columns in (like, unlike))
    assert other.coefficients * units == pytest.approx(one.coefficients, rel=1e-6)
    assert other.covariance * np.outer(units, units) == pytest.approx(one.covariance, rel=1e-6)
    assert other.twice_log_likelihood == pytest.approx(one.twice_log_likelihood, abs=1e-6)


def test_a_column_of_nothing_has_neither_a_coefficient_nor_an_error():
    columns = Predictions(np.zeros((3, 2)), np.zeros((K, 3, 2)), np.zeros((2, 2)))
    columns.cosines[:, :, 0] = np.random.default_rng(7).normal(size=(K, 3))
    found = fitted(observed(cosines=NOISE + 3.0 * columns.cosines[:, :, 0]), columns)
    assert found.coefficients == pytest.approx([3.0, 0.0], abs=0.3)
    assert found.covariance[1] == pytest.approx([0.0, 0.0])


def test_axes_without_errors_are_as_likely_as_those_of_a_millionth_of_a_unit_half_of_it_noise():
    """The scale of each axis is left open: half the square is likelier by the root of two for each ordinate."""
    nothing, millionth = (twice_log(cosines=np.full((K, 3), size)) for size in (0.0, 1e-6))
    assert nothing - millionth == pytest.approx(3 * K * np.log(2), rel=1e-6)
