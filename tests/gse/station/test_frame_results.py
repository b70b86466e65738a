"""Results of three panoramas as columns, by hand: the rows of both tables, and each result again."""

import math
from dataclasses import astuple, replace

import numpy as np
import pytest

from gse.attitude import Attitude
from gse.identifier import Answers, Identification, Reason, Unidentified
from gse.panorama import Panorama
from gse.station.frame_results import FrameResults, NewResults
from gse.station.frame_table import ANSWER_CHECKS, FRAME, MATCH, OTHER, STATUSES
from gse.station.non_stellar import KINDS
from gse.station.results import AnswerCheck, AttitudeError, FrameResult, Matches, Starlight, Status

RAW, GEOMETRIC, TRUE = (Attitude.from_angles(10.0 + k, -20.0 + k, 30.0 + k) for k in range(3))
NO_MATCH = Unidentified(Reason.NO_MATCH, "no star reached Fn = 6")
ERROR = AttitudeError(1.0, 2.0, 3.0, 4.0, 5.0)


def star(row):
    return f"star {row}"


def other_star(row):
    return f"other {row}"


def panorama(k, objects):
    """Panorama k; its objects stand at x = 100 k + row, y = 500 + 100 k + row, and are of brightness 300, 200, ..."""
    rows = np.arange(objects)
    places = np.column_stack([100.0 * k + rows, 500.0 + 100.0 * k + rows])
    return Panorama(
        utc_ns=1_774_000_000_000_000_000 + k,
        xy_px=places,
        brightness=300.0 - 100.0 * rows,
        frame_no=70 + k,
        exposure_s=0.25 + k,
        time_us=5_000_000 + k,
        host_utc_ns=1_774_000_000_500_000_000 + k,
        sequence=900 + k,
        temperature_c=21.5 + k,
    )


def identified():
    """Three objects: the first and the last are stars 17 and 4, the middle one is none; star 6 was left out."""
    return FrameResult(
        panorama(1, 3),
        Status.IDENTIFIED,
        "",
        "neighbour",
        Identification(np.array([0, 2]), np.array([17, 4]), 1e-9),
        RAW,
        Matches(np.array([0, 2]), np.array([17, 4]), np.array([[3.0, -4.0], [0.5, 0.25]]), star),
        150.5,
        GEOMETRIC,
        ERROR,
        TRUE,
        AnswerCheck.CORRECT,
        ((1, "unknown"), (2, "hot pixel")),
        Matches(np.array([1]), np.array([6]), np.array([[7.0, 8.0]]), star),
        Starlight(2, 14.5, 5.25, 199.0),
    )


def without_answer():
    return FrameResult(panorama(0, 1), Status.NO_MATCH, "no star reached Fn = 6", "neighbour", elapsed_us=0.0)


def bare():
    """An answer that nothing is known of but its stars and its attitude."""
    named = Identification(np.array([1]), np.array([8]), 0.5)
    matches = Matches(np.array([1]), np.array([8]), np.array([[-1.0, 2.0]]), other_star)
    return FrameResult(panorama(2, 2), Status.IDENTIFIED, "", "pivot", named, RAW, matches)


MADE = [identified(), without_answer(), bare()]


def plain(result):
    """Everything that a result says, as values that can be compared; NaN as a word."""
    attitudes = result.attitude, result.attitude_geometric, result.attitude_true
    named = result.identification
    return (
        repr(result.panorama.utc_ns),
        result.status,
        result.detail,
        result.identifier,
        None if named is None else (named.objects.tolist(), named.stars.tolist(), named.false_match_probability),
        [None if one is None else one.icrs_to_sensor.tolist() for one in attitudes],
        [list(map(repr, some)) for some in (result.matches, result.left_out)],
        result.elapsed_us,
        result.attitude_error,
        result.answer_check,
        result.others,
        repr(result.light),
    )


def column(name):
    return FrameResults.of(MADE).rows()[name].tolist()


