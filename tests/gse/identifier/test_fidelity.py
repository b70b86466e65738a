"""The options that bring the identifiers nearer to their papers; docs/formulas.md has the statements."""

import numpy as np
import pytest
from skies.made_frames import FIELD_14_DEG, Noise, made_frame, sky_of

from gse.catalog import load_catalog
from gse.identifier import Identification, ObjectColumns, Reason, Unidentified, make_identifier
from gse.values.identifier_options import IdentifierOptions
from gse.values.spiral import spiral_directions


@pytest.fixture(scope="module")
def catalog():
    return load_catalog(stars=20_000)


@pytest.fixture(scope="module")
def frames(catalog):
    """Directions of the sky with eight false objects each."""
    sky, rng = sky_of(catalog, FIELD_14_DEG, 6.0), np.random.default_rng(7)
    noise = Noise(false_objects=8)
    return [made_frame(sky, FIELD_14_DEG, direction, noise, rng) for direction in spiral_directions(60)]


def outcomes(catalog, frames, **options):
    """What becomes of the frames: how many are right, false, and without an answer; and the sizes of the answers."""
    identifier = make_identifier(IdentifierOptions(**options), FIELD_14_DEG, catalog)
    counts, sizes = {"right": 0, "false": 0, "none": 0}, []
    for frame in frames:
        answer = identifier.identify(FIELD_14_DEG.directions(frame.xy_px), frame.brightness)
        if isinstance(answer, Unidentified):
            counts["none"] += 1
            continue
        right = (identifier.catalog.ids[answer.stars] == frame.ids[answer.objects]).mean() > 0.5
        counts["right" if right else "false"] += 1
        sizes.append(len(answer.objects))
    return counts, sizes


def test_without_the_check_the_false_answers_of_a_flight_unit_are_seen(catalog, frames):
    checked, _ = outcomes(catalog, frames, min_fit=3)
    unchecked, _ = outcomes(catalog, frames, min_fit=3, check="none")
    assert unchecked["false"] > 1.5 * checked["false"]
    assert unchecked["none"] < checked["none"] + 3


def test_a_mirrored_image_is_answered_without_the_check(catalog, frames):
    identifier = make_identifier(IdentifierOptions(check="none"), FIELD_14_DEG, catalog)
    flipped = frames[0].xy_px * [-1, 1] + [FIELD_14_DEG.columns - 1, 0]
    answer = identifier.identify(FIELD_14_DEG.directions(flipped), frames[0].brightness)
    assert isinstance(answer, Identification)


def test_exceeded_asks_for_one_more_than_reached(catalog, frames):
    reached = make_identifier(IdentifierOptions(min_fit=6), FIELD_14_DEG, catalog)
    exceeded = make_identifier(IdentifierOptions(min_fit=5, fit_rule="exceeded"), FIELD_14_DEG, catalog)
    for frame in frames[:15]:
        directions = FIELD_14_DEG.directions(frame.xy_px)
        one, other = reached.identify(directions, frame.brightness), exceeded.identify(directions, frame.brightness)
        if isinstance(one, Identification):
            assert one.stars.tolist() == other.stars.tolist()
        else:
            assert isinstance(other, Unidentified)


def test_fn_2_is_a_limit_of_its_own(catalog, frames):
    _, sizes = outcomes(catalog, frames, min_fit=4, min_fit_2=9)
    assert sizes
    assert min(sizes) >= 10
    _, sizes = outcomes(catalog, frames, min_fit=9, min_fit_2=4)
    assert min(sizes) < 10


