"""Statistics of a session by hand: each number from a few frames."""

import math

import numpy as np
import pytest
from skies.known_nights import START_NS, frame, session, unanswered
from skies.one_by_one import add_frame

from gse.station.columns import STATUSES
from gse.station.exclusions import Cause, Exclusion
from gse.station.results import AnswerCheck, AttitudeError, Status, Subject
from gse.station.session_data import ExternalCounts
from gse.statistics.counted_frames import counted_frames
from gse.statistics.session_statistics import _spatial, statistics
from gse.statistics.subject_statistics import _star_fields, about_circular_mean
from gse.values.instant import NS_PER_S
from gse.values.mount import InertialDirection, Mount


def at_seconds(answered, *, silent=()):
    """A session whose frames at these seconds have an answer, or none."""
    made = session(0)
    error = AttitudeError(3.0, -4.0, 5.0, 3.0, 4.0)
    for second in sorted({*answered, *silent}):
        utc_ns = START_NS + second * NS_PER_S
        add_frame(made.frames, frame(utc_ns, second, error) if second in answered else unanswered(second))
        made.frames.columns["utc_ns"][-1] = utc_ns
    return made


def test_the_longest_time_between_good_answers_is_the_outage():
    onboard = statistics(at_seconds([0, 1, 2, 10, 11, 13], silent=[5, 7])).onboard
    assert onboard.outage_s == 8.0


def test_a_false_answer_ends_no_outage():
    made = at_seconds([0, 1, 2, 10, 11, 13])
    made.frames.columns["answer_check"][3] = list(AnswerCheck).index(AnswerCheck.FALSE)
    assert statistics(made).onboard.outage_s == 9.0


def test_acquisition_takes_from_the_first_panorama_to_the_first_answer():
    assert statistics(at_seconds([4, 5, 6], silent=[0, 1, 2])).onboard.acquisition_s == 4.0


def test_an_error_in_right_ascension_is_greater_than_on_the_sky_by_the_cosine_of_the_declination():
    made = at_seconds(range(40))
    made.frames.columns["de_true_deg"][:] = 60.0
    onboard = statistics(made).onboard
    assert onboard.axes["d_ra_cosde"].mean_abs_arcsec == 3.0
    assert onboard.mean_abs_d_ra_deg == pytest.approx(6.0 / 3600)
    assert onboard.mean_abs_d_de_deg == pytest.approx(4.0 / 3600)


def test_at_the_pole_there_is_no_error_in_right_ascension():
    made = at_seconds(range(40))
    made.frames.columns["de_true_deg"][:] = 89.95
    assert not statistics(made).onboard.mean_abs_d_ra_deg >= 0


@pytest.mark.parametrize(("nearest_deg", "is_known"), [(89.89, True), (89.91, False), (-89.91, False)])
def test_one_frame_too_near_the_pole_leaves_no_error_in_right_ascension(nearest_deg, is_known):
    made = at_seconds(range(40))
    made.frames.columns["de_true_deg"][:] = 60.0
    made.frames.columns["de_true_deg"][20] = nearest_deg
    found_deg = statistics(made).onboard.mean_abs_d_ra_deg
    by_hand_deg = (39 * 3.0 / 0.5 + 3.0 / math.sin(math.radians(0.11))) / 40 / 3600
    assert found_deg == pytest.approx(by_hand_deg if is_known else math.nan, nan_ok=True)


def test_the_session_lasts_from_its_first_frame_to_its_last():
    assert statistics(at_seconds([2, 3, 9])).duration_s == 7.0


def test_frames_are_counted_by_status_and_check():
    made = at_seconds([0, 1, 2, 3], silent=[5, 6])
    made.frames.columns["answer_check"][0] = list(AnswerCheck).index(AnswerCheck.FALSE)
    stats = statistics(made)
    assert {name: count for name, count in stats.statuses.items() if count} == {"IDENTIFIED": 4, "NO_MATCH": 2}
    assert stats.answer_checks["false"] == 1
    assert (stats.frames, stats.frames_expected) == (6, 6)
    assert (stats.onboard.available.count, stats.onboard.available.of) == (3, 6)
    assert (stats.onboard.false_answers.count, stats.onboard.false_answers.of) == (1, 4)


def test_frames_that_the_sequence_misses_were_expected_and_are_not_available():
    made = at_seconds(range(10))
    made.link.frames_lost = 6
    stats = statistics(made)
    assert stats.frames_expected == 16
    assert stats.onboard.available.value == 10 / 16
    assert stats.onboard.available.n_eff < 16  # nobody knows whether they were missing one by one


