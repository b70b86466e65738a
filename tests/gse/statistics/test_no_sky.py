"""Stretches without a sky, on frames made by hand: which have a reason, and which are the sensor's."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from skies.known_nights import STATION

from gse.station.columns import ANSWER_CHECKS, FRAME, SKY_CONDITIONS, STATUSES
from gse.station.exclusions import Cause
from gse.station.results import AnswerCheck, SkyCondition, Status, Subject
from gse.statistics.decision import Claim, Outcome, Row
from gse.statistics.excuses import CLOUD, Evidence, no_sky
from gse.truth.solar_system import sun_altitude_deg
from gse.values.instant import NS_PER_S, from_text

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


@pytest.mark.parametrize(
    ("objects", "words"),
    [
        (6, "no object beside 6 hot pixels for 12 s, 20 stars are expected: lens cap, cover or overcast"),
        (8, "at most 2 objects beside 6 hot pixels for 12 s, 20 stars are expected: cloud, a cover, or"),
        (9, None),
    ],
)
def test_hot_pixels_are_seen_through_a_cap_and_are_no_stars(objects, words):
    """They are told from stars where the sky is seen, and nowhere else."""
    made = frames(objects=objects)
    made["hot_pixels"][made["status"] == STATUSES.index(Status.IDENTIFIED)] = 6
    reasons = [reason for _, reason in found(made)]
    assert [reason.startswith(words) for reason in reasons] == [True] if words else reasons == []


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


def under_cloud(row, claim, frames):
    session = SimpleNamespace(frames=SimpleNamespace(columns=frames))
    return CLOUD.applied_to(row, claim, Evidence(session, {}))


@pytest.mark.parametrize(("clouded", "excused"), [(601, True), (600, False)])
def test_only_an_availability_that_fails_under_a_sky_mostly_clouded_is_undecided(clouded, excused):
    made = frames()
    made["sky_condition"][:clouded] = SKY_CONDITIONS.index(SkyCondition.CLOUDED)
    row = Row(Subject.ONBOARD, "availability", 0.5, "", 0.95, Outcome.FAIL, "onboard availability: 50 %")
    judged = under_cloud(row, Claim.ABSENCE, made)
    assert judged.outcome is (Outcome.INCONCLUSIVE if excused else Outcome.FAIL)
    assert (f"the sky was clouded, or the sensor sees too few stars, in {clouded} of 1200" in judged.reason) == excused
    assert under_cloud(row, Claim.FALSEHOOD, made) is row
    passed = replace(row, outcome=Outcome.PASS)
    assert under_cloud(passed, Claim.ABSENCE, made) is passed


def few(seconds, blind=(), **values):
    """Frames of an exposure of 1 s at these seconds, 16 of 20 stars seen; the ``blind`` rows without answer."""
    made = np.zeros(len(seconds), dtype=FRAME)
    made["utc_ns"] = START_NS + np.round(np.asarray(seconds) * NS_PER_S).astype(np.int64)
    made["status"] = STATUSES.index(Status.IDENTIFIED)
    made["answer_check"] = ANSWER_CHECKS.index(AnswerCheck.CORRECT)
    made["exposure_s"], made["zero_point_mag"], made["objects"] = 1.0, 14.0, 25
    made["stars_expected"], made["stars_seen"], made["sun_altitude_deg"] = 20, 16, -40.0
    rows = list(blind)
    made["status"][rows] = STATUSES.index(Status.NO_MATCH)
    made["answer_check"][rows] = ANSWER_CHECKS.index(AnswerCheck.UNKNOWN)
    made["zero_point_mag"][rows], made["stars_seen"][rows] = np.nan, 0
    for name, value in values.items():
        made[name][rows] = value
    return made


def stretches_s(made):
    """From the first blind frame to right after the last, in seconds after the start."""
    return [((item.from_ns - START_NS) / NS_PER_S, (item.until_ns - START_NS - 1) / NS_PER_S)
            for item in no_sky(made, STATION.site)]  # fmt: skip


@pytest.mark.parametrize(
    ("last_s", "exposure_s", "is_long"),
    [
        (36.0, 4.0, True),
        (36.0, 3.9, False),
        (40.0, np.nan, True),
        (40.0 - 1e-9, np.nan, False),
        (40.0 - 1e-9, 0.0, False),
    ],
)
def test_ten_seconds_to_the_end_of_the_last_exposure_are_a_stretch(last_s, exposure_s, is_long):
    seconds = [*range(30), *np.linspace(30.0, last_s, 7), 50.0, 51.0]
    made = few(seconds, range(30, 37), objects=0, exposure_s=exposure_s)
    assert stretches_s(made) == [(30.0, pytest.approx(last_s))] * is_long


@pytest.mark.parametrize(("row", "is_long"), [(36, True), (30, False), (35, False)])
def test_the_exposure_that_counts_is_that_of_the_last_frame(row, is_long):
    """Six seconds from the first to the last, and an exposure of four."""
    made = few([*range(30), *np.linspace(30.0, 36.0, 7), 50.0, 51.0], range(30, 37), objects=0, exposure_s=0.1)
    made["exposure_s"][row] = 4.0
    assert bool(stretches_s(made)) is is_long


def test_a_whole_session_that_is_short_counts_and_one_frame_is_a_session():
    assert stretches_s(few([5.0], [0], objects=0)) == [(5.0, 5.0)]
    assert stretches_s(few([0.0, 1.0], [0, 1], objects=0)) == [(0.0, 1.0)]
    assert stretches_s(few([0.0, 1.0, 2.0], [0, 1], objects=0)) == []
    assert stretches_s(few([0.0, 10.0], [0, 1], objects=0)) == [(0.0, 10.0)]  # the time between both is theirs
    assert no_sky(few([]), STATION.site) == ()


@pytest.mark.parametrize(
    ("step_s", "gap_s", "is_one"),
    [
        (0.5, 3.0, True),
        (0.5, 3.5, False),
        (1.9, 3.8, False),
        (2.0, 4.0, False),
        (10.0, 10.0, True),
        (10.0, 20.0, False),
    ],
)
def test_three_seconds_or_the_time_to_the_next_frame_are_bridged(step_s, gap_s, is_one):
    """Of frames each 10 s one and a half are 15 s: no answer between two frames ends a stretch."""
    rows = np.arange(200)
    after = round(gap_s / step_s)
    blind = [*range(60, 100), *range(99 + after, 140)]
    found = stretches_s(few(step_s * rows, blind, objects=0))
    one = [(60 * step_s, 139 * step_s)]
    two = [(60 * step_s, 99 * step_s), ((99 + after) * step_s, 139 * step_s)]
    assert found == [pytest.approx(item) for item in (one if is_one else two)]


def test_one_frame_and_a_half_are_bridged_and_two_are_not():
    """Frames each 4 s; one comes 6 s after the last one, another a microsecond later than that."""
    for late_s, count in ((6.0, 1), (6.000001, 2)):
        seconds = 4.0 * np.arange(40)
        seconds[20:] += late_s - 4.0
        assert len(stretches_s(few(seconds, range(10, 30), objects=0))) == count


def test_the_reason_tells_the_seconds_from_the_first_frame_to_the_end_of_the_last():
    made = few(np.arange(100.0), range(40, 61), objects=0, exposure_s=4.0)
    assert found(made)[0][1].startswith("no object at all for 24 s, ")


@pytest.mark.parametrize(("blind", "middle"), [(range(2, 7), 4), (range(2, 6), 4), (range(3, 6), 4)])
def test_the_sun_is_that_of_the_middle_frame_above_or_below_the_horizon(blind, middle):
    """Ten minutes turn the Sun by two degrees and a half."""
    for text in ("2026-03-20T05:00:00Z", "2026-03-20T11:00:00Z"):
        made = few(600.0 * np.arange(9), blind)
        made["utc_ns"] += from_text(text) - START_NS
        sun_deg = sun_altitude_deg(STATION.site, int(made["utc_ns"][middle]))
        side = "above" if sun_deg > 0 else "below"
        ((cause, reason),) = found(made)
        duration_s = 600 * (len(blind) - 1) + 1
        assert cause is Cause.NO_SKY
        assert reason == f"Sun {abs(sun_deg):.0f} deg {side} the horizon: no dark sky for {duration_s} s"


@pytest.mark.parametrize(
    ("altitude_deg", "words"), [(0.3, "Sun 0 deg above"), (-0.3, "Sun 0 deg below"), (-0.7, "Sun 1 deg below")]
)
def test_the_horizon_itself_parts_above_and_below(altitude_deg, words):
    """In the morning of this day the Sun rises here between two and three o'clock."""
    low_ns, high_ns = from_text("2026-03-20T21:00:00Z"), from_text("2026-03-21T05:00:00Z")
    while high_ns - low_ns > NS_PER_S:
        middle_ns = (low_ns + high_ns) // 2
        is_lower = sun_altitude_deg(STATION.site, middle_ns) < altitude_deg
        low_ns, high_ns = (middle_ns, high_ns) if is_lower else (low_ns, middle_ns)
    made = few(np.arange(100.0), range(40, 61))
    made["utc_ns"] += low_ns - int(made["utc_ns"][50])
    assert found(made)[0][1].startswith(f"{words} the horizon")


