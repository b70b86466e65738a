"""The spectra behind the bounds of a mean, against transforms of the series that they stand for."""

import math

import numpy as np
import pytest
import scipy.fft

from gse.statistics.autocorrelation import (
    _CYCLES,
    _PEAKS,
    ORDINATES,
    _changes,
    _response,
    _shapes,
    _sinusoids,
    cosines,
    exponential_spectrum,
    mean_error,
    weighted_sum_error,
)

PLACES = np.arange(ORDINATES + 1)
S = (np.arange(4000) + 0.5) / 4000
"""A session from 0 to 1."""


def squares(course):
    """Squared cosines of a course over the session, without its mean."""
    return scipy.fft.dct(course, norm="ortho")[1 : ORDINATES + 1] ** 2 / len(course)


CHANGES = {
    **{f"a step at {place:.1f}": (place < S).astype(float) for place in (0.1, 0.2, 0.3, 0.4, 0.5)},
    "a ramp": S,
    "a bend at the begin": (1 - S) ** 2,
    "half a wave": np.cos(math.pi * S),
}


@pytest.mark.parametrize(("row", "name"), list(enumerate(CHANGES)), ids=list(CHANGES))
def test_the_spectrum_of_a_change_is_that_of_its_course(row, name):
    of_course = squares(CHANGES[name])
    assert _changes(PLACES)[row, 1:] == pytest.approx(of_course / of_course.max(), abs=2e-3)


def test_the_mean_is_uncertain_by_twice_the_scatter_that_a_change_makes():
    spectra = _changes(PLACES)
    assert spectra[:, 0] == pytest.approx(4 * spectra[:, 1:].sum(axis=1))


@pytest.mark.parametrize("cycles", [1.0, 1.6, 3.0, 12.0])
def test_the_spectrum_of_a_sinusoid_is_the_mean_over_its_phases(cycles):
    phases = np.arange(24) * math.pi / 12
    waves = [math.sqrt(2) * np.sin(2 * math.pi * cycles * S + phase) for phase in phases]
    mean = np.mean([[np.mean(wave) ** 2, *squares(wave)] for wave in waves], axis=0)
    assert _sinusoids(np.array([cycles]), PLACES)[0] == pytest.approx(mean, abs=1e-3)


def test_a_weighted_sum_answers_a_sinusoid_by_its_mean_square_over_the_phases():
    weights, s = np.random.default_rng(4).normal(size=300), (np.arange(300) + 0.5) / 300
    phases = np.arange(24)[:, None, None] * math.pi / 12
    sums = math.sqrt(2) * np.sin(2 * math.pi * _CYCLES[:, None] * s + phases) @ weights
    assert _response(weights) == pytest.approx(np.repeat((sums**2).mean(axis=0), len(_PEAKS)))


@pytest.mark.parametrize("time", [0.5, 5.0, 50.0])
def test_the_spectrum_of_correlated_noise_is_the_sum_over_its_covariance(time):
    s = S[::10]
    covariance = np.exp(-time * np.abs(s[:, None] - s)) * time / 2
    cosines = np.sqrt(np.where(PLACES == 0, 1.0, 2.0))[:, None] * np.cos(math.pi * PLACES[:, None] * s) / len(s)
    assert exponential_spectrum(time, PLACES) == pytest.approx(
        np.einsum("ki,ij,kj->k", cosines, covariance, cosines), abs=2e-3
    )


def test_the_shapes_share_one_belief_half_of_it_in_white_noise():
    shapes = _shapes()
    belief = np.exp(shapes.log_prior)
    assert (shapes.spectra[0] == 1).all()
    assert belief[0] == pytest.approx(0.5)
    assert belief.sum() == pytest.approx(1)


