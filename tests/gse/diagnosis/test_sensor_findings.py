"""What is said of a sensor's own answers: zeros, a standstill, a delay, a bias, and where nothing is said."""

import copy
import math
import re
from dataclasses import replace

import numpy as np
import pytest
import scipy.special
from skies.known_nights import START_NS, STATION, session

from gse.diagnosis.sensor_findings import _by_few_other_stars_arcsec, _explained, _scatter, _zeros, sensor_findings
from gse.station.events import Finding
from gse.station.own_answers import SensorAnswers, by_other_stars_arcsec, sensor_answers
from gse.statistics.sensor_convention import ConventionFit, ConventionSearch
from gse.statistics.star_terms import roll_of_a_fix
from gse.truth import Alignment
from gse.values.constants import EARTH_RATE_ARCSEC_PER_S
from gse.values.instant import NS_PER_S
from gse.values.mount import InertialDirection, Mount
from protocols import AttitudeMessage

FRAMES = 400


@pytest.fixture(scope="module")
def night():
    made = session(FRAMES, noise=2.0)
    made.frames.columns["matched"] = 20
    return made


def beside(night, ra=0.0, de=0.0, *, roll=0.0, noise=2.0, count=FRAMES):
    """Answers that lie so far off those that follow here from the same panoramas, in arcsec."""
    frames, rng = night.frames.columns, np.random.default_rng(5)
    off = {name: np.full(FRAMES, np.nan) for name in SensorAnswers.__slots__}
    for name, value in (("d_ra_cosde_arcsec", ra), ("d_de_arcsec", de), ("d_roll_arcsec", roll)):
        off[name][:count] = frames[name][:count] + value + rng.normal(0, noise, count)
    for name in ("ra_deg", "de_deg", "cross_x_arcsec", "cross_y_arcsec"):
        off[name][:count] = frames[name][:count]
    for name in ("de_deg", "cross_y_arcsec"):
        off[name][:count] += rng.normal(0, noise, count) / (3600 if name == "de_deg" else 1)
    return SensorAnswers(**off)


def said(night, *place, **options):
    return [str(finding) for finding in sensor_findings(night, beside(night, *place, **options), None)]


def test_when_an_answer_arrives_is_counted_from_the_middle_of_its_exposure_in_ms():
    """7 ms and half a second, an answer of a file, which came at no time, and none."""
    made = session(4)
    for row, late_ns in zip(made.frames.columns.rows()[:3], (7_000_000, 500_000_000, None), strict=True):
        message = AttitudeMessage(int(row["time_us"]), 10.0, 20.0, 30.0, int(row["frame_no"]), 12, "acquired", 0.08)
        made.sensor_attitudes.append(0 if late_ns is None else int(row["utc_ns"]) + late_ns, message)
    found = sensor_answers(made)
    assert found.arrival_ms == pytest.approx([7.0, 500.0, math.nan, math.nan], nan_ok=True)
    assert found.latency_ms == pytest.approx([80.0, 80.0, 80.0, math.nan], nan_ok=True)
    assert (found.sent.tolist(), found.acquired.tolist()) == ([True] * 3 + [False],) * 2
    assert found.matched.tolist() == [12, 12, 12, 0]
    assert sensor_answers(session(4)) is None


def test_answers_are_compared_from_the_first_frame_after_those_that_the_mount_was_fitted_on():
    aligned = STATION.model_copy(update={"mount": replace(STATION.mount, align="first 1 s")})
    made = session(10, noise=0.0, station=aligned)
    rows = made.frames.columns
    rows["ra_true_deg"][:4] = np.nan
    made.alignment = Alignment(STATION.mount, ((0.0,) * 3,) * 3, (0.0,) * 3, 4, 0, START_NS, START_NS + NS_PER_S)
    for row in rows.rows():
        message = AttitudeMessage(int(row["time_us"]), 10.0, 20.0, 30.0, int(row["frame_no"]), 12, "acquired", 0.08)
        made.sensor_attitudes.append(int(row["utc_ns"]), message)
    assert np.isfinite(sensor_answers(made).d_de_arcsec).tolist() == [False] * 4 + [True] * 6
    rows["ra_true_deg"] = np.nan
    assert not np.isfinite(sensor_answers(made).d_de_arcsec).any()


