"""The error per kelvin, by the definition of a fit and its bounds, and where nothing is told."""

import numpy as np
import pytest
import scipy.stats

from gse.statistics.subject_statistics import thermal_error
from gse.values.instant import NS_PER_S

RNG = np.random.default_rng(11)


def made(frames, *, correlation=0.0, per_k=0.0, range_k=4.0):
    """A session whose temperature swings twice while its error drifts in time."""
    time_s = np.arange(frames) * 10.0
    temperature = 20 + range_k / 2 * np.sin(4 * np.pi * np.arange(frames) / frames)
    noise = RNG.normal(0, 1, frames)
    for row in range(1, frames):
        noise[row] += correlation * noise[row - 1]
    return time_s, temperature, noise + 0.002 * time_s + per_k * temperature


def by_definition(time_s, temperature, error, blocks):
    """Least squares of block means on time and temperature; the bias of a short correlation as Kendall has it."""
    time, warm, mean = (np.array([part.mean() for part in np.array_split(one, blocks)])
                        for one in (time_s, temperature, error))  # fmt: skip
    design = np.column_stack([np.ones(blocks), (time - time.mean()) / np.ptp(time), warm - warm.mean()])
    fit, *_ = np.linalg.lstsq(design, mean, rcond=None)
    left = mean - design @ fit
    lag = (left[1:] * left[:-1]).sum() / (left**2).sum()
    lag = np.clip(lag + (1 + 4 * lag) / blocks, 0.0, 0.9)
    widening = (1 + lag) / (1 - lag)
    variance = (left**2).sum() / (blocks - 3) * widening * np.linalg.inv(design.T @ design)[2, 2]
    half = scipy.stats.t.ppf(0.975, max(blocks / widening - 3, 1.0)) * np.sqrt(variance)
    return fit[2], fit[2] - half, fit[2] + half, np.ptp(warm)


@pytest.mark.parametrize(
    ("frames", "blocks"), [(60, 12), (100, 20), (159, 31), (160, 32), (2000, 32)], ids=lambda one: f"{one}"
)
@pytest.mark.parametrize("correlation", [0.0, 0.95])
def test_the_error_per_kelvin_is_that_of_a_fit_of_at_most_32_means_of_five_frames(frames, blocks, correlation):
    time_s, temperature, error = made(frames, correlation=correlation, per_k=0.5)
    found = thermal_error((time_s * NS_PER_S).astype(np.int64), error, temperature)
    expected = by_definition(time_s, temperature, error, blocks)
    assert (
        found.arcsec_per_k, found.low_arcsec_per_k, found.high_arcsec_per_k, found.range_k
    ) == pytest.approx(expected)  # fmt: skip


@pytest.mark.parametrize(("frames", "is_told"), [(59, False), (60, True)])
def test_sixty_known_frames_are_needed(frames, is_told):
    time_s, temperature, error = made(frames + 3)
    temperature[:2], error[-1] = np.nan, np.nan
    found = thermal_error((time_s * NS_PER_S).astype(np.int64), error, temperature)
    assert (found is not None) is is_told


@pytest.mark.parametrize(
    ("range_k", "resolution_k", "is_told"), [(0.5, 0.1, True), (0.49, 0.1, False), (0.5, 0.2, False)]
)
def test_a_temperature_that_moved_by_less_than_five_of_its_steps_tells_nothing(range_k, resolution_k, is_told):
    time_s, _, error = made(320)
    temperature = np.where(np.arange(320) < 160, 20.0, 20.0 + range_k)
    found = thermal_error((time_s * NS_PER_S).astype(np.int64), error, temperature, resolution_k=resolution_k)
    assert (found is not None) is is_told


def test_frames_of_one_instant_and_errors_without_scatter_end_nothing():
    time_s, temperature, error = made(320)
    assert thermal_error(np.zeros(320, dtype=np.int64), error, temperature) is None
    exact = thermal_error((time_s * NS_PER_S).astype(np.int64), np.zeros(320), temperature)
    assert (exact.low_arcsec_per_k, exact.high_arcsec_per_k) == (0.0, 0.0)