def test_rolls_on_both_sides_of_half_a_turn_scatter_by_little():
    made = at_seconds(range(40))
    made.frames.columns["d_roll_arcsec"][:] = np.tile([648_000.0 - 30.0, -648_000.0 + 30.0], 20)
    roll = statistics(made).onboard.axes["d_roll"]
    assert roll.mean_abs_arcsec == pytest.approx(648_000.0, abs=31)
    assert roll.std_arcsec == pytest.approx(30.0, rel=0.02)


def test_an_answer_in_a_stretch_without_sky_is_judged_and_none_need_be_there():
    made = at_seconds(range(20))
    made.frames.columns["answer_check"][3] = list(AnswerCheck).index(AnswerCheck.FALSE)
    made.excluded = (Exclusion(START_NS, START_NS + 10 * NS_PER_S, "clouds", Cause.OPERATOR),)
    onboard = statistics(made).onboard
    assert (onboard.false_answers.count, onboard.false_answers.of) == (1, 20)
    assert (onboard.available.count, onboard.available.of) == (10, 10)


def test_the_half_cone_is_of_the_angles_between_boresights():
    onboard = statistics(at_seconds(range(40))).onboard  # 3 arcsec along columns and 4 along rows
    assert onboard.half_cone_95.p95_abs_arcsec == 5.0


def test_lost_frames_that_were_no_panoramas_are_not_missing():
    made = at_seconds(range(10))
    made.link.frames_lost, made.others_lost = 6, 4
    assert statistics(made).onboard.available.value == 10 / 12


def test_what_arrives_late_is_measured_from_the_middle_of_the_exposure_to_the_host():
    made = at_seconds(range(4))
    made.frames.columns["host_utc_ns"][:] = made.frames.columns["utc_ns"] + 7_000_000
    assert statistics(made).arrival_ms.p50 == 7.0
    made.frames.columns["host_utc_ns"][:2] = 0  # panoramas of a file, which came at no time
    assert (statistics(made).arrival_ms.n, statistics(made).arrival_ms.p50) == (2, 7.0)


def test_faults_of_an_external_identifier_are_counted_only_where_there_are_any():
    made = at_seconds(range(4))
    assert "IDENTIFIER_FAULT" not in statistics(made).statuses
    made.frames.columns["status"][1] = STATUSES.index(Status.IDENTIFIER_FAULT)
    assert statistics(made).statuses["IDENTIFIER_FAULT"] == 1


@pytest.mark.parametrize("de_deg", [0.0, 60.0, -80.0])
def test_the_earth_rate_is_measured_by_how_stars_run_away_in_right_ascension(de_deg):
    """Half of its error is that of the drift: an hour's arcseconds, in seconds, at the cosine of the declination."""
    made = session(400, step_s=9.0, noise=1.0, drift_per_h=(36.0, 0.0))
    made.frames.columns["de_true_deg"][:] = de_deg
    onboard = statistics(made).onboard
    drift, cos_de = onboard.axes["d_ra_cosde"], math.cos(math.radians(de_deg))
    assert onboard.earth_rate.measured_arcsec_per_s == pytest.approx(15.041067 + 0.01 / cos_de, abs=2e-4 / cos_de)
    wide = drift.drift_high_arcsec_per_h - drift.drift_low_arcsec_per_h
    assert onboard.earth_rate.error_arcsec_per_s == pytest.approx(wide / 2 / 3600 / cos_de)


@pytest.mark.parametrize(("de_deg", "is_known"), [(89.0, True), (89.95, False), (-89.95, False)])
def test_at_the_pole_the_earth_rate_is_not_measured(de_deg, is_known):
    made = session(60)
    made.frames.columns["de_true_deg"][:] = de_deg
    assert math.isfinite(statistics(made).onboard.earth_rate.measured_arcsec_per_s) == is_known


def test_frames_over_the_limit_of_time_are_slow_and_one_at_it_is_not():
    made = at_seconds(range(4))
    limit_us = made.station.limits.identification_ms * 1000
    made.frames.columns["elapsed_us"][:] = [limit_us - 1, limit_us, limit_us + 1000, limit_us + 2000]
    slow = statistics(made).onboard.slow
    assert (slow.count, slow.of) == (2, 4)