@pytest.mark.parametrize(("late_frames", "cause"), [(1.0, "sensor delay"), (1.5, "sensor bias")])
def test_a_shift_of_whole_frames_is_a_delay_though_it_lies_a_little_north_too(late_frames, cause):
    """Within what pixels leave of a boresight."""
    made = session(FRAMES, step_s=2.0, noise=0.5)
    made.frames.columns["matched"] = 4
    cos_de = math.cos(math.radians(float(np.median(made.frames.columns["de_true_deg"]))))
    (text,) = said(made, -2.0 * late_frames * EARTH_RATE_ARCSEC_PER_S * cos_de, 8.0, noise=0.5)
    assert cause in text


@pytest.mark.parametrize(("late_s", "cause"), [(299.0, "sensor delay"), (301.0, "sensor bias")])
def test_no_sensor_answers_more_than_five_minutes_late(late_s, cause):
    made = session(FRAMES, step_s=2.0, noise=0.5)
    cos_de = math.cos(math.radians(float(np.median(made.frames.columns["de_true_deg"]))))
    (text,) = said(made, -late_s * EARTH_RATE_ARCSEC_PER_S * cos_de, noise=0.5)
    assert cause in text


def test_answers_that_agree_are_no_finding(night):
    assert said(night) == []
    assert sensor_findings(night, None, None) == ()


@pytest.mark.parametrize(("late_s", "side"), [(3.0, "before"), (-3.0, "after")])
def test_a_shift_along_the_turning_sky_is_a_delay(night, late_s, side):
    cos_de = math.cos(math.radians(float(np.median(night.frames.columns["de_true_deg"]))))
    (text,) = said(night, -late_s * EARTH_RATE_ARCSEC_PER_S * cos_de)
    assert "sensor delay" in text
    stated_s = re.search(rf"as those of ([\d.]+) s {side} the exposure", text)
    assert float(stated_s[1]) == pytest.approx(3.0, abs=0.05)


@pytest.mark.parametrize(
    ("ra", "de", "words"),
    [
        (0.0, 40.0, ["sensor bias", "+40.", "arcsec north"]),
        (100.0, -30.0, ["sensor bias", "arcsec east"]),
        (100.0, 5.0, ["sensor delay"]),
        (20.0, 5400.0, ["sensor bias", "+1.500 deg north"]),
        (20.0, -3000.2, ["sensor bias", "-3000.", "arcsec north"]),
    ],
)
def test_what_lies_across_it_too_is_a_bias(night, ra, de, words):
    (text,) = said(night, ra, de, noise=0.1)
    assert all(word in text for word in words)


def test_a_boresight_that_points_the_other_way_is_a_bias_and_no_noise(night):
    """Half a circle east is half a circle west, and an arc of half a circle goes any way."""
    own, frames = beside(night), night.frames.columns
    side = np.random.default_rng(4).choice([648_000.0, -648_000.0], FRAMES)
    off = {name: getattr(own, name) for name in SensorAnswers.__slots__}
    off |= {
        "ra_deg": (own.ra_deg + 180) % 360,
        "de_deg": -own.de_deg,
        "d_ra_cosde_arcsec": side * np.cos(np.radians(frames["de_true_deg"])),
        "d_de_arcsec": -7200.0 * frames["de_true_deg"].astype(np.float64),
        "cross_x_arcsec": side,
        "cross_y_arcsec": np.zeros(FRAMES),
    }
    causes = [finding.cause for finding in sensor_findings(night, SensorAnswers(**off), None)]
    assert "sensor bias" in causes
    assert "sensor noise" not in causes


@pytest.mark.parametrize(("off", "is_said"), [(11.0, False), (15.0, True)])
def test_four_sigmas_of_whole_pixels_are_let_pass(night, off, is_said):
    """A pixel of 49 arcsec leaves 14.3 in each star, 3.2 in twenty, four times as much is 12.8."""
    assert STATION.sensor.camera().pixel_rad * 206264.8 == pytest.approx(49.5, abs=0.6)
    assert bool(said(night, 0.0, off, noise=0.5)) == is_said


@pytest.mark.parametrize(("off", "is_said"), [(40.0, False), (400.0, True)])
def test_five_sigmas_of_their_own_scatter_are_let_pass(night, off, is_said):
    """Medians of twenty blocks of twenty answers that scatter by 400 arcsec are known to 25 on each axis."""
    assert any("sensor bias" in text for text in said(night, 0.0, off, noise=400.0)) == is_said


def test_a_frame_that_is_late_is_a_delay_though_it_lies_across_too(night):
    """12.1 arcsec is what the sky turns by in ten frames of 0.1 s here: within the pixels' error, a bias of DE too."""
    cos_de = math.cos(math.radians(float(np.median(night.frames.columns["de_true_deg"]))))
    (text,) = said(night, -EARTH_RATE_ARCSEC_PER_S * cos_de, 6.0, noise=0.1)
    assert "sensor delay" in text
    (text,) = said(night, 0.4 * EARTH_RATE_ARCSEC_PER_S, 14.0, noise=0.1)
    assert "sensor bias" in text


