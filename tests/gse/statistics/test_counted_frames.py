"""Which frames count: an exclusion has sky, link or clock as its reason, and hides no wrong answer."""

import dataclasses

import numpy as np
import pytest
from devices.injected_clocks import MISBEHAVIOURS, InjectedClocks, Sky, until_14_s, wrong_objects
from skies.known_nights import START_NS, STATION, VOUCHED, frame, session
from skies.one_by_one import Made, add_frame

from drivers.chunk import LinkEvent, LinkKind
from gse.diagnosis.plain_findings import time_tag_faults
from gse.errors import UsageError
from gse.station.columns import ANSWER_CHECKS, STATUSES
from gse.station.events import ClockStep, StationKind
from gse.station.exclusions import Cause, Exclusion, excluded, exclusions, parse_exclusion
from gse.station.own_answers import SensorAnswers
from gse.station.results import AnswerCheck, AttitudeError, Status, Subject, Verdict
from gse.station.session_tables import MATCH
from gse.statistics.counted_frames import counted_frames, own_counted
from gse.statistics.session_statistics import statistics
from gse.values.instant import NS_PER_S, from_text
from gse.verdict.assessment import judge
from gse.verdict.obstacles import missing_by_time, obstacles

CLEAR_ZERO_POINT_MAG = 14.0


def appended(made, result, *, utc_ns=None, host_utc_ns=None, time_us=None):
    """The frame with other stamps."""
    changes = {"utc_ns": utc_ns, "host_utc_ns": host_utc_ns, "time_us": time_us}
    panorama = dataclasses.replace(
        result.panorama, **{key: value for key, value in changes.items() if value is not None}
    )
    add_frame(made.frames, dataclasses.replace(result, panorama=panorama))


def no_answer(utc_ns, number, *, objects=0):
    panorama = frame(utc_ns, number, AttitudeError(0, 0, 0, 0, 0)).panorama
    panorama = dataclasses.replace(panorama, xy_px=np.zeros((objects, 2)), brightness=np.ones(objects))
    return Made(panorama, Status.NO_MATCH if objects else Status.TOO_FEW, "", "neighbour")


# False answers


def false_rows(made):
    return np.flatnonzero(counted_frames(made).false).tolist()


@pytest.mark.parametrize(("off_arcsec", "expected"), [(175.0, []), (205.0, [7])])
def test_an_answer_that_nothing_confirms_is_false_where_it_lies_too_far_from_truth(off_arcsec, expected):
    """180 arcsec, three times the limit, and the 19 arcsec within which truth itself is known."""
    made = session(60, noise=0.1, judged=AnswerCheck.UNKNOWN)
    made.frames.columns["cross_x_arcsec"][7] = off_arcsec
    assert false_rows(made) == expected


@pytest.mark.parametrize(("limits", "within_arcsec"), [({"d_de_arcsec": 100.0}, 300), ({"false_arcsec": 40.0}, 40)])
def test_what_is_false_is_three_times_the_larger_limit_or_what_the_station_file_states(limits, within_arcsec):
    made = with_limits(session(60, noise=0.1), **limits)
    made.frames.columns["answer_check"][7:9] = ANSWER_CHECKS.index(AnswerCheck.UNKNOWN)
    made.frames.columns["cross_y_arcsec"][7:9] = [within_arcsec - 1, within_arcsec + 1]
    assert false_rows(made) == [8]


def with_limits(made, **changes):
    limits = dataclasses.replace(made.station.limits, **changes)
    made.station = made.station.model_copy(update={"limits": limits})
    return made


def test_a_mount_that_is_off_makes_no_answer_false():
    """All that the reference identifier confirms shares it: answers that nothing confirms are judged beside them."""
    made = session(60, noise=0.1, bias=(900.0, 0.0, 0.0))
    made.frames.columns["answer_check"][[7, 8]] = ANSWER_CHECKS.index(AnswerCheck.UNKNOWN)
    made.frames.columns["cross_x_arcsec"][8] -= 900.0
    assert false_rows(made) == [8]


@pytest.mark.parametrize(("off", "false"), [(1, 1), (29, 29), (30, 30), (31, 29), (60, 0)])
def test_without_a_reference_truth_decides_for_half_of_the_answers_and_what_most_share_is_no_falsehood(off, false):
    """Beyond half the rows of the accuracy show it: nothing tells a mount from a sensor."""
    made = session(60, noise=0.1, judged=AnswerCheck.UNKNOWN)
    made.frames.columns["cross_x_arcsec"][:off] += 3600.0
    assert counted_frames(made).false.sum() == false
    assert (counted_frames(made).used.sum(), counted_frames(made).judged.sum()) == (60 - false, 60)


