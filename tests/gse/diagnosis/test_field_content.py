"""What a field of stars makes of the noise of each, by sums over a few stars."""

import math

import numpy as np
import pytest
from skies.known_nights import session

from gse.diagnosis.field_content import SeenStars, field_content, share_error
from gse.station.columns import ANSWER_CHECKS
from gse.station.results import AnswerCheck
from gse.statistics.counted_frames import counted_frames

FOCAL_PX, CENTRE_PX = 4169.905, 511.5
SIDE_PX = 200.0
LINE = tuple((CENTRE_PX - SIDE_PX, CENTRE_PX + 40.0 * k) for k in (-5, -3, -1, 1, 3, 5))
"""Six stars on one column, left of the middle and about it."""
FRAMES = 80
"""One a second: eight stretches of time of ten frames."""


def night(places=LINE, *, roll_deg=0.0, residual=lambda frame, star: (0.0 * frame, 0.0 * frame)):
    made = session(FRAMES, step_s=1.0, noise=0.0, matches=tuple((x, y, 0.0, 0.0) for x, y in places))
    made.frames.columns["roll_true_deg"] = roll_deg
    matches = made.frames.matches
    x, y = residual(matches["frame"].astype(float), matches["star"])
    matches["residual_x_arcsec"], matches["residual_y_arcsec"] = x, y
    return made


def content_of(made):
    return field_content(made, counted_frames(made).false)


def along_and_across(count=6):
    """By hand, of small angles: a boresight beside a line of stars goes along it with what turns about them leave."""
    lever = SIDE_PX**2 / (40.0**2 * 2 * (1 + 9 + 25))
    return math.sqrt(1 / count), math.sqrt(1 / count + lever)


@pytest.mark.parametrize(("roll_deg", "is_north"), [(0.0, True), (180.0, True), (90.0, False), (-90.0, False)])
def test_an_arcsec_of_each_star_is_one_over_the_root_of_their_number_and_more_where_they_stand_aside(
    roll_deg, is_north
):
    """Image up is north where the roll is 0; a turn about a line that is beside the middle moves that along rows."""
    found = content_of(night(roll_deg=roll_deg))
    plain, levered = along_and_across()
    de, ra = (levered, plain) if is_north else (plain, levered)
    assert found["d_ra_cosde"].geometry == pytest.approx(ra, rel=0.01)
    assert found["d_de"].geometry == pytest.approx(de, rel=0.01)


@pytest.mark.parametrize(("roll_deg", "ra_share"), [(45.0, 0.5), (30.0, 0.25), (60.0, 0.75)])
def test_both_axes_share_what_is_along_columns_and_rows_by_the_roll(roll_deg, ra_share):
    found = content_of(night(roll_deg=roll_deg))
    plain, levered = (one**2 for one in along_and_across())
    ra, de = (found[axis].geometry ** 2 for axis in ("d_ra_cosde", "d_de"))
    assert ra == pytest.approx((1 - ra_share) * plain + ra_share * levered, rel=0.02)
    assert de == pytest.approx(ra_share * plain + (1 - ra_share) * levered, rel=0.02)


@pytest.mark.parametrize(
    ("roll_deg", "ra_px", "de_px"),
    [
        (0.0, 100.0, 200.0),
        (30.0, 186.60, 123.21),
        (-30.0, 13.40, 223.21),
        (120.0, 123.21, 186.60),
        (90.0, 200.0, 100.0),
    ],
)
def test_stars_that_stand_aside_and_below_move_the_boresight_across_the_line_to_them(roll_deg, ra_px, de_px):
    """A turn about stars that stand 200 px left and 100 px below moves it by 100 px right and 200 px down, or back.

    East of that are 100 cos + 200 sin of the roll, north 200 cos - 100 sin.
    """
    aside = tuple((x, y + 100.0) for x, y in LINE)
    found = content_of(night(aside, roll_deg=roll_deg))
    for axis, lever_px in (("d_ra_cosde", ra_px), ("d_de", de_px)):
        expected = 1 / 6 + lever_px**2 / (40.0**2 * 2 * (1 + 9 + 25))
        assert found[axis].geometry ** 2 == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize(("stars", "is_told"), [(4, False), (5, True)])
def test_five_stars_are_needed(stars, is_told):
    assert set(content_of(night(LINE[:stars]))) == ({"d_ra_cosde", "d_de"} if is_told else set())


