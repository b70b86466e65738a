"""Results of three panoramas as columns, by hand: the rows of both tables, and each result again."""

import math
from dataclasses import astuple, replace

import numpy as np
import pytest
from skies.one_by_one import Light, Made, Stars, results_of

from gse.external.answers import Failure, FailureKind
from gse.external.identifier import Given
from gse.identifier import Answers, Identification, Reason, Unidentified
from gse.station.columns import ANSWER_CHECKS, FRAME, STATUSES
from gse.station.non_stellar import KINDS
from gse.station.results import AnswerCheck, AttitudeError, Status
from gse.station.session_tables import MATCH, OTHER
from gse.values.attitude import Attitude
from gse.values.panorama import Panorama

RAW, GEOMETRIC, TRUE = (Attitude.from_angles(10.0 + k, -20.0 + k, 30.0 + k) for k in range(3))
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
    return Made(
        panorama(1, 3),
        Status.IDENTIFIED,
        "",
        "neighbour",
        Identification(np.array([0, 2]), np.array([17, 4]), 1e-9),
        RAW,
        Stars(np.array([0, 2]), np.array([17, 4]), np.array([[3.0, -4.0], [0.5, 0.25]]), star),
        150.5,
        GEOMETRIC,
        ERROR,
        TRUE,
        AnswerCheck.CORRECT,
        ((1, "unknown"), (2, "hot pixel")),
        Stars(np.array([1]), np.array([6]), np.array([[7.0, 8.0]]), star),
        Light(2, 14.5, 5.25, 199.0),
    )


def without_answer():
    return Made(panorama(0, 1), Status.NO_MATCH, "no star reached Fn = 6", "neighbour", elapsed_us=0.0)


def bare():
    """An answer that nothing is known of but its stars and its attitude."""
    named = Identification(np.array([1]), np.array([8]), 0.5)
    matches = Stars(np.array([1]), np.array([8]), np.array([[-1.0, 2.0]]), other_star)
    return Made(panorama(2, 2), Status.IDENTIFIED, "", "pivot", named, RAW, matches)


MADE = [identified(), without_answer(), bare()]


def column(name):
    return results_of(MADE).rows[name].tolist()


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
    "ra_reference_deg": [10.0, math.nan, math.nan],
    "de_reference_deg": [-20.0, math.nan, math.nan],
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
    assert set(FRAME.names) == set(COLUMNS), "give COLUMNS above what the three results say in a new column"


def angles_of(attitudes):
    return [None if one is None else round(one.ra_deg, 9) for one in attitudes]


def test_a_result_is_a_view_of_its_row():
    results = results_of(MADE)
    assert len(results) == 3
    one, none, bare_one = results
    assert [seen.status for seen in results] == [Status.IDENTIFIED, Status.NO_MATCH, Status.IDENTIFIED]
    assert [seen.detail for seen in results] == ["", "no star reached Fn = 6", ""]
    assert [seen.identifier for seen in results] == ["neighbour"] * 3
    assert [seen.elapsed_us for seen in results] == [150.5, 0.0, None]
    assert [seen.answer_check for seen in results] == [made.answer_check for made in MADE]
    assert [seen.false_match_probability for seen in (one, bare_one)] == [1e-9, 0.5]
    assert angles_of([one.attitude, one.attitude_geometric, one.attitude_true]) == [10.0, 11.0, 12.0]
    assert angles_of([none.attitude, bare_one.attitude, bare_one.attitude_geometric]) == [None, 10.0, None]
    assert [seen.attitude_error for seen in results] == [ERROR, None, None]
    assert [(match.object, match.star) for match in one.matches] == [(0, "star 17"), (2, "star 4")]
    assert [(match.object, match.star) for match in results.left_out[0]] == [(1, "star 6")]
    assert (one.others, none.others, none.matches) == (((1, "unknown"), (2, "hot pixel")), (), [])
    assert [seen.row["frame_no"].tolist() for seen in results] == [[71], [70], [72]]


def test_a_result_has_the_objects_of_its_own_panorama():
    seen = [one.panorama for one in results_of(MADE)]
    assert [one.frame_no for one in seen] == [71, 70, 72]
    assert [one.xy_px.tolist() for one in seen] == [one.panorama.xy_px.tolist() for one in MADE]
    assert [len(one.brightness) for one in seen] == [3, 1, 2]


def test_an_error_of_which_the_roll_alone_is_missing_is_an_error():
    errors = np.array([[1.0, 2.0, math.nan, 4.0, 5.0], *[[math.nan] * 5] * 2])
    found = replace(results_of(MADE), errors_arcsec=errors)
    assert astuple(found[0].attitude_error) == pytest.approx((1.0, 2.0, math.nan, 4.0, 5.0), nan_ok=True)
    assert found[1].attitude_error is None