def test_where_no_clock_tells_how_well_truth_is_known_answers_far_from_most_are_false():
    made = session(60, noise=0.1, judged=AnswerCheck.UNKNOWN)
    made.clock = []
    made.frames.columns["cross_x_arcsec"] += 500.0
    made.frames.columns["cross_x_arcsec"][7] += 200.0
    assert false_rows(made) == [7]


@pytest.mark.parametrize(("off_arcsec", "expected"), [(3000.0, []), (4000.0, [7])])
def test_an_answer_that_the_reference_identifier_confirms_is_false_only_where_the_panorama_is_of_another_sky(
    off_arcsec, expected
):
    """A kick may move a mount by minutes of arc, and it is a degree that tells another sky."""
    made = session(60, noise=1.0)
    made.frames.columns["cross_x_arcsec"][7] += off_arcsec
    assert false_rows(made) == expected
    assert counted_frames(made).used.sum() == 60 - len(expected)


@pytest.mark.parametrize(("elsewhere", "false"), [(29, 29), (30, 0)])
def test_two_pointings_that_are_as_frequent_tell_no_other_sky(elsewhere, false):
    made = session(60, noise=1.0)
    made.frames.columns["cross_x_arcsec"][:elsewhere] += 72_000.0
    assert counted_frames(made).false.sum() == false


def test_between_two_pointings_that_are_as_frequent_nothing_is_shared():
    """An answer that nothing confirms is judged by truth itself, and not by what lies between both."""
    made = session(61, noise=1.0)
    made.frames.columns["cross_x_arcsec"][:30] += 72_000.0
    made.frames.columns["answer_check"][60] = ANSWER_CHECKS.index(AnswerCheck.UNKNOWN)
    assert false_rows(made) == []


def test_answers_of_other_stars_are_false_and_judged_though_there_is_no_truth():
    made = session(60)
    frames = made.frames.columns
    for name in ("cross_x_arcsec", "cross_y_arcsec", "d_de_arcsec"):
        frames[name] = np.nan
    frames["answer_check"][:] = ANSWER_CHECKS.index(AnswerCheck.UNKNOWN)
    frames["answer_check"][:3] = [ANSWER_CHECKS.index(one) for one in ("correct", "false", "absent")]
    assert false_rows(made) == [1]
    assert np.flatnonzero(counted_frames(made).judged).tolist() == [0, 1]


# The sensor's own answers


def own_answers(made, off_arcsec=0.0, rows=slice(None), **changes):
    """Answers along with those of the frames, some of which lie off in declination, with their errors."""
    frames, count = made.frames.columns, len(made.frames)
    columns = {name: np.full(count, np.nan) for name in SensorAnswers.__slots__}
    columns |= {"sent": np.ones(count, dtype=bool), "acquired": np.ones(count, dtype=bool)}
    columns |= {name: frames[name].astype(np.float64) for name in ("ra_deg", "de_deg", "d_de_arcsec")}
    columns |= {name: frames[name].astype(np.float64) for name in ("cross_x_arcsec", "cross_y_arcsec")}
    columns["de_deg"][rows] += off_arcsec / 3600
    for name, sign in (("d_de_arcsec", 1), ("cross_y_arcsec", -1)):
        columns[name][rows] += sign * off_arcsec
    return SensorAnswers(**{**columns, **changes})


def own_false(made, own):
    return np.flatnonzero(own_counted(made, own, counted_frames(made)).false).tolist()


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("cloud", [False, True])
@pytest.mark.parametrize(("off_arcsec", "expected"), [(160.0, []), (210.0, [7, 8, 9])])
def test_own_answers_are_false_by_the_reference_identifier_and_by_truth_where_it_has_none(
    sign, cloud, off_arcsec, expected
):
    made = session(60, noise=0.1)
    if cloud:
        blind(made, slice(5, 20))
    assert own_false(made, own_answers(made, sign * off_arcsec, slice(7, 10))) == expected


