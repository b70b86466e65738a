"""The errors of a session over time: what a long session keeps of them when neighbours are taken together."""

import numpy as np
import pytest
import scipy.fft
from scipy.spatial.transform import Rotation

from gse.diagnosis.session_model import (
    MOST_INSTANTS,
    ErrorSeries,
    _rotation_vectors,
    error_series,
    often_answered,
    with_left_out,
)
from gse.station.columns import FRAME
from gse.station.session_tables import MATCH
from gse.values.camera import Camera
from gse.values.star_influence import boresight_shifts


def series_of(count: int, errors_arcsec: np.ndarray, *, frame_s: float = 0.1) -> ErrorSeries:
    return ErrorSeries(np.arange(count), np.arange(count) * frame_s, errors_arcsec)


def test_a_short_session_is_left_as_it_is():
    series = series_of(MOST_INSTANTS, np.random.default_rng(1).normal(0, 5, (MOST_INSTANTS, 3)))
    shortened = series.shortened()
    np.testing.assert_array_equal(shortened.errors_arcsec, series.errors_arcsec)
    np.testing.assert_array_equal(shortened.rows, series.rows)


@pytest.mark.parametrize("count", [MOST_INSTANTS + 1, 3 * MOST_INSTANTS, 100_003])
def test_a_long_session_keeps_its_mean_its_drift_and_the_time_of_a_step(count):
    time_s = np.arange(count) * 0.1
    step_s = float(time_s[count // 3])
    errors = np.column_stack([np.full(count, 7.0), 0.01 * time_s, 20.0 * (time_s >= step_s)])
    shortened = series_of(count, errors).shortened()
    assert len(shortened.rows) == MOST_INSTANTS
    steps = np.diff(shortened.rows)
    assert shortened.rows[0] == 0
    assert 0 <= steps.max() - steps.min() <= 1
    np.testing.assert_allclose(shortened.errors_arcsec[:, 0], 7.0)
    np.testing.assert_allclose(shortened.errors_arcsec[:, 1], 0.01 * shortened.time_s)
    within_s = shortened.time_s[np.flatnonzero(shortened.errors_arcsec[:, 2] > 10)[0]]
    assert abs(within_s - step_s) <= 2 * count / MOST_INSTANTS * 0.1
    assert shortened.duration_s == pytest.approx(time_s[-1], rel=2 / MOST_INSTANTS * count / MOST_INSTANTS + 1e-4)


def test_a_slow_cause_stands_out_of_the_noise_as_before():
    count = 5 * MOST_INSTANTS
    rng = np.random.default_rng(2)
    slow = 3.0 * np.cos(np.pi * 4 * (np.arange(count) + 0.5) / count)
    series = series_of(count, np.column_stack([slow, slow, slow]) + rng.normal(0, 10, (count, 3)))
    for one in (series, series.shortened()):
        cosines = one.cosines(one.errors_arcsec)
        noise = cosines[64:].std(axis=0)
        np.testing.assert_allclose(cosines[3] / noise, 3.0 / 10 * np.sqrt(count / 2), rtol=0.25)


def test_frames_that_are_answered_now_and_then_are_left_out_after_a_stretch_of_answers():
    used = np.concatenate([np.ones(200, dtype=bool), np.arange(100) % 5 == 0])
    kept = often_answered(used)
    assert kept[:190].all()
    assert not kept[215:].any()


@pytest.mark.parametrize("used", [np.arange(300) % 5 == 0, np.zeros(0, dtype=bool), np.ones(8, dtype=bool)])
def test_a_session_that_is_answered_now_and_then_throughout_keeps_what_it_has(used):
    assert often_answered(used).tolist() == used.tolist()


def test_weights_against_cosines_are_their_transpose():
    rng = np.random.default_rng(5)
    series = series_of(700, rng.normal(0, 5, (700, 3)))
    ordinates = rng.normal(0, 1, (series.ordinates, 2))
    expected = np.einsum("kp,ka->pa", ordinates, series.cosines(series.errors_arcsec))
    weights = series.against_cosines(ordinates)
    assert np.einsum("mp,ma->pa", weights, series.errors_arcsec) == pytest.approx(expected, abs=1e-9)


# By hand


@pytest.mark.parametrize(("count", "ordinates"), [(40, 20), (41, 20), (255, 127), (256, 128), (257, 128), (5000, 128)])
def test_half_as_many_ordinates_are_used_as_there_are_errors_at_most_128(count, ordinates):
    series = series_of(count, np.zeros((count, 3)))
    assert series.ordinates == ordinates
    assert series.cosines(series.errors_arcsec).shape == (ordinates, 3)


@pytest.mark.parametrize("count", [40, 255, 1000, 1024])
def test_the_ordinates_are_those_of_scipys_cosine_transform_without_the_mean(count):
    errors = np.random.default_rng(3).normal(5.0, 2.0, (count, 3))
    series = series_of(count, errors)
    expected = scipy.fft.dct(errors, axis=0, norm="ortho")[1 : series.ordinates + 1]
    assert series.cosines(errors) == pytest.approx(expected, abs=1e-9)


def test_a_longer_session_is_transformed_by_1024_blocks():
    """Two errors to each of them, at its middle: the 10th cosine loses 1 in 10 000 000, the 128th 1 in 800."""
    place = (np.arange(2048) + 0.5) / 2048
    for order, lost in ((10, 1e-4), (128, 5e-3)):
        series = series_of(2048, np.cos(np.pi * order * place)[:, None] * [1.0, 0.0, 0.0])
        found = series.cosines(series.errors_arcsec)
        assert found[order - 1, 0] == pytest.approx(np.sqrt(1024), rel=lost)
        assert np.abs(np.delete(found[:, 0], order - 1)).max() < 1e-6


def test_8192_errors_are_kept_of_a_long_session():
    assert MOST_INSTANTS == 8192
    assert len(series_of(8192, np.zeros((8192, 3))).shortened().rows) == 8192
    assert len(series_of(9000, np.zeros((9000, 3))).shortened().rows) == 8192


def test_the_duration_is_from_the_first_to_the_last():
    series = ErrorSeries(np.arange(4), np.array([2.0, 3.0, 5.0, 11.5]), np.zeros((4, 3)))
    assert series.duration_s == 9.5


@pytest.mark.parametrize(
    ("neighbours", "is_kept"),
    [
        ([-15, -14, -13, -12, -11, -10, -9, 9, 10, 11, 12, 13, 14, 15], False),
        ([-15, -14, -13, -12, -11, -10, -9, 1, 9, 10, 11, 12, 13, 14, 15], True),
        ([-16, -15, -14, -13, -12, -11, -10, -9, 9, 10, 11, 12, 13, 14, 15, 16], False),
    ],
    ids=["15 of 31", "16 of 31", "others are no neighbours"],
)
def test_half_of_a_frame_and_the_fifteen_before_and_after_it_are_used(neighbours, is_kept):
    used = np.zeros(500, dtype=bool)
    used[:200] = True
    used[[300, *(300 + one for one in neighbours)]] = True
    assert often_answered(used)[300] == is_kept


@pytest.mark.parametrize(("others", "is_kept"), [(6, False), (7, True)])
def test_the_first_and_the_last_frame_have_fifteen_neighbours(others, is_kept):
    used = np.zeros(500, dtype=bool)
    used[100:300] = True
    used[[0, *range(15, 15 - others, -1)]] = True
    assert often_answered(used)[0] == is_kept
    assert often_answered(used[::-1])[-1] == is_kept


@pytest.mark.parametrize(("single", "are_left_out"), [(40, True), (41, False)])
def test_single_answers_are_left_out_where_they_are_no_more_than_half(single, are_left_out):
    used = np.zeros(3000, dtype=bool)
    used[:40] = True
    used[100 : 100 + 40 * single : 40] = True
    assert often_answered(used).sum() == (40 if are_left_out else 40 + single)


def frames_of(count, *, seed=4):
    """Rows of FRAME in no order of time, with errors of some arcsec."""
    rng = np.random.default_rng(seed)
    frames = np.zeros(count, dtype=FRAME)
    frames["utc_ns"] = 10**18 + rng.permutation(count) * 5 * 10**8
    for name in ("cross_x", "cross_y", "d_roll"):
        frames[f"{name}_arcsec"] = rng.normal(0, 20, count)
    return frames


def test_errors_are_those_of_the_frames_in_the_order_of_time_with_seconds_from_the_first():
    frames, used = frames_of(40), np.ones(40, dtype=bool)
    frames["d_roll_arcsec"][7], used[11] = np.nan, False
    found = error_series(frames, used)
    kept = [row for row in np.argsort(frames["utc_ns"]) if row not in (7, 11)]
    assert found.rows.tolist() == kept
    since = frames["utc_ns"][kept] - frames["utc_ns"][kept].min()
    assert found.time_s == pytest.approx(since / 1e9)
    for axis, name in enumerate(("cross_x", "cross_y", "d_roll")):
        assert found.errors_arcsec[:, axis] == pytest.approx(frames[f"{name}_arcsec"][kept], abs=0.01)


@pytest.mark.parametrize(("count", "is_told"), [(19, False), (20, True)])
def test_twenty_errors_are_needed(count, is_told):
    assert (error_series(frames_of(count), np.ones(count, dtype=bool)) is not None) is is_told


def test_great_turns_are_rotation_vectors_of_first_the_boresight_and_then_about_it():
    """About z by 90 deg after about x by 90 deg: a third of a turn about the space diagonal."""
    third = 2 * np.pi / 3 / np.sqrt(3)
    found = _rotation_vectors(np.array([0.0]), np.array([np.pi / 2]), np.array([np.pi / 2]))
    assert found[0] == pytest.approx([third, third, third])
    found = _rotation_vectors(np.array([-np.pi / 2]), np.array([0.0]), np.array([np.pi / 2]))
    assert found[0] == pytest.approx([-third, third, third])


@pytest.mark.parametrize("size_rad", [0.0, 1e-9, 1e-4, 1e-2, 1.0, 3.0])
def test_turns_are_as_scipy_has_them(size_rad):
    x, y, roll = size_rad * np.random.default_rng(3).uniform(-1, 1, size=(3, 100))
    none = np.zeros(100)
    about = Rotation.from_rotvec(np.column_stack([none, none, roll]))
    turns = about * Rotation.from_rotvec(np.column_stack([y, -x, none]))
    assert _rotation_vectors(x, y, roll) == pytest.approx(turns.as_rotvec(), rel=1e-12, abs=1e-14 * size_rad)


def test_more_turns_than_are_made_at_once_are_made_all():
    angles = 1e-6 * np.random.default_rng(1).normal(size=(3, (1 << 14) + 5))
    found = _rotation_vectors(*angles)
    assert boresight_shifts(found) == pytest.approx(angles.T, abs=1e-10)


CAMERA = Camera(1024, 1024, 4000.0, (511.5, 511.5))
TURN = np.array([3.0, -2.0, 40.0])
"""In arcsec; a boresight moves by -y along columns and by x along rows."""


def turned_stars(frames, *, named=6, others=4, turn=TURN):
    """Rows of MATCH: stars that are all off by one turn of each frame, of which an answer names some."""
    count = named + others
    xy_px = np.random.default_rng(8).uniform(50, 970, (count, 2))
    residuals = np.cross(turn, CAMERA.directions(xy_px))[:, :2]
    matches = np.zeros(len(frames) * count, dtype=MATCH)
    matches["frame"] = np.repeat(frames, count)
    for place, name in enumerate(("x", "y")):
        matches[f"{name}_px"] = np.tile(xy_px[:, place], len(frames))
        matches[f"residual_{name}_arcsec"] = np.tile(residuals[:, place], len(frames))
    matches["named"] = np.tile(np.arange(count) < named, len(frames))
    return matches


def test_the_stars_that_answers_left_out_move_the_errors_by_the_turn_that_all_stars_show():
    errors = np.random.default_rng(9).normal(0, 5, (30, 3))
    series = series_of(30, errors)
    found = with_left_out(series, turned_stars(np.arange(40)), CAMERA)
    assert found.errors_arcsec == pytest.approx(errors + np.array([2.0, 3.0, 40.0]), abs=1e-3)
    assert found.time_s is series.time_s


def test_between_frames_with_rows_their_turns_are_linear():
    series = series_of(30, np.zeros((30, 3)))
    matches = np.concatenate([turned_stars([10]), turned_stars([20], turn=3 * TURN)])
    found = with_left_out(series, matches, CAMERA).errors_arcsec
    assert found[[0, 10, 15, 20, 29]] == pytest.approx(np.outer([1, 1, 2, 3, 3], [2.0, 3.0, 40.0]), abs=1e-3)


@pytest.mark.parametrize(("times", "is_sound"), [(4.9, True), (5.1, False)])
def test_a_star_that_was_left_out_for_its_error_stays_out_beyond_five_times_the_median(times, is_sound):
    """A named one is never out."""
    series, matches = series_of(30, np.zeros((30, 3))), turned_stars(np.arange(30))
    for star, counts in ((9, is_sound), (0, True)):
        wild = matches.copy()
        wild["residual_x_arcsec"][star::10], wild["residual_y_arcsec"][star::10] = 1e6, 0.0
        median = float(np.median(np.hypot(wild["residual_x_arcsec"], wild["residual_y_arcsec"])))
        wild["residual_x_arcsec"][star::10] = times * median
        found = with_left_out(series, wild, CAMERA).errors_arcsec
        assert bool(np.abs(found - [2.0, 3.0, 40.0]).max() > 0.01) is counts


@pytest.mark.parametrize("frames", [range(30), range(30, 60), []], ids=["named", "of other frames", "none"])
def test_errors_stay_where_no_star_was_left_out(frames):
    series = series_of(30, np.zeros((30, 3)))
    others = 4 if len(frames) and frames[0] >= 30 else 0
    assert with_left_out(series, turned_stars(np.array(frames, dtype=int), others=others), CAMERA) is series