def test_an_answer_without_a_roll_has_none_in_its_row():
    rows = results_of([replace(MADE[0], has_roll=False), MADE[0]]).rows
    assert rows["roll_deg"].tolist() == pytest.approx([math.nan, 30.0], nan_ok=True)
    assert rows["roll_true_deg"].tolist() == pytest.approx([32.0, 32.0])
    assert rows["ra_deg"].tolist() == pytest.approx([10.0, 10.0])


@pytest.mark.parametrize(("faintest_index", "count"), [(199.0, 1), (200.0, 0), (201.0, 0), (math.inf, 0)])
def test_a_false_object_is_brighter_than_every_star_that_the_catalogue_lacks(faintest_index, count):
    """The second object of the second panorama, of brightness 200: the first one's are brighter."""
    seen = replace(MADE[0], light=Light(2, 14.5, 5.25, faintest_index))
    rows = results_of([MADE[1], seen]).rows
    assert rows["false_objects"].tolist() == [0, count]


def test_hot_pixels_and_planets_are_no_false_objects():
    seen = replace(MADE[0], others=((0, "Jupiter"), (1, "hot pixel"), (2, "hot pixel")))
    rows = results_of([seen]).rows
    assert (rows["false_objects"].tolist(), rows["hot_pixels"].tolist()) == ([0], [2])


def test_rows_of_stars_stand_by_frame_those_that_were_left_out_behind_those_that_were_named():
    rows = results_of(MADE).match_rows()
    assert rows.dtype == MATCH
    assert rows.tolist() == [
        (0, 17, 100.0, 600.0, 3.0, -4.0, 300.0, True),
        (0, 4, 102.0, 602.0, 0.5, 0.25, 100.0, True),
        (0, 6, 101.0, 601.0, 7.0, 8.0, 200.0, False),
        (2, 8, 201.0, 701.0, -1.0, 2.0, 200.0, True),
    ]


def test_rows_of_stars_are_those_that_were_named_where_none_was_left_out():
    rows = results_of(MADE[1:]).match_rows()
    assert rows.tolist() == [(1, 8, 201.0, 701.0, -1.0, 2.0, 200.0, True)]


def test_rows_of_other_objects_are_those_that_no_answer_names_each_with_its_kind():
    """Of the second panorama, which has no answer, all of them."""
    rows = results_of([replace(MADE[0], others=((1, "hot pixel"),)), *MADE[1:]]).other_rows()
    assert rows.dtype == OTHER
    hot, unknown = KINDS.index("hot pixel"), KINDS.index("unknown")
    assert rows[rows["frame"] == 0].tolist() == [(0, 101.0, 601.0, 200.0, hot)]
    unnamed = rows[rows["frame"] == 1]
    assert unnamed["x_px"].tolist() == MADE[1].panorama.xy_px[:, 0].tolist()
    assert unnamed["brightness"].tolist() == MADE[1].panorama.brightness.tolist()
    assert set(unnamed["kind"].tolist()) <= {unknown}
    named = len(MADE[2].matches)
    assert int((rows["frame"] == 2).sum()) == len(MADE[2].panorama.brightness) - named


def test_rows_are_made_once():
    results = results_of(MADE)
    assert results.rows is results.rows


def test_a_part_of_results_is_what_they_are_counted_from_its_first():
    given = [Given(Failure(FailureKind.CRASH, word), 1.0) for word in ("first", "second", "third")]
    results = results_of([replace(one, given=of_one) for one, of_one in zip(MADE, given, strict=True)])
    assert results.part(0, 3) is results
    part = results.part(1, 3)
    assert len(part) == 2
    assert repr(part.rows.tolist()) == repr(results.rows[1:].tolist())
    assert part.match_rows().tolist() == results_of(MADE[1:]).match_rows().tolist()
    assert part.other_rows().tolist() == results_of(MADE[1:]).other_rows().tolist()
    assert [one.detail for one in part] == ["no star reached Fn = 6", ""]
    assert [one.given for one in part] == given[1:]
    assert [one.status for one in (part[0], part[1], part[-1])] == [Status.NO_MATCH, *[Status.IDENTIFIED] * 2]
    with pytest.raises(IndexError):
        part[2]


def test_a_part_of_answers_has_its_own_reasons():
    none = Unidentified(Reason.NO_MATCH, "no star reached Fn = 6")
    answers = Answers.from_answers([none, Identification(np.array([1]), np.array([8]), 0.5), none])
    part = answers.part(1, 3)
    assert (part[0].stars.tolist(), part[0].false_match_probability) == ([8], 0.5)
    assert part.unidentified == {1: none}


def test_a_result_alone_is_a_part_of_one():
    (alone,) = results_of(MADE)[0].alone
    assert repr(alone.row.tolist()) == repr(results_of(MADE).rows[:1].tolist())
    assert (alone.matches, alone.others) == (results_of(MADE)[0].matches, MADE[0].others)
    assert alone.results.left_out[0] == results_of(MADE).left_out[0]
