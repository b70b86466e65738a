"""Where steps and swings are looked for, in series that are made of nothing else."""

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.fft
import scipy.stats
from scipy.optimize import brentq
from skies.star_errors import SETTINGS

from gse.diagnosis.competing_models import Predictions, fitted
from gse.diagnosis.field_patterns import PARAMETERS
from gse.diagnosis.fine_causes import (
    _is_rest,
    _refined,
    _step,
    _wave,
    constant_causes,
    fine_causes,
    sinusoids,
    steps,
    together,
    told,
)
from gse.diagnosis.session_model import ErrorSeries, SessionModel
from gse.diagnosis.turns import pole

SITE, MOUNT = SETTINGS[0]


def model_of(errors, frame_s=1.0):
    series = ErrorSeries(np.arange(len(errors)), frame_s * np.arange(len(errors)), np.asarray(errors))
    return SessionModel.from_series(series, None, SITE, MOUNT, is_fitted=False)


def tried(search, model):
    observed = model.observed()
    nothing = Predictions(np.zeros((3, 0)), np.zeros((*observed.cosines.shape, 0)), np.zeros((len(PARAMETERS), 0)))
    return list(search(model, observed, fitted(observed, nothing), nothing))


def stepped(count, place, *, noise=0.1):
    errors = noise * np.random.default_rng(1).normal(size=(count, 3))
    errors[place:] += [100.0, -50.0, 20.0]
    return errors


@pytest.mark.parametrize("place", range(1, 12))
def test_a_step_between_any_two_frames_of_a_short_session_is_tried_there(place):
    found = tried(steps, model_of(stepped(12, place)))
    assert (place, float(place)) in {(one.place, one.at_s) for one in found}
    assert {(one.cause, one.kind) for one in found} == {
        ("clock step", "clock step"),
        *(("slip of the mount", kind) for kind in ("azimuth", "altitude", "roll", "slip")),
    }


def test_a_step_of_a_long_session_is_tried_near_its_place_and_moved_to_it():
    model = model_of(stepped(9700, 5050))
    for one in tried(steps, model):
        assert abs(one.place - 5050) <= one.spacing == 100
        assert one.searched == 96
        assert one.moved(5050).at_s == 5050.0


def test_one_frame_has_no_step():
    model = model_of(stepped(12, 6))
    alone = replace(model, series=replace(model.series, time_s=np.zeros(1), errors_arcsec=np.zeros((1, 3))))
    assert list(steps(alone, None, None, None)) == []


@pytest.mark.parametrize("cycles", [1.0, 2.25, 5.0])
@pytest.mark.parametrize(("axis", "kind"), [(0, "columns"), (1, "rows")])
def test_a_swing_is_tried_with_its_period(cycles, axis, kind):
    time_s = 5.0 * np.arange(600)
    errors = 0.1 * np.random.default_rng(2).normal(size=(600, 3))
    errors[:, axis] += 40 * np.sin(2 * math.pi * cycles * time_s / time_s[-1] + 1.0)
    model = model_of(errors, 5.0)
    found = [one for one in tried(sinusoids, model) if one.kind == kind]
    assert all(one.columns.count == 2 for one in found)
    (right,) = [one for one in found if one.at_s == pytest.approx(time_s[-1] / cycles)]
    course, seen = right.columns.cosines.reshape(-1, 2), model.observed().cosines.ravel()
    left = seen - course @ np.linalg.lstsq(course, seen, rcond=None)[0]
    assert left @ left < 1e-3 * (seen @ seen)


def test_a_swing_is_not_faster_than_once_a_minute():
    errors = np.random.default_rng(3).normal(size=(179, 3))
    slow = {one.at_s for one in tried(sinusoids, model_of(errors))}
    assert min(slow) >= 59
    assert tried(sinusoids, model_of(errors[:59])) == []


@pytest.mark.parametrize("kind", ["clock step", "slip", "azimuth"])
def test_a_step_is_tried_as_an_error_from_then_on_and_as_one_until_then(kind):
    """Of twelve frames eight have it, or the other four have the opposite one."""
    means = [one.columns.mean for one in tried(steps, model_of(stepped(12, 4))) if (one.kind, one.place) == (kind, 4)]
    after, before = sorted(means, key=lambda mean: -np.abs(mean).max())
    assert after == pytest.approx(-2 * before)