@pytest.mark.parametrize(("row", "explains"), [(39, True), (40, False), (60, False), (61, True)])
def test_a_fault_of_the_detector_counts_within_the_stretch_alone(row, explains):
    made = few(np.arange(100.0), range(40, 61), objects=0)
    made["status"][row] = STATUSES.index(Status.SENSOR_FAULT)
    assert bool(found(made)) == explains


@pytest.mark.parametrize(("many", "is_empty"), [(1, True), (2, False)])
@pytest.mark.parametrize("at", [40, 49])
def test_one_frame_in_ten_may_show_more_objects(many, at, is_empty):
    """The 90th percentile of eleven numbers is the second greatest."""
    made = few(np.arange(100.0), range(40, 51), objects=2)
    made["objects"][at : at + many] = 9
    assert bool(found(made)) == is_empty


@pytest.mark.parametrize(
    ("objects", "expected", "words"),
    [
        (0, np.nan, "no object at all for 21 s: lens cap, cover or overcast"),
        (0, 3, "no object at all for 21 s, 3 stars are expected: lens cap, cover or overcast"),
        (0, 2, "no object at all for 21 s, 2 stars are expected: the field has too few stars to be identified"),
        (1, 1, "at most 1 object for 21 s, 1 star is expected: the field has too few stars to be identified"),
        (2, 0, "at most 2 objects for 21 s, 0 stars are expected: the field has too few stars to be identified"),
        (2, 3, "at most 2 objects for 21 s, 3 stars are expected: cloud, a cover, or a sensor that sends too few "
               "objects"),
        (1, np.nan, "at most 1 object for 21 s: cloud, a cover, or a sensor that sends too few objects"),
    ],
)  # fmt: skip
def test_few_objects_are_told_with_the_stars_that_are_expected_and_what_may_be_the_reason(objects, expected, words):
    made = few(np.arange(100.0), range(40, 61), objects=objects, stars_expected=expected)
    assert found(made) == [(Cause.NO_OBJECTS, words)]