def test_angles_about_half_a_turn_are_taken_about_their_mean_and_unknown_ones_stay_unknown():
    half_turn = 648_000.0
    angles = np.array([half_turn - 10, np.nan, -half_turn + 30])
    found = about_circular_mean(angles)
    assert np.abs(found[[0, 2]]).tolist() == pytest.approx([half_turn + 10, half_turn - 30], abs=1e-6)
    assert np.isnan(found[1])
    assert np.isfinite(angles[[0, 2]]).all()


def test_star_fields_are_counted_by_where_the_boresight_was():
    made = at_seconds(range(9))
    made.frames.columns["ra_deg"][:] = [10, 10.1, 40, 40.1, 70, 70, 70, 100, 100]
    made.frames.columns["de_deg"][:] = 0.3
    assert statistics(made).onboard.star_fields == 4
    assert statistics(session(0)).onboard.star_fields == 0


@pytest.mark.parametrize(
    ("ra_deg", "de_deg", "fields"),
    [
        ([10.0, 10.1, 10.2], [5.0, 5.0, 5.0], 1),
        ([10.0, 100.0, 190.0, 280.0], [5.0] * 4, 4),
        ([40.0, 40.0], [50.0, -50.0], 2),
        ([40.0, 220.0], [50.0, 50.0], 2),
        ([30.0, 150.0], [20.0, 20.0], 2),
        ([1.0, 359.0, 1.0, 359.0], [0.5, 0.5, -0.5, -0.5], 4),  # on the corner of four
    ],
)
def test_fields_of_stars_are_counted_by_where_the_boresight_went(ra_deg, de_deg, fields):
    assert _star_fields(np.array(ra_deg), np.array(de_deg), 0.25) == fields


def test_a_sky_of_boresights_has_as_many_fields_as_cells_of_the_sphere():
    """By hand: the cells of a cube of eighths that unit vectors are in."""
    rng = np.random.default_rng(6)
    vectors = rng.normal(size=(20_000, 3))
    vectors /= np.linalg.norm(vectors, axis=1)[:, None]
    ra, de = np.degrees(np.arctan2(vectors[:, 1], vectors[:, 0])), np.degrees(np.arcsin(vectors[:, 2]))
    assert _star_fields(ra, de, 0.25) == len({tuple(cell) for cell in np.floor(vectors / 0.25).tolist()})


@pytest.mark.parametrize(
    ("answers", "own_times", "is_stated"), [(0, 0, False), (1, 1, True), (4, 3, False), (4, 4, True)]
)
def test_a_time_is_stated_where_every_answer_of_another_identifier_came_with_its_own(answers, own_times, is_stated):
    made = at_seconds(range(4))
    made.external_counts = ExternalCounts(answers=answers, own_times=own_times)
    assert statistics(made).onboard.time_is_stated is is_stated
    made.subject = Subject.SENSOR
    assert statistics(made).onboard.time_is_stated


def test_before_a_star_simulator_no_earth_turns():
    made = at_seconds(range(40))
    made.station = made.station.model_copy(update={"mount": Mount(inertial=InertialDirection(ra_deg=1.0, de_deg=2.0))})
    rate = statistics(made).onboard.earth_rate
    assert math.isnan(rate.expected_arcsec_per_s)
    assert math.isnan(rate.measured_arcsec_per_s)


@pytest.mark.parametrize(("frames", "kept"), [(200, 200), (201, 101), (401, 134)])
def test_of_more_than_twenty_thousand_star_errors_every_second_or_third_frame_counts(frames, kept):
    """A hundred stars in each frame."""
    xy = np.random.default_rng(1).uniform(0, 1023, (100, 2)).tolist()
    made = session(frames, matches=[(*place, 1.0, -1.0) for place in xy])
    found = _spatial(made, counted_frames(made))
    assert [axis.n for axis in found] == [100 * kept] * 2
    assert [axis.stars for axis in found] == [100] * 2


def test_star_errors_of_frames_that_do_not_count_are_left_out_and_none_are_none():
    xy = np.random.default_rng(1).uniform(0, 1023, (30, 2)).tolist()
    made = session(10, matches=[(*place, 1.0, -1.0) for place in xy])
    made.excluded = (Exclusion(START_NS, START_NS + NS_PER_S // 2, "kicked", Cause.MOUNT),)
    assert _spatial(made, counted_frames(made))[0].n == 5 * 30
    made.excluded = (Exclusion(START_NS, START_NS + 9 * NS_PER_S, "kicked", Cause.MOUNT),)
    assert _spatial(made, counted_frames(made)) is None
    assert _spatial(session(10), counted_frames(session(10))) is None
