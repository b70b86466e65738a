"""Figures, verdict and diagnosis on nights made of numbers whose answer is known."""

import dataclasses
import math
from dataclasses import replace

import numpy as np
import pytest
from skies.known_nights import START_NS, STATION, TRUTH, frame, session, unanswered

from drivers.chunk import LinkEvent
from drivers.clock import ClockReading
from gse.assessment.axis_statistics import axis_statistics
from gse.assessment.clock_health import clock_health, stated_error_s
from gse.assessment.statistics import proportion, statistics
from gse.assessment.verdict import judge
from gse.attitude import Attitude
from gse.config.station import BUILT_IN_TEXT
from gse.errors import UsageError
from gse.instant import NS_PER_S, from_text
from gse.station.attitude_error import compare
from gse.station.event_kinds import ClockStep, StationKind
from gse.station.exclusions import Exclusion, parse_exclusion
from gse.station.results import AnswerCheck, AttitudeError, Verdict
from gse.station.session_data import SessionData
from gse.truth import EarthOrientation
from protocols import AttitudeMessage

# Figures of one axis


def axis(error, step_s=0.1):
    return axis_statistics(np.arange(len(error)) * round(step_s * NS_PER_S), np.asarray(error, dtype=float))


def test_white_noise_is_found_as_the_noise_equivalent_angle_both_ways():
    figures = axis(np.random.default_rng(2).normal(3.0, 5.0, 36_000))
    assert figures.nea_arcsec == pytest.approx(5.0, rel=0.02)
    assert figures.nea_successive_arcsec == pytest.approx(5.0, rel=0.02)
    assert figures.nea_low_arcsec < 5.0 < figures.nea_high_arcsec
    assert abs(figures.bias_arcsec - 3.0) < figures.bias_error_arcsec < 0.2
    assert figures.three_sigma_arcsec == pytest.approx(3 * figures.std_arcsec)
    assert figures.rms_arcsec == pytest.approx(math.hypot(3.0, 5.0), rel=0.02)
    assert figures.p95_abs_arcsec < figures.p99_abs_arcsec < figures.max_abs_arcsec


def test_a_slow_wave_is_low_frequency_error_and_no_noise():
    time_s = np.arange(36_000) * 0.1
    figures = axis(np.random.default_rng(3).normal(0, 2.0, 36_000) + 10 * np.sin(2 * np.pi * time_s / 600))
    assert figures.nea_arcsec == pytest.approx(2.0, rel=0.03)
    assert figures.low_frequency_arcsec == pytest.approx(10 / math.sqrt(2), rel=0.05)
    assert figures.std_arcsec == pytest.approx(math.hypot(2, 10 / math.sqrt(2)), rel=0.03)


def test_a_drift_is_found_among_outliers():
    rng = np.random.default_rng(4)
    error = rng.normal(0, 3.0, 18_000) + 40.0 * np.arange(18_000) * 0.1 / 3600
    error[rng.random(18_000) < 0.01] += 500
    figures = axis(error)
    assert figures.drift_low_arcsec_per_h < 40.0 < figures.drift_high_arcsec_per_h
    assert figures.drift_high_arcsec_per_h - figures.drift_low_arcsec_per_h < 3


def test_gaps_do_not_enter_the_successive_differences():
    utc_ns = np.concatenate([np.arange(500), 10_000 + np.arange(500)]) * 100_000_000
    error = np.random.default_rng(5).normal(0, 1.0, 1000)
    error[500:] += 1000
    assert axis_statistics(utc_ns, error).nea_successive_arcsec == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_very_few_frames_give_no_figure_instead_of_a_wrong_one(count):
    figures = axis([1.0] * count)
    assert figures.n == count
    assert math.isnan(figures.drift_arcsec_per_h)


def test_exact_bounds_are_those_of_clopper_and_pearson():
    assert proportion(0, 100).high == pytest.approx(0.0362, abs=1e-4)  # 1 - 0.025 ** (1 / 100)
    none = statistics(session(300))
    assert none.false_upper_95 == pytest.approx(3 / 300, rel=0.01)


# Comparison


@pytest.mark.parametrize(("ra", "de"), [(0.0, 0.0), (359.99999, 45.0), (123.0, 89.9999), (10.0, -90.0), (200.0, 90.0)])
def test_an_error_is_the_same_everywhere_on_the_sky_also_at_the_poles_and_across_zero(ra, de):
    true = Attitude.from_angles(ra, de, 77.0)
    small = np.radians(np.array([30.0, -20.0, 400.0]) / 3600)
    x, y, z = small
    turn = np.array([[1, -z, y], [z, 1, -x], [-y, x, 1]])
    turn, _ = np.linalg.qr(turn.T)
    turn = turn.T * np.sign(np.diag(turn))[:, None]
    error = compare(Attitude(turn @ true.icrs_to_sensor, np.zeros((3, 3))), true)
    assert math.hypot(error.d_ra_cosde_arcsec, error.d_de_arcsec) == pytest.approx(math.hypot(30, 20), rel=1e-3)
    assert math.hypot(error.cross_x_arcsec, error.cross_y_arcsec) == pytest.approx(math.hypot(30, 20), rel=1e-3)
    assert error.d_roll_arcsec == pytest.approx(400, rel=1e-3)


