"""Result types as columns: what stands in them where nothing is given, and what one of many is."""

import math
from dataclasses import asdict

import numpy as np
import pytest

from gse.station.results import (
    NO_MATCHES,
    AnswerCheck,
    FrameResult,
    LinkCounters,
    Match,
    MatchColumns,
    Matches,
    OwnAnswer,
    Starlight,
    Starlights,
    Status,
)
from protocols import AttitudeMessage


def name_of(star):
    return f"HIP {star}"


FIRST = Matches(np.array([0, 3]), np.array([17, 4]), np.array([[3.0, -4.0], [0.5, 0.0]]), name_of)
LAST = Matches(np.array([2]), np.array([9]), np.array([[-8.0, 15.0]]), name_of)


def test_all_counters_of_a_link_begin_at_nothing():
    counters = asdict(LinkCounters())
    assert counters.pop("discarded_bytes_by_reason") == {}
    assert counters == dict.fromkeys(counters, 0)
    assert len(counters) == 9


def test_a_match_has_the_length_of_its_residual_and_the_name_of_its_star():
    assert len(FIRST) == 2
    assert list(FIRST) == [Match(0, "HIP 17", 3.0, -4.0), Match(3, "HIP 4", 0.5, 0.0)]
    assert [one.residual_arcsec for one in (*FIRST, *LAST)] == [5.0, 0.5, 17.0]


def test_no_matches_are_none():
    assert (len(NO_MATCHES), list(NO_MATCHES)) == (0, [])
    assert (NO_MATCHES.objects.shape, NO_MATCHES.stars.shape) == ((0,), (0,))
    assert NO_MATCHES.residuals_arcsec.shape == (0, 2)


def test_matches_of_many_panoramas_are_those_of_each():
    columns = MatchColumns.of([FIRST, NO_MATCHES, LAST])
    assert columns.parts.counts.tolist() == [2, 0, 1]
    assert [list(one) for one in columns] == [list(FIRST), [], list(LAST)]
    assert list(columns[2]) == list(LAST)
    assert columns.residuals_arcsec.tolist() == [[3.0, -4.0], [0.5, 0.0], [-8.0, 15.0]]


def test_matches_of_many_panoramas_have_the_names_of_the_first_catalogue():
    others = Matches(LAST.objects, LAST.stars, LAST.residuals_arcsec, str)
    assert [one.star for one in MatchColumns.of([FIRST, others])[1]] == ["HIP 9"]


@pytest.mark.parametrize("count", [0, 1, 3])
def test_no_matches_of_many_panoramas_are_none_of_each(count):
    columns = MatchColumns.none(count)
    assert [list(one) for one in columns] == [[]] * count
    assert (len(columns.objects), len(columns.stars), columns.residuals_arcsec.shape) == (0, 0, (0, 2))


def test_no_matches_of_no_panorama_have_no_catalogue():
    assert MatchColumns.of([]).name_of(7) == "7"


DARK = Starlight()
BRIGHT, FAINT = Starlight(12, 14.5, 5.25, 310.0), Starlight(3, 13.0, 4.0, 90.0)


def test_without_named_stars_there_is_no_starlight():
    assert DARK.stars == 0
    assert math.isnan(DARK.zero_point_mag)
    assert math.isnan(DARK.limiting_mag)
    assert DARK.faintest_index == math.inf


def test_starlight_of_many_panoramas_is_that_of_each():
    lights = Starlights.of([BRIGHT, DARK, FAINT])
    assert (lights[0], lights[2]) == (BRIGHT, FAINT)
    assert repr(lights[1]) == repr(DARK)  # NaN equals nothing
    assert [repr(Starlights.none(2)[k]) for k in range(2)] == [repr(DARK)] * 2


def test_starlight_is_filled_in_at_the_places_that_lack_it_in_all_of_its_columns():
    lights = Starlights.of([BRIGHT, DARK, DARK])
    lights.fill(np.array([False, True, False]), Starlights.of([DARK, FAINT, FAINT]))
    assert (lights[0], lights[1]) == (BRIGHT, FAINT)
    assert repr(lights[2]) == repr(DARK)


def test_columns_of_starlight_that_show_nothing_are_filled_one_by_one():
    lights = Starlights.none(1)
    lights.zero_point_mag[0] = 3.0
    assert math.isnan(lights.limiting_mag[0])


def test_an_answer_of_the_sensor_without_a_number_on_the_wire_has_number_zero():
    assert OwnAnswer(AttitudeMessage(7, frame_no=3), 5, None).sequence == 0


def test_a_result_says_nothing_that_it_was_not_given():
    result = FrameResult(None, Status.NO_MATCH, "", "neighbour")
    assert result.answer_check is AnswerCheck.UNKNOWN
    assert (result.others, len(result.matches), len(result.left_out)) == ((), 0, 0)
    assert result.has_roll
    nothing = result.identification, result.attitude, result.attitude_geometric, result.attitude_error
    assert nothing == (None, None, None, None)
    assert (result.attitude_true, result.elapsed_us, result.given) == (None, None, None)