def blind(made, rows):
    """Frames in which neither identifier finds a star."""
    frames = made.frames.columns
    frames["status"][rows] = STATUSES.index(Status.TOO_FEW)
    frames["answer_check"][rows] = ANSWER_CHECKS.index(AnswerCheck.UNKNOWN)
    frames["ra_reference_deg"][rows] = frames["de_reference_deg"][rows] = np.nan


@pytest.mark.parametrize(("off", "false"), [(30, 30), (31, 31), (60, 60)])
def test_a_sensor_that_is_a_degree_off_its_panoramas_is_false_as_often_as_it_is_off(off, false):
    """The median of its own answers is no authority."""
    made = session(60, noise=0.1)
    assert len(own_false(made, own_answers(made, 3600.0, slice(0, off)))) == false


def test_own_answers_without_panoramas_that_show_stars_are_judged_by_truth():
    made = session(60, noise=0.1)
    blind(made, slice(None))
    assert own_false(made, own_answers(made, 1500.0, slice(0, 30))) == list(range(30))


def test_an_own_answer_is_right_where_its_panorama_is_of_another_sky_and_it_is_of_the_mounts():
    made = session(60, noise=0.1)
    frames, own = made.frames.columns, own_answers(made)
    frames["de_reference_deg"][7] += 30.0
    frames["cross_y_arcsec"][7] -= 30.0 * 3600
    assert false_rows(made) == [7]
    assert own_false(made, own) == []


def test_own_answers_while_the_mount_was_touched_are_judged_only_where_stars_tell():
    made = session(60, noise=0.1)
    blind(made, slice(5, 8))
    made.excluded = (Exclusion(START_NS, START_NS + NS_PER_S, "kicked", Cause.MOUNT),)
    counted = own_counted(made, own_answers(made, 900.0, slice(0, 10)), counted_frames(made))
    assert np.flatnonzero(counted.false).tolist() == [0, 1, 2, 3, 4, 8, 9]
    assert np.flatnonzero(~counted.judged).tolist() == [5, 6, 7]
    assert np.flatnonzero(~counted.used).tolist() == list(range(10))


def test_an_own_answer_that_is_not_valid_is_not_judged():
    made = session(60, noise=0.1)
    acquired = np.arange(60) != 7
    counted = own_counted(made, own_answers(made, 900.0, slice(7, 8), acquired=acquired), counted_frames(made))
    assert (counted.false.sum(), counted.judged.sum(), counted.used.sum()) == (0, 59, 59)


# Buffers


def test_frames_that_waited_in_a_buffer_before_the_port_was_read_are_excluded_by_name():
    made = session(0)
    for number in range(600):
        due_ns = START_NS + number * NS_PER_S // 10
        result = frame(due_ns, number, AttitudeError(1.0, 1.0, 1.0, 1.0, 1.0))
        if number < 38:
            read_ns = START_NS + 38 * NS_PER_S // 10
            far_off = dataclasses.replace(result, attitude_error=AttitudeError(-55.0, 0.0, 0.0, 0.0, 0.0))
            appended(made, far_off, utc_ns=read_ns, host_utc_ns=read_ns + 10_000_000)
        else:
            add_frame(made.frames, result)
    stats = statistics(made)
    ((stretch, count),) = stats.exclusions
    assert stretch.reason.startswith("read up to 3.80 s late: these frames waited")
    assert count == 39  # and the one that was read in time, which has the same stamp
    assert stats.onboard.axes["d_ra_cosde"].max_abs_arcsec == 1.0


def test_a_stretch_that_an_operator_leaves_out_explains_no_error_of_time():
    stated = parse_exclusion("2026-03-20T18:30:00Z/2026-03-20T18:31:00Z=clouds")
    assert (stated.cause, stated.reason, stated.time_error_s) == (Cause.OPERATOR, "clouds", 0.0)
    assert stated.until_ns - stated.from_ns == 60 * NS_PER_S


def test_a_sensor_clock_that_runs_fast_is_no_buffer():
    assert statistics(session(600, sensor_ppm=-1000.0)).exclusions == ()


