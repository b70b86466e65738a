"""The last check of an answer: an attitude must fit, and the probability that chance alone gives it is bounded."""

import math

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from scipy.stats import binom

from gse.catalog import StarCatalog
from gse.identifier import Identification, Reason, Unidentified
from gse.identifier.checks import RandomSky, accepted, wahba_residual_rad
from gse.identifier.evidence import CHANCE_OF_EVIDENCE, LOG_ACCEPTED, LOG_STRONG, LOG_UNAMBIGUOUS
from gse.identifier.robust import _believed, _false_match_probability
from gse.values.panorama import Parts

ARCSEC = math.radians(1 / 3600)
MIRROR = np.array([-1.0, 1.0, 1.0])
SKY = RandomSky(stars=4200, pairs=280_000, widest_rad=0.34, tolerance_rad=3.6e-4)


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


@pytest.fixture(scope="module")
def seen():
    """Ten stars of a field, and their directions with errors of 20 arcsec."""
    rng = np.random.default_rng(8)
    directions = unit(np.column_stack([rng.uniform(-0.12, 0.12, (10, 2)), np.ones(10)]))
    stars = directions @ Rotation.random(rng=rng).as_matrix()
    catalog = StarCatalog("made", 2016.0, np.arange(10), stars, np.arange(10.0))
    return unit(directions + rng.normal(0, 20 * ARCSEC, (10, 3))), catalog


def residual_by_scipy(measured, stars):
    return Rotation.align_vectors(measured, stars)[1] / math.sqrt(len(measured))


def answer(seen, tolerance_rad, *, flip=False):
    directions, catalog = seen
    rows = np.arange(10)
    return accepted(directions * MIRROR if flip else directions, catalog, rows, rows, tolerance_rad, 1e-7)


def test_the_evidence_that_ends_a_search_leaves_an_ambiguous_rival_a_chance_of_a_thousandth():
    """An attitude by chance has a Bayes factor of x with a probability of 1 / x at most (Markov)."""
    assert math.exp(LOG_UNAMBIGUOUS - LOG_STRONG) == pytest.approx(1e-3)
    assert math.exp(-LOG_ACCEPTED) * CHANCE_OF_EVIDENCE == pytest.approx(1e-3)


def test_the_residual_is_that_of_the_best_rotation_that_scipy_finds(seen):
    directions, catalog = seen
    residual_rad = wahba_residual_rad(directions, catalog.icrs)
    assert residual_rad == pytest.approx(residual_by_scipy(directions, catalog.icrs), rel=1e-6)
    assert 10 * ARCSEC < residual_rad < 40 * ARCSEC


def test_directions_that_are_not_finite_fit_no_attitude(seen):
    directions, catalog = seen
    assert wahba_residual_rad(np.full_like(directions, np.nan), catalog.icrs) == math.inf


def test_an_answer_is_accepted_up_to_a_residual_of_the_tolerance_and_not_beyond(seen):
    residual_rad = wahba_residual_rad(seen[0], seen[1].icrs)
    for tolerance_rad in (residual_rad, 1.001 * residual_rad):
        found = answer(seen, tolerance_rad)
        assert isinstance(found, Identification)
        assert found.false_match_probability == 1e-7
    refused = answer(seen, 0.999 * residual_rad)
    assert isinstance(refused, Unidentified)
    assert refused.reason is Reason.NO_MATCH
    assert f"lie {residual_rad / ARCSEC:.0f} arcsec rms off" in refused.detail


def test_a_mirror_image_is_called_so_only_where_it_fits_once_flipped(seen):
    residual_rad = wahba_residual_rad(seen[0], seen[1].icrs)
    mirrored = answer(seen, residual_rad, flip=True)
    assert isinstance(mirrored, Unidentified)
    assert mirrored.reason is Reason.MIRRORED
    assert f"{residual_rad / ARCSEC:.0f} once flipped" in mirrored.detail
    assert answer(seen, 0.999 * residual_rad, flip=True).reason is Reason.NO_MATCH


def test_the_expected_number_of_matches_of_two_random_objects_is_that_of_a_random_sky():
    """At the widest distance, where pairs are densest, the bound is the number itself."""
    rng, widest, tolerance = np.random.default_rng(2), 0.2, 0.004
    stars = unit(rng.normal(size=(3000, 3)))
    pairs = cKDTree(stars).query_pairs(2 * math.sin(widest / 2), output_type="ndarray")
    distance = 2 * np.arcsin(np.linalg.norm(stars[pairs[:, 0]] - stars[pairs[:, 1]], axis=1) / 2)
    fitting = int((np.abs(distance - (widest - tolerance)) < tolerance).sum())
    each_way_round = 2 * fitting
    # A millionth of the tolerance gives a millionth of the matches, which is a probability.
    sky = RandomSky(len(stars), len(pairs), widest, 1e-6 * tolerance)
    assert sky.false_match_probability(2, 1, 1) == pytest.approx(1e-6 * each_way_round, rel=0.06, abs=0)


