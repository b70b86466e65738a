"""Diagnosis on sessions made of numbers whose errors are known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from skies.known_nights import START_NS, STATION, TRUTH, session, unanswered
from skies.one_by_one import add_frame
from skies.own_answers import with_answers, without_error

from drivers.chunk import LinkEvent
from gse.config.station import BUILT_IN_TEXT
from gse.diagnosis.diagnosis import _facts, causes_so_far, findings, session_model
from gse.diagnosis.field_patterns import PARAMETERS
from gse.diagnosis.misplaced_stars import most_unmatched, stars_fall_out
from gse.diagnosis.plain_findings import faulty_panoramas
from gse.station.columns import ANSWER_CHECKS, FRAME, STATUSES
from gse.station.events import ClockStep, StationKind
from gse.station.results import AnswerCheck, Status, Subject
from gse.station.session_data import SessionData
from gse.statistics.counted_frames import counted_frames
from gse.statistics.session_statistics import statistics
from gse.truth import Alignment
from gse.values.instant import NS_PER_S
from gse.values.mount import InertialDirection, Mount
from gse.verdict.assessment import judge


def found(made):
    return "\n".join(map(str, judge(made).findings))


def test_a_good_night_looks_like_nothing():
    assert found(session(10_000)) == ""


def test_a_mount_error_is_named_with_its_size():
    text = found(session(bias=(30.0, 50.0, 0.0)))
    assert text.startswith("mount: it is off by +30.")
    assert "arcsec in azimuth (on the sky), +50." in text or ", +49." in text


def test_a_turn_about_the_pole_is_named_as_clock_offset():
    de = math.radians(TRUTH.attitude_true(START_NS, STATION.mount).de_deg)
    offset_s = 4.0
    turn = offset_s * 15.041067
    text = found(session(bias=(turn * math.cos(de), 0.0, -turn * math.sin(de))))
    assert "clock offset" in text
    assert "4.0" in text
    assert "slow" in text


def test_where_the_time_tag_stands_still_no_cause_is_told_from_instants_that_nobody_knows():
    de = math.radians(TRUTH.attitude_true(START_NS, STATION.mount).de_deg)
    turned = session(bias=(60 * math.cos(de), 0.0, -60 * math.sin(de)))
    assert found(turned).startswith("clock offset")
    rows = turned.frames.columns
    rows["host_utc_ns"] = rows["utc_ns"]
    rows["time_us"] = (rows["utc_ns"] - START_NS) // 1000
    few, often = len(rows) // 20, len(rows) // 5
    rows["time_us"][:few] = 0
    assert found(turned).startswith("clock offset")
    rows["time_us"][:often] = 0
    assert {finding.cause for finding in judge(turned).findings} == {"sensor time tag"}
    assert [finding.cause for finding in causes_so_far(turned)] == []


def test_a_drifting_clock_is_named_in_ppm():
    per_h = 15.041067 * 3600 * 500e-6
    text = found(session(9000, step_s=0.2, drift_per_h=(per_h * 0.9935, 0.0), sensor_ppm=-500.0))
    assert "clock drift" in text
    ppm = float(text.split("runs ")[1].split(" ppm")[0])
    assert ppm == pytest.approx(500, rel=0.15)


def test_what_turns_about_the_pole_beside_two_clocks_that_agree_is_the_mount():
    per_h = 15.041067 * 3600 * 500e-6
    text = found(session(3000, step_s=0.6, drift_per_h=(per_h * 0.9935, 0.0)))
    assert text.startswith("mount moves: by -27.")


@pytest.mark.parametrize(("ppm", "words"), [(120.0, "ppm slow against"), (-120.0, "ppm fast against")])
def test_a_sensor_clock_that_runs_slow_is_told_from_a_fast_one(ppm, words):
    made = session(1500, sensor_ppm=ppm)
    (finding,) = (line for line in found(made).splitlines() if line.startswith("sensor clock drift"))
    assert words in finding
    assert float(finding.split("runs ")[1].split(" ppm")[0]) == pytest.approx(120, abs=5)


@pytest.mark.parametrize("ppm", [60.0, -60.0])
def test_a_sensor_clock_of_an_ordinary_crystal_is_no_finding(ppm):
    assert "sensor clock drift" not in found(session(1000, sensor_ppm=ppm))


def test_a_moving_mount_is_named():
    assert "mount moves: by +30." in found(session(9000, step_s=0.2, drift_per_h=(0.0, 30.0)))


def radial_matches(scale, cubic):
    camera = STATION.sensor.camera()
    rng = np.random.default_rng(8)
    xy = rng.uniform(0, 1023, (12, 2))
    offset = xy - camera.principal_point_px
    s2 = (offset**2).sum(axis=1) / 512**2
    arcsec = math.degrees(camera.pixel_rad) * 3600
    residual = offset * (scale + cubic * s2)[:, None] * arcsec
    return [(*place, *error) for place, error in zip(xy.tolist(), residual.tolist(), strict=True)]


def test_a_wrong_focal_length_is_named():
    text = found(session(40, matches=radial_matches(np.full(12, 1e-3), 0.0)))
    assert text.startswith("focal length: it is 0.10")
    assert "too short" in text


def test_distortion_is_named():
    text = found(session(40, matches=radial_matches(np.zeros(12), 4e-3)))
    assert text.startswith("distortion: stars at the edge lie 2.")


@pytest.mark.parametrize(("absent", "cause"), [(26, "identifier without an answer"), (25, "nothing identified")])
def test_where_the_reference_finds_stars_in_most_panoramas_it_is_the_identifier(absent, cause):
    made = SessionData(STATION, BUILT_IN_TEXT, "panorama-v1")
    for number in range(50):
        add_frame(made.frames, unanswered(number))
    frames = made.frames.columns
    frames["answer_check"] = ANSWER_CHECKS.index(AnswerCheck.UNKNOWN)
    frames["answer_check"][:absent] = ANSWER_CHECKS.index(AnswerCheck.ABSENT)
    (finding,) = causes_so_far(made)
    assert finding.cause == cause
    frames["status"][7] = STATUSES.index(Status.IDENTIFIED)
    frames["answer_check"][7] = ANSWER_CHECKS.index(AnswerCheck.CORRECT)
    assert causes_so_far(made) == ()  # no more than half are left to the reference


def test_an_identifier_that_answers_few_panoramas_is_named_too():
    made = SessionData(STATION, BUILT_IN_TEXT, "panorama-v1")
    for number in range(50):
        add_frame(made.frames, unanswered(number))
    made.frames.columns["status"][::10] = STATUSES.index(Status.IDENTIFIED)
    made.frames.columns["answer_check"][::10] = ANSWER_CHECKS.index(AnswerCheck.CORRECT)
    (finding,) = causes_so_far(made)
    assert "answers 5 of 50 panoramas" in finding.size


def test_a_program_that_failed_on_most_panoramas_says_nothing_of_the_stars():
    made = SessionData(STATION, BUILT_IN_TEXT, "panorama-v1")
    for number in range(50):
        add_frame(made.frames, unanswered(number))
    made.frames.columns["status"][:26] = STATUSES.index(Status.IDENTIFIER_FAULT)
    (finding,) = causes_so_far(made)
    assert finding.cause == "identifier fails"
    assert "failed on 26 of 50 panoramas" in finding.size
    made.frames.columns["status"][25] = STATUSES.index(Status.NO_MATCH)
    assert causes_so_far(made)[0].cause != "identifier fails"


@pytest.mark.parametrize(("expected", "words"), [(4.0, "which its catalogue holds 4"), (-1.0, ""), (12.0, "")])
def test_a_short_catalogue_is_told_where_it_is_known_to_be_short(expected, words):
    made = SessionData(STATION, BUILT_IN_TEXT, "panorama-v1")
    for number in range(50):
        add_frame(made.frames, unanswered(number))
    made.frames.columns["stars_seen"], made.frames.columns["stars_expected"] = 12, expected
    (finding,) = causes_so_far(made)
    assert "12 stars of the sky are in each" in finding.size
    assert ("its catalogue holds" in finding.size) == bool(words)
    assert words in finding.size


def test_a_night_without_one_answer_says_where_to_look():
    made = SessionData(STATION, BUILT_IN_TEXT, "panorama-v1")
    for number in range(50):
        add_frame(made.frames, unanswered(number))
    made.events.append(LinkEvent(START_NS, 0, "MIRRORED", "the image is mirrored: once flipped, it fits"))
    text = found(made)
    assert "gse calibrate" in text
    assert "mirrored image: the image is mirrored" in text
    assert "nothing identified" not in text  # that is one effect of one cause


@pytest.mark.parametrize(("unmatched", "fall_out"), [(3, False), (7, True)])
def test_a_camera_that_leaves_a_third_of_the_stars_unmatched_lets_them_fall_out(unmatched, fall_out):
    frames, used = np.zeros(9, dtype=FRAME), np.arange(9) < 4
    frames["matched"], frames["false_objects"] = 11, np.where(used, unmatched, 10 - unmatched)
    assert stars_fall_out(frames, used) is fall_out


def silent(count=50):
    made = SessionData(STATION, BUILT_IN_TEXT, "panorama-v1")
    for number in range(count):
        add_frame(made.frames, unanswered(number))
    return made


def clock_steps(*sizes_ns):
    return [ClockStep(START_NS, 0, StationKind.CLOCK_STEP, "the clock stepped", size_ns) for size_ns in sizes_ns]


@pytest.mark.parametrize(
    ("steps_ns", "drift_s"),
    [
        ([10**8] * 40, "+4.000 s"),
        ([-(10**8)] * 40, "-4.000 s"),
        ([10**8] * 35, None),  # ten and half of the frames
        ([10**8] * 39 + [-(10**8)], None),
    ],
    ids=["ahead", "behind", "in too few frames", "to and fro"],
)
def test_a_clock_that_steps_one_way_in_most_frames_runs_away(steps_ns, drift_s):
    made = silent()
    made.events = clock_steps(*steps_ns)
    (first, *_) = causes_so_far(made)
    assert first.cause == ("clock drift" if drift_s else "clock step")
    assert drift_s is None or drift_s in first.size


def test_a_host_that_was_suspended_is_told_as_that_and_as_no_step_of_its_clock():
    made = silent()
    made.events = [replace(step, utc_kept=True) for step in clock_steps(60 * NS_PER_S)]
    causes = [finding.cause for finding in causes_so_far(made)]
    assert "monotonic clock" in causes
    assert "clock step" not in causes
    made.events += clock_steps(NS_PER_S)
    assert {"monotonic clock", "clock step"} <= {finding.cause for finding in causes_so_far(made)}


def test_a_gross_mistake_is_named_alone():
    made = session(30)
    made.station = STATION.model_copy(update={"mount": replace(STATION.mount, roll_deg=STATION.mount.roll_deg + 90)})
    (finding,) = causes_so_far(made)
    assert "off by 90 deg" in finding.cause
    assert finding.is_gross


def test_stars_that_all_stand_on_the_boresight_tell_no_cause_and_end_no_session():
    """No attitude follows from them: their normal equations have no inverse."""
    assert causes_so_far(session(60, matches=((511.5, 511.5, 3.0, -2.0),) * 12)) == ()


def test_a_session_without_frames_has_no_findings():
    assert found(SessionData(STATION, BUILT_IN_TEXT, "panorama-v1")) == ""


@pytest.mark.parametrize("left_out", [False, True])
def test_stars_are_out_of_place_in_the_frames_that_count(left_out):
    made, unlike = session(200), np.arange(200) < 120
    counted = replace(counted_frames(made), excluded=unlike & left_out, false=np.ones(200, dtype=bool))
    frames = made.frames.columns
    frames["matched"], frames["false_objects"] = np.where(unlike, 5, 16), np.where(unlike, 12, 1)
    frames["stars_expected"] = 17
    assert bool(list(most_unmatched(made, counted))) is not left_out


def test_a_time_tag_that_leaps_is_a_finding_of_the_sensor_with_its_size():
    made = session(600)
    made.frames.columns["time_us"][300:] += 5_000_000
    (found,) = [finding for finding in judge(made).findings if finding.cause == "sensor time tag"]
    assert found.size.startswith("it leapt by +5.0")
    assert found.next_step == "ask the maker; gse decode SESSION --explain"
    assert all(finding.cause != "sensor time tag" for finding in judge(session(600)).findings)


@pytest.mark.parametrize(
    ("kinds", "is_named"),
    [
        ((), True),
        ((StationKind.DARK_NIGHT,), True),
        ((StationKind.DAYLIGHT,), False),
        ((StationKind.DAYLIGHT, StationKind.DARK_NIGHT), True),
        ((StationKind.DARK_NIGHT, StationKind.MIRRORED), False),
        ((StationKind.DARK_NIGHT, StationKind.WRONG_CAMERA), False),
    ],
)
def test_a_night_without_an_answer_is_a_finding_where_neither_day_nor_camera_explain_it(kinds, is_named):
    made = silent()
    made.frames.columns["status"] = STATUSES.index(Status.NO_MATCH)
    made.frames.columns["answer_check"] = ANSWER_CHECKS.index(AnswerCheck.UNKNOWN)
    made.events = [LinkEvent(START_NS, 0, kind, "so it is") for kind in kinds]
    named = {finding.cause for finding in causes_so_far(made)}
    assert ("nothing identified" in named) is is_named


@pytest.mark.parametrize(("faulty", "is_most"), [(25, False), (26, True)])
def test_panoramas_that_cannot_be_are_told_otherwise_where_they_are_most(faulty, is_most):
    made = silent()
    made.frames.columns["status"][:faulty] = STATUSES.index(Status.SENSOR_FAULT)
    found = {finding.cause: finding.size for finding in faulty_panoramas(made, counted_frames(made))}
    assert found["faulty panoramas"].startswith("26 of 50 panoramas cannot be") is is_most


@pytest.mark.parametrize(("unmatched", "is_camera"), [(11, False), (12, False), (13, True)])
def test_a_camera_is_to_blame_where_more_objects_are_no_stars_than_are(unmatched, is_camera):
    made = session(60)
    frames = made.frames.columns
    frames["matched"], frames["false_objects"], frames["stars_expected"] = 12, unmatched, 30
    counted = replace(counted_frames(made), false=np.ones(60, dtype=bool))
    sizes = [finding.size for finding in most_unmatched(made, counted)]
    assert bool(sizes) is is_camera
    assert all("13 objects as bright as stars of the catalogue are none of them, 12 are" in size for size in sizes)


@pytest.mark.parametrize(
    ("altitude_deg", "inertial", "cause"),
    [
        (90.0, None, "camera"),
        (20.5, None, "camera"),
        (15.0, None, "field near the horizon"),
        (90.0, InertialDirection(ra_deg=83.0, de_deg=-2.0), "camera"),
    ],
)
def test_stars_are_out_of_place_by_air_where_the_field_reaches_down_to_ten_degrees(altitude_deg, inertial, cause):
    """Half of its diagonal is 10.0 deg: at an altitude of 20.5 it ends above, at 15 below."""
    made = session(60)
    mount = Mount(altitude_deg=altitude_deg, inertial=inertial)
    made.station = STATION.model_copy(update={"mount": mount})
    frames = made.frames.columns
    frames["matched"], frames["false_objects"], frames["stars_expected"] = 12, 13, 30
    counted = replace(counted_frames(made), answered=np.ones(60, dtype=bool), false=np.ones(60, dtype=bool))
    (finding,) = most_unmatched(made, counted)
    assert finding.cause == cause


# What the parts of a diagnosis say to each other


def facts(made, *named, false=False, ppm=0.0):
    """The causes that facts tell beside named ones, of answers that are all false or none."""
    counted = counted_frames(made)
    if false:
        counted = replace(counted, false=np.ones(len(made.frames.columns), dtype=bool))
    stats = statistics(session(2))
    stats = replace(
        stats, counted=counted, clock=replace(stats.clock, sensor_drift_ppm=ppm, sensor_drift_error_ppm=0.0)
    )
    return [finding.cause for finding in _facts(made, stats, set(named))]


def defocused():
    """Ten stars in twenty frames that scatter ever more, as bright as before."""
    made = session(20, step_s=1.0, matches=[(100.0 + 80 * k, 900.0 - 70 * k, 0.0, 0.0) for k in range(10)])
    matches = made.frames.matches
    for name in ("residual_x_arcsec", "residual_y_arcsec"):
        matches[name] = 10.0 * 1.1 ** matches["frame"] * (-1.0) ** (matches["frame"] + matches["star"])
    made.frames.columns["transparency"] = 1.0
    return made


def unmatched(count=13):
    """Twenty frames of twelve stars and objects that are none, where thirty stars ought to be."""
    made = session(20)
    frames = made.frames.columns
    frames["matched"], frames["false_objects"], frames["stars_expected"] = 12, count, 30
    return made


@pytest.mark.parametrize(
    ("named", "causes"),
    [((), ["defocus"]), (("mount",), ["defocus"]), (("distortion",), []), (("mount", "focal length"), [])],
)
def test_stars_that_scatter_more_are_out_of_focus_unless_a_camera_is_named(named, causes):
    assert facts(defocused(), *named) == causes


@pytest.mark.parametrize(("named", "causes"), [((), ["camera"]), (("mount",), []), (("distortion",), [])])
def test_objects_that_are_no_stars_are_told_where_nothing_is_named(named, causes):
    assert facts(unmatched(), *named, false=True) == causes


def test_out_of_focus_stars_are_told_before_a_camera():
    made = defocused()
    frames = made.frames.columns
    frames["matched"], frames["false_objects"], frames["stars_expected"] = 12, 13, 30
    assert facts(made) == ["defocus"]


@pytest.mark.parametrize(
    ("ppm", "named", "causes"),
    [(150.0, (), ["sensor clock drift"]), (150.0, ("clock drift",), []), (150.0, ("mount",), ["sensor clock drift"]),
     (50.0, (), [])],
)  # fmt: skip
def test_a_clock_of_the_sensor_drifts_unless_the_hosts_does(ppm, named, causes):
    assert facts(session(20), *named, ppm=ppm) == causes


@pytest.mark.parametrize(
    ("count", "named", "is_told"),
    [(13, (), True), (13, ("mount",), True), (13, ("distortion",), False), (3, ("distortion",), True)],
)
def test_objects_that_stand_still_are_hot_pixels_unless_stars_fall_out_by_a_named_camera(count, named, is_told):
    made = unmatched(count)
    made.frames.columns["hot_pixels"] = 5
    assert ("hot pixels" in facts(made, *named)) is is_told


def test_beside_a_camera_of_which_stars_fall_out_all_others_are_guesses():
    """Of a lens that is off in two ways, on a mount that shakes, the greater one is told then."""
    made = session(40, matches=radial_matches(np.zeros(12), 4e-3), bias=(300.0, 500.0, 0.0))
    made.frames.columns["matched"], made.frames.columns["false_objects"] = 12, 0
    all_of_them = [finding.cause for finding in causes_so_far(made)]
    of_camera = [cause for cause in all_of_them if cause in ("distortion", "principal point")]
    assert len(of_camera) == 2
    assert "vibration" in all_of_them
    made.frames.columns["false_objects"] = 11
    assert [finding.cause for finding in causes_so_far(made)] == of_camera[:1]


def test_the_sensors_own_answers_are_compared_unless_the_set_up_is_wrong_or_they_are_what_is_tested():
    made = session(60, noise=0.5)
    made.frames.columns["matched"] = 20
    assert causes_so_far(made) == ()
    angles = without_error(made, whole_field=True)
    angles[:, 1] += 0.5
    made = with_answers(made, angles, np.full(60, 20))
    assert "sensor bias" in {finding.cause for finding in causes_so_far(made)}
    made.subject = Subject.SENSOR
    assert causes_so_far(made) == ()
    made.subject = Subject.ONBOARD
    turned = replace(STATION.mount, roll_deg=STATION.mount.roll_deg + 90)
    made.station = STATION.model_copy(update={"mount": turned})
    (gross,) = causes_so_far(made)
    assert gross.is_gross


# What fine causes are worded with


def test_a_model_has_the_first_instant_the_usual_exposure_and_the_rate_of_the_frames_that_count():
    made = session(60, step_s=0.5)
    frames = made.frames.columns
    frames["exposure_s"] = np.where(np.arange(60) < 31, 0.2, 0.4)
    frames["exposure_s"][:5] = math.nan
    frames["d_roll_arcsec"][0] = math.nan
    frames["utc_ns"][40:] += 7 * NS_PER_S  # one gap
    found = session_model(made, counted_frames(made))
    assert found.setting.first_ns == START_NS + NS_PER_S // 2
    assert found.setting.exposure_s == pytest.approx(0.4)
    assert found.setting.frame_hz == pytest.approx(2.0)
    assert found.setting.late is not None
    assert (found.setting.site, found.setting.mount) == (STATION.site, STATION.mount)
    assert found.setting.camera == STATION.sensor.camera()
    assert len(found.series.rows) == 59
    assert found.model.field is None
    assert not found.model.is_fitted


def test_a_fitted_mount_is_that_of_the_model_and_tells_no_constant_error():
    made = session(60)
    fitted = replace(STATION.mount, roll_deg=33.0)
    made.alignment = Alignment(fitted, ((0.0,) * 3,) * 3, (0.0,) * 3, 4, 0, START_NS, START_NS + NS_PER_S)
    found = session_model(made, counted_frames(made))
    assert (found.setting.mount, found.model.mount, found.model.is_fitted) == (fitted, fitted, True)


@pytest.mark.parametrize("count", [19, 20])
def test_few_frames_and_a_star_simulator_have_no_model(count):
    made = session(count)
    assert (session_model(made, counted_frames(made)) is not None) is (count == 20)
    shown = replace(STATION.mount, inertial=InertialDirection(ra_deg=83.0, de_deg=-2.0))
    made.station = STATION.model_copy(update={"mount": shown})
    assert session_model(made, counted_frames(made)) is None


@pytest.mark.parametrize(("times", "is_taken_out"), [(1, True), (41, False)])
def test_steps_of_the_host_that_are_known_are_taken_out_of_the_errors_unless_its_clock_runs_away(times, is_taken_out):
    """Frames from the middle on are stamped by a clock that was set 2 s ahead, in which the sky turns by 30 arcsec."""
    made = session(60, step_s=1.0, noise=0.0)
    frames = made.frames.columns
    frames["host_utc_ns"][30:] += 2 * NS_PER_S
    frames["cross_x_arcsec"] = 30.0 * (np.arange(60) >= 30)
    at_ns = int(frames["host_utc_ns"][30])
    counted = counted_frames(made)
    made.events = [ClockStep(at_ns, 0, StationKind.CLOCK_STEP, "the clock stepped", 2 * NS_PER_S)] * times
    found = session_model(made, counted).series.errors_arcsec
    changed = not np.allclose(found[:, :2], [[30.0 * (row >= 30), 0.0] for row in range(60)], atol=0.1)
    assert changed is is_taken_out


def test_a_picture_that_stands_still_is_told_of_a_whole_session_and_of_one_that_runs():
    """On a mount that is described wrongly too, which it hides."""
    stars = tuple((100.0 + 60 * star, 900.0 - 50 * star, 0.0, 0.0) for star in range(12))
    made = session(21, step_s=60.0, noise=0.0, matches=stars)
    assert findings(made, statistics(made))[0].cause == causes_so_far(made)[0].cause == "frozen sensor"
    made.station = STATION.model_copy(update={"mount": replace(STATION.mount, roll_deg=STATION.mount.roll_deg + 90)})
    assert findings(made, statistics(made))[0].cause == causes_so_far(made)[0].cause == "frozen sensor"
    made.frames.matches["x_px"] += 0.1 * made.frames.matches["frame"]
    assert findings(made, statistics(made))[0].is_gross


@pytest.mark.parametrize(("azimuth_deg", "roll_deg", "axis"), [(90.0, 0.0, 1), (200.0, 90.0, 0)])
def test_more_air_lifts_the_stars_of_a_model_towards_the_zenith_of_its_mount(azimuth_deg, roll_deg, axis):
    """Image up is the zenith where the roll is 0, image left or right where it is 90 deg."""
    made = session(40, matches=radial_matches(np.zeros(12), 4e-3))
    mount = replace(STATION.mount, azimuth_deg=azimuth_deg, altitude_deg=45.0, roll_deg=roll_deg)
    made.station = STATION.model_copy(update={"mount": mount})
    by_air = session_model(made, counted_frames(made)).model.field.shifts[:, :2, PARAMETERS.index("pressure")]
    assert np.abs(by_air[:, axis]).min() > 10 * np.abs(by_air[:, 1 - axis]).max()
