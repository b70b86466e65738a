"""Which of a sensor's own answers belong to which panorama, and what is compared with the sky."""

import math
from dataclasses import replace

import numpy as np
import pytest
from skies.known_nights import START_NS, STATION, TRUTH, session

from gse.station.own_answers import (
    OwnAnswerTruth,
    _compared,
    _stars_of_a_fix,
    by_other_stars_arcsec,
    field_of,
    not_compared,
    own_truth,
    paired,
    sensor_answers,
)
from gse.truth import Alignment, horizon_to_sensor
from gse.values.instant import NS_PER_S, from_text
from gse.values.mount import InertialDirection, Mount
from protocols import AttitudeMessage

ARCSEC_DEG = 1 / 3600


def night(tags_us, numbers=None, *, station=STATION):
    """A session whose frames have these time tags and numbers."""
    made = session(len(tags_us), noise=0.0, step_s=1.0, station=station)
    made.frames.columns["time_us"] = tags_us
    made.frames.columns["frame_no"] = range(len(tags_us)) if numbers is None else numbers
    return made


def answer(made, tag_us, number=0, **values):
    usual = {"ra_deg": 10.0, "de_deg": 20.0, "roll_deg": 30.0, "matched": 9, "state": "acquired", "latency_s": 0.08}
    made.sensor_attitudes.append(START_NS, AttitudeMessage(tag_us, frame_no=number, **usual | values))


@pytest.mark.parametrize(
    ("tags_us", "numbers", "answers", "pairs"),
    [
        ([100, 200, 300], [5, 6, 7], [(100, 5), (300, 7)], [(0, 0), (2, 1)]),
        ([100, 200, 300], [5, 6, 7], [(100, 0), (200, 0)], [(0, 0), (1, 1)]),
        ([100, 200, 300], [5, 6, 7], [(100, 6), (200, 6)], [(1, 1)]),
        ([100, 200, 300], [5, 6, 7], [(99, 5), (101, 5), (50, 0), (301, 7)], []),
        ([300, 100, 200], [5, 6, 7], [(100, 6), (200, 7), (300, 5)], [(0, 2), (1, 0), (2, 1)]),
        ([100, 200, 300], [5, 6, 7], [(200, 6), (100, 5), (200, 6)], [(0, 1), (1, 2)]),
        ([100, 100, 300], [5, 6, 7], [(100, 6)], [(1, 0)]),
        ([100], [5], [(100, 5)], [(0, 0)]),
        ([], [], [(100, 5)], []),
        ([100], [5], [], []),
    ],
)
def test_an_answer_belongs_to_the_panorama_of_its_tag_and_number_the_later_of_two(tags_us, numbers, answers, pairs):
    made = night(tags_us, numbers)
    for tag_us, number in answers:
        answer(made, tag_us, number)
    rows, places = paired(made.frames.columns, made.sensor_attitudes.columns)
    assert list(zip(rows.tolist(), places.tolist(), strict=True)) == pairs


@pytest.mark.parametrize(
    ("answers", "count"),
    [
        ([], 0),
        ([(500, {}), (600, {}), (700, {"state": "lost"})], 2),
        ([(100, {}), (500, {})], 1),
        ([(100, {}), (50, {}), (500, {})], 2),
        ([(100, {}), (100, {}), (200, {})], 0),
        ([(100, {}), (300, {}), (300, {})], 0),
        ([(100, {"ra_deg": 11.0}), (100, {}), (200, {})], 1),
        ([(100, {"de_deg": 21.0}), (100, {"roll_deg": 31.0}), (100, {}), (300, {})], 2),
        ([(100, {"roll_deg": math.nan}), (100, {})], 1),
        ([(100, {"roll_deg": math.nan}), (100, {"roll_deg": math.nan})], 0),
        ([(100, {"q1": 0.5}), (100, {})], 1),
        ([(100, {"state": "lost"}), (100, {})], 0),
        ([(300, {}), (100, {"ra_deg": 11.0}), (200, {}), (100, {})], 1),
    ],
)
def test_answers_to_no_panorama_or_that_were_taken_back_are_not_compared(answers, count):
    """A second one that says the same, the missing numbers too, is a copy."""
    made = night([100, 200, 300])
    for tag_us, values in answers:
        answer(made, tag_us, **values)
    assert not_compared(made) == count