@pytest.mark.parametrize(("objects", "alphas"), [(2, 1), (7, 1), (30, 1), (30, 4)])
def test_matches_grow_with_the_partners_and_the_alpha_stars(objects, alphas):
    fine = RandomSky(4200, 280_000, 0.34, 1e-12)
    one = fine.false_match_probability(2, 1, 1)
    assert fine.false_match_probability(objects, 1, alphas) == pytest.approx(
        alphas * (objects - 1) * one, rel=1e-12, abs=0
    )


@pytest.mark.parametrize(("objects", "fit"), [(30, 6), (30, 9), (12, 5), (8, 7), (7, 6)])
def test_the_other_objects_must_find_their_stars_by_chance(objects, fit):
    """Beside the two that match, fit - 1 of the others lie where they may: within 16 squares of the tolerance."""
    fine = RandomSky(4200, 280_000, 0.34, 1e-5)
    matches = 4 * 1e-5 / 0.34 * 2 * 280_000 * (objects - 1)
    near_a_star = 4200 * 16 * 1e-5**2 / (4 * math.pi)
    expected = matches * binom.sf(fit - 2, objects - 2, near_a_star)
    assert fine.false_match_probability(objects, fit, 1) == pytest.approx(expected, rel=1e-6, abs=0)


def test_the_bound_is_a_probability_whatever_is_asked():
    assert SKY.false_match_probability(30, 1, 4) == 1.0
    assert SKY.false_match_probability(1, 1, 1) == 0.0
    assert SKY.false_match_probability(0, 1, 1) == 0.0
    assert 0 < SKY.false_match_probability(3, 5, 1) < 1


def test_a_window_wider_than_the_field_holds_every_pair_once():
    near_a_star = 16 * 0.05**2 / (4 * math.pi)
    assert RandomSky(1, 1, 0.1, 0.05).false_match_probability(3, 2, 1) == pytest.approx(2 * 2 * near_a_star)


def test_a_sky_full_of_stars_has_one_near_every_object():
    assert RandomSky(100_000, 1, 2.0, 0.05).false_match_probability(3, 2, 1) == pytest.approx(2 * 2 * 0.1)


def evidence_of(false_match_probability):
    """The logarithm of the evidence that has this probability: a factor of x is reached with 0.05 / x at most."""
    return math.log(0.05 / false_match_probability)


def answers_by_evidence(best, second=-math.inf, *, mirrored=False):
    rows = np.arange(8)
    eight = Parts.of_counts(np.array([8]))
    return _believed(np.array([[best, second]]), np.array([mirrored]), eight, rows, rows, np.array([10]))


def by_evidence(*evidence, **options):
    return answers_by_evidence(*evidence, **options)[0]


def test_the_robust_identifier_answers_where_chance_would_in_one_of_a_thousand_or_less():
    found = by_evidence(evidence_of(0.999e-3))
    assert isinstance(found, Identification)
    assert found.false_match_probability == pytest.approx(0.999e-3)
    assert by_evidence(evidence_of(1e-12)).false_match_probability == pytest.approx(1e-12)
    assert by_evidence(evidence_of(1.001e-3)).reason is Reason.NO_MATCH
    assert by_evidence(-math.inf).reason is Reason.NO_MATCH
    assert answers_by_evidence(evidence_of(1.001e-3)).false_match_probability == [1.0]


def test_an_answer_is_ambiguous_where_another_explains_the_objects_up_to_a_hundred_times_worse():
    best = evidence_of(1e-9)
    assert by_evidence(best, best - math.log(99)).reason is Reason.AMBIGUOUS
    assert "99.0 times" in by_evidence(best, best - math.log(99)).detail
    assert isinstance(by_evidence(best, best - math.log(101)), Identification)


def test_a_mirrored_image_tells_how_many_objects_are_stars_once_flipped():
    found = by_evidence(evidence_of(1e-9), mirrored=True)
    assert found.reason is Reason.MIRRORED
    assert "8 of 10 objects" in found.detail


@pytest.mark.parametrize("evidence", [-math.inf, math.log(0.01), math.log(0.05)])
def test_what_tells_nothing_may_be_chance_with_certainty(evidence):
    assert _false_match_probability(evidence) == 1.0