COLUMNS = {
    "utc_ns": [1_774_000_000_000_000_001, 1_774_000_000_000_000_000, 1_774_000_000_000_000_002],
    "host_utc_ns": [1_774_000_000_500_000_001, 1_774_000_000_500_000_000, 1_774_000_000_500_000_002],
    "time_us": [5_000_001, 5_000_000, 5_000_002],
    "frame_no": [71, 70, 72],
    "sequence": [901, 900, 902],
    "exposure_s": [1.25, 0.25, 2.25],
    "temperature_c": [22.5, 21.5, 23.5],
    "status": [STATUSES.index(one) for one in (Status.IDENTIFIED, Status.NO_MATCH, Status.IDENTIFIED)],
    "answer_check": [ANSWER_CHECKS.index(one.answer_check) for one in MADE],
    "objects": [3, 1, 2],
    "matched": [2, 0, 1],
    "hot_pixels": [1, 0, 0],
    "stars_seen": [2, 0, 0],
    "false_objects": [1, 0, 0],
    "elapsed_us": [150.5, 0.0, math.nan],
    "false_match_probability": [1e-9, math.nan, 0.5],
    "zero_point_mag": [14.5, math.nan, math.nan],
    "limiting_mag": [5.25, math.nan, math.nan],
    "ra_deg": [10.0, math.nan, 10.0],
    "de_deg": [-20.0, math.nan, -20.0],
    "roll_deg": [30.0, math.nan, 30.0],
    "ra_true_deg": [12.0, math.nan, math.nan],
    "de_true_deg": [-18.0, math.nan, math.nan],
    "roll_true_deg": [32.0, math.nan, math.nan],
    "d_ra_cosde_arcsec": [1.0, math.nan, math.nan],
    "d_de_arcsec": [2.0, math.nan, math.nan],
    "d_roll_arcsec": [3.0, math.nan, math.nan],
    "cross_x_arcsec": [4.0, math.nan, math.nan],
    "cross_y_arcsec": [5.0, math.nan, math.nan],
    "sky_condition": [0, 0, 0],
    "mode": [0, 0, 0],
    **dict.fromkeys(
        (
            "transparency",
            "stars_expected",
            "sun_altitude_deg",
            "sun_separation_deg",
            "moon_altitude_deg",
            "moon_separation_deg",
            "supply_v",
        ),
        [math.nan] * 3,
    ),
}
"""What the three results say, by column of the frame table; of the sky and the supply nothing is known yet."""


@pytest.mark.parametrize(("name", "values"), COLUMNS.items())
def test_a_column_of_the_frame_table_is_what_the_results_say(name, values):
    assert column(name) == pytest.approx(values, rel=1e-7, nan_ok=True)


def test_every_column_of_the_frame_table_is_held_above():
    assert set(COLUMNS) == set(FRAME.names)


def test_columns_give_back_each_result_whether_it_is_kept_or_made_again():
    results = FrameResults.of(MADE)
    assert len(results) == 3
    assert [plain(one) for one in results] == [plain(one) for one in MADE]
    again = replace(results, made=(), answers=Answers.of([MADE[0].identification, NO_MATCH, MADE[2].identification]))
    # Columns have one identifier and the names of one catalogue: those of the first.
    bare_of_the_first = replace(MADE[2], identifier="neighbour", matches=replace(MADE[2].matches, name_of=star))
    assert [plain(one) for one in again] == [plain(one) for one in (*MADE[:2], bare_of_the_first)]
    assert len(list(again)) == 3
    assert results[1] is MADE[1]


def test_a_result_that_is_made_again_has_the_objects_of_its_own_panorama():
    seen = [one.panorama for one in replace(FrameResults.of(MADE), made=())]
    assert [one.frame_no for one in seen] == [71, 70, 72]
    assert [one.xy_px.tolist() for one in seen] == [one.panorama.xy_px.tolist() for one in MADE]
    assert [len(one.brightness) for one in seen] == [3, 1, 2]


def test_an_error_of_which_the_roll_alone_is_missing_is_an_error():
    errors = np.array([[1.0, 2.0, math.nan, 4.0, 5.0], *[[math.nan] * 5] * 2])
    found = replace(FrameResults.of(MADE), made=(), errors_arcsec=errors)
    assert astuple(found[0].attitude_error) == pytest.approx((1.0, 2.0, math.nan, 4.0, 5.0), nan_ok=True)
    assert found[1].attitude_error is None


