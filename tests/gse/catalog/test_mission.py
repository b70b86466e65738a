import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from skies.made_frames import FIELD_14_DEG

from gse.catalog import StarCatalog, load_catalog, merge_doubles, mission_catalog, stars_for_field
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