@pytest.mark.parametrize(("number", "count"), [(1, 0), (0, 1)])
def test_a_copy_has_the_frame_number_too(number, count):
    made = night([100, 200, 300], [1, 2, 3])
    answer(made, 100, number)
    answer(made, 100, 1)
    assert not_compared(made) == count


@pytest.mark.parametrize(
    ("own", "here", "stars"),
    [
        ([(4, "acquired"), (6, "acquired"), (9, "acquired")], 30, 6.0),
        ([(4, "acquired"), (0, "acquired"), (7, "acquired"), (90, "lost")], 30, 5.5),
        ([(0, "acquired"), (0, "acquired")], 30, 30.0),
        ([(40, "lost")], 20, 20.0),
        ([(0, "acquired")], 0, 1.0),
        ([(1, "acquired")], 20, 1.0),
    ],
)
def test_the_stars_of_a_fix_are_those_the_sensor_says_or_those_identified_here(own, here, stars):
    made = night([100, 200, 300, 400])
    made.frames.columns["matched"] = [here, here, here, 0]
    for place, (matched, state) in enumerate(own):
        answer(made, 100 * (place + 1), matched=matched, state=state)
    assert _stars_of_a_fix(made) == stars


def test_other_stars_make_as_much_as_the_unevenness_of_the_field_leaves_in_so_many():
    made = night([100 * number for number in range(1, 6)])
    answer(made, 100, matched=9)
    middle_ns = int(made.frames.columns["utc_ns"][2])
    field = OwnAnswerTruth(TRUTH, STATION.mount, False, field_of(STATION.sensor.camera()))
    assert by_other_stars_arcsec(made) == pytest.approx(field.uneven_arcsec(middle_ns) / 3)
    assert by_other_stars_arcsec(made) > 0


def shown():
    return STATION.model_copy(update={"mount": Mount(inertial=InertialDirection(ra_deg=10.0, de_deg=20.0))})


def test_before_a_star_simulator_and_without_truth_or_frames_no_stars_part():
    simulator = night([100, 200], station=shown())
    assert by_other_stars_arcsec(simulator) == 0.0
    without = night([100, 200])
    without.earth_orientation = None
    assert own_truth(without) is None
    assert by_other_stars_arcsec(without) == 0.0
    assert by_other_stars_arcsec(night([])) == 0.0


def fitted(mount, from_ns=START_NS):
    return Alignment(mount, ((0.0,) * 3,) * 3, (0.0,) * 3, 4, 0, from_ns, from_ns + NS_PER_S)


def test_a_mount_to_be_fitted_has_no_truth_before_and_that_of_the_fit_after():
    aligned = STATION.model_copy(update={"mount": replace(STATION.mount, align="first 60 s")})
    made = night([100, 200], station=aligned)
    assert own_truth(made) is None
    other = Mount(azimuth_deg=10.0, altitude_deg=50.0)
    made.alignment = fitted(other)
    assert own_truth(made).mount is other
    assert own_truth(night([100])).mount is STATION.mount


@pytest.mark.parametrize(("word", "corrected"), [("corrected", True), ("not corrected", False)])
def test_truth_has_aberration_as_the_convention_says(word, corrected):
    sensor = STATION.sensor.model_copy(update={"attitude": replace(STATION.sensor.attitude, aberration=word)})
    assert (
        own_truth(night([100], station=STATION.model_copy(update={"sensor": sensor}))).aberration_corrected is corrected
    )


def test_the_first_instant_of_truth_is_the_day_after_1972_began():
    made = night([100])
    first_ns = from_text("1972-01-02T00:00:00Z")
    assert _compared(made, np.array([first_ns - 1, first_ns, first_ns + 1])).tolist() == [False, True, True]


def test_answers_are_compared_from_the_first_frame_that_has_a_truth():
    made = night([100, 200, 300, 400])
    made.alignment = fitted(STATION.mount)
    frames = made.frames.columns
    frames["ra_true_deg"][:2] = np.nan
    utc_ns = frames["utc_ns"].copy()
    assert _compared(made, utc_ns).all()  # the mount is stated: a fit to judge it by leaves nothing out
    made.station = STATION.model_copy(update={"mount": replace(STATION.mount, align="first 1 s")})
    assert _compared(made, utc_ns).tolist() == [False, False, True, True]
    frames["ra_true_deg"] = np.nan
    assert not _compared(made, utc_ns).any()