@pytest.mark.parametrize(
    ("zero_point_mag", "exposure_s", "words"),
    [
        (13.0, 1.0, "stars 1.0 mag too faint"),
        (13.01, 1.0, None),
        (13.0, 0.0, "stars 1.0 mag too faint"),
        (13.0, 0.1, None),
        (13.0, 10.0, "stars 3.5 mag too faint"),
        (15.4, 10.0, "stars 1.1 mag too faint"),
        (10.4, 0.1, "stars 1.1 mag too faint"),
    ],
)
def test_a_magnitude_is_faint_and_a_tenfold_exposure_is_two_and_a_half_of_them(zero_point_mag, exposure_s, words):
    made = few(np.arange(100.0), range(40, 61))
    made["zero_point_mag"][39], made["exposure_s"][39] = zero_point_mag, exposure_s
    assert found(made) == [(Cause.NO_SKY, f"{words}: cloud for 21 s")] * (words is not None)


def test_the_clear_sky_is_that_of_the_best_tenth():
    """Of 80 frames with stars seven may be brighter than the clear sky by anything: the ninetieth percentile."""
    made = few(np.arange(101.0), range(40, 61))
    made["zero_point_mag"][70:77] = 18.0
    assert found(made) == []
    made["zero_point_mag"][70:80] = 18.0
    assert found(made) == [(Cause.NO_SKY, "stars 4.0 mag too faint: cloud for 21 s")]


