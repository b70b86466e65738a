"""A mount that shakes: its size against the size that was made, its frequency, and what is no vibration."""

import math
from dataclasses import replace

import numpy as np
import pytest
from skies.star_errors import CAMERA, SETTINGS, Truth, made

from gse.assessment.error_series import error_series
from gse.assessment.field_patterns import field_of_errors
from gse.assessment.vibration import _independent, _without_means, vibration, without_waves
from gse.truth import horizon_to_sensor

FRAME_S = 0.05


@pytest.fixture(scope="module")
def sky():
    """A still session of a minute, 20 frames a second: its errors, its stars, the scatter that these explain."""
    site, mount = SETTINGS[0]
    frames, matches = made(Truth(site, mount), site, mount, 1199 * FRAME_S, np.random.default_rng(1))
    used = np.ones(len(frames), dtype=bool)
    matches = matches[matches["frame"] % 10 == 0]  # enough for what stars explain
    field = field_of_errors(matches, frames["utc_ns"], used, CAMERA, site, horizon_to_sensor(mount)[:, 2])
    series = error_series(frames, used)
    loud = replace(series, errors_arcsec=1000 * np.random.default_rng(2).normal(size=series.errors_arcsec.shape))
    return series, field, vibration(loud, field).predicted_arcsec / math.sqrt(2)


def shaken(sky, errors, *, step_s=FRAME_S):
    """The same frames with other errors (M, 3), in units of what the stars explain, of the first M frames."""
    series, field, one = sky
    count = len(errors)
    rows, time_s = series.rows[:count], np.arange(count) * step_s
    return vibration(replace(series, rows=rows, time_s=time_s, errors_arcsec=one * np.asarray(errors)), field)


def noise(size, seed=3, count=1200):
    return size * np.random.default_rng(seed).normal(size=(count, 3))


def with_line(amplitude, size, hz=2.0):
    errors = noise(size)
    errors[:, 0] += amplitude * np.sin(2 * math.pi * hz * FRAME_S * np.arange(len(errors)))
    return errors


@pytest.mark.parametrize(("ratio", "is_vibration"), [(1.0, False), (3.2, False), (5.0, True)])
def test_vibration_is_a_scatter_twice_of_what_the_stars_explain(sky, ratio, is_vibration):
    assert (shaken(sky, noise(math.sqrt(ratio))) is not None) == is_vibration


@pytest.mark.parametrize("step_s", [0.05, 5.0], ids=["20 Hz", "0.2 Hz, twelve frames in a block"])
def test_its_size_is_that_of_both_axes_beyond_the_stars(sky, step_s):
    found = [shaken(sky, noise(4.0, seed), step_s=step_s) for seed in range(6)]
    excess = np.mean([one.excess_arcsec for one in found]) / sky[2]
    assert excess == pytest.approx(math.sqrt(2 * (4.0**2 - 1)), rel=0.02)
    assert found[0].frame_hz == pytest.approx(1 / step_s)


def test_one_axis_that_shakes_is_enough(sky):
    found = shaken(sky, noise(1.0) * [1.0, 5.0, 1.0])
    assert found.excess_arcsec == pytest.approx(sky[2] * math.sqrt(24), rel=0.1)


def test_an_axis_that_does_not_shake_adds_nothing_to_the_other(sky):
    both = noise(4.0)
    parts = [shaken(sky, both * axes).excess_arcsec ** 2 for axes in ([1, 0, 0], [0, 1, 0])]
    assert sum(parts) == pytest.approx(shaken(sky, both).excess_arcsec ** 2, rel=1e-6)


