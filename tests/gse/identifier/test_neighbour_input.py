"""Bad input to the onboard identifiers: a reason, never a crash, a hang or a false star."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skies.made_frames import FIELD_14_DEG, Noise, made_frame, sky_of

from gse.catalog import load_catalog
from gse.identifier import Identification, Reason, Unidentified, make_identifier
from gse.values.identifier_options import IdentifierOptions
from gse.values.spiral import spiral_directions

OPTIONS = {
    "first-fit": IdentifierOptions(),
    "best-vote": IdentifierOptions(selection="best-vote"),
    "pivot": IdentifierOptions(algorithm="pivot"),
    "match-group": IdentifierOptions(algorithm="match-group"),
}


@pytest.fixture(scope="module")
def identifiers():
    catalog = load_catalog()
    return {name: make_identifier(options, FIELD_14_DEG, catalog) for name, options in OPTIONS.items()}


@pytest.fixture(params=list(OPTIONS))
def identifier(identifiers, request):
    return identifiers[request.param]


@pytest.fixture(scope="module")
def frame():
    sky = sky_of(load_catalog(), FIELD_14_DEG, 6.0)
    return made_frame(sky, FIELD_14_DEG, spiral_directions(10)[4], Noise(), np.random.default_rng(2))


def answer(identifier, xy_px, brightness):
    return identifier.identify(FIELD_14_DEG.directions(np.array(xy_px, dtype=float)), np.array(brightness, dtype=float))


@pytest.mark.parametrize("count", [0, 1, 2])
def test_too_few_objects_are_called_so(identifier, count):
    result = answer(identifier, [[100.0 * i, 50.0] for i in range(count)], range(count, 0, -1))
    assert isinstance(result, Unidentified)
    assert result.reason is Reason.TOO_FEW
    assert str(count) in result.detail


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_position_that_is_no_number_is_a_sensor_fault(identifier, frame, value):
    xy = frame.xy_px.copy()
    xy[3, 1] = value
    with np.errstate(invalid="ignore"):
        result = answer(identifier, xy, frame.brightness)
    assert isinstance(result, Unidentified)
    assert result.reason is Reason.SENSOR_FAULT


@pytest.mark.parametrize("value", [np.nan, np.inf, -1.0])
def test_an_index_that_is_no_brightness_is_a_sensor_fault(identifier, frame, value):
    brightness = frame.brightness.copy()
    brightness[-1] = value
    assert answer(identifier, frame.xy_px, brightness).reason is Reason.SENSOR_FAULT


@pytest.mark.parametrize("value", [0.0, 1.0, 4096.0])
def test_index_values_that_are_all_equal_are_a_sensor_fault(identifier, frame, value):
    result = answer(identifier, frame.xy_px, np.full(len(frame.brightness), value))
    assert result.reason is Reason.SENSOR_FAULT
    assert "zero" in result.detail if value == 0 else "equal" in result.detail


def test_thirty_one_objects_are_a_sensor_fault(identifier):
    xy = np.random.default_rng(0).uniform(0, 1023, (31, 2))
    result = answer(identifier, xy, np.linspace(4000, 100, 31))
    assert result.reason is Reason.SENSOR_FAULT
    assert "31" in result.detail


def test_thirty_objects_on_one_pixel_are_not_stars(identifier):
    result = answer(identifier, [[512, 300]] * 30, np.linspace(4000, 100, 30))
    assert isinstance(result, Unidentified)


def test_objects_in_one_clump_are_not_stars(identifier):
    xy = [[512 + i % 6, 300 + i // 6] for i in range(30)]
    assert isinstance(answer(identifier, xy, np.linspace(4000, 100, 30)), Unidentified)


def test_an_object_listed_twice_is_one_star(identifier, frame):
    once = answer(identifier, frame.xy_px[:15], frame.brightness[:15])
    twice = answer(identifier, np.repeat(frame.xy_px[:15], 2, axis=0), np.repeat(frame.brightness[:15], 2))
    assert isinstance(once, Identification)
    assert isinstance(twice, Identification)
    assert (twice.objects == 2 * once.objects).all()
    assert (twice.stars == once.stars).all()


def test_directions_that_are_not_unit_vectors_are_a_sensor_fault(identifier, frame):
    directions = 2 * FIELD_14_DEG.directions(frame.xy_px)
    assert identifier.identify(directions, frame.brightness).reason is Reason.SENSOR_FAULT


@pytest.mark.parametrize(("directions", "brightness"), [((5, 2), (5,)), ((5, 3), (4,)), ((5,), (5,)), ((5, 3), (5, 1))])
def test_shapes_that_do_not_belong_together_are_the_callers_error(identifier, directions, brightness):
    with pytest.raises(ValueError, match="expected"):
        identifier.identify(np.ones(directions), np.ones(brightness))


@settings(max_examples=60)
@given(
    xy=st.lists(st.tuples(st.integers(0, 1023), st.integers(0, 1023)), max_size=30),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_panorama_gets_an_answer_in_which_one_object_is_one_star(identifiers, xy, seed):
    brightness = np.sort(np.random.default_rng(seed).uniform(1, 4096, len(xy)))[::-1]
    for identifier in identifiers.values():
        result = answer(identifier, np.array(xy, dtype=float).reshape(-1, 2), brightness)
        if isinstance(result, Identification):
            assert len(set(result.objects)) == len(set(result.stars)) == len(result.objects)
            assert 0 <= result.false_match_probability <= 1


@pytest.mark.parametrize("selection", ["first-fit", "best-vote"])
def test_random_objects_are_not_named(identifiers, selection):
    rng = np.random.default_rng(9)
    for _ in range(20):
        result = answer(identifiers[selection], rng.integers(0, 1024, (30, 2)), np.linspace(4000, 100, 30))
        assert isinstance(result, Unidentified)


def test_a_tolerance_that_lets_everything_fit_still_ends():
    options = [replace(o, tolerance_px=20.0, min_fit=20) for o in OPTIONS.values()]
    catalog = load_catalog()
    xy = np.random.default_rng(1).uniform(0, 1023, (30, 2))
    for option in options:
        identifier = make_identifier(option, FIELD_14_DEG, catalog)
        assert answer(identifier, xy, np.linspace(4000, 100, 30)) is not None
