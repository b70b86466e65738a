"""Result types as columns: what stands in them where nothing is given, and what one of many is."""

import math
from dataclasses import asdict, astuple, fields

import numpy as np
import pytest
from skies.one_by_one import DARK, NO_STARS, Light, Made, Stars, lights_of, matches_of, result_of

from gse.station.results import (
    AnswerCheck,
    LinkCounters,
    Match,
    Matches,
    OwnAnswer,
    Starlight,
    Status,
)
from gse.values.panorama import Panorama
from protocols import AttitudeMessage


def name_of(star):
    return f"HIP {star}"


FIRST = Stars(np.array([0, 3]), np.array([17, 4]), np.array([[3.0, -4.0], [0.5, 0.0]]), name_of)
LAST = Stars(np.array([2]), np.array([9]), np.array([[-8.0, 15.0]]), name_of)


def test_all_counters_of_a_link_begin_at_nothing():
    counters = asdict(LinkCounters())
    assert counters.pop("discarded_bytes_by_reason") == {}
    assert counters == dict.fromkeys(counters, 0)
    assert len(counters) == 14


def test_a_match_has_the_length_of_its_residual_and_the_name_of_its_star():
    (matches,) = [matches_of([FIRST], name_of)[0]]
    assert matches == [Match(0, "HIP 17", 3.0, -4.0), Match(3, "HIP 4", 0.5, 0.0)]
    assert [one.residual_arcsec for one in matches] == [5.0, 0.5]


def test_matches_of_many_panoramas_are_those_of_each():
    columns = matches_of([FIRST, NO_STARS, LAST], name_of)
    assert columns.parts.counts.tolist() == [2, 0, 1]
    assert [[one.object for one in columns[k]] for k in range(3)] == [[0, 3], [], [2]]
    assert [one.star for one in columns[2]] == ["HIP 9"]
    assert columns.residuals_arcsec.tolist() == [[3.0, -4.0], [0.5, 0.0], [-8.0, 15.0]]


def test_a_part_of_matches_is_counted_from_its_first_panorama():
    columns = matches_of([FIRST, NO_STARS, LAST, FIRST], name_of)
    part = columns.part(1, 3)
    assert (len(part.parts), part.parts.counts.tolist()) == (2, [0, 1])
    assert [part[k] for k in range(2)] == [[], columns[2]]
    assert columns.part(3, 3).parts.counts.tolist() == []


@pytest.mark.parametrize("count", [0, 1, 3])
def test_no_matches_of_many_panoramas_are_none_of_each(count):
    columns = Matches.none(count)
    assert [columns[k] for k in range(count)] == [[]] * count
    assert (len(columns.objects), len(columns.stars), columns.residuals_arcsec.shape) == (0, 0, (0, 2))


BRIGHT, FAINT = Light(12, 14.5, 5.25, 310.0), Light(3, 13.0, 4.0, 90.0)


def shown(lights):
    return [[getattr(lights, item.name)[k] for item in fields(lights)] for k in range(len(lights.stars))]


def test_without_named_stars_there_is_no_starlight():
    assert shown(Starlight.none(2)) == [pytest.approx([0, math.nan, math.nan, math.inf], nan_ok=True)] * 2


def test_starlight_is_filled_in_at_the_places_that_lack_it_in_all_of_its_columns():
    lights = lights_of([BRIGHT, DARK, DARK])
    lights.fill(np.array([False, True, False]), lights_of([DARK, FAINT, FAINT]))
    assert shown(lights) == [pytest.approx(astuple(one), nan_ok=True) for one in (BRIGHT, FAINT, DARK)]
    assert shown(lights.part(1, 3)) == [pytest.approx(astuple(one), nan_ok=True) for one in (FAINT, DARK)]


def test_columns_of_starlight_that_show_nothing_are_filled_one_by_one():
    lights = Starlight.none(1)
    lights.zero_point_mag[0] = 3.0
    assert math.isnan(lights.limiting_mag[0])


def test_an_answer_of_the_sensor_without_a_number_on_the_wire_has_number_zero():
    assert OwnAnswer(AttitudeMessage(7, frame_no=3), 5, None).sequence == 0


def test_a_result_says_nothing_that_it_was_not_given():
    nowhere = Panorama(0, np.zeros((0, 2)), np.zeros(0))
    result = result_of(Made(nowhere, Status.NO_MATCH))
    assert result.answer_check is AnswerCheck.UNKNOWN
    assert (result.others, result.matches) == ((), [])
    assert result.has_roll
    assert math.isnan(result.false_match_probability)
    nothing = result.attitude, result.attitude_geometric, result.attitude_error
    assert nothing == (None, None, None)
    assert (result.attitude_true, result.elapsed_us, result.given) == (None, None, None)
