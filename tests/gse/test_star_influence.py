"""Stars in stretches of time: cells and their means, by a dictionary."""

import numpy as np

from gse.star_influence import StarCells


def test_sightings_of_a_star_in_a_stretch_are_one_cell_also_before_the_first_stretch_and_of_star_zero() -> None:
    rng = np.random.default_rng(4)
    stars = rng.integers(0, 7, 400).astype(np.int32)
    blocks = rng.integers(-3, 5, 400)
    values = rng.normal(size=(400, 2))
    by_hand: dict[tuple[int, int], list[int]] = {}
    for row, cell in enumerate(zip(stars.tolist(), blocks.tolist(), strict=True)):
        by_hand.setdefault(cell, []).append(row)

    cells = StarCells.of(stars, blocks)

    assert list(zip(cells.star.tolist(), cells.block.tolist(), strict=True)) == sorted(by_hand)
    for number, cell in enumerate(sorted(by_hand)):
        rows = by_hand[cell]
        assert set(cells.of_row[rows].tolist()) == {number}
        assert np.allclose(cells.means(values)[number], values[rows].mean(axis=0), rtol=1e-12)


def test_no_sighting_is_no_cell() -> None:
    none = np.empty(0, dtype=np.int64)
    assert len(StarCells.of(none, none).star) == 0
