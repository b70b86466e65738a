"""The coordinates in which causes compete for the errors of a session, and what is left open in them."""

import math

import numpy as np
import pytest
import scipy.fft

from gse.diagnosis.competing_models import Fitted
from gse.diagnosis.field_patterns import PARAMETERS, FieldOfErrors, StarErrors
from gse.diagnosis.session_model import ErrorSeries, SessionModel
from gse.values.mount import Mount
from gse.values.site import Site

SITE = Site(latitude_deg=48.0, longitude_deg=11.0)
MOUNT = Mount(azimuth_deg=130.0, altitude_deg=60.0, roll_deg=25.0)
COUNT = 40
"""Errors, of which twenty ordinates are used: the upper half are the 11th to the 20th."""


def series_of(errors, rows=None):
    rows = np.arange(len(errors)) if rows is None else rows
    return ErrorSeries(rows, rows.astype(float), np.asarray(errors, dtype=float))


def model_of(errors, *, field=None, is_fitted=False):
    return SessionModel.from_series(series_of(errors), field, SITE, MOUNT, is_fitted=is_fitted)


def plain(errors, *, field=None, is_fitted=False, rows=None):
    """In the coordinates of the errors themselves."""
    return SessionModel(series_of(errors, rows), field, SITE, MOUNT, is_fitted, np.eye(3))


def of_ordinates(ordinates):
    """Errors whose cosine transform is 0 and these."""
    return scipy.fft.idct(np.vstack([np.zeros(3), ordinates]), axis=0, norm="ortho")


def ordinates(seed=1):
    """Of white noise that is not alike on the axes, nor independent."""
    mixed = np.array([[2.0, 0.0, 0.0], [1.0, 0.5, 0.0], [0.0, 3.0, 40.0]])
    return np.random.default_rng(seed).normal(size=(COUNT - 1, 3)) @ mixed.T


def field_of(stars, *, freedom=50.0):
    """Normal equations of no meaning, with what single stars keep."""
    count = len(PARAMETERS)
    normal, right = np.diag(np.arange(1.0, count + 1)), np.arange(10.0, 10.0 + count)
    none = np.zeros((1, count, count))
    shifts = np.zeros((1, 3, count))
    return FieldOfErrors(
        normal, right, freedom, none, none[0], np.zeros(1, dtype=int), shifts, stars, np.zeros((1, 2, count)), 0.01
    )


def one_star(frames, phases, *, phase_arcsec=3.0):
    """A star that moves the boresight along columns by its error there, along rows by that along rows."""
    operators = np.zeros((len(frames), 3, 2))
    operators[:, 1, 0], operators[:, 0, 1] = -1.0, 1.0
    both = np.column_stack([phases, np.zeros(len(frames))]).astype(complex)
    star = np.zeros(len(frames), dtype=int)
    return StarErrors(frames, frames * 10**9, star, operators, np.zeros((len(frames), 2)), both, phase_arcsec)


# Coordinates


def test_in_its_coordinates_the_upper_half_of_the_ordinates_is_independent_and_of_variance_one():
    """Whatever the ordinates below it are."""
    of = ordinates()
    of[:10] *= 1e3
    model = model_of(of_ordinates(of))
    turned = of[10:20] @ model.decorrelate.T
    assert turned.T @ turned / 10 == pytest.approx(np.eye(3), abs=1e-4)
    assert np.triu(model.decorrelate, 1) == pytest.approx(0.0, abs=1e-12)


def test_an_axis_without_errors_counts_as_one_of_a_thousandth_of_an_arcsec():
    of = ordinates()
    of[:, 1] = 0.0
    assert model_of(of_ordinates(of)).decorrelate[1] == pytest.approx([0.0, 1000.0, 0.0], rel=1e-6)


def test_axes_that_err_alike_to_the_last_digit_are_told_apart_by_a_millionth_of_their_variance():
    """Their difference, of which nothing is seen, counts as one of a thousandth of their errors on each axis."""
    of = 1e3 * ordinates()
    of[:, 1] = of[:, 0]
    size = math.sqrt(np.mean(of[10:20, 0] ** 2))
    apart = model_of(of_ordinates(of)).decorrelate[1]
    assert apart == pytest.approx(np.array([-1.0, 1.0, 0.0]) / (1e-3 * size * math.sqrt(2)), rel=1e-4, abs=1e-9)


def test_columns_are_the_mean_of_a_course_and_its_cosines_in_the_coordinates_of_the_model():
    model = model_of(of_ordinates(ordinates()) + np.array([3.0, 4.0, 5.0]))
    courses = np.random.default_rng(2).normal(1.0, 2.0, (2, COUNT, 3))
    found = model.columns(*courses)
    assert found.count == 2
    for place, course in enumerate(courses):
        turned = course @ model.decorrelate.T
        assert found.mean[:, place] == pytest.approx(turned.mean(axis=0))
        assert found.cosines[:, :, place] == pytest.approx(scipy.fft.dct(turned, axis=0, norm="ortho")[1:21], abs=1e-9)
    assert found.field.tolist() == [[0.0, 0.0]] * len(PARAMETERS)
    shown = np.eye(len(PARAMETERS))[:, :2]
    assert model.columns(*courses, field=shown).field is shown


# What is observed