def test_signs_are_east_north_and_roll_as_defined():
    true = Attitude.from_angles(100.0, -6.5, 20.0)
    error = compare(Attitude.from_angles(100.0 + 10 / 3600, -6.5 + 5 / 3600, 20.0 + 50 / 3600), true)
    assert error.d_ra_cosde_arcsec == pytest.approx(10 * math.cos(math.radians(6.5)), abs=1e-3)
    assert error.d_de_arcsec == pytest.approx(5, abs=1e-3)
    assert error.d_roll_arcsec == pytest.approx(50 - 10 * math.sin(math.radians(-6.5)), abs=0.01)


def test_an_answer_on_the_other_side_of_the_sky_is_180_degrees_off():
    error = compare(Attitude.from_angles(190.0, -30.0, 0.0), Attitude.from_angles(10.0, 30.0, 0.0))
    assert math.hypot(error.d_ra_cosde_arcsec, error.d_de_arcsec) == pytest.approx(180 * 3600)


# Verdict


def test_a_good_night_passes_with_every_measurement():
    assessment = judge(session())
    assert assessment.verdict is Verdict.PASS
    assert assessment.reasons == ()
    assert [item.name for item in assessment.measurements] == [
        "mean |dRA*|",
        "95 % of |dRA*|",
        "mean |dDE|",
        "95 % of |dDE|",
        "availability",
        "false answers",
        "identification time, 99 %",
    ]


def test_a_bias_over_the_limit_fails_by_its_axis_only():
    assessment = judge(session(bias=(0.0, 70.0, 0.0)))
    assert assessment.verdict is Verdict.FAIL
    failed = [item.name for item in assessment.measurements if item.outcome is Verdict.FAIL]
    assert failed == ["mean |dDE|", "95 % of |dDE|"]
    assert any("mean |dDE| is 70" in reason for reason in assessment.reasons)


def test_few_frames_are_inconclusive_with_their_number():
    assessment = judge(session(29))
    assert assessment.verdict is Verdict.INCONCLUSIVE
    assert any(reason.startswith("29 frames were compared") for reason in assessment.reasons)


def test_no_frame_at_all_is_inconclusive():
    empty = SessionData(STATION, BUILT_IN_TEXT, "panorama-v1")
    assert judge(empty).verdict is Verdict.INCONCLUSIVE


def test_an_unsynchronised_clock_is_inconclusive_and_named():
    made = session()
    made.clock.append(ClockReading(START_NS, 0, "unsynchronised", False, 0.0, 16.0))
    assessment = judge(made)
    assert assessment.verdict is Verdict.INCONCLUSIVE
    assert any("dRA*: clock leaves an unknown error" in reason for reason in assessment.reasons)


def test_a_stated_clock_error_takes_the_place_of_an_unsynchronised_clock():
    made = session()
    made.clock = []
    made.clock_error_s = stated_error_s("0.1s")
    assert judge(made).verdict is Verdict.PASS
    made.clock_error_s = stated_error_s("2s")
    assert any("clock leaves 29.9 of" in reason for reason in judge(made).reasons)


def test_frames_that_waited_in_a_buffer_before_the_port_was_read_are_left_out_by_name():
    made = session(0)
    for number in range(600):
        due_ns = START_NS + number * NS_PER_S // 10
        result = frame(due_ns, number, AttitudeError(1.0, 1.0, 1.0, 1.0, 1.0))
        if number < 38:
            read_ns = START_NS + 38 * NS_PER_S // 10
            waited = dataclasses.replace(result.panorama, utc_ns=read_ns, host_utc_ns=read_ns + 10_000_000)
            far_off = AttitudeError(-55.0, 0.0, 0.0, 0.0, 0.0)
            result = dataclasses.replace(result, panorama=waited, attitude_error=far_off)
        made.frames.append(result)
    figures = statistics(made)
    ((stretch, count),) = figures.excluded
    assert stretch.reason.startswith("read up to 3.80 s late: these frames waited")
    assert count == 39  # and the one that was read in time, which has the same stamp
    assert figures.axes["d_ra_cosde"].max_abs_arcsec == 1.0


def test_a_sensor_clock_that_runs_fast_is_no_buffer():
    assert statistics(session(600, sensor_ppm=-1000.0)).excluded == ()