def test_errors_that_stay_with_each_star_are_left_in_the_bias():
    """3 arcsec to and fro, 12 by 6 / 4.5 in the square of them before the fit; an eighth is within one stretch."""
    found = content_of(night(residual=lambda frame, star: (3.0 * (-1.0) ** star, 3.0 * (-1.0) ** (star // 2))))
    for one in found.values():
        before_fit = 3.0 * math.sqrt(6 / 4.5)
        assert one.bias_error_arcsec == pytest.approx(one.geometry * before_fit * math.sqrt(7 / 8), rel=1e-6)
        assert (one.noise_error_share, one.spread_error_share) == (0.0, 0.0)


def test_noise_of_every_frame_leaves_nothing_in_the_bias_and_tells_itself_to_one_over_the_root_of_twice_the_frames():
    """The errors of the stars about their means of ten seconds, less the turn that fits those of a frame best."""
    noise = np.random.default_rng(2).normal(size=(8, 10, 6, 2))
    noise -= noise.mean(axis=1, keepdims=True)
    x, y = (np.array(LINE).T - CENTRE_PX) / FOCAL_PX
    zeros, ones = np.zeros(6), np.ones(6)
    turns = np.stack([np.column_stack([zeros, ones, -y]), np.column_stack([-ones, zeros, x])], axis=1).reshape(12, 3)
    left = noise.reshape(FRAMES, 12) @ (np.eye(12) - turns @ np.linalg.pinv(turns))
    found = content_of(night(residual=lambda frame, star: left.reshape(FRAMES, 6, 2)[frame.astype(int), star].T))
    for one in found.values():
        assert one.bias_error_arcsec == pytest.approx(0.0, abs=1e-3)
        for share in (one.noise_error_share, one.spread_error_share):
            assert share == pytest.approx(1 / math.sqrt(2 * FRAMES), rel=0.3)


def test_errors_that_change_from_one_stretch_of_time_to_the_next_are_in_the_spread_alone():
    """Ten seconds each: eight values tell their spread much worse than eighty do."""
    step = np.random.default_rng(3).normal(size=(8, 6, 2))
    found = content_of(night(residual=lambda frame, star: step[(frame // 10).astype(int), star].T))
    for one in found.values():
        assert one.noise_error_share == pytest.approx(0.0, abs=1e-6)
        assert one.spread_error_share > 0.15


def test_frames_without_a_truth_false_answers_and_stars_that_no_answer_names_do_not_count():
    """Those that are left are of five stars of the line, and of the last forty frames."""
    made = night()
    frames, matches = made.frames.columns, made.frames.matches
    frames["roll_true_deg"][:20] = np.nan
    frames["answer_check"][20:40] = ANSWER_CHECKS.index(AnswerCheck.FALSE)
    matches["named"][matches["star"] == 5] = False
    matches["residual_x_arcsec"][matches["frame"] < 40] = 1000.0
    found = content_of(made)
    # the middle is a fifth of the line's half away from that of the stars: a turn about them moves it along too
    assert found["d_ra_cosde"].geometry == pytest.approx(math.sqrt(1 / 5 + 1 / (16 + 4 + 0 + 4 + 16)), rel=0.01)
    assert found["d_ra_cosde"].bias_error_arcsec == 0.0
    frames["roll_true_deg"] = np.nan
    assert content_of(made) == {}


@pytest.mark.parametrize(
    ("sizes", "alone", "variance", "whole"),
    [
        # Squares are 4 of each: twice what is expected of a star, 12 over 6, is 2; pairs are 2 (0 + 2 / 4 of 4)
        ((1.0, 1.0, 1.0), None, 2 * 6 * 4.0**2, 2.0 * 12),
        # 4, 8 and 12 differ from their mean by 4, twice that counts; a half more of three stars; pairs are 2 (0 + 4)
        ((1.0, 2.0, 3.0), None, 3 / 2 * 2 * 8.0**2 + 2 * 6 * 8.0**2, 4.0 * 12),
        # A star of which the fit takes all counts as if a tenth were left: ten times 0.6. The others lose 0.1 each
        ((1.0, 1.0, 1.0), 0.6, 4 / 3 * (3 * 0.4**2 + 6.0**2) + 2 * 6 * 4.2**2, 2.1 * 16),
    ],
)
def test_the_error_of_a_root_mean_square_is_that_of_stars_and_of_pairs_of_them(sizes, alone, variance, whole):
    """Three stars at right angles to each other in four frames, whose errors across the middle make a combination.

    A fit of them takes half of the square of each, and a quarter of it in common with each of the two others. Their
    errors go to and fro so that no two of them do so together. ``alone`` is the square of one in a frame of its own,
    which counts four times as much.
    """
    turn = 2 * np.pi / 3 * np.arange(3)
    directions = np.column_stack([np.cos(turn) * 2, np.sin(turn) * 2, np.full(3, math.sqrt(2))]) / math.sqrt(6)
    across = np.column_stack([-np.sin(turn), np.cos(turn)])
    course = np.sqrt(sizes) * np.array([[1, 1, 1], [1, -1, 1], [1, 1, -1], [1, -1, -1]])
    operators, residuals = np.tile(across, (4, 1)), course.reshape(-1, 1) * np.tile(across, (4, 1))
    seen = SeenStars(np.tile(directions, (4, 1)), np.tile([5, 6, 9], 4), np.repeat(np.arange(4), 3))
    if alone is not None:
        operators, residuals = np.vstack([operators, [2.0, 0.0]]), np.vstack([residuals, [math.sqrt(alone) / 2, 0.0]])
        one = np.vstack([seen.directions, [0.0, 0.0, 1.0]])
        seen = SeenStars(one, np.append(seen.stars, 12), np.append(seen.frames, 7))
    assert share_error(operators, residuals, seen) == pytest.approx(math.sqrt(variance) / 2 / whole)