@pytest.mark.parametrize(("cycles", "is_tried"), [(4.75, True), (5.5, False)])
def test_a_swing_is_not_faster_than_once_in_four_ordinates(cycles, is_tried):
    """Forty frames have twenty of them."""
    time_s = 120.0 * np.arange(40)
    errors = 0.1 * np.random.default_rng(4).normal(size=(40, 3))
    errors[:, 0] += 40 * np.sin(2 * math.pi * cycles * time_s / time_s[-1])
    periods_s = [one.at_s for one in tried(sinusoids, model_of(errors, 120.0))]
    assert (pytest.approx(time_s[-1] / cycles) in periods_s) is is_tried


# Steps and swings, by hand

PLAIN = SessionModel(
    ErrorSeries(np.arange(40), 3.0 * np.arange(40), np.zeros((40, 3))), None, SITE, MOUNT, False, np.eye(3)
)
"""Forty frames, 3 s apart, in the coordinates of their errors."""


def cosines_of(course):
    """The lowest half of scipy's transform, without the mean."""
    return scipy.fft.dct(course, axis=0, norm="ortho")[1:21]


@pytest.mark.parametrize(
    ("place", "first"),
    [(-5.0, 1), (0.0, 1), (0.6, 1), (1.0, 1), (1.6, 2), (20.4, 20), (38.6, 39), (39.0, 39), (40.0, 39), (900.0, 39)],
)
@pytest.mark.parametrize("is_before", [False, True])
def test_a_step_is_at_a_frame_after_the_first_and_up_to_the_last(place, first, is_before):
    """One of the azimuth, of an arcsec: from that frame on, or the opposite one until then."""
    found = _step(PLAIN, 7, "slip of the mount", "azimuth", is_before, place)
    assert (found.place, found.at_s, found.searched, found.is_change) == (first, 3.0 * first, 7, True)
    assert found.spacing == 40 / 97
    course = np.where(np.arange(40) >= first, 1.0, 0.0) - is_before
    shift = PLAIN.shift(np.array([0.0, 0.0, 1.0]))
    assert found.columns.mean[:, 0] == pytest.approx(course.mean() * shift)
    assert found.columns.cosines[:, :, 0] == pytest.approx(cosines_of(np.outer(course, shift)), abs=1e-9)
    moved = found.moved(17.0)
    assert (moved.place, moved.kind, moved.cause, moved.searched) == (17, "azimuth", "slip of the mount", 7)
    assert moved.columns.mean[:, 0] == pytest.approx((23 / 40 - is_before) * shift)


def test_a_step_of_the_clock_turns_the_sky_by_15_arcsec_a_second_and_a_slip_has_three_angles():
    clock = _step(PLAIN, 1, "clock step", "clock step", False, 20)
    about_pole = PLAIN.shift(np.array([0.0, math.cos(math.radians(-6.53)), math.sin(math.radians(-6.53))]))
    assert clock.columns.mean[:, 0] == pytest.approx(15.04107 / 2 * about_pole, rel=1e-5)
    slip = _step(PLAIN, 1, "slip of the mount", "slip", False, 20)
    assert slip.columns.count == 3
    for column, kind in ((1, "altitude"), (2, "roll")):
        alone = _step(PLAIN, 1, "slip of the mount", kind, False, 20).columns.mean[:, 0]
        assert slip.columns.mean[:, column] == pytest.approx(alone, abs=1e-9)


@pytest.mark.parametrize(("kind", "axes"), [("sinusoid", [0, 1]), ("columns", [0]), ("rows", [1])])
@pytest.mark.parametrize("cycles", [1.0, 2.25])
def test_a_swing_is_a_sine_and_a_cosine_along_each_axis(kind, axes, cycles):
    """Of so many cycles from the first frame to the last, 117 s later."""
    found = _wave(PLAIN, 9, kind, cycles)
    assert (found.cause, found.kind, found.searched, found.is_change) == ("thermal sinusoid", kind, 9, True)
    assert (found.place, found.spacing) == (cycles, 0.25)
    assert found.at_s == pytest.approx(117.0 / cycles)
    phase = 2 * np.pi * cycles * np.arange(40) / 39
    courses = [np.outer(wave, np.eye(3)[axis]) for axis in axes for wave in (np.sin(phase), np.cos(phase))]
    assert found.columns.count == len(courses)
    for column, course in enumerate(courses):
        assert found.columns.mean[:, column] == pytest.approx(course.mean(axis=0), abs=1e-12)
        assert found.columns.cosines[:, :, column] == pytest.approx(cosines_of(course), abs=1e-9)
    assert (found.moved(3.5).place, found.moved(3.5).kind, found.moved(3.5).searched) == (3.5, kind, 9)


