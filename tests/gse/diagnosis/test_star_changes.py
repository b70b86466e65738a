"""A star with a lasting error that leaves the field: the boresight steps, and that is told from a slip."""

import numpy as np
import pytest

from gse.diagnosis.diagnosis import _Cells, sampled_matches, without_star_changes
from gse.diagnosis.session_model import ErrorSeries
from gse.station.session_tables import MATCH
from gse.values.camera import Camera
from gse.values.star_influence import attitude_operators, boresight_shifts

CAMERA = Camera(1024, 1024, 4000.0, (511.5, 511.5))
FRAMES, STARS = 40, 8


def night(errors_arcsec, gone, slip_arcsec=0.0):
    """Residuals and errors of frames with stars that stand still; star 0 is there in the first ``gone`` frames."""
    rng = np.random.default_rng(3)
    xy_px = rng.uniform(50, 970, (STARS, 2))
    rows, errors = [], np.zeros((FRAMES, 3))
    residuals = []
    for number in range(FRAMES):
        stars = np.arange(1 if number >= gone else 0, STARS)
        directions = CAMERA.directions(xy_px[stars])
        operators = attitude_operators(directions, np.zeros(len(stars), dtype=np.int64))
        turn = np.einsum("nij,nj->i", operators, errors_arcsec[stars])
        errors[number] = boresight_shifts(turn[None])[0]
        errors[number, 0] += slip_arcsec * (number >= FRAMES // 2)
        residuals.append(errors_arcsec[stars] - np.cross(turn, directions)[:, :2])
        rows += [(number, star, *xy_px[star]) for star in stars.tolist()]
    matches = np.zeros(len(rows), dtype=MATCH)
    for place, name in enumerate(("frame", "star", "x_px", "y_px")):
        matches[name] = [row[place] for row in rows]
    matches["named"] = True
    series = ErrorSeries(np.arange(FRAMES), np.arange(FRAMES) / 2, errors)
    return series, matches, np.concatenate(residuals)


def test_the_step_of_a_star_that_leaves_is_taken_away_and_a_slip_stays():
    lasting = np.zeros((STARS, 2))
    lasting[0] = 12.0, -8.0
    series, matches, residuals = night(lasting, 12, slip_arcsec=3.0)
    stepped = np.abs(series.errors_arcsec[11] - series.errors_arcsec[12])
    assert stepped[:2].max() > 1.0
    left = without_star_changes(series, sampled_matches(matches, series), residuals, CAMERA).errors_arcsec
    assert np.abs(left[11] - left[12])[:2].max() < 0.02 * stepped[:2].max()
    assert left[20, 0] - left[19, 0] == pytest.approx(3.0, abs=1e-9)
    assert left.mean(axis=0) == pytest.approx(series.errors_arcsec.mean(axis=0))


def test_stars_that_stay_change_nothing():
    lasting = np.random.default_rng(4).normal(0, 5, (STARS, 2))
    series, matches, residuals = night(lasting, FRAMES)
    left = without_star_changes(series, matches, residuals, CAMERA).errors_arcsec
    assert left == pytest.approx(series.errors_arcsec, abs=1e-9)


def passing(noise_arcsec, seed, lasting_arcsec=0.0):
    """A night of stars that each take 100 s through the field, one after the other; star 30 has a lasting error."""
    rng = np.random.default_rng(seed)
    rows, residuals, errors = [], [], np.zeros((600, 3))
    for number in range(len(errors)):
        stars = np.arange(number // 10, number // 10 + 10)
        xy_px = np.column_stack([10 * (number - 10.0 * stars) + 1000, 97 * stars % 1000])
        directions = CAMERA.directions(xy_px)
        operators = attitude_operators(directions, np.zeros(len(stars), dtype=np.int64))
        noise = rng.normal(0, noise_arcsec, (len(stars), 2))
        noise[stars == 30, 0] += lasting_arcsec
        turn = np.einsum("nij,nj->i", operators, noise)
        errors[number] = boresight_shifts(turn[None])[0]
        residuals.append(noise - np.cross(turn, directions)[:, :2])
        rows += [(number, star, *place) for star, place in zip(stars.tolist(), xy_px.tolist(), strict=True)]
    matches = np.zeros(len(rows), dtype=MATCH)
    for place, name in enumerate(("frame", "star", "x_px", "y_px")):
        matches[name] = [row[place] for row in rows]
    return ErrorSeries(np.arange(600), np.arange(600.0), errors), matches, np.concatenate(residuals)


def test_the_noise_of_stars_that_come_and_go_changes_next_to_nothing():
    """Whole means of the stars, not made smaller by their part of chance, changed 0.08 to 0.1 arcsec here."""
    for seed in (1, 2, 3):
        series, matches, residuals = passing(3.0, seed)
        left = without_star_changes(series, matches, residuals, CAMERA).errors_arcsec
        assert np.sqrt(((left - series.errors_arcsec)[:, :2] ** 2).mean()) < 0.02


def test_a_star_of_great_lasting_error_is_told_among_noise():
    plain, *_ = passing(1.0, 4)
    series, matches, residuals = passing(1.0, 4, lasting_arcsec=12.0)
    left = without_star_changes(series, matches, residuals, CAMERA).errors_arcsec
    stepped, rest = series.errors_arcsec - plain.errors_arcsec, left - plain.errors_arcsec
    assert stepped[:, 0].std() > 0.4
    assert rest[:, 0].std() < 0.5 * stepped[:, 0].std()


# By hand


def test_a_lasting_error_is_the_mean_of_a_star_as_far_as_it_is_more_than_chance():
    """Two stars in two stretches of time, of 5 and 7 arcsec to either side: means of 6.

    Two of four stretches are free, each with two axes: they scatter by 1 arcsec, and means of two by half of that
    square. The square of 6 on one of two axes is 18 on each, of which a half is chance: 17.5 of 18 are lasting.
    """
    cells = _Cells.from_stars(np.array([3, 3, 9, 9]), np.array([0, 4, 0, 4]))
    errors = np.array([[5.0, 0.0], [7.0, 0.0], [-5.0, 0.0], [-7.0, 0.0]])
    kept = np.array([6.0, 6.0, -6.0, -6.0]) * 17.5 / 18
    assert cells.lasting(errors) == pytest.approx(np.column_stack([kept, np.zeros(4)]))


def test_a_star_of_more_stretches_is_known_better():
    """Means of 6 and of 8: 3 x 36 and 1 x 64 are 86 on each axis of four stretches, the chance of two stars is 2.

    The three differ by -1, 0 and 1 on both axes: four over two times two is 1. 84 / 4 is lasting, of three stretches
    with a third of chance, of one with the whole.
    """
    cells = _Cells.from_stars(np.array([3, 3, 3, 3, 9]), np.array([0, 1, 2, 2, 0]))
    x = np.array([5.0, 6.0, 6.5, 7.5, 8.0])
    found = cells.lasting(np.column_stack([x, x - [6.0, 6.0, 6.0, 6.0, 8.0]]))
    assert found[:, 0] == pytest.approx([6 * 21 / (21 + 1 / 3)] * 4 + [8 * 21 / 22])
    assert found[:, 1] == pytest.approx(np.zeros(5))


@pytest.mark.parametrize("blocks", [[0, 0, 0, 0], [0, 1, 0, 1]])
def test_what_is_chance_or_was_seen_in_one_stretch_alone_is_kept_of_no_star(blocks):
    """Means of a half, which chance makes as well."""
    cells = _Cells.from_stars(np.array([3, 3, 9, 9]), np.array(blocks))
    errors = np.array([[1.5, 0.0], [-0.5, 0.0], [-1.5, 0.0], [0.5, 0.0]])
    assert cells.lasting(errors).tolist() == np.zeros((4, 2)).tolist()


@pytest.mark.parametrize(("count", "every"), [(0, 1), (20, 1), (40_000, 1), (40_001, 2), (80_000, 2), (80_001, 3)])
def test_of_more_than_forty_thousand_matches_those_of_every_second_or_third_frame_are_taken(count, every):
    """Twenty of each frame; others that no answer names, or of frames without an error, do not count."""
    series = ErrorSeries(np.arange(0, 8100, 2), np.arange(4050.0), np.zeros((4050, 3)))
    matches = np.zeros(count + 200, dtype=MATCH)
    matches["frame"], matches["named"] = np.arange(count + 200) // 20 * 2, True
    matches["frame"][count:] = 8001
    matches["frame"][count + 100 :] = 8000
    matches["named"][count + 100 :] = False
    frames = np.arange(count) // 20
    assert sampled_matches(matches, series)["frame"].tolist() == (2 * frames[frames % every == 0]).tolist()