def test_a_stretch_to_leave_out_is_read_with_its_reason():
    stretch = parse_exclusion("2026-03-20T18:30:00Z/2026-03-20T18:31:00Z=clouds")
    assert (stretch.from_ns, stretch.until_ns - stretch.from_ns) == (START_NS, 60 * NS_PER_S)
    assert stretch.reason == "clouds"


@pytest.mark.parametrize("text", ["", "clouds", "2026-03-20T18:30:00Z", "2026-03-20T18:31:00Z/2026-03-20T18:30:00Z"])
def test_a_stretch_without_sense_is_refused(text):
    with pytest.raises(UsageError, match="expected for example 2026"):
        parse_exclusion(text)


@pytest.mark.parametrize(("text", "seconds"), [("0.1s", 0.1), ("20 ms", 0.02), ("50us", 5e-5), ("1s", 1.0)])
def test_clock_errors_are_read_with_their_unit(text, seconds):
    assert stated_error_s(text) == pytest.approx(seconds)


@pytest.mark.parametrize("text", ["", "0.1", "s", "-1s", "nan s", "1e9s", "0.1 min"])
def test_a_clock_error_without_sense_is_refused(text):
    with pytest.raises(UsageError, match=r"expected for example 0\.1s"):
        stated_error_s(text)


def test_an_error_that_truth_cannot_explain_fails_even_on_a_bad_clock():
    made = session(bias=(200.0, 0.0, 0.0))
    made.clock_error_s = 2.0  # 30 arcsec
    assert judge(made).verdict is Verdict.FAIL


def test_ut1_past_the_end_of_the_table_is_inconclusive_by_name_under_a_tight_limit():
    far = from_text("2031-01-01T00:00:00Z")
    tight = STATION.model_copy(update={"limits": replace(STATION.limits, d_ra_cosde_arcsec=36.0)})
    made = session(station=tight)
    made.earth_orientation = EarthOrientation.from_disk(far)
    assessment = judge(made)
    assert assessment.verdict is Verdict.INCONCLUSIVE
    assert any("UT1" in reason for reason in assessment.reasons)


def test_missed_frames_fail_by_availability():
    made = session(100)
    for number in range(100, 110):
        made.frames.append(unanswered(number))
    assessment = judge(made)
    assert assessment.verdict is Verdict.FAIL
    assert assessment.statistics.available.value == pytest.approx(100 / 110)
    assert any("100 of 110" in reason for reason in assessment.reasons)


def test_frames_that_never_arrived_count_as_expected():
    made = session(100)
    made.link.frames_lost = 100
    assert judge(made).statistics.available.value == pytest.approx(0.5)


def test_one_false_answer_fails_and_does_not_enter_the_mean():
    made = session(200)
    made.frames.append(frame(START_NS + 30 * NS_PER_S, 201, AttitudeError(9e4, 9e4, 0, 9e4, 9e4), AnswerCheck.FALSE))
    assessment = judge(made)
    assert assessment.verdict is Verdict.FAIL
    assert assessment.statistics.false_answers.count == 1
    assert assessment.statistics.axes["d_de"].max_abs_arcsec < 100


def test_an_answer_far_from_all_others_is_false_also_where_no_judge_saw_it():
    made = session(200, judged=AnswerCheck.NONE)
    made.frames.append(frame(START_NS + 30 * NS_PER_S, 201, AttitudeError(9e4, 0, 0, 9e4, 0), AnswerCheck.NONE))
    assert judge(made).statistics.false_answers.count == 1


def test_frames_around_a_clock_step_are_left_out_by_name():
    made = session(600)
    made.events.append(
        ClockStep(START_NS + 30 * NS_PER_S, 0, StationKind.CLOCK_STEP, "stepped by +2.000 s", 2 * NS_PER_S)
    )
    ((item, count),) = statistics(made).excluded
    assert "stepped by +2.000 s" in item.reason
    assert count == 120  # 7 s before, 5 s after


def test_what_the_operator_leaves_out_is_not_counted():
    made = session(600)
    made.excluded = (Exclusion(START_NS, START_NS + 10 * NS_PER_S, "clouds"),)
    figures = statistics(made)
    assert figures.available.of == 500
    assert figures.excluded[0][1] == 100


def test_the_earth_turns_at_its_rate():
    figures = statistics(session(10_000))
    rate = figures.earth_rate
    assert abs(rate.measured_arcsec_per_s - 15.041067) < max(2 * rate.error_arcsec_per_s, 1e-3)


def test_the_sensor_clock_drifts_by_so_many_ppm():
    health = statistics(session(5000, sensor_ppm=40.0)).clock
    assert health.sensor_drift_ppm == pytest.approx(40.0, abs=3)


