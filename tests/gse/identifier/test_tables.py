import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from skies.made_frames import FIELD_14_DEG

from gse.catalog import StarCatalog, load_catalog, mission_catalog
from gse.errors import CatalogError
from gse.identifier.robust_tables import sky_tables
from gse.identifier.tables import (
    MOST_PAIRS,
    build_pair_table,
    cached_columns,
    field_diameter_rad,
    pair_table,
    tolerance_rad,
)
from gse.values.camera import Camera
from gse.values.spiral import spiral_directions


def scattered(count, seed=0):
    """A catalogue of stars anywhere."""
    icrs = np.random.default_rng(seed).normal(size=(count, 3))
    icrs /= np.linalg.norm(icrs, axis=1)[:, None]
    return StarCatalog("scattered", 2016.0, np.arange(count), icrs, np.linspace(0, 6, count))


def same(one, other):
    return all(np.array_equal(a, b) and a.dtype == b.dtype for a, b in zip(one, other, strict=True))


@given(st.integers(0, 40), st.integers(0, 2**32 - 1), st.floats(0.01, 3.0))
def test_the_table_holds_every_pair_once_and_each_star_its_neighbours(count, seed, widest_rad):
    catalog = scattered(count, seed)
    table = build_pair_table(catalog, widest_rad)
    cosine = np.clip(catalog.icrs @ catalog.icrs.T, -1, 1)
    expected = {(i, j) for i in range(count) for j in range(i + 1, count) if np.arccos(cosine[i, j]) < widest_rad}
    pairs = list(zip(table.brighter.tolist(), table.dimmer.tolist(), strict=True))
    assert set(pairs) == expected
    assert len(pairs) == len(expected)
    assert (np.diff(table.distance_urad) >= 0).all()
    for star in range(count):
        rows = slice(table.first[star], table.first[star + 1])
        assert sorted(table.neighbour[rows]) == sorted({j if i == star else i for i, j in pairs if star in (i, j)})
        assert (np.diff(table.neighbour_urad[rows]) >= 0).all()


def test_distances_are_whole_microradians():
    catalog = scattered(50)
    table = build_pair_table(catalog, 1.0)
    exact = 1e6 * np.arccos((catalog.icrs[table.brighter] * catalog.icrs[table.dimmer]).sum(axis=1))
    assert np.abs(table.distance_urad - exact).max() <= 0.5 + 1e-6


def test_the_table_of_the_papers_field_has_the_size_it_should():
    table = build_pair_table(mission_catalog(load_catalog(), FIELD_14_DEG, 4000), field_diameter_rad(FIELD_14_DEG))
    assert 240_000 < len(table.distance_urad) < 280_000


def test_a_table_from_the_cache_is_the_table(tmp_path):
    catalog = scattered(60)
    made = pair_table(catalog, 0.5, tmp_path)
    (stored,) = tmp_path.iterdir()
    before = stored.stat().st_ino
    assert same(pair_table(catalog, 0.5, tmp_path), made)
    assert same(build_pair_table(catalog, 0.5), made)
    assert all(column.flags.c_contiguous for column in made), "compiled code would be compiled twice"
    assert stored.stat().st_ino == before


def test_another_catalogue_or_field_is_another_table(tmp_path):
    pair_table(scattered(60, 1), 0.5, tmp_path)
    pair_table(scattered(60, 2), 0.5, tmp_path)
    pair_table(scattered(60, 2), 0.6, tmp_path)
    assert len(list(tmp_path.iterdir())) == 3


def test_the_tables_that_were_used_longest_ago_make_room_for_new_ones(tmp_path):
    used, unused, other_kind, new = (tmp_path / f"{name}.tables" for name in ("pairs-1", "pairs-2", "sky-1", "pairs-3"))
    cached_columns(used, lambda: (np.arange(9),), lambda columns: True, 1)
    for path in (unused, other_kind):
        path.touch()
        os.truncate(path, 256_000_000)
    for number, path in enumerate((used, unused, other_kind)):
        os.utime(path, ns=(number, number))
    cached_columns(used, tuple, lambda columns: True, 1)
    cached_columns(new, lambda: (np.arange(9),), lambda columns: True, 1)
    assert sorted(tmp_path.iterdir()) == [used, new, other_kind]


