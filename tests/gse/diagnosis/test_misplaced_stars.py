"""When objects are stars out of place, and why: each limit from both sides."""

import math
from dataclasses import replace

import numpy as np
import pytest
from skies.known_nights import START_NS, STATION, session

from gse.diagnosis.misplaced_stars import most_unmatched, stars_fall_out
from gse.station.columns import FRAME
from gse.statistics.counted_frames import counted_frames
from gse.truth import Alignment
from gse.values.instant import NS_PER_S
from gse.values.mount import Mount

HALF_FIELD_DEG = math.degrees(math.atan(math.hypot(512.0, 512.0) / 4169.905))


@pytest.mark.parametrize(
    ("unmatched", "matched", "fall_out"),
    [(5, 1, False), (6, 1, True), (5, 20, False), (6, 20, True), (8, 30, False), (9, 30, True), (6, 21, False)],
)
def test_stars_fall_out_where_six_objects_and_three_for_ten_that_are_matched_are_none(unmatched, matched, fall_out):
    """Most of the used frames."""
    frames, used = np.zeros(9, dtype=FRAME), np.arange(9) < 5
    frames["false_objects"], frames["matched"] = np.where(np.arange(9) % 9 < 3, unmatched, 0), matched
    assert stars_fall_out(frames, used) is fall_out
    frames["false_objects"][:5] = np.array([0, 0, 0, unmatched, unmatched])
    assert not stars_fall_out(frames, used)


def night(count=20, *, unmatched=13, matched=12, expected=30, false=20):
    """Frames of so many objects, and what counts of them: the first answers are false."""
    made = session(count)
    frames = made.frames.columns
    frames["matched"], frames["false_objects"], frames["stars_expected"] = matched, unmatched, expected
    return made, replace(counted_frames(made), false=np.arange(count) < false)


@pytest.mark.parametrize(
    ("options", "is_told"),
    [
        ({}, True),
        ({"count": 4}, False),
        ({"count": 5}, True),
        ({"unmatched": 12}, False),
        ({"matched": 4, "unmatched": 5}, False),  # fewer than six
        ({"matched": 5, "unmatched": 6}, True),
        ({"expected": 17}, False),  # six more than are matched
        ({"expected": 18}, True),
        ({"false": 1}, False),  # 95 % are good, as the limit has it
        ({"false": 2}, True),
    ],
)
def test_stars_are_out_of_place_where_most_objects_are_none_and_too_few_answers_are_good(options, is_told):
    assert STATION.limits.availability == 0.95
    assert bool(list(most_unmatched(*night(**options)))) is is_told


def test_frames_without_an_answer_and_those_that_are_left_out_tell_nothing_of_their_objects():
    made, counted = night(12)
    made.frames.columns["matched"][5:] = 100
    counted.answered[5:8] = False
    counted.excluded[8:] = True
    assert len(list(most_unmatched(made, counted))) == 1
    counted.excluded[0] = True
    assert list(most_unmatched(made, counted)) == []


def test_only_frames_that_must_have_an_answer_make_availability():
    made, counted = night(false=2)
    assert len(list(most_unmatched(made, counted))) == 1
    counted.expected[0] = False  # 18 of 19 are 94.7 %
    assert len(list(most_unmatched(made, counted))) == 1
    counted.expected[1] = False
    assert list(most_unmatched(made, counted)) == []


@pytest.mark.parametrize(
    ("altitude_deg", "words"),
    [
        (HALF_FIELD_DEG + 10.1, None),
        (HALF_FIELD_DEG + 9.9, "it reaches down to an altitude of 10 deg"),
        (HALF_FIELD_DEG + 2.0, "it reaches down to an altitude of 2 deg"),
        (5.0, "it reaches down to an altitude of -5 deg"),
    ],
)
@pytest.mark.parametrize("is_fitted", [True, False])
def test_a_field_near_the_horizon_reaches_below_ten_degrees(altitude_deg, words, is_fitted):
    made, counted = night()
    low = Mount(altitude_deg=altitude_deg)
    if is_fitted:
        made.alignment = Alignment(low, ((0.0,) * 3,) * 3, (0.0,) * 3, 4, 0, START_NS, START_NS + NS_PER_S)
    else:
        made.station = STATION.model_copy(update={"mount": low})
    (found,) = most_unmatched(made, counted)
    seen = "13 objects as bright as stars of the catalogue are none of them, 12 are, and 30 stars are expected: "
    assert found.size.startswith(seen)
    assert found.cause == ("field near the horizon" if words else "camera")
    assert (words or "they do not lie where the camera of the station file has them") in found.size
    assert found.equals[0] == ("a camera that is not as stated" if words else "a distortion of the lens")
