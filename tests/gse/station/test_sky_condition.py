"""The condition of the sky by hand: each limit, and the words that go with it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gse.station.columns import ANSWER_CHECKS, FRAME, STATUSES
from gse.station.results import AnswerCheck, SkyCondition, Status
from gse.station.sky_condition import (
    BACK_SHARE,
    CLEARED_MAG,
    DOUBTFUL_SHARE,
    FADED_MAG,
    FEW_SHARE,
    FEWEST_EXPECTED,
    FEWEST_OBJECTS,
    FEWEST_UNMATCHED,
    MISSING_SHARE,
    MOON_GLARE_DEG,
    SUN_LIMIT_DEG,
    UNMATCHED_SHARE,
    ClearSky,
    Lights,
    SkyEvidence,
    clear_sky,
    condition_of,
    evidence_of,
    faded_mag,
    glared,
    words_of,
)

CLEAR, CLOUDED, UNKNOWN = SkyCondition.CLEAR, SkyCondition.CLOUDED, SkyCondition.UNKNOWN
NO_STARS, DAYLIGHT = SkyCondition.NO_STARS, SkyCondition.DAYLIGHT
DARK = Lights(SUN_LIMIT_DEG, -30.0, 120.0, 90.0)
TWILIGHT = replace(DARK, sun_altitude_deg=SUN_LIMIT_DEG + 0.1)
FULL = SkyEvidence(
    lights=DARK,
    expected=30.0,
    seen_share=0.9,
    zero_point_mag=17.0,
    limiting_mag=5.5,
    objects=30.0,
    empty_share=0.0,
    shows_stars=True,
    overexposed=False,
    exposure_s=0.05,
)
USUAL = ClearSky(17.0, 0.9, 0.05, 30.0)
EMPTY = replace(FULL, shows_stars=False, seen_share=math.nan, objects=0.0, zero_point_mag=math.nan)


@pytest.mark.parametrize(
    ("before", "changes", "condition"),
    [
        # Stars that are fainter than in the clear: a cloud ends at another value than it begins.
        (CLEAR, {"zero_point_mag": 17.0 - FADED_MAG + 0.01}, CLEAR),
        (CLEAR, {"zero_point_mag": 17.0 - FADED_MAG}, CLOUDED),
        (CLOUDED, {"zero_point_mag": 17.0 - CLEARED_MAG}, CLOUDED),
        (CLOUDED, {"zero_point_mag": 17.0 - CLEARED_MAG + 0.01}, CLEAR),
        (CLEAR, {"zero_point_mag": 15.0, "lights": TWILIGHT}, CLEAR),
        (CLEAR, {"zero_point_mag": 15.0, "moon_glares": True}, CLEAR),
        # Stars that are missing of the 0.9 that are seen in the clear.
        (CLEAR, {"seen_share": MISSING_SHARE * 0.9 + 0.005}, CLEAR),
        (CLEAR, {"seen_share": MISSING_SHARE * 0.9 - 0.005}, CLOUDED),
        (CLOUDED, {"seen_share": BACK_SHARE * 0.9 + 0.01}, CLEAR),
        (CLOUDED, {"seen_share": BACK_SHARE * 0.9 - 0.01}, CLOUDED),
        (CLEAR, {"seen_share": 0.71, "lights": TWILIGHT}, DAYLIGHT),
        (CLEAR, {"seen_share": 0.73, "lights": TWILIGHT}, CLEAR),
        (CLEAR, {"seen_share": 0.1, "lights": TWILIGHT, "expected": FEWEST_EXPECTED - 1.0}, CLEAR),
        (CLEAR, {"seen_share": 0.1, "expected": FEWEST_EXPECTED - 1.0}, CLEAR),
        (CLEAR, {"seen_share": 0.1, "expected": FEWEST_EXPECTED}, CLOUDED),
        # Missing stars that are there as objects: a share of the 24, or at least some.
        (CLEAR, {"seen_share": 0.2, "unmatched": 24 * UNMATCHED_SHARE - 0.1}, CLOUDED),
        (CLEAR, {"seen_share": 0.2, "unmatched": 24 * UNMATCHED_SHARE + 0.1}, CLEAR),
        (CLEAR, {"seen_share": 0.2, "expected": 12.0, "unmatched": FEWEST_UNMATCHED - 0.1}, CLOUDED),
        (CLEAR, {"seen_share": 0.2, "expected": 12.0, "unmatched": FEWEST_UNMATCHED}, CLEAR),
        # Empty frames count where a cloud hides some of the stars in the others, and beside full ones they do not.
        (CLEAR, {"seen_share": BACK_SHARE * 0.9 - 0.01, "empty_share": 0.1}, CLEAR),
        (CLEAR, {"seen_share": BACK_SHARE * 0.9 - 0.01, "empty_share": 0.3}, CLOUDED),
        (CLEAR, {"seen_share": BACK_SHARE * 0.9 + 0.01, "empty_share": 0.9}, CLEAR),
        (CLOUDED, {"seen_share": BACK_SHARE * 0.9, "empty_share": 0.9}, CLEAR),
        # The Moon hides stars as a cloud does.
        (CLEAR, {"seen_share": FEW_SHARE, "moon_glares": True}, CLEAR),
        (CLEAR, {"seen_share": FEW_SHARE - 0.01, "moon_glares": True}, UNKNOWN),
    ],
)
def test_stars_that_are_seen_tell_a_cloud(before, changes, condition):
    assert condition_of(replace(FULL, **changes), USUAL, before) is condition


@pytest.mark.parametrize(("seen_share", "condition"), [(FEW_SHARE, CLEAR), (FEW_SHARE - 0.01, CLOUDED)])
@pytest.mark.parametrize("usual_share", [math.nan, 0.4])
def test_less_than_a_share_of_the_stars_is_no_clear_sky_whatever_was_seen_before(usual_share, seen_share, condition):
    few = replace(FULL, seen_share=seen_share)
    assert condition_of(few, replace(USUAL, seen_share=usual_share), CLEAR) is condition


@pytest.mark.parametrize(
    ("before", "changes", "condition"),
    [
        (CLEAR, {}, NO_STARS),
        (CLEAR, {"lights": TWILIGHT}, DAYLIGHT),
        (CLOUDED, {"lights": TWILIGHT}, DAYLIGHT),
        (CLEAR, {"moon_glares": True}, NO_STARS),
        (CLEAR, {"moon_glares": True, "objects": FEWEST_OBJECTS - 1.0}, NO_STARS),
        (CLEAR, {"moon_glares": True, "objects": FEWEST_OBJECTS}, UNKNOWN),
        (CLEAR, {"moon_glares": True, "overexposed": True}, UNKNOWN),
        (CLOUDED, {"moon_glares": True, "objects": FEWEST_OBJECTS}, UNKNOWN),
        (CLOUDED, {"moon_glares": True}, CLOUDED),
        (CLOUDED, {}, CLOUDED),
        (CLEAR, {"objects": 30.0}, NO_STARS),
        (CLEAR, {"objects": 30.0, "expected": FEWEST_EXPECTED - 1.0}, UNKNOWN),
        (CLEAR, {"objects": 30.0, "expected": FEWEST_EXPECTED}, NO_STARS),
        (CLEAR, {"objects": 30.0, "expected": FEWEST_EXPECTED - 1.0, "overexposed": True}, NO_STARS),
        (CLEAR, {"objects": FEWEST_OBJECTS - 1.0, "expected": FEWEST_EXPECTED - 1.0}, NO_STARS),
        (CLEAR, {"objects": FEWEST_OBJECTS, "expected": FEWEST_EXPECTED - 1.0}, UNKNOWN),
    ],
)
def test_a_sky_without_stars_has_its_reason(before, changes, condition):
    assert condition_of(replace(EMPTY, **changes), USUAL, before) is condition


NO_OBJECT = "no object at all, 30 stars are expected: lens cap, cover, overcast"
MOONLIT = Lights(-40.0, 10.0, 90.0, 15.0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"overexposed": True}, "the detector is overexposed in the dark, 30 stars are expected: a lamp"),
        ({"overexposed": True, "objects": 2.0}, "the detector is overexposed in the dark, 30 stars"),
        ({"overexposed": True, "objects": 9.0}, "9 objects, and none is identified, 30 stars are expected: overcast"),
        ({"exposure_s": 0.024}, "the exposure fell from 0.05 to 0.024 s: too short, 30 stars are expected"),
        ({"exposure_s": 0.025}, "no object at all, 30 stars are expected: lens cap"),
        ({"objects": 2.0}, "2 objects, 30 stars are expected: lens cap"),
        (
            {"moon_glares": True, "lights": MOONLIT},
            NO_OBJECT + ", or too short an exposure; or the Moon's glare: Sun 40",
        ),
        ({"objects": 9.0}, "9 objects, and none is identified, 30 stars are expected: overcast"),
        ({"expected": 0.0}, "no object at all, 0 stars are expected: lens cap"),
        ({"expected": math.nan}, "no object at all: lens cap"),
    ],
)
def test_a_sky_without_stars_is_told_by_what_is_there_instead(changes, words):
    assert words_of(NO_STARS, replace(EMPTY, **changes), USUAL).startswith(words)


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (FULL, "27 of 30 expected stars are seen, to magnitude 5.5; Sun"),
        (replace(FULL, limiting_mag=math.nan), "27 of 30 expected stars are seen; Sun"),
        (replace(FULL, seen_share=math.nan), "stars are identified, to magnitude 5.5; Sun"),
        (replace(FULL, seen_share=0.0, lights=TWILIGHT), "0 of 30 expected stars are seen, to magnitude 5.5; Sun"),
        (
            replace(FULL, seen_share=DOUBTFUL_SHARE),
            f"{30 * DOUBTFUL_SHARE:.0f} of 30 expected stars are seen, to magnitude 5.5; Sun",
        ),
        (replace(FULL, seen_share=0.79), "24 of 30 expected stars are seen, to magnitude 5.5 (or thin cloud"),
        (replace(FULL, seen_share=0.5, lights=TWILIGHT), "15 of 30 expected stars are seen, to magnitude 5.5; Sun"),
        (replace(FULL, seen_share=0.5, moon_glares=True), "15 of 30 expected stars are seen, to magnitude 5.5; Sun"),
        (replace(FULL, seen_share=0.5, unmatched=20.0), "15 of 30 expected stars are seen, to magnitude 5.5; Sun"),
    ],
)
def test_a_clear_sky_is_told_by_its_stars_and_with_its_doubt(found, words):
    assert words_of(CLEAR, found, USUAL).startswith(words)


@pytest.mark.parametrize(
    ("zero_point_mag", "words"),
    [
        (16.9, ", 0.1 mag fainter than the stated zero point says; Sun"),
        (17.0, ", 0.0 mag fainter than the stated zero point says; Sun"),
        (17.1, ", 0.1 mag brighter than the stated zero point says; Sun"),
        (16.99 + FADED_MAG, " mag brighter than the stated zero point says; Sun"),
        (17.0 + FADED_MAG, " mag brighter than the stated zero point says: it is not this sensor's; Sun"),
    ],
)
def test_a_clear_sky_is_compared_with_the_stated_zero_point(zero_point_mag, words):
    told = words_of(CLEAR, replace(FULL, zero_point_mag=zero_point_mag), replace(USUAL, is_stated=True))
    assert words in told


def test_a_stated_zero_point_that_stars_without_brightness_do_not_meet_leaves_the_doubt():
    told = words_of(CLEAR, replace(FULL, seen_share=0.5, zero_point_mag=math.nan), replace(USUAL, is_stated=True))
    assert told.startswith("15 of 30 expected stars are seen, to magnitude 5.5 (or thin cloud")


def test_what_is_not_said_of_a_sky_is_not_known():
    assert (FULL.unmatched, FULL.moon_glares) == (0.0, False)
    unknown = ClearSky()
    numbers = unknown.zero_point_mag, unknown.seen_share, unknown.exposure_s, unknown.objects
    assert all(math.isnan(number) for number in numbers)
    assert unknown.is_stated is False
    assert math.isnan(Lights(1.0, 2.0).sun_separation_deg)
    assert math.isnan(Lights(1.0, 2.0).moon_separation_deg)


def test_a_cloud_without_a_star_and_daylight_have_their_words():
    assert words_of(CLOUDED, EMPTY, USUAL) == "no star is left: cloud, haze or dew"
    assert words_of(DAYLIGHT, replace(EMPTY, lights=TWILIGHT), USUAL) == str(TWILIGHT)


@pytest.mark.parametrize(
    ("lights", "words"),
    [
        (Lights(20.4, -5.0), "Sun 20 deg above the horizon, Moon down"),
        (Lights(0.6, -0.6), "Sun 1 deg above the horizon, Moon down"),
        (Lights(0.0, -5.0), "Sun 0 deg above the horizon, Moon down"),
        (Lights(-0.6, 0.6), "Sun 1 deg below the horizon (twilight), Moon 1 deg up"),
        (Lights(-5.0, 0.0), "Sun 5 deg below the horizon (twilight), Moon down"),
        (Lights(-11.0, 10.0), "Sun 11 deg below the horizon (twilight), Moon 10 deg up"),
        (Lights(-12.0, 10.0, 90.0, 33.3), "Sun 12 deg below the horizon, Moon 10 deg up, 33 deg from the boresight"),
        (Lights(-40.0, 10.0, 90.0, 0.0), "Sun 40 deg below the horizon, Moon 10 deg up, 0 deg from the boresight"),
    ],
)
def test_sun_and_moon_are_told_by_where_they_stand(lights, words):
    assert str(lights) == words


@pytest.mark.parametrize(
    ("altitude_deg", "separation_deg", "glares"),
    [
        (1.0, 6.9 + MOON_GLARE_DEG, True),
        (1.0, 7.0 + MOON_GLARE_DEG, False),
        (0.0, 5.0, False),
        (1.0, math.nan, False),
    ],
)
def test_the_moon_glares_within_some_degrees_of_the_field_where_it_is_up(altitude_deg, separation_deg, glares):
    lights = replace(DARK, moon_altitude_deg=altitude_deg, moon_separation_deg=separation_deg)
    assert glared(replace(FULL, lights=lights), 7.0).moon_glares is glares


# What frames show


def frames(count=10, **columns):
    """Rows that are identified with ten stars."""
    made = np.zeros(count, dtype=FRAME)
    made["status"], made["answer_check"] = STATUSES.index(Status.IDENTIFIED), ANSWER_CHECKS.index(AnswerCheck.CORRECT)
    made["objects"], made["stars_seen"], made["exposure_s"] = 20, 10, 0.1
    made["zero_point_mag"], made["limiting_mag"] = 14.5, 5.0
    for name, values in columns.items():
        made[name] = values
    return made


def codes(names, words):
    return [names.index(word) for word in words]


def test_frames_show_their_medians_and_a_zero_point_for_one_second():
    part = frames(
        4, zero_point_mag=[14.0, 15.0, 17.0, np.nan], limiting_mag=[5.0, 6.0, np.nan, np.nan], objects=[1, 2, 4, 9]
    )
    found = evidence_of(part, 20.0, DARK, math.nan)
    assert found.zero_point_mag == pytest.approx(17.5)  # an exposure of 0.1 s is 2.5 mag
    assert (found.limiting_mag, found.objects, found.seen_share) == (5.5, 3.0, 0.5)
    assert found.exposure_s == pytest.approx(0.1)
    assert math.isnan(evidence_of(frames(zero_point_mag=np.nan), 20.0, DARK, 20.0).zero_point_mag)


@pytest.mark.parametrize(
    ("expected", "share"), [(0.0, math.nan), (1.0, 1.0), (5.0, 1.0), (10.0, 1.0), (12.5, 0.8), (math.nan, math.nan)]
)
def test_the_share_of_ten_stars_is_one_at_most_and_of_none_expected_unknown(expected, share):
    assert evidence_of(frames(), expected, DARK, 20.0).seen_share == pytest.approx(share, nan_ok=True)


def test_nothing_shown_has_no_share_though_stars_are_expected():
    part = frames(status=STATUSES.index(Status.NO_MATCH), answer_check=ANSWER_CHECKS.index(AnswerCheck.UNKNOWN))
    found = evidence_of(part, 20.0, DARK, 20.0)
    assert math.isnan(found.seen_share)
    assert (found.unmatched, found.empty_share, found.shows_stars) == (0.0, 0.0, False)


@pytest.mark.parametrize(
    "values", [[3.0], [1.0, 8.0], [7.0, 1.0, 2.0], [9.0, 4.0, 1.0, 2.0], [5.0, 5.0, 1.0, 0.0, 8.0]]
)
def test_what_frames_show_is_their_median_as_numpy_has_it(values):
    part = frames(len(values), limiting_mag=values, objects=values, exposure_s=values)
    found = evidence_of(part, 20.0, DARK, 20.0)
    assert (found.limiting_mag, found.objects, found.exposure_s) == (np.median(values),) * 3
    many = frames(len(values) + 2, limiting_mag=[*values, math.nan, math.inf])
    assert evidence_of(many, 20.0, DARK, 20.0).limiting_mag == np.median(values)


def test_a_frame_without_a_stated_exposure_is_taken_as_it_is():
    assert evidence_of(frames(exposure_s=0.0), 20.0, DARK, 20.0).zero_point_mag == pytest.approx(14.5)


def test_a_false_answer_shows_stars_but_not_which_and_a_confirmed_sky_shows_them_without_an_answer():
    false = frames(answer_check=ANSWER_CHECKS.index(AnswerCheck.FALSE))
    found = evidence_of(false, 20.0, DARK, 20.0)
    assert (found.shows_stars, math.isnan(found.seen_share), found.unmatched) == (True, True, 0.0)
    absent = frames(status=STATUSES.index(Status.NO_MATCH), answer_check=ANSWER_CHECKS.index(AnswerCheck.ABSENT))
    found = evidence_of(absent, 20.0, DARK, 20.0)
    assert (found.shows_stars, found.seen_share, found.empty_share) == (True, 0.5, 0.0)
    unknown = frames(status=STATUSES.index(Status.NO_MATCH), answer_check=ANSWER_CHECKS.index(AnswerCheck.UNKNOWN))
    assert not evidence_of(unknown, 20.0, DARK, 20.0).shows_stars


@pytest.mark.parametrize(("faults", "is_told"), [(5, False), (6, True)])
def test_a_detector_is_overexposed_where_most_frames_are_faults(faults, is_told):
    status = codes(STATUSES, [Status.SENSOR_FAULT] * faults + [Status.IDENTIFIED] * (10 - faults))
    assert evidence_of(frames(status=status), 20.0, DARK, 20.0).overexposed is is_told


def test_objects_that_match_none_are_those_of_the_frames_that_show_stars():
    status = codes(STATUSES, [Status.IDENTIFIED] * 4 + [Status.TOO_FEW] * 6)
    check = codes(ANSWER_CHECKS, [AnswerCheck.CORRECT] * 4 + [AnswerCheck.UNKNOWN] * 6)
    false_objects = [3, 4, 5, 6, 60, 60, 60, 60, 60, 60]
    part = frames(status=status, answer_check=check, false_objects=false_objects)
    found = evidence_of(part, 20.0, DARK, 20.0)
    assert found.unmatched == 4.5
    assert (found.seen_share, found.shows_stars, found.empty_share) == (0.5, True, 0.0)


def test_the_clear_sky_is_the_clearest_twentieth_of_the_dark_without_the_moon():
    values = np.linspace(0, 1, 101)
    night = [
        replace(FULL, seen_share=v, zero_point_mag=16 + v, exposure_s=0.1 * v, objects=100 * v) for v in values.tolist()
    ]
    others = [
        replace(FULL, seen_share=5.0, zero_point_mag=30.0, lights=TWILIGHT),
        replace(FULL, seen_share=5.0, zero_point_mag=30.0, moon_glares=True),
        replace(FULL, seen_share=5.0, zero_point_mag=30.0, shows_stars=False),
    ]
    found = clear_sky(night + others * 10)
    assert (found.zero_point_mag, found.seen_share) == (pytest.approx(16.95), pytest.approx(0.95))
    assert (found.exposure_s, found.objects) == (pytest.approx(0.095), pytest.approx(95))
    assert not found.is_stated
    few = [replace(one, expected=FEWEST_EXPECTED - 1.0, seen_share=1.0) for one in night]
    assert clear_sky(night + few).seen_share == pytest.approx(0.95)
    enough = [replace(one, expected=FEWEST_EXPECTED, seen_share=1.0) for one in night]
    assert clear_sky(night + enough).seen_share == 1.0


def test_a_stated_zero_point_is_that_of_the_clear_sky_even_where_there_is_none():
    assert clear_sky([FULL], 18.0) == replace(USUAL, zero_point_mag=18.0, is_stated=True)
    assert (clear_sky([], 18.0).zero_point_mag, clear_sky([], 18.0).is_stated) == (18.0, True)
    none = clear_sky([])
    assert (math.isnan(none.zero_point_mag), none.is_stated) == (True, False)


def test_how_much_fainter_stars_are_is_told_in_the_dark_without_the_moon():
    assert faded_mag(replace(FULL, zero_point_mag=16.0), USUAL) == 1.0
    assert math.isnan(faded_mag(replace(FULL, lights=TWILIGHT), USUAL))
    assert math.isnan(faded_mag(replace(FULL, moon_glares=True), USUAL))
