"""Stretches without a sky, on frames made by hand: which have a reason, and which are the sensor's."""

from dataclasses import replace

import numpy as np
import pytest
from skies.known_nights import STATION

from gse.instant import NS_PER_S, from_text
from gse.station.exclusions import Cause
from gse.station.frame_table import ANSWER_CHECKS, FRAME, SKY_CONDITIONS, STATUSES
from gse.station.results import AnswerCheck, SkyCondition, Status, Subject
from gse.statistics.decision import Outcome, Row
from gse.statistics.no_sky import no_sky, under_cloud

START_NS = from_text("2026-03-20T18:30:00Z")
BLIND = slice(400, 520)
"""Twelve seconds at 10 Hz."""


def frames(**blind):
    """A clear night at 10 Hz: 20 stars are expected and 18 seen; with other values in the blind stretch."""
    made = np.zeros(1200, dtype=FRAME)
    made["utc_ns"] = made["host_utc_ns"] = START_NS + np.arange(1200) * (NS_PER_S // 10)
    made["status"] = STATUSES.index(Status.IDENTIFIED)
    made["answer_check"] = ANSWER_CHECKS.index(AnswerCheck.CORRECT)
    made["exposure_s"], made["zero_point_mag"], made["objects"] = 0.05, 14.0, 25
    made["stars_expected"], made["stars_seen"], made["sun_altitude_deg"] = 20, 18, -40.0
    part = made[BLIND]
    part["status"] = STATUSES.index(Status.NO_MATCH)
    part["answer_check"] = ANSWER_CHECKS.index(AnswerCheck.UNKNOWN)
    part["zero_point_mag"], part["stars_seen"] = np.nan, 0
    for name, value in blind.items():
        part[name] = value
    return made


def beside(made, **values):
    """The fifteen seconds before the stretch."""
    for name, value in values.items():
        made[250:400][name] = value
    return made


def found(made):
    return [(item.cause, item.reason) for item in no_sky(made, STATION.site)]


def test_a_sensor_that_is_blind_under_a_clear_sky_has_no_excuse():
    assert found(frames()) == []


@pytest.mark.parametrize(("seen", "is_cloud"), [(8, True), (10, False)])
def test_stars_that_are_missing_just_before_show_a_cloud(seen, is_cloud):
    """Half of the share of the clear part is 9 of 20."""
    words = (Cause.NO_SKY, "less than half of the stars just before or after: cloud for 12 s")
    assert found(beside(frames(), stars_seen=seen)) == ([words] if is_cloud else [])


@pytest.mark.parametrize(("few", "is_cloud"), [(95, False), (105, True)])
def test_stars_must_be_missing_in_a_tenth_of_the_frames_of_the_minute_beside(few, is_cloud):
    """Forty seconds before the stretch and sixty after it are a thousand frames."""
    made = frames()
    made["stars_seen"][400 - few : 400] = 8
    assert bool(found(made)) == is_cloud


def test_few_expected_stars_or_a_bright_sky_tell_no_share():
    assert found(beside(frames(), stars_expected=9, stars_seen=2)) == []
    assert found(beside(frames(), stars_seen=2, sun_altitude_deg=-11.0)) == []


@pytest.mark.parametrize(("fainter_mag", "is_cloud"), [(0.9, False), (1.1, True)])
def test_stars_that_are_fainter_just_before_show_a_cloud(fainter_mag, is_cloud):
    words = (Cause.NO_SKY, f"stars {fainter_mag:.1f} mag too faint: cloud for 12 s")
    assert found(beside(frames(), zero_point_mag=14.0 - fainter_mag)) == ([words] if is_cloud else [])


def test_a_longer_exposure_makes_no_cloud_and_twilight_none_either():
    """A tenfold exposure shows each star 2.5 mag brighter."""
    assert found(beside(frames(), exposure_s=0.5, zero_point_mag=16.5)) == []
    assert found(beside(frames(), exposure_s=0.5, zero_point_mag=14.0)) != []
    assert found(beside(frames(), zero_point_mag=12.0, sun_altitude_deg=-11.0)) == []


def test_what_was_faint_more_than_a_minute_away_explains_nothing():
    made = frames()
    made["utc_ns"][400:] += 61 * NS_PER_S
    assert found(beside(made, zero_point_mag=12.0)) == []
    made["utc_ns"][400:] -= 2 * NS_PER_S
    assert found(beside(made, zero_point_mag=12.0)) != []


@pytest.mark.parametrize(
    ("objects", "words"), [(0, "no object at all"), (1, "at most 1 object"), (2, "at most 2 objects"), (3, "")]
)
def test_panoramas_without_objects_are_a_cause_of_their_own(objects, words):
    made = found(frames(objects=objects))
    assert [cause for cause, _ in made] == ([Cause.NO_OBJECTS] if words else [])
    assert all(reason.startswith(f"{words} for 12 s, 20 stars are expected: ") for _, reason in made)
    assert all(("lens cap" in reason) == (objects == 0) for _, reason in made)


def test_an_overexposed_detector_in_the_dark_is_no_cloud():
    made = frames(objects=0)
    made["status"][450] = STATUSES.index(Status.SENSOR_FAULT)
    assert found(made) == []


@pytest.mark.parametrize(("last", "is_long"), [(499, False), (501, True)])
def test_a_stretch_lasts_ten_seconds_with_its_last_exposure(last, is_long):
    made = frames(objects=0)
    made[last:520] = made[600]
    made["utc_ns"] = START_NS + np.arange(1200) * (NS_PER_S // 10)
    assert bool(found(made)) == is_long


@pytest.mark.parametrize(("gap", "stretches"), [(2, 1), (35, 2)])
def test_answers_for_three_seconds_end_a_stretch(gap, stretches):
    made = frames(objects=0)
    made[520 + gap : 640 + gap] = made[BLIND]
    made["utc_ns"] = START_NS + np.arange(1200) * (NS_PER_S // 10)
    assert len(found(made)) == stretches


def test_what_the_reference_identifier_sees_is_a_sky():
    made = frames(objects=0)
    made["answer_check"][BLIND] = ANSWER_CHECKS.index(AnswerCheck.ABSENT)
    assert found(made) == []


@pytest.mark.parametrize(("text", "side"), [("2026-03-20T05:00:00Z", "above"), ("2026-03-20T11:20:00Z", "below")])
def test_the_sun_explains_a_stretch_until_nautical_twilight(text, side):
    made = frames()
    made["utc_ns"] += from_text(text) - START_NS
    ((cause, reason),) = found(made)
    assert cause is Cause.NO_SKY
    assert f"deg {side} the horizon: no dark sky for 12 s" in reason


def test_frames_out_of_order_are_the_same_night():
    made = beside(frames(), stars_seen=5)
    assert no_sky(made[::-1], STATION.site) == no_sky(made, STATION.site)


@pytest.mark.parametrize(("clouded", "excused"), [(601, True), (600, False)])
def test_only_an_availability_that_fails_under_a_sky_mostly_clouded_is_undecided(clouded, excused):
    made = frames()
    made["sky_condition"][:clouded] = SKY_CONDITIONS.index(SkyCondition.CLOUDED)
    row = Row(Subject.ONBOARD, "availability", 0.5, "", 0.95, Outcome.FAIL, "onboard availability: 50 %")
    judged = under_cloud(row, made)
    assert judged.outcome is (Outcome.INCONCLUSIVE if excused else Outcome.FAIL)
    assert (f"the sky was clouded, or the sensor sees too few stars, in {clouded} of 1200" in judged.reason) == excused
    for other in (replace(row, name="false answers"), replace(row, outcome=Outcome.PASS)):
        assert under_cloud(other, made) is other
