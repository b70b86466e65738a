import math

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.stats import binom
from skies.made_frames import FIELD_14_DEG, Noise, made_frame, sky_of

from gse.catalog import load_catalog
from gse.identifier import Identification, Reason, Unidentified, make_identifier
from gse.identifier.tables import field_diameter_rad, tolerance_rad
from gse.values.identifier_options import IdentifierOptions
from gse.values.spiral import spiral_directions

SELECTIONS = ("first-fit", "best-vote")


@pytest.fixture(scope="module")
def catalog():
    return load_catalog()


@pytest.fixture(scope="module")
def identifiers(catalog):
    return {s: make_identifier(IdentifierOptions(selection=s), FIELD_14_DEG, catalog) for s in SELECTIONS}


@pytest.fixture(scope="module")
def frames(catalog):
    """A hundred directions of the sky with three false objects each."""
    sky, rng = sky_of(catalog, FIELD_14_DEG, 6.0), np.random.default_rng(7)
    return [made_frame(sky, FIELD_14_DEG, b, Noise(false_objects=3), rng) for b in spiral_directions(100)]


def labels_are_right(answer: Identification, frame, identifier) -> bool:
    return bool((identifier.catalog.ids[answer.stars] == frame.ids[answer.objects]).all())


@pytest.mark.parametrize("selection", SELECTIONS)
def test_stars_are_named_right_among_three_false_objects(identifiers, frames, selection):
    identifier = identifiers[selection]
    answers = [identifier.identify(FIELD_14_DEG.directions(f.xy_px), f.brightness) for f in frames]
    named = [(a, f) for a, f in zip(answers, frames, strict=True) if isinstance(a, Identification)]
    assert len(named) >= 99
    assert all(labels_are_right(a, f, identifier) for a, f in named)
    assert all(len(a.objects) >= 7 and a.false_match_probability < 1e-3 for a, _ in named)


def test_the_false_match_probability_is_binomial_and_the_alpha_star_is_no_fit_of_its_own(identifiers, frames):
    """Each alpha object that was tried adds as much as the first. Sixteen squares of the tolerance are a place."""
    identifier = identifiers["first-fit"]
    icrs, widest_rad = identifier.catalog.icrs, field_diameter_rad(FIELD_14_DEG)
    error_rad = tolerance_rad(FIELD_14_DEG, IdentifierOptions().tolerance_px)
    pairs = len(cKDTree(icrs).query_pairs(2 * math.sin(widest_rad / 2)))
    begun = 2 * pairs * 4 * error_rad / widest_rad
    third = len(icrs) / (4 * math.pi) * 16 * error_rad**2
    tried = []
    for frame in frames:
        answer = identifier.identify(FIELD_14_DEG.directions(frame.xy_px), frame.brightness)
        others, fits = len(frame.xy_px) - 1, len(answer.objects) - 1
        of_one = others * begun * binom.sf(fits - 2, others - 1, third)
        tried.append(answer.false_match_probability / of_one)
    assert np.round(tried) == pytest.approx(tried, rel=1e-3)
    assert np.median(tried) == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize("selection", SELECTIONS)
def test_one_object_is_one_star(identifiers, frames, selection):
    for frame in frames[:30]:
        answer = identifiers[selection].identify(FIELD_14_DEG.directions(frame.xy_px), frame.brightness)
        if isinstance(answer, Identification):
            assert len(set(answer.objects)) == len(set(answer.stars)) == len(answer.objects)


@pytest.mark.parametrize("selection", SELECTIONS)
def test_a_mirrored_image_is_refused_and_called_mirrored(identifiers, frames, selection):
    flipped = frames[0].xy_px * [-1, 1] + [FIELD_14_DEG.columns - 1, 0]
    answer = identifiers[selection].identify(FIELD_14_DEG.directions(flipped), frames[0].brightness)
    assert isinstance(answer, Unidentified)
    assert answer.reason is Reason.MIRRORED
    assert "mirrored" in answer.detail


def test_without_retries_a_false_alpha_star_ends_the_search(catalog, frames):
    identifier = make_identifier(IdentifierOptions(alpha_retries=0), FIELD_14_DEG, catalog)
    false_first = next(f for f in frames if f.ids[0] == 0)
    answer = identifier.identify(FIELD_14_DEG.directions(false_first.xy_px), false_first.brightness)
    assert isinstance(answer, Unidentified)
    assert "1 alpha star" in answer.detail