def test_an_answer_without_a_roll_has_none_in_its_row():
    rows = FrameResults.of([replace(MADE[0], has_roll=False), MADE[0]]).rows()
    assert rows["roll_deg"].tolist() == pytest.approx([math.nan, 30.0], nan_ok=True)
    assert rows["roll_true_deg"].tolist() == pytest.approx([32.0, 32.0])
    assert rows["ra_deg"].tolist() == pytest.approx([10.0, 10.0])


@pytest.mark.parametrize(("faintest_index", "count"), [(199.0, 1), (200.0, 0), (201.0, 0), (math.inf, 0)])
def test_a_false_object_is_brighter_than_every_star_that_the_catalogue_lacks(faintest_index, count):
    """The second object of the second panorama, of brightness 200: the first one's are brighter."""
    seen = replace(MADE[0], light=Starlight(2, 14.5, 5.25, faintest_index))
    rows = FrameResults.of([MADE[1], seen]).rows()
    assert rows["false_objects"].tolist() == [0, count]


def test_hot_pixels_and_planets_are_no_false_objects():
    seen = replace(MADE[0], others=((0, "Jupiter"), (1, "hot pixel"), (2, "hot pixel")))
    rows = FrameResults.of([seen]).rows()
    assert (rows["false_objects"].tolist(), rows["hot_pixels"].tolist()) == ([0], [2])


def test_rows_of_stars_stand_by_frame_those_that_were_left_out_behind_those_that_were_named():
    rows = FrameResults.of(MADE).match_rows()
    assert rows.dtype == MATCH
    assert rows.tolist() == [
        (0, 17, 100.0, 600.0, 3.0, -4.0, 300.0, True),
        (0, 4, 102.0, 602.0, 0.5, 0.25, 100.0, True),
        (0, 6, 101.0, 601.0, 7.0, 8.0, 200.0, False),
        (2, 8, 201.0, 701.0, -1.0, 2.0, 200.0, True),
    ]


def test_rows_of_stars_are_those_that_were_named_where_none_was_left_out():
    rows = FrameResults.of(MADE[1:]).match_rows()
    assert rows.tolist() == [(1, 8, 201.0, 701.0, -1.0, 2.0, 200.0, True)]


def test_rows_of_other_objects_are_those_that_no_answer_names_each_with_its_kind():
    """Of the second panorama, which has no answer, all of them."""
    rows = FrameResults.of([replace(MADE[0], others=((1, "hot pixel"),)), *MADE[1:]]).other_rows()
    assert rows.dtype == OTHER
    hot, unknown = KINDS.index("hot pixel"), KINDS.index("unknown")
    assert rows[rows["frame"] == 0].tolist() == [(0, 101.0, 601.0, 200.0, hot)]
    unnamed = rows[rows["frame"] == 1]
    assert unnamed["x_px"].tolist() == MADE[1].panorama.xy_px[:, 0].tolist()
    assert unnamed["brightness"].tolist() == MADE[1].panorama.brightness.tolist()
    assert set(unnamed["kind"].tolist()) <= {unknown}
    named = len(MADE[2].matches)
    assert int((rows["frame"] == 2).sum()) == len(MADE[2].panorama.brightness) - named


def test_new_results_are_a_part_of_the_results_with_their_rows():
    results = FrameResults.of(MADE)
    rows = results.rows()
    some = NewResults(results, rows[1:3], 1)
    assert (len(some), list(some)) == (2, MADE[1:])
    assert (some[0], some[1], some[-1]) == (MADE[1], MADE[2], MADE[2])
    assert some.rows["frame_no"].tolist() == [70, 72]
    with pytest.raises(IndexError):
        some[2]
    assert list(NewResults(results, rows[:2])) == MADE[:2]
    every = NewResults.of(MADE)
    assert (list(every), every.rows["frame_no"].tolist()) == (MADE, [71, 70, 72])