@pytest.mark.parametrize("wrong", [AnswerCheck.FALSE, AnswerCheck.ABSENT])
def test_a_leap_of_the_time_tag_hides_no_wrong_answers(wrong):
    made = session(0, noise=2.0)
    rng = np.random.default_rng(1)
    for number in range(600):
        utc_ns = START_NS + number * NS_PER_S // 10
        error = AttitudeError(*rng.normal(0, 2.0, 5).tolist())
        result = frame(utc_ns, number, error)
        if number < 140:
            far = AttitudeError(9e4, 9e4, 0, 9e4, 9e4)
            result = (
                frame(utc_ns, number, far, wrong)
                if wrong is AnswerCheck.FALSE
                else dataclasses.replace(no_answer(utc_ns, number, objects=30), answer_check=AnswerCheck.ABSENT)
            )
        tag_us = number * 100_000 + (3_000_000 if number >= 140 else 0)
        appended(made, result, time_us=tag_us, host_utc_ns=utc_ns + 200_000)
    assessment = judge(made)
    assert assessment.statistics.exclusions == ()
    assert assessment.verdict is not Verdict.PASS
    assert any("time tag: it leapt by +3.00 s" in line for line in map(str, assessment.findings))


def test_a_restart_with_a_fast_clock_is_no_buffer():
    made = session(0)
    for number in range(600):
        utc_ns = START_NS + number * NS_PER_S // 10
        tag_us = number * 100_000 if number < 300 else (number - 300) * 120_000
        appended(
            made, frame(utc_ns, number, AttitudeError(1, 1, 1, 1, 1)), time_us=tag_us, host_utc_ns=utc_ns + 200_000
        )
    assert statistics(made).exclusions == ()


def test_a_time_tag_that_stands_still_is_a_finding():
    made = session(200)
    made.frames.columns["time_us"][100:150] = made.frames.columns["time_us"][100]
    assert any("stood still in 49 frames" in line for line in time_tag_faults(made.frames.columns, ()))


def test_the_time_tags_of_a_sound_session_are_no_finding():
    assert time_tag_faults(session(600).frames.columns, ()) == ()


# A sensor whose clock or counter misbehaves just while its answers are wrong


@pytest.fixture(scope="module")
def sky():
    return Sky()


@pytest.mark.parametrize("clocks", MISBEHAVIOURS.values(), ids=MISBEHAVIOURS.keys())
def test_no_clock_or_counter_hides_that_stars_were_wrong(sky, clocks):
    session = sky.session(clocks, blind_s=(0.0, 14.0), blind_px=wrong_objects(sky))
    assessment = judge(session)
    assert assessment.verdict is not Verdict.PASS
    available = assessment.statistics.onboard.available
    assert available.of >= 375  # those that waited while the host slept may be left out
    assert available.of - available.count in (70, 71, 72)


@pytest.mark.parametrize("name", [name for name in MISBEHAVIOURS if name != "nothing moves but the stars"])
def test_no_clock_or_counter_hides_that_panoramas_were_empty(sky, name):
    session = sky.session(MISBEHAVIOURS[name], blind_s=(0.0, 14.0), blind_px=[np.empty((0, 2))] * len(sky.frames))
    assert judge(session).verdict is not Verdict.PASS


@pytest.mark.parametrize("name", ["stuck tags", "tags 20 % fast", "tags 20 % slow", "a leap ahead"])
def test_a_time_tag_that_misbehaves_is_a_finding_though_stars_are_right(sky, name):
    session = sky.session(MISBEHAVIOURS[name])
    assert any(line.startswith("sensor time tag: it ") for line in map(str, judge(session).findings))


def test_frames_of_a_real_backlog_count_though_their_times_do_not(sky):
    assessment = judge(sky.session(MISBEHAVIOURS["a real backlog"]))
    assert assessment.verdict is Verdict.PASS, assessment.reasons
    assert assessment.statistics.onboard.available.count == 400
    assert assessment.statistics.counted.used.sum() == pytest.approx(330, abs=1)
    assert assessment.findings == ()


@pytest.mark.parametrize("change_s", [20.0, 40.0])
def test_a_restart_with_a_fast_clock_hides_no_wrong_stars(sky, change_s):
    clocks = InjectedClocks(tag_s=until_14_s(lambda t: t, lambda t: 1.2 * (t - change_s), change=change_s))
    blind_px = [sky.elsewhere_px] * len(sky.frames)
    assessment = judge(sky.session(clocks, blind_s=(change_s, change_s + 14.0), blind_px=blind_px))
    assert assessment.statistics.exclusions == ()
    assert assessment.verdict is not Verdict.PASS
    assert any("sensor time tag: it ran 20 % fast" in line for line in map(str, assessment.findings))


# Frames that never came