@pytest.mark.parametrize(("roll", "is_said"), [(100.0, False), (648_000.0, True), (-900.0, True)])
def test_a_turn_about_the_boresight_is_named(night, roll, is_said):
    assert [text.split(":")[0] for text in said(night, roll=roll)] == ["sensor roll"] * is_said


@pytest.mark.parametrize("cause", ["distortion", "refraction", "clock offset"])
def test_a_camera_or_air_that_is_wrong_puts_off_the_answers_here(night, cause):
    named = (Finding(cause, "as it is"),)
    found = sensor_findings(night, beside(night, 20.0, 3000.0, roll=4000.0), None, named=named)
    assert len(found) == (2 if cause == "clock offset" else 0)


def test_the_turn_of_the_sky_within_a_delay_is_no_error_of_its_own(night):
    """At a declination of 60 deg a minute turns the sky about the boresight by 781 arcsec."""
    made = copy.deepcopy(night)
    made.frames.columns["de_true_deg"] = 60.0
    sky_arcsec = -60 * EARTH_RATE_ARCSEC_PER_S
    along, about = sky_arcsec * math.cos(math.radians(60)), sky_arcsec * math.sin(math.radians(60))
    (text,) = said(made, along, roll=about)
    assert "sensor delay" in text
    assert len(said(made, along, roll=2 * about)) == 2


def test_answers_that_scatter_by_more_than_those_here_are_named(night):
    assert said(night, noise=5.0) == []
    (text,) = said(night, noise=40.0)
    assert "sensor noise" in text


@pytest.mark.parametrize(("count", "is_said"), [(39, False), (40, True)])
def test_forty_answers_are_needed(night, count, is_said):
    assert bool(said(night, 0.0, 200.0, count=count)) == is_said


def answering(times_s, places_deg, *, state="acquired", mount=None):
    station = STATION if mount is None else STATION.model_copy(update={"mount": mount})
    made = session(0, station=station)
    for at_s, ra_deg in zip(times_s, places_deg, strict=True):
        time_us = round(at_s * 1e6)
        de_deg, roll_deg = (0.0, 0.0) if ra_deg == 0 else (-10.0, 30.0)
        message = AttitudeMessage(time_us, ra_deg=ra_deg, de_deg=de_deg, roll_deg=roll_deg, state=state)
        made.sensor_attitudes.append(START_NS + round(at_s * NS_PER_S), message)
    return [str(finding) for finding in sensor_findings(made, None, None)]


@pytest.mark.parametrize(
    ("alike", "step_s", "is_said"), [(5, 0.5, True), (4, 1.0, False), (5, 0.4, False), (8, 0.3, True)]
)
@pytest.mark.parametrize("begin", [0, 7, 12])
def test_five_equal_answers_over_two_seconds_are_a_standstill(alike, step_s, is_said, begin):
    places = [100.0 + 0.01 * k for k in range(20)]
    places[begin : begin + alike] = [places[begin]] * alike
    found = answering(step_s * np.arange(20), places)
    seconds = (alike - 1) * step_s
    words = f"{alike} of 20 repeat the one before to the last digit, for up to {seconds:.1f} s"
    assert bool(found) == is_said
    assert all(words in text and f"turned by {15.041 * seconds:.0f} arcsec" in text for text in found)


def test_the_longest_of_two_standstills_is_told_and_all_their_answers_counted():
    places = [1.0] * 5 + [2.0, 3.0] + [4.0] * 9
    (text,) = answering(np.arange(16.0), places)
    assert "14 of 16 repeat" in text
    assert "up to 8.0 s" in text


def test_before_a_star_simulator_answers_may_stand_still():
    shown = Mount(inertial=InertialDirection(ra_deg=10.0, de_deg=20.0, roll_deg=0.0))
    assert answering(np.arange(10.0), [5.0] * 10) != []
    assert answering(np.arange(10.0), [5.0] * 10, mount=shown) == []


