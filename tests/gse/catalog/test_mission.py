import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from skies.made_frames import FIELD_14_DEG

from gse.catalog import StarCatalog, load_catalog, merge_doubles, mission_catalog, stars_for_field
from gse.catalog.mission import coverage, thinned
from gse.values.camera import Camera
from gse.values.spiral import spiral_directions

ROOFTOP = Camera(768, 1024, 5113.75, (511.5, 383.5), (-0.0011, 0.0))
WIDE = Camera(1024, 1024, 1073.0, (511.5, 511.5))
ARCSEC = np.pi / 648000


def made_catalog(places_arcsec, magnitudes) -> StarCatalog:
    """Stars around the x axis, at offsets (N, 2) in arcsec, brightest first."""
    order = np.argsort(magnitudes, kind="stable")
    offsets = np.asarray(places_arcsec, dtype=float)[order] * ARCSEC
    icrs = np.column_stack([np.ones(len(offsets)), offsets])
    icrs /= np.linalg.norm(icrs, axis=1)[:, None]
    return StarCatalog("made", 2016.0, np.arange(1, len(order) + 1)[order], icrs, np.asarray(magnitudes, float)[order])


@pytest.mark.parametrize(
    ("camera", "least", "most"), [(FIELD_14_DEG, 3900, 4400), (ROOFTOP, 8000, 9500), (WIDE, 1500, 1500)]
)
def test_the_size_follows_the_field(camera, least, most):
    assert least <= stars_for_field(camera) <= most


def test_nearly_every_field_holds_eight_stars():
    source = load_catalog()
    for camera in (FIELD_14_DEG, ROOFTOP):
        stars = mission_catalog(source, camera)
        directions = spiral_directions(2000)
        cap = np.cos(np.sqrt(camera.solid_angle_sr / np.pi))
        counts = (directions @ stars.icrs.T > cap).sum(axis=1)
        assert (counts >= 8).mean() > 0.99


def test_the_number_of_stars_can_be_given():
    source = load_catalog()
    catalog = mission_catalog(source, FIELD_14_DEG, 4000)
    assert len(catalog) == 4000
    assert (np.diff(catalog.magnitude) >= 0).all()


def test_a_double_becomes_one_star_at_the_centre_of_light():
    merged = merge_doubles(made_catalog([(0, 0), (30, 0), (500, 0)], [4.0, 4.0, 5.0]), 60 * ARCSEC)
    assert merged.ids.tolist() == [1, 3]
    assert merged.icrs[0, 1] / ARCSEC == pytest.approx(15, abs=1e-3)
    assert merged.magnitude[0] == pytest.approx(4.0 - 2.5 * np.log10(2))


def test_a_faint_companion_hardly_moves_a_bright_star():
    merged = merge_doubles(made_catalog([(0, 0), (50, 0)], [2.0, 7.0]), 60 * ARCSEC)
    assert merged.icrs[0, 1] / ARCSEC == pytest.approx(0.5, abs=0.01)


def test_a_chain_of_stars_does_not_become_one():
    merged = merge_doubles(made_catalog([(0, 0), (50, 0), (100, 0)], [3.0, 4.0, 5.0]), 60 * ARCSEC)
    assert merged.ids.tolist() == [1, 3]


def test_a_merged_star_can_overtake_a_brighter_single_one():
    merged = merge_doubles(made_catalog([(0, 0), (900, 0), (930, 0)], [4.0, 4.2, 4.2]), 60 * ARCSEC)
    assert merged.ids.tolist() == [2, 1]


@given(
    st.lists(st.tuples(st.integers(-200, 200), st.integers(-200, 200)), min_size=1, max_size=25, unique=True),
    st.integers(0, 2**32 - 1),
)
def test_merging_keeps_the_light_and_leaves_none_closer_to_its_leader(places, seed):
    magnitudes = np.random.default_rng(seed).uniform(2, 8, len(places))
    catalog = made_catalog(places, magnitudes)
    merged = merge_doubles(catalog, 60 * ARCSEC)
    assert (10 ** (-0.4 * merged.magnitude)).sum() == pytest.approx((10 ** (-0.4 * catalog.magnitude)).sum())
    assert (np.diff(merged.magnitude) >= 0).all()
    own = {int(i): place for i, place in zip(catalog.ids, catalog.icrs, strict=True)}
    kept = np.array([own[int(i)] for i in merged.ids])
    gaps = np.linalg.norm(kept[:, None] - kept[None], axis=2)[np.triu_indices(len(kept), 1)]
    assert (gaps >= 60 * ARCSEC * 0.999).all()


def test_the_coverage_is_that_of_random_directions_and_rolls():
    """Against a count by rotations of scipy's, drawn uniformly from all of them."""
    stars = mission_catalog(load_catalog(), FIELD_14_DEG)
    found = coverage(stars, FIELD_14_DEG)
    drawn = np.zeros(6000, dtype=np.int64)
    for k, icrs_to_sensor in enumerate(Rotation.random(6000, random_state=3).as_matrix()):
        x, y, z = icrs_to_sensor @ stars.icrs.T
        half = np.array([FIELD_14_DEG.columns, FIELD_14_DEG.rows]) / 2 / FIELD_14_DEG.focal_length_px
        drawn[k] = ((z > 0) & (np.abs(x) < half[0] * z) & (np.abs(y) < half[1] * z)).sum()
    for number in (10, 14, 18, 25):
        assert found.share_below(number) == pytest.approx((drawn < number).mean(), abs=0.02)
    assert found.stars.mean() == pytest.approx(len(stars) * FIELD_14_DEG.solid_angle_sr / (4 * np.pi), rel=0.01)


def test_the_map_shows_where_a_hole_in_the_catalogue_is():
    directions = spiral_directions(40_000)
    ra, de = np.radians([100, 40])
    hole = np.array([np.cos(de) * np.cos(ra), np.cos(de) * np.sin(ra), np.sin(de)])
    icrs = directions[directions @ hole < np.cos(np.radians(25))]
    stars = StarCatalog("made", 2016.0, np.arange(1, len(icrs) + 1), icrs, np.full(len(icrs), 5.0))
    cells = coverage(stars, FIELD_14_DEG).map_below(5)
    assert cells.shape == (12, 24)
    assert cells[3, 6] == 1  # DE 30 to 45 deg, RA 90 to 105 deg
    assert cells[3, 18] == cells[8, 6] == 0


def test_a_thinned_catalogue_keeps_fields_that_have_too_few_stars_as_they_are():
    stars = mission_catalog(load_catalog(), FIELD_14_DEG)
    fewer = thinned(stars, FIELD_14_DEG, 8)
    assert 0.4 < len(fewer) / len(stars) < 0.8
    assert set(fewer.ids.tolist()) < set(stars.ids.tolist())
    all_of_them, left = coverage(stars, FIELD_14_DEG), coverage(fewer, FIELD_14_DEG)
    assert all_of_them.share_below(8) <= left.share_below(8) < 0.2
    assert left.stars.mean() < all_of_them.stars.mean()
