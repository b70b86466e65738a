"""Stars in stretches of time and in frames: means by a dictionary, turns of frames by numpy's least squares."""

import tracemalloc

import numpy as np

from gse.values.star_influence import FrameFits, StarCells, star_covariance


def test_sightings_of_a_star_in_a_stretch_are_one_cell_also_before_the_first_stretch_and_of_star_zero() -> None:
    rng = np.random.default_rng(4)
    stars = rng.integers(0, 7, 400).astype(np.int32)
    blocks = rng.integers(-3, 5, 400)
    values = rng.normal(size=(400, 2))
    by_hand: dict[tuple[int, int], list[int]] = {}
    for row, cell in enumerate(zip(stars.tolist(), blocks.tolist(), strict=True)):
        by_hand.setdefault(cell, []).append(row)

    cells = StarCells.from_stars(stars, blocks)

    assert list(zip(cells.star.tolist(), cells.block.tolist(), strict=True)) == sorted(by_hand)
    for number, cell in enumerate(sorted(by_hand)):
        rows = by_hand[cell]
        assert set(cells.of_row[rows].tolist()) == {number}
        assert np.allclose(cells.means(values)[number], values[rows].mean(axis=0), rtol=1e-12)


def test_no_sighting_is_no_cell() -> None:
    none = np.empty(0, dtype=np.int64)
    assert len(StarCells.from_stars(none, none).star) == 0


def test_the_turns_of_frames_are_the_least_squares_fits_of_small_rotations_to_the_errors_of_their_stars() -> None:
    rng = np.random.default_rng(5)
    frames = np.repeat([2, 3, 7], [6, 2, 9])
    tangent = rng.uniform(-0.1, 0.1, (len(frames), 2))
    directions = np.column_stack([tangent, np.ones(len(frames))])
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    errors = rng.normal(size=(len(frames), 2, 4))

    fits = FrameFits.from_directions(directions, frames)
    turns = fits.turns(errors)

    assert fits.numbers.tolist() == [2, 3, 7]
    assert turns.shape == (3, 3, 4)
    assert (turns[1] == 0.0).all()  # two stars
    for place, number in ((0, 2), (2, 7)):
        (rows,) = np.nonzero(frames == number)
        across = -(directions[rows, :2, None] * errors[rows]).sum(axis=1) / directions[rows, 2:]
        whole = np.concatenate([errors[rows], across[:, None]], axis=1)  # no part along the line of sight
        # w x r = -[r]x w
        crosses = np.concatenate([-np.cross(r, np.eye(3)).T for r in directions[rows]])
        expected = np.linalg.lstsq(crosses, whole.reshape(-1, 4), rcond=None)[0]
        assert np.allclose(turns[place], expected, rtol=1e-9, atol=1e-9)
    by_operators = np.einsum("nij,njf->nif", fits.operators(), errors)
    assert np.allclose(turns[2], by_operators[frames == 7].sum(axis=0), rtol=1e-9, atol=1e-9)


def test_a_leap_of_the_clock_by_years_takes_no_more_memory_than_one_by_weeks_and_changes_no_covariance() -> None:
    """Two stretches of 20 blocks, each star in all of them: how far apart these two are has one row of its own."""
    rng = np.random.default_rng(6)
    stars, blocks = np.repeat(np.arange(8), 40), np.tile(np.arange(40), 8)
    operators, errors = rng.normal(size=(320, 3, 2)), rng.normal(size=(320, 2)) + rng.normal(size=(8, 2))[stars]

    def covariance(leap_blocks: int) -> np.ndarray:
        at = np.where(blocks < 20, blocks, blocks + leap_blocks)
        return star_covariance(operators, errors, stars, at, within_blocks=True)

    tracemalloc.start()
    years = covariance(20_000_000)
    _, most_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most_bytes < 32 << 20
    assert (years == covariance(30_000)).all()
    assert not np.allclose(years, covariance(0))