@pytest.mark.parametrize(("alike", "is_bias_said"), [(FRAMES, False), (60, True)])
def test_answers_most_of_which_stand_still_have_no_bias_and_no_noise_beside(night, alike, is_bias_said):
    made = copy.copy(night)
    made.sensor_attitudes = type(night.sensor_attitudes)()
    for number, row in enumerate(night.frames.columns.rows()):
        ra_deg = 10.0 if number < alike else 10.0 + 0.01 * number
        message = AttitudeMessage(int(row["time_us"]), ra_deg, 20.0, 30.0, int(row["frame_no"]), 12, "acquired", 0.08)
        made.sensor_attitudes.append(int(row["utc_ns"]), message)
    texts = said(made, 4000.0, 4000.0, roll=9000.0)
    assert "sensor answers stand still" in texts[0]
    assert any("sensor bias" in text for text in texts) == is_bias_said
    assert is_bias_said or len(texts) == 1


def test_zeros_that_are_called_good_are_counted():
    places = [0.0 if k % 4 == 0 else 100.0 + k for k in range(12)]
    (text,) = answering(np.arange(12.0), places)
    assert "3 of 12 say RA 0, DE 0 and roll 0" in text
    assert answering(np.arange(12.0), places, state="lost") == []


def test_scatter_from_frame_to_frame_is_the_standard_deviation_of_noise_whatever_a_few_false_answers_do():
    """Steps of noise of 7 arcsec are a normal distribution of 7 times the root of 2; here its quantiles, mixed."""
    frames, random = session(1001).frames.columns, np.random.default_rng(8)
    steps = 7 * math.sqrt(2) * random.permutation(scipy.special.ndtri((np.arange(1000) + 0.5) / 1000))
    values, rows = np.r_[0.0, np.cumsum(steps)], np.arange(1001)
    assert _scatter(frames, rows, values) == pytest.approx(7.0, rel=1e-3)
    mixed = random.permutation(1001)
    assert _scatter(frames, mixed, values[mixed]) == _scatter(frames, rows, values)
    values[::100] = 1e5
    assert _scatter(frames, rows, values) == pytest.approx(7.0, rel=0.05)


def turning(*, quaternions=(), times_s=None):
    """Findings of answers as quaternions."""
    made = session(0)
    for number, of_one in enumerate(quaternions):
        at_s = number if times_s is None else times_s[number]
        q1, q2, q3, q4 = of_one
        message = AttitudeMessage(round(at_s * 1e6), state="acquired", q1=q1, q2=q2, q3=q3, q4=q4)
        made.sensor_attitudes.append(START_NS + round(at_s * NS_PER_S), message)
    return [str(finding) for finding in sensor_findings(made, None, None)]


@pytest.mark.parametrize("place", range(4))
def test_a_quaternion_stands_still_where_each_of_its_numbers_does(place):
    places = np.tile([0.1, 0.2, 0.3, 0.9], (6, 1))
    (text,) = turning(quaternions=places)
    assert "6 of 6 repeat the one before to the last digit, for up to 5.0 s" in text
    places[:, place] += 1e-9 * np.arange(6)
    assert turning(quaternions=places) == []


@pytest.mark.parametrize(("third", "count"), [(0.0, 6), (1e-3, 0)])
def test_a_quaternion_that_turns_nothing_is_an_answer_of_zeros(third, count):
    places = np.column_stack([np.zeros(6), np.zeros(6), np.full(6, third), 1 - 1e-3 * np.arange(6)])
    found = turning(quaternions=places)
    assert [text.split(":")[0] for text in found] == ["sensor answers of zeros"] * (count > 0)
    assert all(f"{count} of 6 say RA 0, DE 0 and roll 0" in text for text in found)


@pytest.mark.parametrize("name", ["ra_deg", "de_deg", "roll_deg"])
def test_one_angle_that_is_not_zero_is_no_answer_of_zeros(name):
    made = session(0)
    angles = {"ra_deg": 0.0, "de_deg": 0.0, "roll_deg": 0.0} | {name: 1e-3}
    made.sensor_attitudes.append(START_NS, AttitudeMessage(0, state="acquired", **angles))
    assert list(_zeros(made)) == []
    made.sensor_attitudes.append(START_NS, AttitudeMessage(0, state="acquired", ra_deg=0.0, de_deg=0.0))
    assert [finding.size.split(",")[0] for finding in _zeros(made)] == ["1 of 2 say RA 0"]
    made.sensor_attitudes.append(START_NS, AttitudeMessage(0, state="lost"))
    assert [finding.size.split(",")[0] for finding in _zeros(made)] == ["1 of 3 say RA 0"]


def test_answers_stand_still_from_five_on_and_a_pause_between_ends_nothing():
    assert answering(np.arange(5.0), [5.0] * 5) != []
    assert answering(np.arange(4.0), [5.0] * 4) == []