@pytest.mark.parametrize(("count", "frame_s", "most"), [(40, 120.0, 5.0), (41, 120.0, 5.0), (400, 3.0, 19.75)])
def test_swings_are_tried_in_quarters_of_a_cycle_up_to_a_quarter_of_the_ordinates_and_one_a_minute(
    count, frame_s, most
):
    """20 ordinates; 1197 s are 19.95 minutes."""
    errors = 0.1 * np.random.default_rng(4).normal(size=(count, 3))
    errors[:, 0] += 40 * np.sin(2 * math.pi * most * np.arange(count) / (count - 1))
    found = tried(sinusoids, model_of(errors, frame_s))
    assert {one.searched for one in found} == {round(4 * (most - 1)) + 1}
    assert max(one.place for one in found) == most
    assert {one.kind for one in found} == {"sinusoid", "columns", "rows"}


@pytest.mark.parametrize("search", [steps, sinusoids])
def test_what_is_named_already_is_not_searched_for_again(search):
    """A step of 100 arcsec or a swing of it, beside a smaller one elsewhere: places are six or seven frames apart."""
    place = np.arange(600)
    if search is steps:
        great, small, shift, other = place >= 100, place >= 400, PLAIN.shift(pole(SITE)), 400
        named = functools.partial(_step, searched=1, cause="clock step", kind="clock step", is_before=False, place=100)
    else:
        great, small = (np.sin(2 * np.pi * cycles * place / 599) for cycles in (2.0, 5.0))
        shift, other = np.array([1.0, 0.0, 0.0]), 5.0
        named = functools.partial(_wave, searched=1, kind="columns", cycles=2.0)
    errors = 0.1 * np.random.default_rng(4).normal(size=(600, 3)) + np.outer(100.0 * great + 20.0 * small, shift)
    model = model_of(errors)
    observed, columns = model.observed(), named(model).columns
    places = {one.place for one in search(model, observed, fitted(observed, columns), columns)}
    assert all(abs(found - other) <= 7 * (search is steps) for found in places)


# What fine_causes makes of them


@pytest.mark.parametrize("place", [5050, 5037, 4961])
def test_a_step_is_moved_to_the_frame_where_it_is(place):
    """Places are tried a hundred frames apart."""
    model = model_of(stepped(9700, place))
    found = next(one for one in tried(steps, model) if one.kind == "slip")
    assert abs(found.place - place) > 5
    assert _refined(model.observed(), [], found).at_s == pytest.approx(place, abs=2)


def test_what_has_no_place_stays_as_it_is():
    model = model_of(stepped(12, 4))
    (constant, *_) = constant_causes(model)
    assert _refined(model.observed(), [], constant) is constant


@pytest.mark.parametrize(("size", "is_rest"), [(19.0, True), (21.0, False)])
def test_a_change_that_is_less_than_a_fifth_of_an_earlier_one_is_a_rest_of_it(size, is_rest):
    """No swing is quite a sinusoid."""
    time_s = np.arange(1200.0)
    errors = 0.5 * np.random.default_rng(5).normal(size=(1200, 3))
    for arcsec, cycles in ((100.0, 2.0), (40.0, 4.0), (size, 7.0)):
        errors[:, 0] += arcsec * np.sin(2 * math.pi * cycles * time_s / time_s[-1] + cycles)
    model = model_of(errors)
    great, middle, small = (_wave(model, 1, "columns", cycles) for cycles in (2.0, 4.0, 7.0))
    assert _is_rest(model.observed(), [great, middle], small) is is_rest
    assert _is_rest(model.observed(), [middle, great], small) is is_rest
    assert not _is_rest(model.observed(), [middle], small)
    assert not _is_rest(model.observed(), [], small)
    (constant, *_) = constant_causes(model)
    assert not _is_rest(model.observed(), [constant], small)
    assert not _is_rest(model.observed(), [great], constant)


