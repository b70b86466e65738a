"""A mount that shakes: its size against the size that was made, its frequency, and what is no vibration."""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.stats
from skies.star_errors import CAMERA, SETTINGS, Truth, made

from gse.diagnosis.field_patterns import field_of_errors
from gse.diagnosis.fine_findings import (
    _independent,
    _line_hz,
    _predicted,
    _usual_variance,
    _without_means,
    vibration,
    without_waves,
)
from gse.diagnosis.session_model import error_series
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


# By hand


@pytest.mark.parametrize("count", [12, 30])
def test_the_usual_variance_is_the_median_of_blocks_as_chi_squared_has_it(count):
    """Of five blocks; the squares of the middle one are 4."""
    blocks = np.repeat(np.arange(5), count)
    quick = np.repeat(np.sqrt([9.0, 1.0, 4.0, 100.0, 2.0]), count)
    freedom = count - 1
    median = scipy.stats.chi2.ppf(0.5, freedom) / freedom
    assert _usual_variance(quick, blocks) == pytest.approx(4 / median, rel=1e-3)


@pytest.mark.parametrize(("frames", "variance"), [(5, 4.0), (6, 50.0)])
def test_blocks_of_fewer_than_six_frames_do_not_count_among_longer_ones(frames, variance):
    """Three long ones of 1, 4 and 9; three short ones of 91 would make the median (9 + 91) / 2."""
    blocks = np.concatenate([np.repeat(np.arange(3), 20), np.repeat(np.arange(3, 6), frames)])
    quick = np.sqrt(np.concatenate([np.repeat([1.0, 4.0, 9.0], 20), np.full(3 * frames, 91.0)]))
    usual = 19 if frames == 5 else 12
    median = scipy.stats.chi2.ppf(0.5, usual) / usual
    assert _usual_variance(quick, blocks) == pytest.approx(variance / median, rel=2e-3)


def test_blocks_of_two_frames_count_where_all_are_so_short():
    """Of one degree of freedom, whose median is 0.455 of the mean; Wilson and Hilferty have 0.470."""
    quick = np.array([1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 50.0])
    assert _usual_variance(quick, np.array([0, 0, 1, 1, 2, 2, 3])) == pytest.approx(4 / 0.4705, rel=1e-3)


def test_what_stars_explain_is_the_scatter_of_each_about_its_mean_as_the_fit_takes_it(sky):
    """Two stars in two frames, off by 1 and by 3 arcsec to either side along columns: a variance of 2 and 18 there.

    That of any star's axis is 5; half of each makes the boresight's shift along columns, the whole along rows.
    """
    operators = np.zeros((4, 3, 2))
    operators[:, 1, 0], operators[:, 0, 1] = -0.5, 1.0
    stars = replace(
        sky[1].stars,
        frames=np.array([0, 0, 1, 1]),
        stars=np.array([1, 2, 1, 2]),
        operators=operators,
        errors=np.array([[7.0, 5.0], [30.0, 0.0], [9.0, 5.0], [36.0, 0.0]]),
    )
    field = replace(sky[1], stars=stars)
    rows = np.array([0, 1])
    assert _predicted(field, rows, np.array([0, 0])) == pytest.approx([5 * 2 / 4, 5 * 2.0])
    assert _predicted(field, rows, np.array([3, 3])) == pytest.approx([5 * 2 / 4, 5 * 2.0])
    assert _predicted(field, rows, np.array([0, 1])) == pytest.approx([0.0, 0.0])
    assert _predicted(field, rows[:1], np.array([0])) == pytest.approx([0.0, 0.0])
    assert _predicted(field, rows[1:], np.array([1])) == pytest.approx([0.0, 0.0])  # the first frame is of no block


def sine(amplitude, cycles, count=200):
    return amplitude * np.cos(2 * math.pi * cycles * np.arange(count) / count)


@pytest.mark.parametrize("cycles", [1, 2, 10, 99])
@pytest.mark.parametrize(("excess", "is_named"), [(3.33, True), (3.34, False)])
def test_a_line_has_three_tenths_of_half_of_the_excess(cycles, excess, is_named):
    """A sine of amplitude 1 has a mean square of a half: 0.3 of 3.333 / 2."""
    found = _line_hz(0.1 * np.arange(200), 100 + sine(1.0, cycles), 0.1, excess)
    assert found == pytest.approx(cycles / 20.0 if is_named else math.nan, nan_ok=True)


@pytest.mark.parametrize(("times", "is_named"), [(19.9, False), (20.1, True)])
def test_a_line_stands_twenty_times_above_the_median_of_the_spectrum(times, is_named):
    """A blow in one frame is as strong at each frequency; a cosine of the same phase adds to it."""
    values = sine(2 / 200 * (math.sqrt(times) - 1), 10)
    values[0] += 1.0
    assert math.isfinite(_line_hz(0.1 * np.arange(200), values, 0.1, 0.0)) is is_named


