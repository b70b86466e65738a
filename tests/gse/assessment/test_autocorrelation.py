"""The spectra behind the bounds of a mean, against transforms of the series that they stand for."""

import math

import numpy as np
import pytest
import scipy.fft

from gse.assessment.autocorrelation import (
    _CYCLES,
    _PEAKS,
    ORDINATES,
    _changes,
    _response,
    _shapes,
    _sinusoid,
    exponential_spectrum,
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
    assert _sinusoid(cycles, PLACES) == pytest.approx(mean, abs=1e-3)


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
