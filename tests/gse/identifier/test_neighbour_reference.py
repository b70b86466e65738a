"""The compiled neighbour technique gives the answer of the plain one, object for object."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skies.made_frames import Noise, made_frame, sky_of
from skies.reference_neighbour import ReferenceNeighbour, angle_urad, onboard_table

from gse.catalog import load_catalog, mission_catalog
from gse.identifier import neighbour_search
from gse.identifier.consistency import MOST_CANDIDATES, object_of, star_of
from gse.identifier.neighbour_search import (
    BLOCK,
    EVERYWHERE,
    SearchOptions,
    best_vote,
    blocks_of,
    first_fit,
    put_fits,
    put_fits_of_star,
    seen_from,
    view_of,
)
from gse.identifier.tables import build_pair_table, field_diameter_rad
from gse.values.camera import Camera
from gse.values.spiral import spiral_directions

CAMERA = Camera(768, 1024, 1400.0, (511.5, 383.5))
"""40 deg wide, so that few stars make a full sky and the plain search ends within the day."""

TOLERANCE_URAD = 1e6 * 1.5 / 1400
NOISE = Noise(false_objects=3, limit=4.5)


@pytest.fixture(scope="module")
def source():
    return load_catalog()


@pytest.fixture(scope="module")
def stars(source):
    return mission_catalog(source, CAMERA, 400)


@pytest.fixture(scope="module")
def table(stars):
    return build_pair_table(stars, field_diameter_rad(CAMERA))


@pytest.fixture(scope="module")
def plain_table(stars):
    return onboard_table(stars.icrs.tolist(), field_diameter_rad(CAMERA))


def compared(search, directions, stars, table, plain_table, limits):
    """What the compiled and the plain search answer, as {object: star}."""
    found = [search(directions, stars.icrs, table, blocks_of(table), limits, hopeless) for hopeless in (False, True)]
    (objects, named, alphas), others = found
    assert alphas == others[2]
    assert (np.concatenate([objects, named]) == np.concatenate(others[:2])).all()
    plain = ReferenceNeighbour(stars.icrs.tolist(), plain_table, limits.tolerance_urad, limits.min_fit, limits.alphas)
    slow = plain.first_fit if search is first_fit else plain.best_vote
    return dict(zip(objects.tolist(), named.tolist(), strict=True)), slow(directions.tolist())


def test_the_table_of_pairs_is_the_onboard_table(table, plain_table):
    for star, neighbours in enumerate(plain_table):
        rows = slice(table.first[star], table.first[star + 1])
        assert list(zip(table.neighbour_urad[rows], table.neighbour[rows], strict=True)) == neighbours


@pytest.mark.parametrize("search", [first_fit, best_vote])
@pytest.mark.parametrize("min_fit", [3, 6])
def test_same_answers_over_the_sky(source, stars, table, plain_table, search, min_fit):
    sky, rng = sky_of(source, CAMERA, 4.5), np.random.default_rng(11)
    limits, named = SearchOptions(TOLERANCE_URAD, min_fit, min_fit, 3, False, EVERYWHERE, True), 0
    for boresight in spiral_directions(8):
        frame = made_frame(sky, CAMERA, boresight, NOISE, rng)
        directions = CAMERA.directions(frame.xy_px)
        fast, slow = compared(search, directions, stars, table, plain_table, limits)
        assert fast == slow
        named += bool(fast)
    assert named >= 4


@pytest.mark.parametrize("min_fit", [3, 6])
def test_alpha_stars_that_are_no_stars_change_nothing_for_those_after_them(source, stars, table, plain_table, min_fit):
    sky, rng = sky_of(source, CAMERA, 4.5), np.random.default_rng(12)
    limits, named = SearchOptions(TOLERANCE_URAD, min_fit, min_fit, 30, False, EVERYWHERE, True), 0
    for boresight in spiral_directions(8)[:4]:
        frame = made_frame(sky, CAMERA, boresight, NOISE, rng)
        pixels = np.concatenate([rng.uniform(0, (1024, 768), (7, 2)), frame.xy_px])
        fast, slow = compared(first_fit, CAMERA.directions(pixels), stars, table, plain_table, limits)
        assert fast == slow
        named += bool(fast)
    assert named >= 2


@pytest.mark.parametrize("min_fit", [4, 6])
@pytest.mark.parametrize("missing", [0, 1])
def test_the_smallest_group_among_objects_that_are_no_stars_is_found(stars, table, min_fit, missing):
    rng, named = np.random.default_rng(21), 0
    limits, frames = SearchOptions(TOLERANCE_URAD / 20, min_fit, min_fit, 30, False, EVERYWHERE, True), 60
    for boresight in spiral_directions(frames):
        to_sensor = np.linalg.svd(boresight[None])[2][[1, 2, 0]]
        to_sensor *= np.array([1, 1, np.sign(to_sensor[2] @ boresight)])[:, None]
        to_sensor[0] *= np.linalg.det(to_sensor)
        pixels = CAMERA.pixels(stars.icrs @ to_sensor.T)
        seen = np.flatnonzero(CAMERA.contains(pixels))
        seen = rng.choice(seen, min(len(seen), min_fit + 1 - missing), replace=False)
        pixels = np.concatenate([pixels[seen], rng.uniform(0, (1024, 768), (30 - len(seen), 2))])
        order = rng.permutation(30)
        arguments = CAMERA.directions(pixels[order]), stars.icrs, table, blocks_of(table), limits
        for hopeless in (False, True):
            objects, found, _ = first_fit(*arguments, hopeless)
            if len(seen) == min_fit + 1:
                assert sorted(found.tolist()) == sorted(seen.tolist())
            named += len(objects) > 0
    assert named == 0 if missing else named > frames


def test_two_hot_pixels_side_by_side_make_the_proof_look_at_no_star(stars, table):
    limits = SearchOptions(TOLERANCE_URAD, 6, 6, 30, False, EVERYWHERE, True)
    pixels = np.array([[400.0, 300.0], [700.0, 500.0], [701.0, 500.0]])
    view = view_of(CAMERA.directions(pixels), stars.icrs, table, limits)
    whole = seen_from(0, view.angles, limits.tolerance_urad, np.ones(3, np.bool_))
    room = np.empty(len(stars), np.int32), np.empty((2, 10_000), np.int32)
    comparisons = neighbour_search._excluded(0, np.array([1, 2]), whole, *room, view, limits)
    assert 0 < comparisons < len(stars)


def test_level_1_counts_as_eq_2_5_for_every_star(source, stars, table, plain_table):
    frame = made_frame(sky_of(source, CAMERA, 4.5), CAMERA, spiral_directions(8)[3], NOISE, np.random.default_rng(1))
    directions = CAMERA.directions(frame.xy_px)
    limits = SearchOptions(3 * TOLERANCE_URAD, 1, 1, 1, False, EVERYWHERE, True)
    plain = ReferenceNeighbour(stars.icrs.tolist(), plain_table, limits.tolerance_urad, limits.min_fit, limits.alphas)
    assert max(each_star_as_plain(directions, stars, table, limits, plain)) >= 6


def test_level_1_keeps_the_nearest_candidates_where_more_fit_than_there_is_room_for(source):
    polar = mission_catalog(source, CAMERA, 8000)
    polar = polar.rows(np.flatnonzero(polar.icrs[:, 2] > 0.97))
    table = build_pair_table(polar, field_diameter_rad(CAMERA))
    plain_table = onboard_table(polar.icrs.tolist(), field_diameter_rad(CAMERA))
    frame = made_frame(sky_of(source, CAMERA, 4.5), CAMERA, spiral_directions(8)[3], NOISE, np.random.default_rng(1))
    directions = CAMERA.directions(frame.xy_px)
    limits = SearchOptions(60 * TOLERANCE_URAD, 1, 1, 1, False, EVERYWHERE, True)
    plain = ReferenceNeighbour(polar.icrs.tolist(), plain_table, limits.tolerance_urad, limits.min_fit, limits.alphas)
    assert max(each_star_as_plain(directions, polar, table, limits, plain)) > MOST_CANDIDATES


def each_star_as_plain(directions, stars, table, limits, plain):
    """Fn of each star, which is the plain one, with its candidates, for stars one by one and in blocks."""
    view, blocks = view_of(directions, stars.icrs, table, limits), blocks_of(table)
    seen = seen_from(0, view.angles, limits.tolerance_urad, np.ones(len(directions), np.bool_))
    fits = []
    for star in range(len(stars)):
        fit, candidates = plain.level_1(star, plain.from_alpha(directions.tolist(), 0))
        put_fits_of_star(star, seen, table, view.fits_of_star)
        assert candidates_of(0, view.fits_of_star) == (fit, candidates)
        put_fits(star // BLOCK, seen, blocks, view.fits)
        assert candidates_of(star % BLOCK, view.fits) == (fit, candidates)
        fits.append(fit)
    return fits


def candidates_of(member, fits):
    """Fn of a star of a block, and its candidates."""
    kept = fits.candidate[member, : min(fits.number[member], MOST_CANDIDATES)]
    return fits.number[member] - fits.again[member], [(object_of(each), star_of(each)) for each in kept]


@pytest.mark.parametrize("search", [first_fit, best_vote])
@settings(max_examples=12)
@given(
    pixels=st.lists(st.tuples(st.integers(0, 1023), st.integers(0, 767)), min_size=3, max_size=14),
    min_fit=st.integers(2, 4),
)
def test_same_answers_on_any_objects(stars, table, plain_table, search, pixels, min_fit):
    directions = CAMERA.directions(np.array(pixels, dtype=float))
    limits = SearchOptions(2 * TOLERANCE_URAD, min_fit, min_fit, 2, False, EVERYWHERE, True)
    fast, slow = compared(search, directions, stars, table, plain_table, limits)
    assert fast == slow


def test_the_angle_of_the_reference_is_exact_for_small_angles():
    assert angle_urad((1.0, 0.0, 0.0), (1.0, 1e-7, 0.0)) == pytest.approx(0.1, rel=1e-9)