def without(sky, is_missing, clocks=None):
    """The verdict on a session of which frames are missing by their true time, where sequence numbers go on."""
    whole = sky.frames
    sky.frames = [item for item in whole if not is_missing(item[0])]
    try:
        return judge(sky.session(clocks or InjectedClocks()))
    finally:
        sky.frames = whole


@pytest.mark.parametrize(
    ("is_missing", "clocks"),
    [
        (lambda t: round(5 * t) % 5 == 0, None),
        (lambda t: round(5 * t) % 5 == 0, InjectedClocks(sequence=lambda n: n * 7919)),
        (lambda t: t % 10 < 4, None),
        (lambda t: t % 10 < 4, InjectedClocks(tag_s=lambda t: t % 10)),
    ],
    ids=["every fifth left out", "sequence chaos", "silent 4 of 10 s", "restarts each 10 s"],
)
def test_frames_that_no_sequence_number_tells_as_missing_make_no_pass(sky, is_missing, clocks):
    assessment = without(sky, is_missing, clocks)
    assert assessment.verdict is Verdict.INCONCLUSIVE
    assert any(reason.startswith("by time ") for reason in assessment.reasons)


def test_the_frames_that_are_missing_by_time_are_counted():
    made = session(600)
    frames = made.frames.columns.rows()
    assert missing_by_time(frames) == 0
    assert missing_by_time(np.delete(frames, np.s_[100:140])) == 40
    assert missing_by_time(np.delete(frames, np.s_[5:600:5])) == 119
    assert missing_by_time(frames[np.r_[0:300, 300:600:10]]) <= 10
    leaping = frames.copy()
    leaping["time_us"][300:] += 15_900_000
    assert missing_by_time(leaping) == 0
    in_bunches = frames.copy()
    in_bunches["host_utc_ns"] -= in_bunches["host_utc_ns"] % NS_PER_S
    assert missing_by_time(in_bunches) == 0


@pytest.mark.parametrize(("missing", "is_open"), [(5, False), (6, True)])
def test_the_availability_is_open_only_where_frames_missing_by_time_would_break_its_limit(missing, is_open):
    """95 of 100 keep a limit of 95 %, 94 of 100 do not."""
    made, whole = session(0), session(100).frames.columns.rows()
    rows = np.delete(whole, np.s_[40 : 40 + missing])
    rows["frame_no"] = np.arange(len(rows))
    made.frames.extend(rows, np.zeros(0, MATCH))
    lines = [line for line in obstacles(made, statistics(made), ()) if line.startswith("by time")]
    assert bool(lines) is is_open
    assert all("by time 6 frames are missing that no sequence number tells" in line for line in lines)


def test_bursts_with_hours_between_them_and_a_restart_are_not_missing_frames():
    frames = session(600).frames.columns
    for name, unit in (("time_us", 1_000_000), ("host_utc_ns", NS_PER_S)):
        frames[name][200:400] += frames[name].dtype.type(3600 * unit)
        frames[name][400:] += frames[name].dtype.type(7200 * unit)
    assert missing_by_time(frames) == 0
    frames = session(600).frames.columns
    frames["host_utc_ns"][300:] += 4 * NS_PER_S
    frames["time_us"][300:] -= frames["time_us"][300]
    assert missing_by_time(frames) == 0


@pytest.mark.parametrize(("restarts", "missing"), [(1, 0), (2, 0), (3, 3 * 99)])
def test_a_sensor_that_starts_anew_again_and_again_was_away_and_one_that_does_twice_was_not(restarts, missing):
    """At 10 Hz, each time with ten seconds until its next frame."""
    frames = session(600).frames.columns
    for row in range(100, 100 * (restarts + 1), 100):
        frames["host_utc_ns"][row:] += 99 * NS_PER_S // 10
        frames["time_us"][row:] -= frames["time_us"][row]
    assert missing_by_time(frames) == missing


def test_a_pause_that_the_operator_leaves_out_is_not_missing():
    frames = np.delete(session(600).frames.columns.rows(), np.s_[100:140])
    assert missing_by_time(frames, excluded(frames["utc_ns"], [pause(9.0, 15.0)])) == 0


def pause(from_s, until_s):
    return Exclusion(START_NS + round(from_s * NS_PER_S), START_NS + round(until_s * NS_PER_S), "", Cause.OPERATOR)


# The mount