def test_a_few_pairs_of_frames_with_gaps_between_them_show_it_too(sky):
    series, field, one = sky
    time_s = FRAME_S * (np.arange(32) + 18 * (np.arange(32) // 2))
    for seed in range(5):
        errors = one * noise(10.0, seed, 32)
        found = vibration(replace(series, rows=series.rows[:32], time_s=time_s, errors_arcsec=errors), field)
        assert found.excess_arcsec == pytest.approx(one * 10 * math.sqrt(2), rel=0.5)


def test_waves_that_were_found_are_taken_out_with_their_periods(sky):
    series, _, _ = sky
    time_s, rest = series.time_s, noise(1.0)
    fast, slow = (np.sin(2 * math.pi * time_s / period_s + 0.7)[:, None] for period_s in (7.0, 23.0))
    waved = replace(series, errors_arcsec=rest + 50 * fast * [1, 0, 2] + 30 * slow * [0, 1, 0])
    left = without_waves(waved, [7.0, 23.0]).errors_arcsec
    assert left == pytest.approx(
        without_waves(replace(series, errors_arcsec=rest), [7.0, 23.0]).errors_arcsec, abs=1e-6
    )
    assert np.abs(left - rest).std() < 0.1
    assert without_waves(waved, []) is waved


@pytest.mark.parametrize("hz", [0.5, 2.0, 7.3])
def test_a_mount_that_swings_is_given_its_frequency(sky, hz):
    assert shaken(sky, with_line(10.0, 1.0, hz)).frequency_hz == pytest.approx(hz, abs=0.02)


@pytest.mark.parametrize(("share", "is_named"), [(0.2, False), (0.6, True)])
def test_a_frequency_has_three_tenths_of_the_scatter(sky, share, is_named):
    """``share`` is the power of the line, in that of the noise of one axis; 0.35 would be three tenths of one half."""
    found = shaken(sky, with_line(10.0 * math.sqrt(2 * share), 10.0))
    assert math.isfinite(found.frequency_hz) == is_named


def test_the_highest_of_few_random_ordinates_is_no_frequency(sky):
    found = [shaken(sky, noise(10.0, seed, 64) * [1.0, 0.1, 1.0]) for seed in range(40)]
    assert sum(math.isfinite(one.frequency_hz) for one in found) <= 2


def test_a_swing_in_few_frames_is_given_its_frequency(sky):
    assert shaken(sky, with_line(10.0, 1.0, 5.0)[:64]).frequency_hz == pytest.approx(5.0, abs=0.2)


@pytest.mark.parametrize(("gaps", "is_named"), [(12, True), (40, False)])
def test_frames_that_come_irregularly_tell_no_frequency(sky, gaps, is_named):
    series, field, one = sky
    time_s = np.arange(1200) * FRAME_S
    for row in np.linspace(5, 1190, gaps).astype(int):
        time_s[row:] += 0.5 * FRAME_S
    errors = one * 10 * np.sin(2 * math.pi * 2.0 * time_s)[:, None] * [1, 0, 0] + one * noise(1.0)
    found = vibration(replace(series, time_s=time_s, errors_arcsec=errors), field)
    assert math.isfinite(found.frequency_hz) == is_named


def test_frames_whose_time_stands_still_tell_nothing(sky):
    series, field, one = sky
    stuck = series.time_s // 0.3 * 0.3
    assert vibration(replace(series, time_s=stuck, errors_arcsec=one * noise(10.0)), field) is None


def test_a_slip_or_a_slow_course_is_no_vibration(sky):
    late = (np.arange(1200) > 700)[:, None]
    assert shaken(sky, noise(1.0) + 300.0 * late) is None
    assert shaken(sky, noise(1.0) + 0.01 * np.arange(1200)[:, None], step_s=0.5) is None


@pytest.mark.parametrize(("size", "is_told"), [(4.5, False), (7.0, True)])
def test_what_lasts_longer_than_twenty_seconds_is_no_vibration(sky, size, is_told):
    """Of a swing of 80 s means of 20 s leave a variance of 0.095 of its size squared, those of 40 s a half; three times
    that of the noise is vibration.
    """
    swing = size * np.cos(2 * math.pi * 0.5 * np.arange(1200) / 80.0)
    found = shaken(sky, noise(1.0) + swing[:, None] * [1, 0, 0], step_s=0.5)
    assert (found is not None) is is_told


def test_few_blocks_tell_nothing(sky):
    assert shaken(sky, noise(10.0, count=36)) is None
    assert shaken(sky, noise(10.0, count=48)) is not None


def test_values_about_the_means_of_their_blocks_have_the_variance_of_a_sample():
    """A frame that is alone in its block tells nothing."""
    blocks = np.array([4, 4, 4, 7, 9, 9])
    values = np.column_stack([np.array([1.0, 2.0, 6.0, 5.0, -1.0, 3.0]), np.arange(6.0)])
    found = _without_means(values, blocks)
    for axis in range(2):
        for block, count in ((4, 3), (9, 2)):
            part = blocks == block
            assert (found[part, axis] ** 2).sum() / count == pytest.approx(values[part, axis].var(ddof=1))
            assert found[part, axis].sum() == pytest.approx(0.0, abs=1e-12)
    assert (found[3] == 0.0).all()


def test_values_that_hang_together_tell_a_variance_as_fewer_would():
    """An autoregressive process of first order: the squares of its correlations add up to a^2 / (1 - a^2)."""
    share, noise = 0.6, np.random.default_rng(9).normal(size=40_000)
    for row in range(1, len(noise)):
        noise[row] += share * noise[row - 1]
    expected = len(noise) / (1 + 2 * share**2 / (1 - share**2))
    assert _independent(noise) == pytest.approx(expected, rel=0.03)
    assert _independent(np.random.default_rng(9).normal(size=40_000)) == pytest.approx(40_000, rel=0.01)