def test_angles_and_errors_of_an_answer_stand_in_its_row_and_unknown_ones_are_not_numbers():
    """An answer 100 arcsec north of what an errorless sensor on this mount says, one without roll, one that is lost."""
    made = night([100, 200, 300, 400])
    utc_ns = made.frames.columns["utc_ns"]
    expected = own_truth(made).expected(utc_ns)
    ra = np.degrees(np.arctan2(expected[:, 2, 1], expected[:, 2, 0])) % 360
    de = np.degrees(np.arcsin(expected[:, 2, 2]))
    answer(made, 200, ra_deg=ra[1], de_deg=de[1] + 100 * ARCSEC_DEG, roll_deg=30.0, matched=7)
    answer(made, 300, ra_deg=ra[2] + 40 * ARCSEC_DEG, de_deg=de[2], roll_deg=math.nan, matched=8)
    answer(made, 400, state="lost", matched=3, latency_s=0.25)
    found = sensor_answers(made)
    nan = math.nan
    assert found.sent.tolist() == [False, True, True, True]
    assert found.acquired.tolist() == [False, True, True, False]
    assert found.ra_deg == pytest.approx([nan, ra[1], ra[2] + 40 * ARCSEC_DEG, nan], nan_ok=True)
    assert found.de_deg == pytest.approx([nan, de[1] + 100 * ARCSEC_DEG, de[2], nan], nan_ok=True)
    assert found.roll_deg == pytest.approx([nan, 30.0, nan, nan], nan_ok=True)
    assert found.d_de_arcsec == pytest.approx([nan, 100.0, 0.0, nan], abs=0.02, nan_ok=True)
    of_ra = 40 * math.cos(math.radians(de[2]))
    assert found.d_ra_cosde_arcsec == pytest.approx([nan, 0.0, of_ra, nan], abs=0.02, nan_ok=True)
    assert np.isfinite(found.d_roll_arcsec).tolist() == [False, True, False, False]
    assert np.hypot(found.cross_x_arcsec, found.cross_y_arcsec)[1:3] == pytest.approx([100.0, of_ra], abs=0.02)
    assert found.latency_ms == pytest.approx([nan, 80.0, 80.0, 250.0], nan_ok=True)
    assert found.matched.tolist() == [0, 7, 8, 3]


def test_an_answer_arrives_so_long_after_the_middle_of_the_exposure_unless_nobody_stamped_it():
    made = night([100, 200, 300])
    for tag_us, late_ns in ((100, 120_000_000), (300, -5_000_000)):
        at_ns = int(made.frames.columns["utc_ns"][tag_us // 100 - 1]) + late_ns
        made.sensor_attitudes.append(at_ns, AttitudeMessage(tag_us, 10.0, 20.0, 30.0, 0, 9, "acquired"))
    made.sensor_attitudes.append(0, AttitudeMessage(200, 10.0, 20.0, 30.0, 0, 9, "acquired"))  # of a file
    assert sensor_answers(made).arrival_ms == pytest.approx([120.0, math.nan, -5.0], nan_ok=True)


def test_of_answers_about_the_begin_of_all_truth_the_later_ones_are_compared():
    made = night([100, 200, 300])
    made.frames.columns["utc_ns"][0] = 0
    for tag_us in (100, 200, 300):
        answer(made, tag_us)
    assert np.isfinite(sensor_answers(made).d_de_arcsec).tolist() == [False, True, True]
    assert np.isfinite(sensor_answers(made).de_deg).all()


def test_the_roll_of_an_answer_is_that_of_the_mount():
    made = night([100])
    zenith = own_truth(made).expected(made.frames.columns["utc_ns"])[0]
    assert zenith @ zenith.T == pytest.approx(np.eye(3), abs=1e-12)
    geometric = horizon_to_sensor(STATION.mount) @ TRUTH.icrs_to_horizon(START_NS)
    assert math.degrees(np.linalg.norm(zenith - geometric)) < 0.05