@pytest.mark.parametrize(("sun_deg", "is_dark"), [(-12.0, True), (-11.9, False), (np.nan, True)])
@pytest.mark.parametrize("change", [{"zero_point_mag": 12.0}, {"stars_seen": 4}])
def test_stars_tell_a_cloud_up_to_nautical_twilight(sun_deg, is_dark, change):
    made = few(np.arange(100.0), range(40, 61))
    made["sun_altitude_deg"][39] = sun_deg
    for name, value in change.items():
        made[name][38:40] = value
    made["zero_point_mag"][38] = 14.0
    made["stars_seen"][38] = 16
    made["stars_expected"][:38] = made["stars_expected"][61:] = 20 if "zero_point_mag" in change else np.nan
    assert bool(found(made)) == is_dark


def test_without_a_star_beside_it_a_stretch_has_no_reason():
    made = few(np.arange(30.0), range(30))
    assert found(made) == []
    dark = few(np.r_[np.arange(10.0), 200.0 + np.arange(20.0)], range(10, 30))
    dark["zero_point_mag"][:5], dark["stars_seen"][:5] = 10.0, 2
    assert found(dark) == []


@pytest.mark.parametrize(
    ("seconds", "is_beside"),
    [(40.0 - 60.0, True), (40.0 - 60.0 - 1e-6, False), (60.0 + 60.0, True), (60.0 + 60.0 + 1e-6, False)],
)
@pytest.mark.parametrize("change", [{"zero_point_mag": 12.0}, {"stars_seen": 2}])
def test_a_minute_is_beside_on_either_side(seconds, is_beside, change):
    """Clear frames are far away; one alone is near, and shows a cloud."""
    far = [-500.0 + np.arange(10.0), 700.0 + np.arange(10.0)]
    stretch = 40.0 + np.arange(21.0)
    times = np.sort(np.r_[far[0], far[1], stretch, seconds])
    made = few(times, np.flatnonzero(np.isin(times, stretch)))
    for name, value in change.items():
        made[name][np.flatnonzero(times == seconds)] = value
    assert bool(found(made)) == is_beside


@pytest.mark.parametrize(
    ("seen", "expected", "is_cloud"),
    [(8, 20, False), (7, 20, True), (4, 10, False), (3, 10, True), (3, 9, False), (14, 40, True), (17, 40, False)],
)
def test_less_than_half_of_the_share_of_the_clear_is_a_cloud_with_ten_expected_stars(seen, expected, is_cloud):
    """The clear sky shows 16 of 20, so that half is two fifths."""
    times = np.r_[-500.0 + np.arange(10.0), 39.0, 40.0 + np.arange(21.0), 700.0 + np.arange(10.0)]
    made = few(times, range(11, 32))
    made["stars_seen"][10], made["stars_expected"][10] = seen, expected
    words = "less than half of the stars just before or after: cloud for 21 s"
    assert found(made) == [(Cause.NO_SKY, words)] * is_cloud


def test_a_frame_without_stars_is_no_share():
    times = np.r_[-500.0 + np.arange(10.0), 38.0, 39.0, 40.0 + np.arange(21.0), 700.0 + np.arange(10.0)]
    made = few(times, range(12, 33))
    made["stars_seen"][10] = 0
    assert found(made) == []
    made["stars_seen"][10] = 1
    assert found(made) != []


def test_the_same_instant_twice_is_no_order():
    """A step of the clock turns the order, a pause of it does not."""
    made = few([*np.arange(40.0), *np.repeat(40.0 + np.arange(11.0), 2), 60.0], range(40, 62), objects=0)
    assert stretches_s(made) == [(40.0, 50.0)]


# Twilight, cloud, and their edges


