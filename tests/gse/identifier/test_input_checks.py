"""What makes a panorama unfit to be identified, limit by limit."""

import numpy as np
import pytest

from gse.identifier import Reason
from gse.identifier.checks import distinct_objects, refusal, refusals
from gse.identifier.result import ObjectColumns

FEWEST = 4


def fan(count):
    """Unit vectors a degree apart."""
    angles = np.radians(np.arange(count, dtype=float))
    return np.column_stack([np.sin(angles), np.zeros(count), np.cos(angles)])


def refused(directions=None, brightness=None, *, count=8):
    directions = fan(count) if directions is None else directions
    brightness = np.linspace(900.0, 100.0, len(directions)) if brightness is None else brightness
    return refusal(directions, np.asarray(brightness, dtype=float), FEWEST)


@pytest.mark.parametrize("count", [FEWEST, 17, 30])
def test_a_sound_panorama_is_not_refused(count):
    assert refused(count=count) is None


@pytest.mark.parametrize(
    ("count", "reason"), [(0, Reason.TOO_FEW), (FEWEST - 1, Reason.TOO_FEW), (31, Reason.SENSOR_FAULT)]
)
def test_a_panorama_has_enough_objects_and_no_more_than_thirty(count, reason):
    found = refused(count=count)
    assert found.reason is reason
    assert str(count) in found.detail
    assert str(30 if count == 31 else FEWEST) in found.detail


def test_many_panoramas_are_refused_as_one_by_one():
    panoramas = [(fan(count), np.linspace(900.0, 100.0, count)) for count in (0, FEWEST - 1, FEWEST, 17, 30, 31)]
    panoramas += [(fan(8), np.full(8, 5.0)), (fan(2), np.full(2, np.nan)), (fan(31), np.full(31, -1.0))]
    found = refusals(ObjectColumns.from_panoramas(panoramas), FEWEST)
    assert [found.get(k) for k in range(len(panoramas))] == [refusal(*panorama, FEWEST) for panorama in panoramas]
    assert sorted(found) == [0, 1, 5, 6, 7, 8]


@pytest.mark.parametrize("place", [0, 3, 7])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_every_number_must_be_finite(place, value):
    brightness = np.linspace(900.0, 100.0, 8)
    brightness[place] = value
    assert refused(brightness=brightness).detail == "a position or index value is not a finite number"
    for axis in range(3):
        directions = fan(8)
        directions[place, axis] = value
        assert refused(directions).detail == "a position or index value is not a finite number"


@pytest.mark.parametrize("place", [0, 5, 7])
@pytest.mark.parametrize("axis", range(3))
def test_a_direction_has_the_length_of_one_to_a_part_in_two_million(place, axis):
    for off, good in ((0.9e-6, True), (-0.9e-6, True), (1.1e-6, False), (-1.1e-6, False)):
        directions = np.roll(fan(8), axis, axis=1)
        directions[place] *= np.sqrt(1 + off)
        found = refused(directions)
        assert (found is None) is good
        assert good or (found.reason, found.detail) == (Reason.SENSOR_FAULT, "a direction is not a unit vector")


@pytest.mark.parametrize(
    ("brightness", "detail"),
    [
        ([5, 4, 3, 2, 1, 0, 0, 0], None),
        ([1, 0, 0, 0, 0, 0, 0, 0], None),
        ([0] * 8, "all index values are zero: the panorama holds no light"),
        ([1] * 8, "all index values are equal: no object is the brightest"),
        ([7, 7, 7, 7, 7, 7, 7, 6], None),
        ([5, 4, 3, 2, 1, 0, 0, -1e-9], "an index value is negative; 0 is the darkest"),
        ([0, 0, 0, 0, 0, 0, 0, -1], "an index value is negative; 0 is the darkest"),
        ([-1] * 8, "an index value is negative; 0 is the darkest"),
    ],
)
def test_index_values_tell_bright_from_dark(brightness, detail):
    found = refused(brightness=brightness)
    assert (found and found.detail) == detail
    assert found is None or found.reason is Reason.SENSOR_FAULT


@pytest.mark.parametrize(
    ("directions", "brightness"), [((8, 2), 8), ((8, 4), 8), ((8, 3), 7), ((8, 3), 9), ((8, 3, 1), 8), ((24,), 24)]
)
def test_shapes_that_do_not_belong_together_are_named(directions, brightness):
    with pytest.raises(ValueError, match=r"shape \(.*expected \(N, 3\) and \(N,\)"):
        refusal(np.ones(directions), np.ones(brightness), FEWEST)


@pytest.mark.parametrize("axis", range(3))
def test_two_objects_at_one_place_are_the_brighter_one_and_a_fifth_of_an_arcsec_is_one_place(axis):
    directions = np.roll(fan(6), axis, axis=1)
    for shift in ([1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0], [0.6, 0, 0.8], [0, -0.6, 0.8]):
        near, apart = directions.copy(), directions.copy()
        near[4] = directions[1] + 0.99e-6 * np.array(shift)
        apart[4] = directions[1] + 1.01e-6 * np.array(shift)
        assert distinct_objects(near).tolist() == [0, 1, 2, 3, 5]
        assert distinct_objects(apart).tolist() == [0, 1, 2, 3, 4, 5]


def test_of_many_objects_at_one_place_the_first_stays():
    assert distinct_objects(np.repeat(fan(3), 3, axis=0)).tolist() == [0, 3, 6]
    assert distinct_objects(fan(1)).tolist() == [0]
    assert distinct_objects(np.empty((0, 3))).tolist() == []
