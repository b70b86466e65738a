import numpy as np
import pytest
from skies.made_frames import ARCSEC, FIELD_14_DEG, Noise, made_frame, sky_of

from gse.catalog import StarCatalog, brightest_per_field, load_catalog, merge_doubles, mission_catalog
from gse.identifier import Identification, Reason, Unidentified, make_identifier
from gse.identifier.consistency import Separations
from gse.identifier.match_group import MatchGroupIdentifier
from gse.identifier.pivot import PivotIdentifier
from gse.values.identifier_options import IdentifierOptions
from gse.values.spiral import spiral_directions

FIELD_RAD = np.radians(8)
ZERO_POINT = 20.0
LIMIT = 5.7


@pytest.fixture(scope="module")
def stars():
    """Stars to magnitude 5.7, which are as many as those of the Bright Star Catalogue to 6.0."""
    catalog = merge_doubles(load_catalog().rows(slice(0, 10_000)), 60 * ARCSEC)
    return catalog.rows(np.flatnonzero(catalog.magnitude <= LIMIT))


@pytest.fixture(scope="module")
def mission(stars):
    return brightest_per_field(stars, FIELD_RAD, directions=5000)


def success(kind, stars, mission, *, noise_arcsec, noise_mag, directions=200, **options):
    """Share of first stars right, as [N] section 4.1 validates: noise on each angle, tolerance of three sigma."""
    identifier = kind(mission, FIELD_RAD, 3 * noise_arcsec * ARCSEC, **options)
    rng, right, counted = np.random.default_rng(1), 0, 0
    for boresight in spiral_directions(directions):
        near = np.flatnonzero(stars.icrs @ boresight > np.cos(FIELD_RAD / 2))
        magnitude = stars.magnitude[near] + rng.normal(0, noise_mag, len(near))
        seen = np.argsort(magnitude, kind="stable")[: min(30, int((magnitude <= LIMIT).sum()))]
        if len(seen) < 3:
            continue
        rows = near[seen]
        angles = np.arccos(np.clip(stars.icrs[rows] @ stars.icrs[rows].T, -1, 1))
        noise = np.triu(rng.normal(0, noise_arcsec * ARCSEC, angles.shape), 1)
        angles = np.abs(angles + noise + noise.T)
        brightness = 10 ** (-0.4 * (magnitude[seen] - ZERO_POINT))
        named = identifier.identify_angles(Separations(np.cos(angles), np.sin(angles)), brightness)
        counted += 1
        if not isinstance(named, Unidentified):
            right += bool(mission.ids[named[1][0]] == stars.ids[rows[named[0][0]]])
    return right / counted


def test_success_is_that_of_the_paper(stars, mission):
    assert success(PivotIdentifier, stars, mission, noise_arcsec=10, noise_mag=0.1) > 0.94
    assert 0.86 < success(PivotIdentifier, stars, mission, noise_arcsec=50, noise_mag=0.1) < 0.97
    assert 0.80 < success(PivotIdentifier, stars, mission, noise_arcsec=10, noise_mag=0.5) < 0.93


def test_match_group_falls_where_magnitudes_are_poor_and_pivot_less(stars, mission):
    kinds = {"pivot": (PivotIdentifier, {}), "match-group": (MatchGroupIdentifier, {"zero_point": ZERO_POINT})}
    rates = {
        name: [
            success(kind, stars, mission, noise_arcsec=10, noise_mag=noise_mag, **options) for noise_mag in (0.1, 0.7)
        ]
        for name, (kind, options) in kinds.items()
    }
    assert abs(rates["pivot"][0] - rates["match-group"][0]) < 0.02
    assert rates["match-group"][1] < rates["pivot"][1] - 0.05


@pytest.mark.parametrize("algorithm", ["pivot", "match-group"])
def test_stars_are_named_right_in_a_panorama(algorithm):
    catalog = load_catalog()
    identifier = make_identifier(IdentifierOptions(algorithm=algorithm), FIELD_14_DEG, catalog)
    sky, rng = sky_of(catalog, FIELD_14_DEG, 6.0), np.random.default_rng(4)
    named = 0
    for boresight in spiral_directions(60):
        frame = made_frame(sky, FIELD_14_DEG, boresight, Noise(magnitude=0.1), rng)
        answer = identifier.identify(FIELD_14_DEG.directions(frame.xy_px), frame.brightness)
        if isinstance(answer, Identification):
            assert (identifier.catalog.ids[answer.stars] == frame.ids[answer.objects]).mean() > 0.8
            named += 1
    assert named >= 50
    assert identifier.name == algorithm


def test_a_mirrored_image_is_refused_and_called_mirrored():
    catalog = load_catalog()
    identifier = make_identifier(IdentifierOptions(algorithm="pivot"), FIELD_14_DEG, catalog)
    sky = sky_of(catalog, FIELD_14_DEG, 6.0)
    frame = made_frame(sky, FIELD_14_DEG, spiral_directions(60)[20], Noise(magnitude=0.0), np.random.default_rng(4))
    flipped = frame.xy_px * [-1, 1] + [FIELD_14_DEG.columns - 1, 0]
    answer = identifier.identify(FIELD_14_DEG.directions(flipped), frame.brightness)
    assert isinstance(answer, Unidentified)
    assert answer.reason is Reason.MIRRORED


def test_several_equally_good_pivots_are_ambiguous(mission):
    """With a tolerance of degrees nearly every star is a pivot."""
    identifier = PivotIdentifier(mission, FIELD_RAD, np.radians(2))
    directions = np.array([[0.0, 0.0, 1.0], [0.03, 0.0, 1.0], [0.0, 0.04, 1.0], [0.03, 0.03, 1.0]])
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    answer = identifier.identify(directions, np.array([4.0, 3.0, 2.0, 1.0]))
    assert isinstance(answer, Unidentified)
    assert answer.reason is Reason.AMBIGUOUS


def test_every_field_keeps_its_five_brightest_stars(stars, mission):
    kept = set(mission.ids.tolist())
    for boresight in spiral_directions(5000)[::50]:
        near = np.flatnonzero(stars.icrs @ boresight > np.cos(FIELD_RAD / 2))
        assert kept.issuperset(stars.ids[near[:5]].tolist())
    assert len(mission) < len(stars)
    assert len(brightest_per_field(mission_catalog(stars, FIELD_14_DEG, 500), FIELD_RAD, directions=100)) <= 500


def test_spiral_directions_cover_the_sky_evenly():
    directions = spiral_directions(1000)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
    assert np.abs(directions.mean(axis=0)).max() < 0.002
    nearest = np.sort(directions @ directions.T, axis=1)[:, -2]
    assert np.degrees(np.arccos(nearest)).min() > 2.0
    assert np.degrees(np.arccos(nearest)).max() < 7.0


def test_of_two_like_groups_the_one_whose_stars_are_ordered_like_the_objects_is_named():
    triangle = np.array([[0.0, 0.0, 1.0], [0.03, 0.0, 1.0], [0.0, 0.04, 1.0]])
    triangle /= np.linalg.norm(triangle, axis=1)[:, None]
    elsewhere = triangle @ np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    stars = np.concatenate([elsewhere[[0, 2, 1]], triangle])
    catalog = StarCatalog("two triangles", 2016.0, np.arange(6), stars, np.arange(6.0))
    answer = PivotIdentifier(catalog, FIELD_RAD, 10 * ARCSEC).identify(triangle, np.array([3.0, 2.0, 1.0]))
    assert isinstance(answer, Identification)
    assert answer.stars.tolist() == [3, 4, 5]