def dusk(count=3600, *, dark_from=1800, least=0):
    """An hour at 1 Hz: the stars come out one by one until it is dark, 18 of 20."""
    made = few(np.arange(float(count)))
    made["stars_seen"] = np.minimum(18, least + 18 * np.arange(count) // dark_from)
    made["sun_altitude_deg"] = np.linspace(-4.0, -20.0, count)
    return made


def test_twilight_is_left_out_until_as_many_stars_are_seen_as_in_the_dark():
    """17 of 18, from 1700 s on; 16 are too few, by half minutes."""
    made = dusk()
    ((item,), (first_s, last_s)) = no_sky(made, STATION.site), stretches_s(made)[0]
    assert item.cause is Cause.NO_SKY
    assert (first_s, last_s) == (0.0, 1679.0)
    assert (
        item.reason
        == "Sun 4 deg below to 11 deg below the horizon: no dark sky for 1680 s, 8 of 20 expected stars are seen"
    )


def test_while_the_mount_is_not_known_as_many_stars_are_expected_as_after_it():
    made = dusk()
    made["stars_expected"][:900] = np.nan
    assert stretches_s(made) == [(0.0, 1679.0)]


def test_a_twilight_in_which_all_stars_are_seen_is_night():
    assert found(dusk(least=18)) == []


def test_dawn_is_left_out_from_the_first_frame_that_shows_fewer_stars_to_the_last():
    made = dusk()
    for name in ("stars_seen", "sun_altitude_deg"):
        made[name] = made[name][::-1].copy()
    assert stretches_s(made) == [(1920.0, 3599.0)]


def test_as_many_stars_as_the_noise_of_the_dark_part_allows_are_no_fewer():
    rng = np.random.default_rng(3)
    made = dusk(least=18)
    made["stars_seen"] = np.repeat(rng.integers(9, 19, 120), 30)
    assert found(made) == []
    made["stars_seen"][:300] = 2
    assert stretches_s(made) == [(0.0, 299.0)]


def ends_in_twilight(*, silent_until: int):
    """Half an hour of a dusk that ends 8 deg below the horizon, when 18 of 20 stars are seen; first without answers."""
    made = dusk(1800)
    made["sun_altitude_deg"] = np.linspace(-4.0, -8.0, 1800)
    made["status"][:silent_until] = STATUSES.index(Status.NO_MATCH)
    return made


def test_where_nothing_is_dark_twilight_ends_with_the_last_half_minute_that_misses_answers():
    assert stretches_s(ends_in_twilight(silent_until=900)) == [(0.0, 899.0)]
    assert stretches_s(ends_in_twilight(silent_until=902)) == [(0.0, pytest.approx(901.0, abs=2))]
    assert found(ends_in_twilight(silent_until=0)) == []


def test_a_dusk_that_ends_before_the_first_stars_are_enough_is_no_fault_of_the_sensor():
    made = ends_in_twilight(silent_until=1800)[:700]  # 6 of 20 stars at its end
    assert stretches_s(made) == [(0.0, 699.0)]


@pytest.mark.parametrize(("until", "ends_s"), [(960, 957.0), (1080, 1029.0)])
def test_answers_that_are_missing_up_to_two_minutes_after_such_a_dusk_belong_to_it(until, ends_s):
    """Every third one is, by half minutes; the ten seconds at the edge of any stretch come on top."""
    made = ends_in_twilight(silent_until=900)
    made["status"][900:until:3] = STATUSES.index(Status.NO_MATCH)
    assert stretches_s(made) == [(0.0, pytest.approx(ends_s, abs=3))]


def test_answers_that_are_missing_while_all_stars_are_seen_are_not_excused_by_twilight():
    made = ends_in_twilight(silent_until=1800)
    made["stars_seen"] = 19
    assert found(made) == []


def test_a_sensor_that_sends_no_panoramas_shows_no_twilight_by_its_stars():
    made = dusk()
    made["stars_seen"], made["stars_expected"] = 0, np.nan
    assert found(made) == []


def clouded(first, last, made=None, *, light=0.3):
    made = few(np.arange(400.0)) if made is None else made
    made["sky_condition"][first:last] = SKY_CONDITIONS.index(SkyCondition.CLOUDED)
    made["transparency"] = 1.0
    made["transparency"][first:last] = light
    return made


def test_a_cloud_is_left_out_though_every_frame_is_answered():
    made = clouded(100, 160)
    assert found(made) == [(Cause.NO_SKY, "stars up to 1.3 mag too faint: cloud, haze or dew for 60 s")]
    assert stretches_s(made) == [(100.0, 159.0)]


@pytest.mark.parametrize(("blind", "is_cloud"), [(5, False), (6, True)])
@pytest.mark.parametrize("light", [np.nan, 1.0])
def test_stars_that_are_missing_and_not_faint_are_a_cloud_where_a_tenth_of_the_frames_shows_none(
    light, blind, is_cloud
):
    """Noise takes stars away, too, and leaves enough to be named."""
    made = clouded(100, 160, few(np.arange(400.0), range(105, 105 + 9 * blind, 9)), light=light)
    assert [words for _, words in found(made)] == ["too few stars: cloud, haze or dew for 60 s"] * is_cloud


def test_a_blind_stretch_within_a_cloud_is_part_of_it():
    made = clouded(100, 300, few(np.arange(400.0), range(150, 250), objects=0))
    assert stretches_s(made) == [(100.0, 299.0)]
    assert found(made)[0][0] is Cause.NO_SKY


def absent(made, *rows):
    made["status"][list(rows)] = STATUSES.index(Status.NO_MATCH)
    made["answer_check"][list(rows)] = ANSWER_CHECKS.index(AnswerCheck.ABSENT)
    return made


@pytest.mark.parametrize(
    ("rows", "until_s"),
    [((161, 164, 167), 167.0), ((160, 164), 160.0), (range(160, 200), 169.0), ((), 159.0), ((90, 200), 159.0)],
)
def test_absences_at_the_edge_of_a_cloud_belong_to_it_for_ten_seconds(rows, until_s):
    """One after the other within three seconds, though the reference identifier has an answer."""
    assert stretches_s(absent(clouded(100, 160), *rows)) == [(100.0, until_s)]


@pytest.mark.parametrize(
    ("few_until_s", "rows", "until_s"),
    [
        (240, (165, 190, 230), 230.0),
        (240, (190, 250), 190.0),  # as many stars as ever from the block at 240 s on
        (300, (190, 279, 280), 279.0),
        (210, (215,), 159.0),
    ],
)
def test_all_absences_belong_to_a_cloud_that_breaks_up_for_two_minutes(few_until_s, rows, until_s):
    """13 stars instead of 16 until then: blocks of half a minute tell."""
    made = absent(clouded(100, 160), *rows)
    made["stars_seen"][160:few_until_s] = 13
    assert stretches_s(made) == [(100.0, until_s)]


def test_a_hole_in_a_cloud_shows_all_stars_for_half_a_minute():
    made = absent(clouded(100, 160), 190, 195, 250, 290, 50)
    made["stars_seen"][210:270] = made["stars_seen"][30:60] = 13
    assert stretches_s(made) == [(50.0, 250.0)]


def test_absences_before_a_cloud_belong_to_it_too():
    assert stretches_s(absent(clouded(100, 160), 92, 95, 98, 80)) == [(92.0, 159.0)]


def test_absences_far_from_a_cloud_are_the_sensors():
    assert stretches_s(absent(clouded(100, 160), *range(200, 230))) == [(100.0, 159.0)]


@pytest.mark.parametrize("step_s", [0.1, 4.0, 30.0])
def test_a_cloud_is_one_at_any_rate(step_s):
    made = clouded(100, 160, few(step_s * np.arange(400)))
    assert stretches_s(made) == [(pytest.approx(100 * step_s), pytest.approx(159 * step_s))]


@pytest.mark.parametrize(
    ("moon", "objects", "status", "is_excused"),
    [
        ((40.0, 4.0), 25, Status.NO_MATCH, True),
        ((40.0, 5.5), 25, Status.NO_MATCH, False),
        ((-1.0, 4.0), 25, Status.NO_MATCH, False),
        ((np.nan, np.nan), 25, Status.NO_MATCH, False),
        ((40.0, 4.0), 25, Status.SENSOR_FAULT, False),
    ],
)
def test_the_moon_in_the_field_explains_panoramas_without_a_star(moon, objects, status, is_excused):
    made = frames(moon_altitude_deg=moon[0], moon_separation_deg=moon[1], objects=objects)
    made[BLIND]["status"] = STATUSES.index(status)
    words = [(item.cause, item.reason) for item in no_sky(made, STATION.site, field_deg=5.0)]
    told = (Cause.NO_SKY, "the Moon in the field, 4.0 deg from the boresight: no star for 12 s")
    assert words == ([told] if is_excused else [])


def test_the_moon_excuses_no_identifier_where_the_reference_answers():
    made = frames(moon_altitude_deg=40.0, moon_separation_deg=4.0)
    made[BLIND]["answer_check"] = ANSWER_CHECKS.index(AnswerCheck.ABSENT)
    assert no_sky(made, STATION.site, field_deg=5.0) == ()