def test_the_brightest_central_star_is_the_alpha_star(catalog, frames):
    options = IdentifierOptions(alpha="central", alpha_radius_px=256, alpha_retries=0)
    identifier = make_identifier(options, FIELD_14_DEG, catalog)
    for frame in frames:
        answer = identifier.identify(FIELD_14_DEG.directions(frame.xy_px), frame.brightness)
        central = np.flatnonzero(np.hypot(*(frame.xy_px - 511.5).T) <= 256)
        if isinstance(answer, Identification) and len(central):
            assert answer.objects[0] == central[0]  # the panorama is in the order of brightness
    one, _ = outcomes(catalog, frames, alpha_retries=0)
    central, _ = outcomes(catalog, frames, alpha_retries=0, alpha="central", alpha_radius_px=256)
    assert one["right"] != central["right"]


def test_all_fit_answers_the_greatest_fit_and_refuses_a_tie(catalog, frames):
    first, first_sizes = outcomes(catalog, frames, min_fit=3)
    every, every_sizes = outcomes(catalog, frames, min_fit=3, selection="all-fit")
    assert every["right"] > first["right"]
    assert every["false"] < first["false"]
    assert np.mean(every_sizes) > np.mean(first_sizes)
    identifier = make_identifier(IdentifierOptions(min_fit=3, selection="all-fit"), FIELD_14_DEG, catalog)
    answers = [identifier.identify(FIELD_14_DEG.directions(f.xy_px), f.brightness) for f in frames]
    assert any(isinstance(answer, Unidentified) and answer.reason is Reason.AMBIGUOUS for answer in answers)


def test_a_pivot_group_of_five_asks_for_more_than_one_of_four(catalog, frames):
    four, _ = outcomes(catalog, frames, algorithm="pivot")
    five, _ = outcomes(catalog, frames, algorithm="pivot", pivot_members=5)
    assert five["right"] > 0
    assert five != four


def test_a_magnitude_limit_shortens_the_catalogue_of_pivot(catalog):
    options = IdentifierOptions(algorithm="pivot", catalog_stars=5000, magnitude_limit=5.0)
    identifier = make_identifier(options, FIELD_14_DEG, catalog)
    assert identifier.catalog.magnitude[-1] <= 5.0
    assert len(identifier.catalog) > 500


def sequence(catalog, frames, **options):
    """The answers to frames that follow each other, as a session gives them, and which of them are right."""
    identifier = make_identifier(IdentifierOptions(algorithm="pivot", **options), FIELD_14_DEG, catalog)
    seen = [(FIELD_14_DEG.directions(frame.xy_px), frame.brightness) for frame in frames]
    parts = [identifier.identify_many(ObjectColumns.from_panoramas(part)) for part in (seen[:20], seen[20:])]
    answers = [answer for part in parts for answer in part]
    return [
        isinstance(answer, Identification)
        and (identifier.catalog.ids[answer.stars] == frame.ids[answer.objects]).mean() > 0.5
        for answer, frame in zip(answers, frames, strict=True)
    ]


def test_cells_known_from_the_frame_before_name_what_the_whole_sky_leaves_open(catalog):
    sky, rng = sky_of(catalog, FIELD_14_DEG, 6.0), np.random.default_rng(8)
    still = [made_frame(sky, FIELD_14_DEG, np.array([0.6, 0.0, 0.8]), Noise(), rng) for _ in range(40)]
    everywhere = sequence(catalog, still, tolerance_px=10)
    in_cells = sequence(catalog, still, tolerance_px=10, a_priori="cells")
    assert sum(everywhere) < 0.8 * len(still)
    assert sum(in_cells) > sum(everywhere) + 4


def test_a_sky_that_jumps_is_looked_for_everywhere(catalog, frames):
    assert sequence(catalog, frames, a_priori="cells") == sequence(catalog, frames)


@pytest.mark.parametrize(
    ("key", "word"),
    [("algorithm", "neighbor"), ("selection", "any"), ("check", "wabha"), ("alpha", "bright"), ("pivot_members", 6)],
)
def test_a_word_that_no_option_knows_is_refused(key, word):
    with pytest.raises(ValueError, match=f"identifier.{key} is {word!r}; expected one of "):
        IdentifierOptions(**{key: word})