def test_errors_are_observed_with_their_mean_and_what_models_of_air_and_stars_leave_open():
    """0.3 arcsec across the boresight and 1 about it; a field that is not there tells nothing."""
    errors = of_ordinates(ordinates()) + np.array([3.0, 4.0, 5.0])
    model = model_of(errors)
    found, turned = model.observed(), errors @ model.decorrelate.T
    assert found.frames == COUNT
    assert found.mean == pytest.approx(turned.mean(axis=0))
    assert found.cosines == pytest.approx(scipy.fft.dct(turned, axis=0, norm="ortho")[1:21], abs=1e-9)
    back = np.linalg.inv(model.decorrelate)
    assert back @ found.lasting @ back.T == pytest.approx(np.diag([0.09, 0.09, 1.0]), abs=1e-9)
    assert found.normal.tolist() == np.eye(len(PARAMETERS)).tolist()
    assert found.right.tolist() == [0.0] * len(PARAMETERS)
    assert found.freedom == 0.0
    assert model.stars_freedom == 1.0


def test_a_mount_that_was_fitted_on_the_same_sky_leaves_every_mean_open():
    assert plain(np.zeros((COUNT, 3)), is_fitted=True).observed().lasting == pytest.approx(1e12 * np.eye(3))


@pytest.mark.parametrize("every", [1, 2])
def test_what_a_star_keeps_is_left_open_of_the_mean_by_its_share_in_every_frame_that_is_looked_at(every):
    """A star that stays on its place on a pixel, by 3 arcsec along columns, alone in its frames."""
    frames = np.arange(0, COUNT, every)
    field = field_of(one_star(frames, np.ones(len(frames))))
    model = plain(np.zeros((COUNT, 3)), field=field)
    found = model.observed()
    assert found.lasting == pytest.approx(np.diag([0.09 + 3.0**2, 0.09, 1.0]), abs=1e-9)
    assert found.normal is field.normal
    assert found.right is field.right
    assert found.freedom == 50.0
    assert model.stars_freedom == field.stars.freedom == 1.0


# What is left open of a change


def least_squares(columns, *, precision=1.0):
    """The fit in white noise of that precision."""
    flat = columns.cosines.reshape(-1, columns.count)
    covariance = np.linalg.inv(flat.T @ flat) / precision
    return Fitted(np.zeros(columns.count), covariance, 0.0, np.full(columns.cosines.shape[:2], precision))


def swing(cycles):
    """A wave of one arcsec that is one of the cosines: half of its square is in it."""
    return np.cos(2 * np.pi * cycles * (np.arange(COUNT) + 0.5) / COUNT)


@pytest.mark.parametrize(("axis", "open_arcsec"), [(0, 0.05), (1, 0.05), (2, 1 / 6)])
def test_a_sixth_of_what_models_leave_open_may_change_in_a_session(axis, open_arcsec):
    """Root mean square over the frames: of a wave the amplitude is greater by the root of two."""
    model = model_of(of_ordinates(ordinates()))
    columns = model.columns(np.outer(swing(3), np.eye(3)[axis]))
    found = model.left_open(columns, least_squares(columns), 1)
    assert found == pytest.approx(np.array([[2 * open_arcsec**2]]), rel=1e-9)


def test_only_the_last_coefficients_are_told():
    model = plain(np.zeros((COUNT, 3)))
    columns = model.columns(*(np.outer(swing(cycles), [1.0, 0.0, 0.0]) * cycles for cycles in (1, 2, 4)))
    found = model.left_open(columns, least_squares(columns), 2)
    assert found == pytest.approx(np.diag([2 * 0.05**2 / 4, 2 * 0.05**2 / 16]), abs=1e-12)


@pytest.mark.parametrize(("every", "first_row"), [(1, 0), (2, 0), (1, 7)])
@pytest.mark.parametrize("precision", [1.0, 0.25])
def test_a_star_whose_error_turns_over_with_a_change_leaves_twice_its_error_open(every, first_row, precision):
    """Minus 3 arcsec before a step at half of the session, 3 from then on: the step is known within 6."""
    rows = first_row + np.arange(COUNT)
    late = np.arange(COUNT) >= COUNT // 2
    looked_at = np.arange(0, COUNT, every)
    stars = one_star(rows[looked_at], np.where(late, 1.0, -1.0)[looked_at])
    model = plain(np.zeros((COUNT, 3)), field=field_of(stars), rows=rows)
    columns = model.columns(np.outer(late, [1.0, 0.0, 0.0]))
    without = SessionModel(model.series, None, SITE, MOUNT, False, np.eye(3))
    fit = least_squares(columns, precision=precision)
    by_star = model.left_open(columns, fit, 1) - without.left_open(columns, fit, 1)
    assert math.sqrt(by_star.item()) == pytest.approx(6.0, rel=1e-3 if every == 1 else 0.05)


def test_a_star_that_keeps_its_error_leaves_nothing_of_a_change_open():
    rows = np.arange(COUNT)
    model = plain(np.zeros((COUNT, 3)), field=field_of(one_star(rows, np.ones(COUNT))))
    columns = model.columns(np.outer(swing(2), [1.0, 0.0, 0.0]))
    assert model.left_open(columns, least_squares(columns), 1).item() == pytest.approx(2 * 0.05**2, rel=1e-9)