def test_a_change_is_known_no_better_than_models_leave_open_however_quiet_the_frames_are():
    """A tenth of an arcsecond across the boresight, without stars that tell more of it."""
    model = model_of(stepped(1200, 600, noise=0.001))
    slip = _step(model, 1, "slip of the mount", "slip", False, 600)
    errors = told(model, model.observed(), [], slip, []).errors
    assert errors[:2] == pytest.approx(0.1, rel=0.05)


def wandering(seed, count=600, arcsec=3.0, memory_s=100.0):
    """Noise of 1 arcsec, and noise of the boresight that lasts."""
    rng, kept = np.random.default_rng(seed), math.exp(-1 / memory_s)
    errors, off = np.zeros((count, 3)), rng.normal(0, arcsec, 2)
    for row in errors:
        off = kept * off + arcsec * math.sqrt(1 - kept**2) * rng.normal(size=2)
        row[:2] = off
    return errors + rng.normal(0, 1, (count, 3))


@pytest.mark.parametrize("seed", [18, 19])
def test_slow_noise_that_looks_like_a_swing_is_none_since_slow_noise_is_left_beside_it(seed):
    assert fine_causes(model_of(wandering(seed))) == ()


def test_a_swing_is_named_in_slow_noise_too():
    errors = wandering(18)
    errors[:, 0] += 30 * np.sin(2 * math.pi * 3 * np.arange(600) / 600)
    assert [one.hypothesis.cause for one in fine_causes(model_of(errors))] == ["thermal sinusoid"]


def glared(seed, outliers, last):
    """Ten minutes with answers of false stars, some within them and the ``last`` frames."""
    rng = np.random.default_rng(seed)
    errors = rng.normal(0, (1.0, 1.0, 10.0), (600, 3))
    for frame in rng.integers(100, 500, outliers):
        errors[frame] += rng.normal(0, (20.0, 20.0, 250.0))
    errors[-last:] += [-25.0, 12.0, -444.0]
    return errors


@pytest.mark.parametrize(("seed", "outliers"), [(0, 6), (8, 12)])
@pytest.mark.parametrize(("last", "causes"), [(1, []), (12, ["slip of the mount"])])
@pytest.mark.parametrize("order", [1, -1])
def test_one_frame_at_an_end_of_the_session_is_no_slip_and_twelve_are(seed, outliers, last, causes, order):
    """A false star turns one answer by minutes of arc; a mount that slipped stays there."""
    errors = glared(seed, outliers, last)[::order]
    assert [one.hypothesis.cause for one in fine_causes(model_of(errors))] == causes


def test_three_causes_are_named_at_most():
    """Of four swings that are alike."""
    place = np.arange(240)
    errors = 0.5 * np.random.default_rng(8).normal(size=(240, 3))
    errors[:, 0] += sum(30 * np.sin(2 * math.pi * cycles * place / 239 + cycles) for cycles in (2, 5, 9, 14))
    causes = fine_causes(model_of(errors, 10.0))
    assert [one.hypothesis.cause for one in causes] == ["thermal sinusoid"] * 3


@pytest.mark.parametrize(("beyond", "causes"), [(-0.5, []), (0.5, ["altitude"])])
def test_a_cause_is_named_that_gains_what_noise_does_in_one_of_12500_sessions(beyond, causes):
    """An altitude that is off, in eighty frames: twice the logarithm of likelihood, whatever a column costs."""
    noise = 0.5 * np.random.default_rng(9).normal(size=(80, 3))
    noise -= noise.mean(axis=0)
    worth = float(scipy.stats.chi2.isf(0.002 / 25, 1))

    def off(arcsec):
        return model_of(noise + arcsec * PLAIN.shift(PLAIN.axes()["altitude"]))

    def gain(arcsec):
        model = off(arcsec)
        (altitude,) = (one for one in constant_causes(model) if one.kind == "altitude")
        nothing = together(model.observed(), [])
        with_it, without = (fitted(model.observed(), columns) for columns in (altitude.columns, nothing))
        return with_it.twice_log_likelihood - without.twice_log_likelihood

    arcsec = brentq(lambda arcsec: gain(arcsec) - worth - beyond, 0.1, 10.0)
    assert [one.hypothesis.kind for one in fine_causes(off(arcsec))] == causes