@given(data=st.data())
def test_a_damaged_cache_file_is_replaced(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("cache")
    catalog = scattered(20)
    made = pair_table(catalog, 0.8, folder)
    (stored,) = folder.iterdir()
    content = bytearray(stored.read_bytes())
    kind = data.draw(st.sampled_from(["cut", "flip", "foreign"]))
    if kind == "cut":
        content = content[: data.draw(st.integers(0, len(content) - 1))]
    elif kind == "flip":
        content[data.draw(st.integers(0, len(content) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    else:
        content = bytearray(data.draw(st.binary(max_size=60)))
    stored.write_bytes(content)
    assert same(pair_table(catalog, 0.8, folder), made)
    assert same(pair_table(catalog, 0.8, folder), made)


def test_a_cache_file_that_names_absent_stars_is_replaced(tmp_path):
    catalog = scattered(20)
    made = pair_table(catalog, 0.8, tmp_path)
    (stored,) = tmp_path.iterdir()
    stored.unlink()
    cached_columns(stored, lambda: made._replace(neighbour=made.neighbour + 20), lambda columns: True, len(made))
    assert same(pair_table(catalog, 0.8, tmp_path), made)


def test_the_tables_of_the_robust_identifier_come_from_the_cache_as_they_were_made(tmp_path):
    catalog = scattered(400)
    field = np.array([-0.1, 0.1, -0.1, 0.1, np.inf, 0.04])
    made = sky_tables(catalog.icrs, catalog.magnitude, field, tmp_path)
    (stored,) = tmp_path.iterdir()
    before = stored.stat().st_ino
    kept = sky_tables(catalog.icrs, catalog.magnitude, field, tmp_path)
    assert same(made[3:9], kept[3:9])
    assert made[9:] == kept[9:]
    assert all(column.flags.carray for column in kept[3:9]), "compiled code would be compiled twice"
    assert stored.stat().st_ino == before


@pytest.mark.parametrize("column", ["pairs", "cell_stars", "pair_start", "cell_start"])
def test_tables_of_the_robust_identifier_that_name_absent_stars_are_replaced(tmp_path, column):
    catalog = scattered(400)
    field = np.array([-0.1, 0.1, -0.1, 0.1, np.inf, 0.04])
    made = sky_tables(catalog.icrs, catalog.magnitude, field, tmp_path)
    (stored,) = tmp_path.iterdir()
    stored.unlink()
    wrong = made._replace(**{column: getattr(made, column) + np.array(400, getattr(made, column).dtype)})
    cached_columns(stored, lambda: wrong[3:9], lambda columns: True, 6)
    assert same(sky_tables(catalog.icrs, catalog.magnitude, field, tmp_path)[3:9], made[3:9])


def test_a_cache_that_cannot_be_written_is_done_without(tmp_path):
    in_the_way = tmp_path / "file"
    in_the_way.write_text("no folder")
    assert len(pair_table(scattered(20), 0.8, in_the_way / "below").first) == 21


def test_a_table_too_big_to_hold_is_refused_before_it_is_made():
    stars = spiral_directions(100_000)
    catalog = StarCatalog("dense", 2016.0, np.arange(len(stars)), stars, np.zeros(len(stars)))
    with pytest.raises(CatalogError, match=str(MOST_PAIRS)):
        build_pair_table(catalog, np.radians(60))


def test_the_field_is_as_wide_as_its_diagonal():
    assert field_diameter_rad(FIELD_14_DEG) == pytest.approx(FIELD_14_DEG.diagonal_rad)
    shifted = Camera(1024, 1024, 4170.0, (300.0, 700.0))
    assert field_diameter_rad(shifted) < FIELD_14_DEG.diagonal_rad


def test_the_tolerance_is_that_of_eq_2_1():
    assert tolerance_rad(FIELD_14_DEG, 1.5) == pytest.approx(1.5 * FIELD_14_DEG.pixel_rad, rel=1e-6)