def test_a_line_between_two_ordinates_counts_with_both():
    """0.405 of its power is in either, 0.045 in the next ones."""
    found = _line_hz(0.1 * np.arange(200), sine(1.0, 10.5), 0.1, 0.8 / 0.3)
    assert found in (pytest.approx(0.5), pytest.approx(0.55))


@pytest.mark.parametrize("other", [8, 12])
def test_a_line_two_ordinates_away_does_not_count(other):
    """Of both together three tenths of the excess are exceeded, of the greater one alone they are not."""
    values = sine(1.0, 10) + sine(0.9, other)
    assert math.isnan(_line_hz(0.1 * np.arange(200), values, 0.1, 4.0))
    assert _line_hz(0.1 * np.arange(200), values, 0.1, 3.0) == pytest.approx(0.5)


@pytest.mark.parametrize(("late", "by", "is_named"), [(2, 1.25, True), (3, 1.25, False), (50, 1.19, True)])
def test_one_step_in_fifty_may_differ_by_more_than_a_fifth(late, by, is_named):
    steps = np.full(100, 0.1)
    steps[10 : 10 + late] *= by
    time_s = np.concatenate([[0.0], np.cumsum(steps)])
    assert math.isfinite(_line_hz(time_s, sine(1.0, 10, 101), 0.1, 1.0)) is is_named


@pytest.mark.parametrize(("count", "lags"), [(7, 0), (8, 1), (12, 2), (79, 18), (80, 19), (300, 19)])
def test_values_to_and_fro_tell_as_many_as_the_first_nineteen_correlations_say(count, lags):
    """Each next pair is one fewer of them, all with the same size."""
    correlations = [(count - lag) / count for lag in range(1, lags + 1)]
    expected = count / (1 + 2 * sum(one**2 for one in correlations))
    assert _independent((-1.0) ** np.arange(count)) == pytest.approx(expected)


def test_an_axis_without_any_error_tells_as_many_as_it_has():
    assert _independent(np.zeros(40)) == 40


def test_what_is_found_is_given_with_what_stars_explain_and_the_rate_of_frames(sky):
    series, field, one = sky
    found = shaken(sky, noise(6.0), step_s=0.5)
    assert found.frame_hz == pytest.approx(2.0)
    assert found.predicted_arcsec == pytest.approx(one * math.sqrt(2), rel=0.1)
    x, y = _predicted(field, series.rows, np.zeros(1200, dtype=np.int64))
    assert found.predicted_arcsec == pytest.approx(math.sqrt(x + y), rel=0.1)


@pytest.mark.parametrize(("ratio", "is_told"), [(4.8, False), (6.0, True)])
def test_few_frames_must_scatter_by_five_standard_errors(sky, ratio, is_told):
    """48 errors to and fro tell a variance as 2.7 do: to 0.86, five times as much is 4.3 beyond what stars explain."""
    _, field, one = sky
    sign = (-1.0) ** np.arange(48)
    assert 5 * math.sqrt(2 / _independent(sign)) == pytest.approx(4.32, abs=0.01)
    blocks = np.arange(48) // 12
    of_one = _usual_variance(_without_means(sign[:, None], blocks)[:, 0], blocks)
    explained = _predicted(field, np.arange(48), blocks)[0]
    size = math.sqrt(ratio * explained / of_one) / one
    assert (shaken(sky, size * sign[:, None] * [1, 0, 0]) is not None) is is_told


def test_the_frequency_is_that_of_the_axis_with_most_beyond_what_its_stars_explain(sky):
    """Stars explain ten times as much along rows: a fifth more there is less than six times what they do along columns.

    Only along columns the mount swings.
    """
    series, field, one = sky
    operators = field.stars.operators.copy()
    operators[:, 0] *= math.sqrt(10)
    uneven = replace(field, stars=replace(field.stars, operators=operators))
    errors = one * with_line(math.sqrt(2 * 6), 1.0) * [1.0, math.sqrt(12), 1.0]
    found = vibration(replace(series, errors_arcsec=errors), uneven)
    assert found.frequency_hz == pytest.approx(2.0, abs=0.02)


@pytest.mark.parametrize(("power", "is_named"), [(69.0, False), (71.0, True)])
def test_the_mean_is_no_ordinate_of_which_the_median_is_taken(power, is_named):
    """Of 1, 3, 4 and the line itself it is 3.5, and the line twenty times as strong; with a nought it would be 3."""
    values = np.fft.irfft(np.sqrt([0.0, 3.0, power, 1.0, 4.0]))
    assert math.isfinite(_line_hz(0.1 * np.arange(8), values, 0.1, 0.0)) is is_named