def test_a_note_that_the_mount_was_touched_takes_the_answers_of_a_minute_on_either_side_out():
    made = session(3000)
    made.frames.columns["d_de_arcsec"][1600:1650] = 5000.0
    made.events.append(LinkEvent(START_NS + 150 * NS_PER_S, 0, StationKind.MOUNT_TOUCHED, "kicked the tripod"))
    stats = statistics(made)
    ((stretch, count),) = stats.exclusions
    assert (stretch.cause, stretch.reason, count) == (Cause.MOUNT, "kicked the tripod", 1200)
    assert stats.onboard.axes["d_de"].n == stats.onboard.available.of == 1800
    assert stats.onboard.axes["d_de"].max_abs_arcsec < 100


# The link


def unplugged_session(*kinds):
    """A hundred frames never came between the 300th and the next, and these events at 30.05 and 39.95 s."""
    made, whole = session(0), session(700).frames.columns.rows()
    made.frames.extend(np.delete(whole, np.s_[300:400]), np.zeros(0, MATCH))
    made.link.frames_lost = 100
    for kind, seconds in zip(kinds, (30.05, 39.95), strict=False):
        made.events.append(LinkEvent(START_NS + round(seconds * NS_PER_S), 0, kind, "so"))
    return made


def unplugged(*kinds):
    return statistics(unplugged_session(*kinds))


def test_frames_that_were_lost_while_the_port_was_gone_are_not_expected_and_the_time_is_told():
    stats = unplugged(LinkKind.LOST, LinkKind.REOPENED)
    assert (stats.onboard.available.count, stats.onboard.available.of) == (600, 600)
    ((stretch, count),) = stats.exclusions
    assert (stretch.cause, stretch.reason, count) == (Cause.LINK, "the port was gone for 9.9 s", 0)


def test_frames_that_were_lost_while_the_port_was_gone_are_not_missing_by_time():
    made = unplugged_session(LinkKind.LOST, LinkKind.REOPENED)
    assert [line for line in obstacles(made, statistics(made), ()) if line.startswith("by time")] == []


@pytest.mark.parametrize("kinds", [(), (LinkKind.LOST,), (LinkKind.SILENT, LinkKind.STREAMING), (LinkKind.REOPENED,)])
def test_frames_that_were_lost_on_a_port_that_was_there_are_expected(kinds):
    assert unplugged(*kinds).onboard.available.of == 700


# Clock steps


def stepped(step_s, *, error_arcsec, check=AnswerCheck.CORRECT):
    """A minute with a clock step in its middle, and ten answers with an error just after it."""
    made = session(600)
    text = f"the host's UTC clock stepped by {step_s:+.3f} s"
    made.events.append(ClockStep(START_NS + 30 * NS_PER_S, 0, StationKind.CLOCK_STEP, text, round(step_s * NS_PER_S)))
    for row in range(301, 311):
        made.frames.columns["cross_x_arcsec"][row] = error_arcsec
        made.frames.columns["answer_check"][row] = list(AnswerCheck).index(check)
    return made


@pytest.mark.parametrize(("step_s", "frames"), [(2.0, 120), (-2.0, 120), (0.006, 100)])
def test_frames_around_a_clock_step_are_excluded_by_name(step_s, frames):
    ((item, count),) = statistics(stepped(step_s, error_arcsec=0.0)).exclusions
    assert "stepped by" in item.reason
    assert count == pytest.approx(frames, abs=1)


@pytest.mark.parametrize(("step_s", "stretches"), [(9, 1), (-9, 1), (11, 2), (-11, 2)])
def test_what_the_two_clocks_tell_of_a_step_is_one_stretch_where_they_meet(step_s, stretches):
    step = ClockStep(START_NS + 60 * NS_PER_S, 0, StationKind.CLOCK_STEP, "set", step_s * NS_PER_S)
    found = exclusions([step], session(0).frames.columns)
    assert len(found) == stretches
    seconds = sum(item.until_ns - item.from_ns for item in found) / NS_PER_S
    assert seconds == (20 if stretches == 2 else 10 + abs(step_s))


def test_the_side_of_a_clock_step_that_has_wrong_stamps_is_excluded():
    forward, back = (statistics(stepped(step_s, error_arcsec=0.0)).exclusions[0][0] for step_s in (2.0, -2.0))
    middle_ns = START_NS + 30 * NS_PER_S
    assert (middle_ns - forward.from_ns, forward.until_ns - middle_ns) == (7 * NS_PER_S, 5 * NS_PER_S)
    assert (middle_ns - back.from_ns, back.until_ns - middle_ns) == (5 * NS_PER_S, 7 * NS_PER_S)


