"""Wahba's problem: accuracy, covariance and the answers that are refused."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from gse.values.attitude import Attitude, paper_mean, solve_attitude

ARCSEC = math.radians(1 / 3600)
ANGLES = st.tuples(
    st.floats(0, 360, exclude_max=True),
    st.one_of(st.floats(-90, 90), st.sampled_from([-90.0, 90.0])),
    st.floats(0, 360, exclude_max=True),
)


def field(rng: np.random.Generator, count: int, half_width_deg: float = 7.0) -> NDArray[np.float64]:
    """Unit vectors (count, 3) uniform over a square field about the boresight."""
    xy = rng.uniform(-1, 1, (count, 2)) * math.tan(math.radians(half_width_deg))
    return unit(np.column_stack([xy, np.ones(count)]))


def unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    result: NDArray[np.float64] = vectors / np.linalg.norm(vectors, axis=1)[:, None]
    return result


def noisy(rng: np.random.Generator, directions: NDArray[np.float64], sigma_rad: float) -> NDArray[np.float64]:
    return unit(directions + rng.normal(0, sigma_rad, directions.shape))


def rotation_vector(turn: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of a small rotation (3, 3)."""
    return np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2


@given(ANGLES, st.integers(2, 30), st.integers(0, 2**32 - 1))
def test_exact_directions_give_the_exact_attitude_everywhere(
    angles: tuple[float, float, float], count: int, seed: int
) -> None:
    true = Attitude.from_angles(*angles).icrs_to_sensor
    directions = field(np.random.default_rng(seed), count)
    solved = solve_attitude(directions, directions @ true, 10 * ARCSEC).icrs_to_sensor
    assert np.abs(solved - true).max() < 1e-4 * ARCSEC
    assert np.abs(solved @ solved.T - np.eye(3)).max() < 1e-14


@pytest.mark.parametrize("axis", range(3))
def test_turns_by_180_degrees_are_no_special_case(axis: int) -> None:
    true = -np.eye(3)
    true[axis, axis] = 1.0
    directions = field(np.random.default_rng(axis), 2)
    solved = solve_attitude(directions, directions @ true, 10 * ARCSEC).icrs_to_sensor
    assert np.abs(solved - true).max() < 1e-4 * ARCSEC


@pytest.mark.parametrize("count", [5, 10, 30])
def test_errors_stay_within_5_percent_of_the_cramer_rao_bound(count: int) -> None:
    rng = np.random.default_rng(count)
    true = Attitude.from_angles(83.0, -6.5, 200.0).icrs_to_sensor
    squared, bound = np.zeros(3), np.zeros(3)
    for _ in range(4000):
        directions = field(rng, count)
        solved = solve_attitude(noisy(rng, directions, 10 * ARCSEC), directions @ true, 10 * ARCSEC)
        squared += rotation_vector(solved.icrs_to_sensor @ true.T) ** 2
        bound += np.diag(np.linalg.inv(sum(np.eye(3) - np.outer(b, b) for b in directions)))
    ratio = np.sqrt(squared / (bound * (10 * ARCSEC) ** 2))
    assert (ratio < 1.05).all()
    assert (ratio > 0.95).all()


def test_the_covariance_says_how_large_the_errors_are() -> None:
    rng = np.random.default_rng(7)
    true = Attitude.from_angles(10.0, 80.0, 30.0).icrs_to_sensor
    directions = field(rng, 6)
    sigma = np.array([5.0, 10.0, 10.0, 20.0, 30.0, 60.0]) * ARCSEC
    errors = []
    for _ in range(6000):
        measured = unit(directions + rng.normal(size=(6, 3)) * sigma[:, None])
        solved = solve_attitude(measured, directions @ true, sigma)
        errors.append(rotation_vector(solved.icrs_to_sensor @ true.T) / np.sqrt(np.diag(solved.covariance_rad2)))
    assert np.abs(np.std(errors, axis=0) - 1).max() < 0.04


def test_a_better_star_weighs_more() -> None:
    true = np.eye(3)
    directions = field(np.random.default_rng(3), 8)
    measured = directions.copy()
    measured[0] = unit((measured[0] + [0.01, 0, 0])[None])[0]
    sigma = np.full(8, 10 * ARCSEC)
    sigma[0] *= 1000
    solved = solve_attitude(measured, directions, sigma).icrs_to_sensor
    assert np.abs(rotation_vector(solved @ true)).max() < 0.01 * ARCSEC


def test_what_does_not_fix_an_attitude_is_refused() -> None:
    one = np.array([[0.0, 0.0, 1.0]])
    with pytest.raises(ValueError, match="at least 2"):
        solve_attitude(one, one, ARCSEC)
    with pytest.raises(ValueError, match="parallel"):
        solve_attitude(np.vstack([one, one]), np.vstack([one, one]), ARCSEC)
    with pytest.raises(ValueError, match="one star per direction"):
        solve_attitude(np.eye(3), np.eye(3)[:2], ARCSEC)
    with pytest.raises(ValueError, match="not finite"):
        solve_attitude(np.full((3, 3), np.nan), np.eye(3), ARCSEC)
    with pytest.raises(ValueError, match="not finite"):
        solve_attitude(np.eye(3), np.full((3, 3), np.inf), ARCSEC)
    with pytest.raises(ValueError, match="sigma_rad"):
        solve_attitude(np.eye(3), np.eye(3), 0.0)
    with pytest.raises(ValueError, match="shape"):
        solve_attitude(np.eye(3)[:, :2], np.eye(3), ARCSEC)


@given(ANGLES, st.integers(0, 2**32 - 1))
def test_the_papers_mean_is_wahbas_boresight_at_the_poles_and_across_ra_0_too(
    angles: tuple[float, float, float], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    true = Attitude.from_angles(*angles).icrs_to_sensor
    directions = field(rng, 12)
    measured = noisy(rng, directions, 10 * ARCSEC)
    wahba = solve_attitude(measured, directions @ true, 10 * ARCSEC)
    mean = paper_mean(wahba, measured, directions @ true)
    turn = rotation_vector(mean.icrs_to_sensor @ wahba.icrs_to_sensor.T)
    assert np.abs(turn).max() < 0.2 * ARCSEC


def test_the_papers_mean_moves_to_where_its_stars_say() -> None:
    """With two stars off by d in the same sense, each centre moves by d, and so does their mean."""
    attitude = Attitude(np.eye(3), np.eye(3))
    stars = unit(np.array([[0.01, 0.0, 1.0], [-0.01, 0.0, 1.0]]))
    turn = np.array([[1.0, 0, 1e-4], [0, 1, 0], [-1e-4, 0, 1]])
    mean = paper_mean(attitude, unit(stars @ turn.T), stars)
    assert mean.boresight_icrs[0] == pytest.approx(-1e-4, rel=1e-3)
