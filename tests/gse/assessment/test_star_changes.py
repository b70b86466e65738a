"""A star with a lasting error that leaves the field: the boresight steps, and that is told from a slip."""

import numpy as np
import pytest

from gse.assessment.error_series import ErrorSeries
from gse.assessment.star_changes import sampled_matches, without_star_changes
from gse.camera import Camera
from gse.star_influence import attitude_operators, boresight_shifts
from gse.station.frame_table import MATCH

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