def test_a_reset_of_the_sensor_clock_does_not_spoil_its_drift():
    whole = session(5000, sensor_ppm=40.0).frames.columns.copy()
    whole["time_us"][4000:] -= whole["time_us"][4000]
    assert clock_health([], [], whole).sensor_drift_ppm == pytest.approx(40.0, abs=4)


# Equivalence


def own_answers(made, *, off_arcsec=0.0, state="acquired"):
    rows = made.frames.columns
    return [
        (
            int(row["utc_ns"]),
            AttitudeMessage(
                time_us=int(row["time_us"]),
                ra_deg=round(float(row["ra_deg"]), 6),
                de_deg=round(float(row["de_deg"]) + off_arcsec / 3600, 6),
                roll_deg=(float(row["roll_deg"]) + 360) % 360,
                frame_no=int(row["frame_no"]),
                state=state,
                latency_s=0.08,
            ),
        )
        for row in rows
    ]


def test_a_sensor_that_answers_as_its_rebuilding_is_equivalent():
    made = session(100)
    made.sensor_attitudes = own_answers(made)
    own = statistics(made).equivalence
    assert own.same
    assert (own.answers, own.both, own.only_sensor, own.only_station) == (100, 100, 0, 0)
    assert own.separation_arcsec.max < 0.01
    assert own.latency_ms.p50 == pytest.approx(80)
    assert found(made) == ""


def test_a_sensor_that_answers_otherwise_is_named():
    made = session(100)
    made.sensor_attitudes = own_answers(made, off_arcsec=30.0)[:50] + own_answers(made, state="lost")[50:]
    own = statistics(made).equivalence
    assert not own.same
    assert (own.both, own.only_station) == (50, 50)
    assert own.separation_arcsec.p50 == pytest.approx(30, abs=0.01)
    assert "not the onboard-equivalent ones: of 100, 0 were answered only by the sensor and 50 only here" in found(made)


def test_a_sensor_without_answers_of_its_own_is_not_compared():
    assert statistics(session(10)).equivalence is None


# Diagnosis


def found(made):
    return "\n".join(judge(made).findings)


def test_a_good_night_looks_like_nothing():
    assert found(session(10_000)) == ""


def test_a_mount_error_is_named_with_its_size():
    text = found(session(bias=(30.0, 50.0, 0.0)))
    assert text.startswith("mount: the boresight lies +3")
    assert "+50." in text or "+49." in text


def test_a_turn_about_the_pole_is_named_as_clock_offset():
    de = math.radians(TRUTH.attitude_true(START_NS, STATION.mount).de_deg)
    offset_s = 4.0
    turn = offset_s * 15.041067
    text = found(session(bias=(turn * math.cos(de), 0.0, -turn * math.sin(de))))
    assert "clock offset" in text
    assert "4.0" in text
    assert "slow" in text


def test_a_drifting_clock_is_named_in_ppm():
    per_h = 15.041067 * 3600 * 500e-6
    text = found(session(9000, step_s=0.2, drift_per_h=(per_h * 0.9935, 0.0)))
    assert "clock drift" in text
    ppm = float(text.split("ran ")[1].split(" ppm")[0])
    assert ppm == pytest.approx(500, rel=0.15)


def test_a_moving_mount_is_named():
    assert "the mount moves" in found(session(9000, step_s=0.2, drift_per_h=(0.0, 30.0)))


def radial_matches(scale, cubic):
    camera = STATION.sensor.camera()
    rng = np.random.default_rng(8)
    xy = rng.uniform(0, 1023, (12, 2))
    offset = xy - camera.principal_point_px
    s2 = (offset**2).sum(axis=1) / 512**2
    arcsec = math.degrees(camera.pixel_rad) * 3600
    # The air compresses the field by 0.027 %, aberration changes it by some 0.01 %.
    residual = offset * (scale - 2.2e-4 + cubic * s2)[:, None] * arcsec
    return [(*place, *error) for place, error in zip(xy.tolist(), residual.tolist(), strict=True)]


def test_a_wrong_focal_length_is_named():
    text = found(session(100, matches=radial_matches(np.full(12, 1e-3), 0.0)))
    assert "focal length: it is about 0.1" in text
    assert "too short" in text


def test_distortion_is_named():
    text = found(session(100, matches=radial_matches(np.zeros(12), 4e-3)))
    assert "distortion: stars at the edge lie 2." in text


def test_a_night_without_one_answer_says_where_to_look():
    made = SessionData(STATION, BUILT_IN_TEXT, "panorama-v1")
    for number in range(50):
        made.frames.append(unanswered(number))
    made.events.append(LinkEvent(START_NS, 0, "MIRRORED", "the image is mirrored: once flipped, it fits"))
    text = found(made)
    assert "gse calibrate" in text
    assert "mirrored image: the image is mirrored" in text