def test_a_sinusoid_stands_above_white_noise_by_each_of_its_heights():
    sinusoids = _shapes().spectra[-len(_shapes().power) :]
    assert sinusoids.min() >= 1
    assert (sinusoids[:, 1:].max(axis=1).reshape(-1, 5) - 1) == pytest.approx(
        np.tile([3.0, 30.0, 300.0, 3000.0, 30_000.0], (len(sinusoids) // 5, 1))
    )


def test_sinusoids_have_a_tenth_of_the_belief_and_changes_a_twentieth():
    shapes = _shapes()
    belief, sinusoids = np.exp(shapes.log_prior), len(shapes.power)
    changes = len(_changes(PLACES)) * len(_PEAKS)
    assert belief[-sinusoids:].sum() == pytest.approx(0.1)
    assert belief[-sinusoids - changes : -sinusoids].sum() == pytest.approx(0.05)
    assert np.ptp(belief[-sinusoids:]) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("weighted", ["a slope", "every second frame less the others"])
def test_a_sum_of_white_noise_is_known_by_the_squares_of_its_weights(weighted):
    """Weights that no low cosine has are as well known as those of a slope."""
    count, place = 2000, np.arange(2000.0)
    weights = place - place.mean() if weighted == "a slope" else np.where(place % 2, 1.0, -1.0)
    found = []
    for seed in range(12):
        values = np.random.default_rng(seed).normal(0, 3.0, count)
        residuals = values - np.polyval(np.polyfit(place, values, 1), place)
        found.append(weighted_sum_error(weights, residuals).standard)
    assert np.median(found) == pytest.approx(3.0 * np.sqrt(weights @ weights), rel=0.1)


# The mixture, by its definition


TIMES = 0.05 * 6000.0 ** (np.arange(20) / 19)
STRENGTHS = (0.3, 1.0, 3.0, 10.0, 100.0, 1e6)
CYCLES = [1.0 + 0.2 * step for step in range(56)]
PEAKS = (3.0, 30.0, 300.0, 3000.0, 30_000.0)


def test_each_shape_of_correlated_noise_has_its_time_and_strength_and_a_belief_that_falls_with_the_root_of_the_time():
    shapes = _shapes()
    expected = [exponential_spectrum(time, PLACES) + 1 / strength for time in TIMES for strength in STRENGTHS]
    belief = np.exp(shapes.log_prior[1:121]).reshape(20, 6)
    assert shapes.spectra[1:121] == pytest.approx(np.array(expected), rel=1e-12)
    assert belief == pytest.approx(belief[0] * np.sqrt(TIMES[0] / TIMES)[:, None], rel=1e-12)
    assert belief.sum() == pytest.approx(0.35)


def test_each_change_stands_above_white_noise_by_each_height():
    expected = [1 + peak * change for peak in PEAKS for change in _changes(PLACES)]
    assert _shapes().spectra[121:161] == pytest.approx(np.array(expected), rel=1e-12)
    assert np.ptp(_shapes().log_prior[121:161]) == 0.0


def test_each_sinusoid_has_a_height_of_its_greatest_ordinate_and_a_mean_square_that_makes_it():
    shapes = _shapes()
    unit = _sinusoids(CYCLES, PLACES)
    power = (np.array(PEAKS) / unit[:, 1:].max(axis=1)[:, None]).ravel()
    assert len(shapes.spectra) == 1 + 20 * 6 + 8 * 5 + 56 * 5
    assert shapes.power == pytest.approx(power, rel=1e-9)
    assert shapes.spectra[161:] == pytest.approx(1 + power[:, None] * np.repeat(unit, 5, axis=0), rel=1e-9)


@pytest.mark.parametrize("time", [0.05, 0.7, 6.0, 25.0])
def test_the_spectrum_of_correlated_noise_is_the_double_integral_of_correlation_and_cosines(time):
    """Over the triangle of s below t, where all is smooth, by Gauss and Legendre."""
    nodes, weights = np.polynomial.legendre.leggauss(120)
    t, weight_t = (nodes + 1) / 2, weights / 2
    s = t[:, None] * (nodes + 1) / 2
    weight = weight_t[:, None] * t[:, None] * weights / 2
    for place in (0, 1, 2, 7, 32):
        size = 2.0 if place else 1.0
        product = np.cos(math.pi * place * s) * np.cos(math.pi * place * t[:, None])
        integral = 2 * size * float((weight * np.exp(-time * (t[:, None] - s)) * product).sum())
        assert exponential_spectrum(time, PLACES)[place] == pytest.approx(time / 2 * integral, rel=1e-8)


@pytest.mark.parametrize("cycles", [1.0, 2.2, 11.8])
def test_the_spectrum_of_a_sinusoid_is_that_of_its_integrals(cycles):
    """The mean over all phases is the square of the integral with a complex wave."""
    s = (np.arange(400_000) + 0.5) / 400_000
    wave = np.exp(2j * math.pi * cycles * s)
    for place in (0, 1, 2, 5, 32):
        size = 2.0 if place else 1.0
        expected = size * abs(np.mean(np.cos(math.pi * place * s) * wave)) ** 2
        assert _sinusoids(np.array([cycles]), PLACES)[0][place] == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize(("row", "place"), list(enumerate((0.1, 0.2, 0.3, 0.4, 0.5))))
def test_the_spectrum_of_a_step_is_the_square_of_the_sine_over_the_place(row, place):
    """The integral of cos(pi k s) from the step on is -sin(pi k place) / (pi k)."""
    squares = [(math.sin(math.pi * k * place) / k) ** 2 for k in range(1, 33)]
    assert _changes(PLACES)[row, 1:] == pytest.approx(np.array(squares) / max(squares), abs=1e-12)


@pytest.mark.parametrize(
    ("row", "squares"),
    [
        (5, [1.0, 0.0, 1 / 81, 0.0, 1 / 625]),  # a ramp: even cosines cancel
        (6, [1.0, 1 / 16, 1 / 81, 1 / 256, 1 / 625]),  # a bend
        (7, [1.0, 0.0, 0.0, 0.0, 0.0]),  # half a wave is the first cosine itself
    ],
)
def test_ramp_bend_and_half_a_wave_fall_with_the_fourth_power_of_the_place(row, squares):
    assert _changes(PLACES)[row, 1:6] == pytest.approx(np.array(squares), abs=1e-12)


def transform(values):
    return scipy.fft.dct(values, norm="ortho")[1 : min(32, len(values) // 2) + 1]


def believed(squares, first):
    """Belief in each shape after squared amplitudes: prior times likelihood, integrated over log scale numerically."""
    shapes = _shapes()
    spectra = shapes.spectra[:, first : first + len(squares)]
    sums = (squares / spectra).sum(axis=1)
    middle = 0.5 * np.log(sums / len(squares))
    log_scale = middle[:, None] + np.linspace(-4, 4, 1601)
    log_density = -len(squares) * log_scale - sums[:, None] / 2 * np.exp(-2 * log_scale)
    top = log_density.max(axis=1)
    log_belief = top + np.log(np.exp(log_density - top[:, None]).sum(axis=1))
    log_belief += shapes.log_prior - 0.5 * np.log(spectra).sum(axis=1)
    belief = np.exp(log_belief - log_belief.max())
    belief[belief < 1e-9] = 0.0
    return belief / belief.sum(), np.sqrt(sums / len(squares))


def noise(n, seed=1):
    return np.random.default_rng(seed).normal(0, 1.0, n)


SERIES = {
    "nine values": noise(9),
    "twelve values": noise(12, 2) + 5.0,
    "white": noise(60, 3),
    "a long one": 3.0 * noise(1000, 4),
    "a random walk": np.cumsum(noise(300, 5)),
    "a wave": noise(200, 6) + 8 * np.sin(np.arange(200) / 8),
    "a step": noise(150, 7) + 6 * (np.arange(150) > 60),
    "a ramp": noise(101, 8) + np.arange(101) / 5,
    "to and fro": np.resize([1.0, -1.0], 64) + 1e-3 * noise(64, 9),
}


@pytest.mark.parametrize("values", SERIES.values(), ids=SERIES)
def test_the_error_of_a_mean_is_a_mixture_of_what_each_shape_makes_of_it(values):
    squares = transform(values) ** 2 + 0.01 * values.var()
    belief, scale = believed(squares, 1)
    expected = scale * np.sqrt(_shapes().spectra[:, 0] / len(values))
    found = mean_error(values)
    assert found.freedom == min(32, len(values) // 2)
    assert found.weights == pytest.approx(belief[belief > 0], rel=1e-6)
    assert found.scales == pytest.approx(expected[belief > 0], rel=1e-9)


@pytest.mark.parametrize("name", ["twelve values", "white", "a long one", "a random walk", "a wave"])
@pytest.mark.parametrize("weighted", ["slope", "random"])
def test_the_error_of_a_weighted_sum_is_a_mixture_of_what_each_shape_makes_of_its_cosines(name, weighted):
    """What no low cosine has of the weights sees the spectrum of the last; a sinusoid is summed phase by phase."""
    values, place = SERIES[name], np.arange(len(SERIES[name])) - (len(SERIES[name]) - 1) / 2
    weights = place / (place @ place) if weighted == "slope" else noise(len(values), 10)
    residuals = values - np.polyval(np.polyfit(place, values, 1), place)
    belief, scale = believed(transform(residuals)[1:] ** 2 + 0.01 * residuals.var(), 2)
    factors, shapes = transform(weights), _shapes()
    variance = shapes.spectra[:, 1 : len(factors) + 1] @ factors**2
    variance += shapes.spectra[:, len(factors)] * (weights @ weights - factors @ factors)
    s, phases = (np.arange(len(values)) + 0.5) / len(values), np.arange(8)[:, None] * math.pi / 8
    for row, power in enumerate(shapes.power.tolist()):
        sums = math.sqrt(2) * np.sin(2 * math.pi * CYCLES[row // 5] * s + phases) @ weights
        variance[161 + row] = weights @ weights + power / len(values) * (sums**2).mean()
    found = weighted_sum_error(weights, residuals)
    assert found.freedom == min(32, len(values) // 2) - 1
    assert found.weights == pytest.approx(belief[belief > 0], rel=1e-6)
    assert found.scales == pytest.approx((scale * np.sqrt(variance))[belief > 0], rel=1e-6)


def test_cosines_of_a_long_series_are_those_of_1024_sums():
    values = noise(2048)
    within, across = values.copy(), values.copy()
    within[[100, 101]] = within[[101, 100]]
    across[[101, 102]] = across[[102, 101]]
    assert cosines(within) == pytest.approx(cosines(values), abs=1e-12)
    assert np.abs(cosines(across) - cosines(values)).max() > 1e-4


def test_sums_change_the_highest_cosine_by_less_than_a_two_thousandth():
    place = (np.arange(5000) + 0.5) / 5000
    expected = np.zeros(32)
    expected[31] = math.sqrt(5000 / 2)
    assert cosines(np.cos(32 * math.pi * place)) == pytest.approx(expected, abs=5e-4 * expected[31])
