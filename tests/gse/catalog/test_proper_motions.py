"""Proper motions of the embedded catalogue against published ones."""

import math

import numpy as np
import pytest

from gse.catalog import load_catalog
from gse.values.constants import ARCSEC_PER_RAD


@pytest.fixture(scope="module")
def bright():
    return load_catalog(stars=8400)


def row_of(catalog, name):
    return next(row for row in range(len(catalog)) if catalog.name(row) == name)


@pytest.mark.parametrize(
    ("name", "ra_mas_yr", "de_mas_yr"),
    [
        ("Sirius", -546.01, -1223.07),  # van Leeuwen 2007
        ("Arcturus", -1093.39, -2000.06),
        ("Vega", 200.94, 286.23),
        ("Procyon", -714.59, -1036.80),
        ("Gaia DR3 1872046609345556480", 4164.2, 3249.6),  # 61 Cygni A, Gaia DR3
    ],
)
def test_fast_stars_move_as_published(bright, name, ra_mas_yr, de_mas_yr):
    row = row_of(bright, name)
    x, y, z = bright.icrs[row]
    level = math.hypot(x, y)
    east, north = [-y / level, x / level, 0.0], [-z * x / level, -z * y / level, level]
    motion = np.array([east, north]) @ bright.motion_rad_yr[row] * ARCSEC_PER_RAD * 1000
    # The photocentre of a binary moves otherwise in 3 years than in 30: 1 % of the fastest.
    assert motion == pytest.approx([ra_mas_yr, de_mas_yr], abs=60)


def test_the_stars_of_the_mission_catalogue_are_not_at_rest(bright):
    assert bright.rows(slice(0, 4200)).at_rest < 0.05 * 4200
    assert bright.at_rest < 0.12 * 8400


def test_ten_years_bring_a_fast_star_where_it_is(bright):
    row = row_of(bright, "Arcturus")
    later = bright.at_epoch(2026.0)
    moved = np.linalg.norm(later.icrs[row] - bright.icrs[row]) * ARCSEC_PER_RAD
    assert moved == pytest.approx(22.79, abs=0.05)
    assert (later.rest_epoch_jyear, later.at_rest) == (2016.0, bright.at_rest)