def test_a_false_identification_counts_though_the_clock_steps_just_then():
    made = stepped(2.0, error_arcsec=0.0, check=AnswerCheck.FALSE)
    assert counted_frames(made).false.sum() == 10
    assert judge(made).statistics.onboard.false_answers.count == 10


def test_an_error_that_the_step_does_not_explain_counts_as_false():
    assert counted_frames(stepped(2.0, error_arcsec=9e4)).false.sum() == 10


def test_an_error_that_the_step_explains_is_the_clocks():
    assert counted_frames(stepped(3600.0, error_arcsec=15.041 * 3600)).false.sum() == 0


def test_much_excluded_for_the_clock_decides_nothing():
    made = session(6000)
    for second in range(0, 600, 60):
        event = ClockStep(START_NS + second * NS_PER_S, 0, StationKind.CLOCK_STEP, "stepped by +0.100 s", 10**8)
        made.events.append(event)
    assessment = judge(made)
    assert assessment.verdict is Verdict.INCONCLUSIVE
    assert any("left out for steps of the clock" in reason for reason in assessment.reasons)


def test_little_excluded_for_the_clock_is_no_obstacle_to_a_verdict():
    """A sixth of the frames, but ten seconds."""
    made = stepped(0.006, error_arcsec=0.0)
    assert not any("too many to say" in reason for reason in judge(made).reasons)


def test_a_figure_that_fails_is_named_before_what_else_forbids_a_pass():
    made = session(600, step_s=1.0, bias=(200.0, 0.0, 0.0), station=VOUCHED)
    for second in range(0, 600, 60):
        event = ClockStep(START_NS + second * NS_PER_S, 0, StationKind.CLOCK_STEP, "stepped by +0.100 s", 10**8)
        made.events.append(event)
    assessment = judge(made)
    assert assessment.verdict is Verdict.FAIL
    failed = next(row.reason for row in assessment.rows if row.outcome == "FAIL")
    obstacle = next(reason for reason in assessment.reasons if "too many to say" in reason)
    assert assessment.reasons.index(failed) < assessment.reasons.index(obstacle)


# Sky


def clouded(
    *, first=600, last=1200, frames=1800, objects=30, zero_point_beside=CLEAR_ZERO_POINT_MAG, check=AnswerCheck.UNKNOWN
):
    """Three minutes at 10 Hz; without an answer from one frame to another."""
    made = session(frames)
    made.frames.columns["zero_point_mag"] = CLEAR_ZERO_POINT_MAG
    made.frames.columns["objects"] = 30
    beside = slice(max(first - 50, 0), last + 50)
    made.frames.columns["zero_point_mag"][beside] = zero_point_beside
    blind = made.frames.columns[first:last]
    blind["status"] = list(Status).index(Status.NO_MATCH)
    blind["answer_check"] = list(AnswerCheck).index(check)
    blind["zero_point_mag"] = blind["d_de_arcsec"] = np.nan
    blind["objects"] = objects
    return made


def test_cloud_that_the_stars_show_is_excluded_by_name():
    assessment = judge(clouded(zero_point_beside=CLEAR_ZERO_POINT_MAG - 2.4))
    ((item, count),) = assessment.statistics.exclusions
    assert (item.cause, count) == (Cause.NO_SKY, 600)
    assert "stars 2.4 mag too faint: cloud" in item.reason
    assert assessment.verdict is Verdict.PASS


def test_a_sensor_that_fails_under_a_clear_sky_is_not_excused():
    assessment = judge(clouded())
    assert assessment.statistics.exclusions == ()
    assert assessment.verdict is not Verdict.PASS


def test_a_sky_in_which_the_reference_finds_stars_is_no_excuse():
    made = clouded(zero_point_beside=CLEAR_ZERO_POINT_MAG - 2.4, check=AnswerCheck.ABSENT)
    assert statistics(made).exclusions == ()


def test_cloud_for_most_of_the_session_is_inconclusive_with_its_reason():
    assessment = judge(clouded(first=100, last=1700, zero_point_beside=CLEAR_ZERO_POINT_MAG - 2.4))
    assert assessment.verdict is Verdict.INCONCLUSIVE
    assert any(reason.startswith("no sky in 1600 of 1800 frames: stars 2.4 mag") for reason in assessment.reasons)


