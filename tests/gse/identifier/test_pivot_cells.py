import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gse.catalog import load_catalog
from gse.identifier.pivot import Cells
from gse.values.spiral import spiral_directions

FIELDS_DEG = st.floats(1.0, 179.0)


def direction(ra_deg, de_deg):
    ra, de = math.radians(ra_deg), math.radians(de_deg)
    return np.array([[math.cos(de) * math.cos(ra), math.cos(de) * math.sin(ra), math.sin(de)]])


def centres(cells):
    """Eqs 3-5: where the centre of each cell lies, as (colatitude, right ascension)."""
    order = cells.order
    for n in range(order + 1):
        height = math.pi / (2 * order + 1)
        colatitude = n * height if n % 2 == 0 else math.pi - n * height
        for j in range(2 * n + 1):
            yield n**2 + j, colatitude, 2 * math.pi * j / (2 * n + 1)


def test_a_field_of_8_deg_makes_529_cells():
    cells = Cells.for_field(math.radians(8))
    assert (cells.order, len(cells)) == (22, 529)


@given(FIELDS_DEG, st.floats(0, 360), st.floats(-90, 90))
def test_every_star_is_in_exactly_one_cell(field_deg, ra_deg, de_deg):
    cells = Cells.for_field(math.radians(field_deg))
    index = cells.index(direction(ra_deg, de_deg))
    assert index.shape == (1,)
    assert 0 <= index[0] < len(cells)


@given(st.floats(3.0, 179.0))
def test_the_centre_of_each_cell_lies_in_that_cell(field_deg):
    cells = Cells.for_field(math.radians(field_deg))
    listed = list(centres(cells))[::7]
    places = np.concatenate([direction(math.degrees(ra), 90 - math.degrees(c)) for _, c, ra in listed])
    assert cells.index(places).tolist() == [index for index, _, _ in listed]


@given(st.floats(3.0, 60.0), st.integers(0, 2**32 - 1))
def test_a_star_is_nearer_to_its_cells_centre_than_a_cell_is_big(field_deg, seed):
    cells = Cells.for_field(math.radians(field_deg))
    stars = np.random.default_rng(seed).normal(size=(20, 3))
    stars /= np.linalg.norm(stars, axis=1)[:, None]
    where = {index: (c, ra) for index, c, ra in centres(cells)}
    for star, index in zip(stars, cells.index(stars), strict=True):
        colatitude, ra = where[int(index)]
        assert abs(math.acos(star[2]) - colatitude) <= math.pi / (2 * cells.order + 1) + 1e-9
        turn = abs((math.atan2(star[1], star[0]) - ra + math.pi) % (2 * math.pi) - math.pi)
        assert turn <= math.pi / (2 * math.isqrt(int(index)) + 1) + 1e-9


def test_all_cells_of_8_deg_hold_stars_of_the_catalogue():
    cells = Cells.for_field(math.radians(8))
    stars = load_catalog().rows(slice(0, 20_000))
    assert len(np.unique(cells.index(stars.icrs))) == len(cells)


@pytest.mark.parametrize("field_deg", [4.0, 8.0, 14.0, 40.0, 130.0])
def test_touching_is_mutual_and_includes_the_cell_itself(field_deg):
    around = Cells.for_field(math.radians(field_deg)).around()
    assert (around == around.T).all()
    assert around.diagonal().all()


def test_stars_close_together_are_nearly_always_in_cells_that_touch():
    cells = Cells.for_field(math.radians(8))
    around = cells.around()
    here = spiral_directions(20_000)
    aside = here + np.random.default_rng(5).normal(0, math.radians(0.5), here.shape)
    aside /= np.linalg.norm(aside, axis=1)[:, None]
    assert around[cells.index(here), cells.index(aside)].mean() > 0.999
