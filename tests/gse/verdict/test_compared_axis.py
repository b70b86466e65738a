"""One axis of two sessions: differences and their errors, against scipy's folded normal distribution and by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.stats

from gse.diagnosis.field_content import FieldContent
from gse.statistics.axis_statistics import axis_statistics
from gse.statistics.sampling import MIN_FRAMES
from gse.values.axis import D_DE
from gse.values.instant import NS_PER_S
from gse.verdict.compared_rows import Change, ComparedAxis, ComparedSubject, axis_rows, error_of_mean, sigmas_of

NOTHING = axis_statistics(np.array([], dtype=np.int64), np.array([]))
NO_STARS = FieldContent(math.nan, 0.0, 0.0, 0.0)
SLOW = np.cumsum(np.random.default_rng(1).normal(0, 1, MIN_FRAMES))
TO_AND_FRO = (-1.0) ** np.arange(MIN_FRAMES) + np.random.default_rng(1).normal(0, 0.1, MIN_FRAMES)


def axis(bias=0.0, std=4.0, mean_abs=3.0, nea=2.0, field=NO_STARS, by_time=(0.1, 0.1, 0.02)):
    found = replace(NOTHING, bias_arcsec=bias, std_arcsec=std, mean_abs_arcsec=mean_abs, nea_arcsec=nea)
    return ComparedAxis(found, field, *by_time)


def folded_mean(bias, spread):
    return float(scipy.stats.foldnorm(abs(bias) / spread, scale=spread).mean())


def rows(one, two, *, paired=None, growth=1.0, **options):
    return axis_rows("dDE", one, two, paired=paired, allowed=0.6, growth=growth, **options)


@pytest.mark.parametrize(
    ("difference", "sigma", "expected"),
    [
        (2.0, 0.5, 4.0),
        (-2.0, 0.5, -4.0),
        (1.0, math.inf, 0.0),
        (0.0, 0.0, 0.0),
        (3.0, 0.0, math.inf),
        (-3.0, 0.0, -math.inf),
        (3.0, math.nan, math.nan),
    ],
)
def test_a_difference_counts_in_its_standard_errors(difference, sigma, expected):
    assert sigmas_of(difference, sigma) == pytest.approx(expected, nan_ok=True)


@pytest.mark.parametrize("values", [[1.0, 4.0], SLOW[:-1].tolist()], ids=["two", "one too few"])
def test_the_mean_of_few_values_is_known_as_of_independent_ones(values):
    assert error_of_mean(np.array(values)) == pytest.approx(scipy.stats.sem(values))


def test_the_mean_of_enough_values_is_known_by_how_they_hang_together():
    assert error_of_mean(SLOW) > 3 * scipy.stats.sem(SLOW)
    assert error_of_mean(TO_AND_FRO) == pytest.approx(scipy.stats.sem(TO_AND_FRO))  # no better than independent ones


@pytest.mark.parametrize(("count", "expected"), [(0, math.nan), (1, math.nan), (2, 0.0), (40, 0.0)])
def test_equal_values_have_no_error_and_one_has_none_that_is_known(count, expected):
    assert error_of_mean(np.full(count, 3.0)) == pytest.approx(expected, nan_ok=True)


@pytest.mark.parametrize(("geometry", "expected"), [((0.3, 0.2), 1.5), ((0.3, math.nan), 1.0), ((math.nan, 0.2), 1.0)])
def test_noise_is_taken_to_the_fields_of_the_first_where_both_tell_theirs(geometry, expected):
    one, two = (axis(field=replace(NO_STARS, geometry=size)) for size in geometry)
    assert one.growth(two) == pytest.approx(expected)


def test_a_bias_is_as_uncertain_as_frames_and_stars_make_it():
    assert axis(field=replace(NO_STARS, bias_error_arcsec=0.4), by_time=(0.3, 9.0, 9.0)).bias_error_arcsec == 0.5


@pytest.mark.parametrize(("by_time", "by_stars"), [(0.05, 0.02), (0.02, 0.05)])
def test_a_noise_is_as_uncertain_as_the_worse_of_frames_and_stars(by_time, by_stars):
    found = axis(nea=3.0, field=replace(NO_STARS, noise_error_share=by_stars), by_time=(9.0, 9.0, by_time))
    assert found.noise_error_arcsec == pytest.approx(0.15)


@pytest.mark.parametrize(("bias", "std"), [(0.0, 4.0), (3.0, 4.0), (-3.0, 4.0), (12.0, 4.0), (1.0, 0.5)])
def test_a_mean_error_is_as_uncertain_as_bias_and_spread_make_it(bias, std):
    """By the slopes of the mean of a folded normal distribution."""
    step = 1e-4
    by_bias = (folded_mean(bias + step, std) - folded_mean(bias - step, std)) / 2 / step
    by_spread = (folded_mean(bias, std + step) - folded_mean(bias, std - step)) / 2 / step
    expected = math.hypot(by_bias * 0.3, by_spread * 0.1 * std)
    field = replace(NO_STARS, spread_error_share=0.1)
    found = axis(bias=bias, std=std, field=field, by_time=(0.3, 0.0, 0.0))
    assert found.mean_abs_error_arcsec == pytest.approx(expected, rel=1e-4)
    of_frames = axis(bias=bias, std=std, field=field, by_time=(0.3, 2.0, 0.0))
    assert of_frames.mean_abs_error_arcsec == 2.0


def test_errors_that_are_all_equal_are_as_uncertain_as_their_bias():
    assert axis(bias=5.0, std=0.0, by_time=(0.3, 0.0, 0.0)).mean_abs_error_arcsec == pytest.approx(0.3)


def test_each_of_three_values_is_compared_with_its_own_error():
    one = axis(bias=1.0, mean_abs=3.0, nea=2.0, by_time=(0.3, 0.6, 0.05))
    two = axis(bias=-1.5, mean_abs=4.0, nea=2.5, by_time=(0.4, 0.8, 0.05))
    mean, noise, bias = rows(one, two)
    assert [row.name for row in (mean, noise, bias)] == ["mean |dDE|", "NEA dDE", "bias dDE"]
    assert {(row.unit, row.allowed) for row in (mean, noise, bias)} == {("arcsec", 0.6)}
    assert (mean.first, mean.second, mean.alike, mean.difference) == pytest.approx((3.0, 4.0, 4.0, 1.0))
    assert mean.sigmas == pytest.approx(1.0 / 1.0)
    assert (noise.first, noise.second, noise.alike, noise.difference) == pytest.approx((2.0, 2.5, 2.5, 0.5))
    assert noise.sigmas == pytest.approx(0.5 / (0.05 * math.hypot(2.0, 2.5)))
    assert (bias.first, bias.second, bias.alike, bias.difference) == pytest.approx((1.0, -1.5, -1.5, -2.5))
    assert bias.sigmas == pytest.approx(-2.5 / 0.5)
    assert (mean.gate, noise.gate, bias.gate) == (True, True, False)
    assert not any(row.worse for row in (mean, noise, bias))
    assert rows(one, two, bias_is_regression=True)[2].gate


def test_the_second_is_taken_to_the_fields_of_the_first():
    one = axis(by_time=(0.1, 0.3, 0.03))
    two = axis(bias=3.0, std=5.0, mean_abs=4.6, nea=2.0, by_time=(0.0, 0.8, 0.04))
    mean, noise, _ = rows(one, two, growth=0.5)
    alike = 4.6 + folded_mean(3.0, 2.5) - folded_mean(3.0, 5.0)
    assert (mean.alike, mean.difference) == pytest.approx((alike, alike - 3.0))
    assert mean.sigmas == pytest.approx((alike - 3.0) / 0.5)
    assert (noise.alike, noise.difference) == pytest.approx((1.0, -1.0))
    assert noise.sigmas == pytest.approx(-1.0 / math.hypot(0.06, 0.5 * 0.08))


def test_of_the_same_panoramas_the_change_of_each_counts():
    mean, noise, _ = rows(axis(mean_abs=3.0), axis(mean_abs=9.0), paired=Change(0.25, 0.05))
    assert (mean.first, mean.second, mean.alike, mean.difference) == (3.0, 9.0, 3.25, 0.25)
    assert mean.sigmas == pytest.approx(5.0)
    assert noise.difference == 0.0


def test_an_axis_of_a_subject_is_that_of_its_good_answers():
    errors = np.random.default_rng(3).normal(1.0, 4.0, 24)
    good = np.arange(24) != 7
    utc_ns = np.arange(24) * 2 * NS_PER_S
    given = {"d_de_arcsec": np.where(good, errors, 1e6)}
    none = np.zeros(24, dtype=bool)
    statistics = type("Statistics", (), {"axes": {"d_de": NOTHING}})()
    subject = ComparedSubject(statistics, utc_ns, given, good, none, none, none, {})
    found = ComparedAxis.from_subject(subject, D_DE)
    kept, at_s = errors[good], utc_ns[good] / NS_PER_S
    quick = np.array([error - kept[np.abs(at_s - when) <= 10].mean() for error, when in zip(kept, at_s, strict=True)])
    assert found.time_error_arcsec == pytest.approx(scipy.stats.sem(kept))
    assert found.time_error_abs_arcsec == pytest.approx(scipy.stats.sem(np.abs(kept)))
    assert found.noise_time_share == pytest.approx(scipy.stats.sem(quick**2) / 2 / np.mean(quick**2))
    assert math.isnan(found.field.geometry)
    assert (found.field.noise_error_share, found.field.spread_error_share, found.field.bias_error_arcsec) == (0, 0, 0)
    nobody = replace(subject, good=none)
    assert math.isnan(ComparedAxis.from_subject(nobody, D_DE).noise_time_share)