def test_empty_panoramas_leave_the_availability_open():
    assessment = judge(clouded(objects=0))
    assert assessment.verdict is Verdict.INCONCLUSIVE
    assert any("no object at all for 60 s: lens cap" in reason for reason in assessment.reasons)
    assert any("or the sensor was blind" in reason for reason in assessment.reasons)


def test_a_sensor_that_sends_no_panoramas_is_not_excused_by_their_being_empty():
    made = clouded(objects=0)
    made.subject = Subject.SENSOR
    assert statistics(made).exclusions == ()
    assert statistics(made).onboard.available.of == 1800


@pytest.mark.parametrize("frames", [1800, 50])
def test_daylight_is_no_fault_of_the_sensor(frames):
    made = clouded(first=0, last=frames, frames=frames)
    noon_ns = from_text("2026-03-20T05:00:00Z") - START_NS  # at 106.7 deg east
    made.frames.columns["utc_ns"] += noon_ns
    assessment = judge(made)
    assert assessment.verdict is Verdict.INCONCLUSIVE
    assert any("Sun 8" in reason and "above the horizon" in reason for reason in assessment.reasons)


def test_five_seconds_under_a_dark_sky_without_an_answer_are_not_excused():
    made = clouded(first=0, last=50, frames=50)
    assert statistics(made).exclusions == ()
    assert (statistics(made).onboard.available.count, statistics(made).onboard.available.of) == (0, 50)
    assessment = judge(made)
    assert assessment.verdict is Verdict.INCONCLUSIVE  # the reference names no star either
    assert assessment.reasons[0].startswith("set-up: nothing identified")


def test_a_short_gap_is_not_the_sky():
    assert statistics(clouded(first=600, last=690, zero_point_beside=CLEAR_ZERO_POINT_MAG - 2.4)).exclusions == ()


# The operator


def test_a_stretch_to_leave_out_is_read_with_its_reason():
    stretch = parse_exclusion("2026-03-20T18:30:00Z/2026-03-20T18:31:00Z=clouds")
    assert (stretch.from_ns, stretch.until_ns - stretch.from_ns) == (START_NS, 60 * NS_PER_S)
    assert (stretch.reason, stretch.cause) == ("clouds", Cause.OPERATOR)


@pytest.mark.parametrize(
    ("why", "reason"), [("=mount: kicked", "kicked"), ("= mount:moved ", "moved"), ("=mount:", "the mount was touched")]
)
def test_a_stretch_in_which_the_mount_was_touched_says_so(why, reason):
    stretch = parse_exclusion(f"2026-03-20T18:30:00Z/2026-03-20T18:31:00Z{why}")
    assert (stretch.cause, stretch.reason) == (Cause.MOUNT, reason)


@pytest.mark.parametrize("text", ["", "clouds", "2026-03-20T18:30:00Z", "2026-03-20T18:31:00Z/2026-03-20T18:30:00Z"])
def test_a_stretch_without_sense_is_refused(text):
    with pytest.raises(UsageError, match="expected for example 2026"):
        parse_exclusion(text)


def test_what_is_counted_is_decided_once():
    made = session(600)
    add_frame(made.frames, frame(START_NS, 700, AttitudeError(9e4, 9e4, 0, 9e4, 9e4), AnswerCheck.FALSE))
    counted = counted_frames(made)
    stats = statistics(made)
    assert stats.onboard.axes["d_de"].n == counted.used.sum() == 600
    assert stats.onboard.false_answers.count == counted.false.sum() == 1
    assert STATION.limits.availability <= stats.onboard.available.value


# A frozen sensor


def test_the_copies_of_a_frozen_sensor_are_missing_answers():
    made = session(600)
    made.link.frames_repeated = 140
    assessment = judge(made)
    assert assessment.statistics.onboard.available.of == 740
    assert assessment.statistics.onboard.available.count == 600
    assert assessment.verdict is not Verdict.PASS


def test_a_stretch_to_leave_out_that_ends_where_it_begins_is_refused():
    with pytest.raises(UsageError, match="ends before it begins"):
        parse_exclusion("2026-03-20T18:30:00Z/2026-03-20T18:30:00Z=dew")


def test_sixteen_frames_tell_what_is_usual_between_two():
    frames = session(600).frames.columns.rows()
    assert missing_by_time(frames[np.r_[0:10, 14:20]]) == 4
    assert missing_by_time(frames[np.r_[0:10, 14:19]]) == 0
