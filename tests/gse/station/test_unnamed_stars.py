"""Stars that an identifier leaves out, and the bias of those that it names."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from skies.made_frames import FIELD_14_DEG

from gse.catalog import load_catalog
from gse.identifier import Answers, Identification, ObjectColumns, Reason, Unidentified
from gse.identifier.neighbour import NeighbourIdentifier
from gse.station.shown_stars import WITHIN_PX, LeftOutStars, SolvedFrames
from gse.truth import EarthOrientation, Refraction, SiderealTruth
from gse.values.attitude import Attitude, solve_attitude
from gse.values.identifier_options import IdentifierOptions
from gse.values.site import Site

AIR = Refraction.at(Site(latitude_deg=48.0, longitude_deg=11.0, height_m=300.0))
LOOKING = Attitude.from_angles(83.0, 0.0, 20.0).icrs_to_sensor
ZENITH = np.array([0.66, 0.55, 0.5]) / np.linalg.norm([0.66, 0.55, 0.5])
"""The boresight is 30 deg above the horizon."""
NOISE_PX = 0.35
FRAMES = 60


@pytest.fixture(scope="module")
def stars():
    return load_catalog(stars=4000)


def frames(count, looking=LOOKING):
    return SolvedFrames(np.array([looking] * count), np.array([looking] * count), None, np.zeros(count, int), None)


def shown(stars, looking=LOOKING):
    """Rows of the stars in the field, and their exact directions."""
    exact = stars.icrs @ looking.T
    rows = np.flatnonzero((exact[:, 2] > 0.9) & FIELD_14_DEG.contains(FIELD_14_DEG.pixels(exact)))[:28]
    return rows, exact[rows]


def objects_of(seen):
    return ObjectColumns.from_panoramas([(one, np.ones(len(one))) for one in seen])


@pytest.mark.parametrize("de_deg", [0.0, 89.0, -89.0])
def test_stars_left_out_are_those_that_a_tree_finds_near_the_objects(stars, de_deg):
    """In many panoramas with several objects at some stars, and some objects that bear a right or a wrong name."""
    looking, rng = Attitude.from_angles(83.0, de_deg, 20.0).icrs_to_sensor, np.random.default_rng(1)
    (rows, exact), pixel_rad = shown(stars, looking), FIELD_14_DEG.pixel_rad
    seen, answers, expected = [], [], []
    for _ in range(40):
        of_star = rng.choice(len(rows), rng.integers(5, 25))
        px = FIELD_14_DEG.pixels(exact[of_star]) + rng.normal(0, 3, (len(of_star), 2))
        seen.append(FIELD_14_DEG.directions(px))
        named = rng.choice(len(of_star), rng.integers(1, 4), replace=False)
        names = rows[rng.choice(len(rows), len(named), replace=False)]
        answers.append(Identification(named, names, 1e-9))
        apart, nearest = cKDTree(stars.icrs).query(seen[-1] @ looking, distance_upper_bound=8 * pixel_rad)
        off = np.hypot(*(seen[-1] - stars.icrs[np.minimum(nearest, len(stars) - 1)] @ looking.T)[:, :2].T)
        free = [k for k in range(len(of_star)) if k not in named and apart[k] < np.inf and nearest[k] not in names]
        first = [k for k in free if apart[k] == min(apart[other] for other in free if nearest[other] == nearest[k])]
        expected.append([(k, nearest[k]) for k in first if off[k] <= WITHIN_PX * pixel_rad])
    found = LeftOutStars(FIELD_14_DEG, stars).beside(
        objects_of(seen), Answers.from_answers(answers), frames(40, looking)
    )
    parts = [found.part(k, k + 1) for k in range(40)]
    assert [list(zip(one.objects.tolist(), one.stars.tolist(), strict=True)) for one in parts] == expected
    assert sum(map(len, expected)) > 100


def test_an_object_at_the_place_of_a_star_is_that_star(stars):
    rows, exact = shown(stars)
    px = FIELD_14_DEG.pixels(exact)
    px[3] += [0.0, 2.0]
    px[5] += [20.0, 0.0]
    named = Identification(np.array([0, 1, 2]), rows[:3], 1e-9)
    found = LeftOutStars(FIELD_14_DEG, stars).beside(
        objects_of([FIELD_14_DEG.directions(px)]), Answers.from_answers([named]), frames(1)
    )
    assert found.objects.tolist() == [3, 4, *range(6, len(rows))]
    assert found.stars.tolist() == [rows[3], rows[4], *rows[6:]]
    assert found.residuals_arcsec[0] == pytest.approx([0.0, 2 * FIELD_14_DEG.pixel_rad * 206264.8], abs=0.5)
    assert np.abs(found.residuals_arcsec[1:]).max() < 0.1


def test_of_two_objects_at_one_star_the_nearer_is_the_star_and_a_named_star_is_not_found_again(stars):
    rows, exact = shown(stars)
    offset_px = np.array([[0, 0], [0, 0], [0, 0], [1.5, 0], [0.5, 0], [1, 0]])
    px = FIELD_14_DEG.pixels(exact[[0, 1, 2, 3, 3, 0]]) + offset_px
    named = Identification(np.array([0, 1, 2]), rows[:3], 1e-9)
    found = LeftOutStars(FIELD_14_DEG, stars).beside(
        objects_of([FIELD_14_DEG.directions(px)]), Answers.from_answers([named]), frames(1)
    )
    assert (found.objects.tolist(), found.stars.tolist()) == ([4], [rows[3]])


def test_what_one_panorama_names_is_free_in_another_and_the_last_stars_of_the_catalogue_are_found(stars):
    rows, exact = shown(stars)
    few = replace_rows(stars, rows)
    named = [Identification(np.arange(3), np.arange(3), 1e-9), Identification(np.arange(3, 6), np.arange(3, 6), 1e-9)]
    beside = FIELD_14_DEG.directions(
        FIELD_14_DEG.pixels(exact[3:4]) + np.array([1.0, 0.0])
    )  # a star that is named already
    seen = objects_of([exact, np.concatenate([exact, beside])])
    found = LeftOutStars(FIELD_14_DEG, few).beside(seen, Answers.from_answers(named), frames(2))
    everything = set(range(len(rows)))
    assert [set(found.part(k, k + 1).stars.tolist()) for k in range(2)] == [
        everything - {0, 1, 2},
        everything - {3, 4, 5},
    ]


def replace_rows(stars, rows):
    """A catalogue of these stars alone."""
    return replace(stars, **{name: getattr(stars, name)[rows] for name in ("ids", "icrs", "magnitude")})


def test_air_biases_the_stars_that_the_neighbour_technique_names_but_not_all_that_the_frames_show(stars):
    rows, exact = shown(stars)
    rng = np.random.default_rng(4)
    places = FIELD_14_DEG.pixels(AIR.added(exact, ZENITH))
    seen = [FIELD_14_DEG.directions(places + rng.normal(0, NOISE_PX, places.shape)) for _ in range(FRAMES)]
    light = np.arange(len(rows), 0, -1.0)
    identifier = NeighbourIdentifier(stars, FIELD_14_DEG, IdentifierOptions())
    named = identifier.identify_many(ObjectColumns.from_panoramas([(one, light) for one in seen]))
    chosen = [_scale(one, answer.objects, answer.stars, stars) for one, answer in zip(seen, named, strict=True)]
    left_out = LeftOutStars(FIELD_14_DEG, stars).beside(objects_of(seen), named, frames(FRAMES))
    whole = [
        _scale(one, np.append(answer.objects, rest.objects), np.append(answer.stars, rest.stars), stars)
        for one, answer, rest in zip(seen, named, (left_out.part(k, k + 1) for k in range(len(seen))), strict=True)
    ]
    assert 512 * (np.mean(chosen) - 1) > 0.04  # px at the edge of the field
    assert abs(512 * (np.mean(whole) - 1)) < 0.02


def _scale(seen, objects, of_star, stars):
    """How much wider the stars stand than they do, freed of air."""
    straight = AIR.removed(seen.take(objects, axis=0), ZENITH)
    attitude = solve_attitude(straight, stars.icrs[of_star], 1e-4).icrs_to_sensor
    expected, measured = ((v[:, :2] / v[:, 2:]) for v in (stars.icrs[of_star] @ attitude.T, straight))
    about = expected - expected.mean(axis=0)
    return float((about * measured).sum() / (about * expected).sum())


def test_residuals_are_free_of_aberration_and_air_where_the_sky_is_known(stars):
    utc_ns = 1_774_000_000_000_000_000
    truth = SiderealTruth(
        Site(latitude_deg=48.0, longitude_deg=11.0, height_m=300.0), EarthOrientation.from_disk(utc_ns)
    )
    to_horizon = truth.icrs_to_horizon(utc_ns)
    zenith_icrs = to_horizon[2]
    up = 0.7 * zenith_icrs + 0.6 * np.cross(zenith_icrs, [0.0, 0.0, 1.0])
    up /= np.linalg.norm(up)
    side = np.cross(up, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    looking = np.array([side, np.cross(up, side), up])
    apparent = truth.apparent(stars.icrs, utc_ns) @ looking.T
    rows = np.flatnonzero((apparent[:, 2] > 0.9) & FIELD_14_DEG.contains(FIELD_14_DEG.pixels(apparent)))[:20]
    seen = truth.refraction.added(apparent[rows], looking @ zenith_icrs)
    known = SolvedFrames(looking[None], looking[None], truth, np.array([utc_ns]), to_horizon[None])
    named = Identification(np.array([0]), rows[:1], 1e-9)
    found = LeftOutStars(FIELD_14_DEG, stars).beside(objects_of([seen]), Answers.from_answers([named]), known)
    assert found.stars.tolist() == rows[1:].tolist()
    assert np.abs(found.residuals_arcsec).max() < 0.01
    twice = seen[[0, 0]]  # a second object at the place of the one star, which has its name already
    found = LeftOutStars(FIELD_14_DEG, stars).beside(objects_of([twice]), Answers.from_answers([named]), known)
    assert len(found.stars) == 0
    unknown = replace(known, truth=None, icrs_to_horizon=None)
    found = LeftOutStars(FIELD_14_DEG, stars).beside(objects_of([seen]), Answers.from_answers([named]), unknown)
    assert np.abs(found.residuals_arcsec).max() > 10


@pytest.mark.parametrize(("off_px", "is_found"), [(WITHIN_PX - 0.05, True), (WITHIN_PX + 0.05, False)])
def test_an_object_within_some_pixels_of_the_place_of_a_star_is_it(stars, off_px, is_found):
    rows, exact = shown(stars)
    px = FIELD_14_DEG.pixels(exact[:4])
    centre_px = px[3] - 511.5
    px[3] += off_px * np.array([-centre_px[1], centre_px[0]]) / np.hypot(*centre_px)
    named = Identification(np.arange(3), rows[:3], 1e-9)
    found = LeftOutStars(FIELD_14_DEG, stars).beside(
        objects_of([FIELD_14_DEG.directions(px)]), Answers.from_answers([named]), frames(1)
    )
    assert found.stars.tolist() == ([rows[3]] if is_found else [])


def test_a_panorama_without_an_answer_leaves_out_no_star_and_those_beside_it_keep_their_own(stars):
    rows, exact = shown(stars)
    named = Identification(np.arange(3), rows[:3], 1e-9)
    answers = Answers.from_answers([Unidentified(Reason.NO_MATCH, ""), named, Unidentified(Reason.NO_MATCH, ""), named])
    found = LeftOutStars(FIELD_14_DEG, stars).beside(
        objects_of([exact, exact[:4], exact, exact[:5]]), answers, frames(2)
    )
    assert [found.part(k, k + 1).objects.tolist() for k in range(4)] == [[], [3], [], [3, 4]]
    assert [found.part(k, k + 1).stars.tolist() for k in range(4)] == [[], [rows[3]], [], rows[3:5].tolist()]
    assert found.name_of(int(rows[3])) == stars.name(int(rows[3]))


def test_before_air_is_taken_off_a_star_is_sought_within_eight_pixels_of_its_place(stars):
    """The raw attitude is 7 px off, as air may lift it, the geometric one is right; at 9 px no star is found."""
    rows, exact = shown(stars)
    named = Identification(np.arange(3), rows[:3], 1e-9)
    found = []
    for off_px in (7.0, 9.0):
        lift = Rotation.from_rotvec([off_px * FIELD_14_DEG.pixel_rad, 0.0, 0.0]).as_matrix()
        lifted = replace(frames(1), raw=(lift @ LOOKING)[None])
        one = LeftOutStars(FIELD_14_DEG, stars).beside(objects_of([exact[:4]]), Answers.from_answers([named]), lifted)
        found.append(one.stars.tolist())
    assert found == [[rows[3]], []]


def test_an_object_that_bears_a_wrong_name_is_not_found_as_the_star_at_whose_place_it_is(stars):
    rows, exact = shown(stars)
    named = Identification(np.arange(3), rows[3:6], 1e-9)
    found = LeftOutStars(FIELD_14_DEG, stars).beside(objects_of([exact[:3]]), Answers.from_answers([named]), frames(1))
    assert len(found.stars) == 0