@pytest.mark.parametrize(("alike", "is_bias_said"), [(200, True), (201, False)])
def test_half_of_the_answers_may_stand_still_beside_a_bias(night, alike, is_bias_said):
    made = copy.copy(night)
    made.sensor_attitudes = type(night.sensor_attitudes)()
    for number, row in enumerate(night.frames.columns.rows()):
        ra_deg = 10.0 if number < alike else 10.0 + 0.01 * number
        message = AttitudeMessage(int(row["time_us"]), ra_deg, 20.0, 30.0, int(row["frame_no"]), 12, "acquired", 0.08)
        made.sensor_attitudes.append(int(row["utc_ns"]), message)
    assert any("sensor bias" in text for text in said(made, 4000.0, 4000.0)) == is_bias_said


@pytest.mark.parametrize(
    ("of_sensor", "of_station", "share"),
    [
        (20, 20, math.sqrt(20 * 2 / 400)),
        (17, 20, math.sqrt(17 * (1 / 17 - 1 / 20))),
        (24, 20, math.sqrt(24 * (1 / 20 - 1 / 24))),
        (16, 20, math.sqrt(16 * (1 / 16 - 1 / 20))),
        (25, 20, math.inf),
        (15, 20, math.inf),
        (1, 1, math.sqrt(2)),
        (0, 20, math.inf),
        (20, 0, math.inf),
    ],
)
def test_few_other_stars_part_two_fixes_by_the_root_of_the_stars_that_are_not_common(
    night, of_sensor, of_station, share
):
    """The mean over n of N stars has the variance 1/n - 1/N of one; one star exchanged 2/N^2 of it.

    Answers that name no star do not count, though they are most.
    """
    made = copy.deepcopy(night)
    made.frames.columns["matched"] = np.where(np.arange(FRAMES) % 3, 0, of_station)
    own = beside(made)
    matched = np.where(np.arange(FRAMES) % 3 == 1, of_sensor, 0).astype(np.uint16)
    own = replace(own, matched=matched)
    found = _by_few_other_stars_arcsec(made, own)
    assert found == (math.inf if share == math.inf else pytest.approx(share * by_other_stars_arcsec(made)))


@pytest.mark.parametrize("shift_arcsec", [0.0, 0.5, 1000.0])
def test_four_sigmas_of_other_stars_or_the_shift_that_is_named_are_explained(night, shift_arcsec):
    own = replace(beside(night), matched=np.full(FRAMES, 20, dtype=np.uint16))
    by_stars, few = by_other_stars_arcsec(night), _by_few_other_stars_arcsec(night, own)
    found = _explained(night, own, shift_arcsec)
    assert found.shift_arcsec == pytest.approx(max(shift_arcsec, 4 * by_stars))
    assert found.same_stars_arcsec == (pytest.approx(4 * few) if shift_arcsec == 0 else math.inf)
    assert found.scatter_arcsec == by_stars
    width_rad = math.sqrt(STATION.sensor.camera().solid_angle_sr)
    assert found.roll_arcsec == pytest.approx(roll_of_a_fix(found.shift_arcsec, width_rad))
    assert 0 < 4 * by_stars < 1000


def searched(aberration="not told", *, stated=STATION.sensor.attitude, aberration_arcsec=15.0):
    """A search that finds the stated convention, or another one."""
    fit = ConventionFit(stated, 3.0, 1.0)
    return ConventionSearch(100, 60.0, (fit,), fit, aberration, aberration_arcsec, False, True)


def causes(night, search, de, *named):
    own = beside(night, 0.0, de, noise=0.5)
    return [finding.cause for finding in sensor_findings(night, own, search, named=named)]


@pytest.mark.parametrize(("de", "is_bias"), [(22.0, False), (40.0, True)])
def test_an_aberration_that_is_named_explains_one_and_a_half_times_its_size(night, de, is_bias):
    """Of 15 arcsec 22.5."""
    found = causes(night, searched("corrected"), de)
    assert found == ["sensor aberration", *["sensor bias"] * is_bias]


def test_an_aberration_that_is_as_stated_explains_nothing(night):
    assert causes(night, searched("not corrected"), 21.0) == ["sensor bias"]
    assert causes(night, searched(), 21.0) == ["sensor bias"]


def test_under_another_convention_errors_tell_nothing_and_a_wrong_camera_hides_aberration_alone(night):
    other = searched(stated=replace(STATION.sensor.attitude, ra_unit="h"))
    camera = Finding("focal length", "as it is")
    assert causes(night, other, 4000.0) == ["sensor convention"]
    assert causes(night, other, 4000.0, camera) == ["sensor convention"]
    assert causes(night, searched("corrected"), 4000.0, camera) == []
