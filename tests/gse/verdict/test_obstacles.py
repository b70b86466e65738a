"""What stands between a session and PASS: each obstacle at the place where it begins."""

from dataclasses import replace

import numpy as np
import pytest
from skies.known_nights import START_NS, STATION, session

from drivers.chunk import LinkEvent
from gse.station.columns import STATUSES
from gse.station.exclusions import Cause, Exclusion
from gse.station.results import Status, Subject
from gse.statistics.decision import Outcome, Row
from gse.statistics.session_statistics import statistics
from gse.truth import Alignment
from gse.values.instant import NS_PER_S
from gse.values.mount import InertialDirection, Mount, MountUncertainty
from gse.verdict.obstacles import obstacles
from protocols import StatusMessage

CORE = ("mean |dRA*|", "95 % of |dRA*|", "mean |dDE|", "95 % of |dDE|", "availability", "false answers")
NOTHING_TESTED = "nothing can pass: dRA*, dDE, availability and false answers are needed, and no subject has all"


def row(name, subject=Subject.ONBOARD, outcome=Outcome.PASS):
    return Row(subject, name, 1.0, "arcsec", 2.0, outcome)


TESTED = tuple(row(name) for name in CORE)


@pytest.fixture(scope="module")
def steady():
    """A thousand frames, one in each second."""
    return session(1000, step_s=1.0)


def seconds(first, until, cause, reason="a reason"):
    return Exclusion(START_NS + round(first * NS_PER_S), START_NS + round(until * NS_PER_S), reason, cause)


def lines(made, *left_out, rows=TESTED):
    made = replace(made, excluded=left_out)
    return list(obstacles(made, statistics(made), rows))


def test_a_sound_session_has_none(steady):
    assert lines(steady) == []


# Rows


@pytest.mark.parametrize(
    ("rows", "is_open"),
    [
        (TESTED, False),
        (tuple(row(name, outcome=Outcome.FAIL) for name in CORE), False),
        ((*TESTED, row("mean |dRA*|", Subject.SENSOR, Outcome.NOT_TESTED)), False),
        (tuple(row(name, Subject.SENSOR) for name in CORE), False),
        ((), True),
        (tuple(row(name, outcome=Outcome.NOT_TESTED) for name in CORE), True),
        (tuple(row(name, subject) for name, subject in zip(CORE, [*Subject] * 3, strict=True)), True),
        *((tuple(row(name) for name in CORE if name != missing), True) for missing in CORE),
    ],
)
def test_one_subject_must_have_all_rows_of_the_core(steady, rows, is_open):
    assert lines(steady, rows=rows) == [NOTHING_TESTED] * is_open


# Telemetry


def test_a_session_of_two_sensors_cannot_pass(steady):
    text = "the sensor says that it is number 8, it was 7 before: two sensors in one session"
    told = [LinkEvent(START_NS, 0, "OTHER_SENSOR", text)]
    assert lines(replace(steady, events=told)) == [
        f"{text}; judge the sensors one by one: 'gse session trim' parts the session"
    ]


def test_a_temperature_that_is_no_number_is_told_and_one_that_the_protocol_lacks_is_not(steady):
    good, without = StatusMessage(temperature_c=20.0), StatusMessage(problems=("supply is nan: no number",))
    invalid = StatusMessage(problems=("temperature is nan: no number of ordinary size",))
    assert lines(replace(steady, statuses=[(START_NS, good), (START_NS, without)])) == []
    told = lines(replace(steady, statuses=[(START_NS, good), (START_NS, invalid)]))
    assert told == ["sensor: the temperature in 1 of 2 STATUS frames is not a number"]


# What was left out


@pytest.mark.parametrize(
    ("frames", "left_out", "is_told"),
    [(1000, 60, False), (1000, 61, True), (4000, 80, False), (4000, 81, True)],
    ids=["a minute", "more than a minute", "one in fifty", "more than one in fifty"],
)
@pytest.mark.parametrize(
    ("cause", "words"), [(Cause.CLOCK_STEP, "steps of the clock"), (Cause.BACKLOG, "frames read late")]
)
def test_more_than_a_minute_and_one_frame_in_fifty_left_out_for_clock_or_link_is_too_much(
    frames, left_out, is_told, cause, words
):
    told = lines(session(frames, step_s=1.0), seconds(100, 100 + left_out, cause))
    line = f"{left_out} of {frames} frames are left out for {words}: too many to say anything of the session"
    assert told == [line] * is_told


@pytest.mark.parametrize(("left_out_s", "is_told"), [(60, False), (60.5, True)])
def test_a_minute_is_a_minute_whatever_the_rate(left_out_s, is_told):
    """Two frames a second: one in fifty is 20 of them, a minute 120."""
    told = lines(session(1000, step_s=0.5), seconds(100, 100 + left_out_s, Cause.BACKLOG))
    assert [line.split(" are ")[0] for line in told] == [f"{2 * left_out_s:.0f} of 1000 frames"] * is_told


@pytest.mark.parametrize(("frames", "words"), [(1, "the only frame is"), (2, "all 2 frames are")])
def test_of_a_session_of_one_frame_the_only_one_is_left_out(frames, words):
    told = lines(session(frames, step_s=1.0), seconds(0, 9, Cause.OPERATOR, "a test"))
    assert told == [f"{words} left out: operator: a test"]


def test_what_the_operator_leaves_out_is_never_too_much_unless_it_is_all(steady):
    assert lines(steady, seconds(0, 999, Cause.OPERATOR)) == []
    reasons = [seconds(place * 300, (place + 1) * 300, Cause.OPERATOR, f"wind {place}") for place in range(4)]
    nobody = seconds(-5, -1, Cause.OPERATOR, "before it began")
    (line,) = lines(steady, nobody, *reasons)
    assert line == "all 1000 frames are left out: operator: wind 0; operator: wind 1; operator: wind 2"


def test_a_session_that_is_left_out_as_a_whole_has_its_reason_once(steady):
    assert lines(steady, seconds(0, 1000, Cause.NO_SKY, "cloud")) == ["all 1000 frames are left out: no sky: cloud"]


# The sky


@pytest.mark.parametrize(("count", "is_told"), [(500, False), (501, True)])
def test_no_sky_in_more_than_half_of_the_frames_is_too_little(count, is_told):
    dark = session(1000, step_s=1.0)
    dark.frames.columns["status"][:count] = STATUSES.index(Status.NO_MATCH)
    told = lines(dark, seconds(0, 300, Cause.NO_SKY, "cloud"), seconds(300, count, Cause.NO_SKY, "dawn"))
    assert told == [f"no sky in {count} of 1000 frames: cloud; dawn"] * is_told


def test_answers_under_cloud_are_no_little_sky(steady):
    assert lines(steady, seconds(0, 900, Cause.NO_SKY, "thin cloud")) == []


@pytest.mark.parametrize(("count", "is_told"), [(49, False), (50, True)])
def test_empty_panoramas_count_where_with_them_the_availability_would_not_keep_its_limit(steady, count, is_told):
    """The limit is 95 % of the 980 frames after dusk."""
    told = lines(steady, seconds(100, 100 + count, Cause.NO_OBJECTS, "a cap"), seconds(0, 20, Cause.NO_SKY, "dusk"))
    words = f"availability depends on {count} frames that show no stars: a cap; dusk, or the sensor was blind"
    assert told == ([words] if is_told else [])


def test_a_sensor_that_answers_too_seldom_anyway_does_not_depend_on_empty_panoramas_that_are_not_there(steady):
    assert lines(steady, seconds(0, 100, Cause.NO_SKY, "cloud")) == []


# A mount that was fitted


def fitted(made, mount, stated):
    station = STATION.model_copy(update={"mount": stated})
    sigmas = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 100.0))
    alignment = Alignment(mount, sigmas, (5.0, 5.0, 50.0), 100, 0, START_NS, START_NS + 60 * NS_PER_S)
    return replace(made, station=station, alignment=alignment)


STATED = Mount(azimuth_deg=40.0, altitude_deg=50.0, roll_deg=20.0)
FEW_ARCSEC = MountUncertainty(azimuth_arcsec=100.0, altitude_arcsec=200.0, roll_arcsec=1000.0)


@pytest.mark.parametrize(
    ("uncertainty", "change", "apart"),
    [
        (MountUncertainty(), {"altitude_deg": 50.99}, None),
        (MountUncertainty(), {"altitude_deg": 51.01}, "1.0 deg"),
        (MountUncertainty(), {"roll_deg": 18.5}, "1.5 deg"),
        # Three standard deviations are 1.53 half-widths of 95 %.
        (FEW_ARCSEC, {"altitude_deg": 50 + 300 / 3600}, None),
        (FEW_ARCSEC, {"altitude_deg": 50 + 312 / 3600}, "312 arcsec"),
        (FEW_ARCSEC, {"altitude_deg": 50 - 312 / 3600}, "312 arcsec"),
        (FEW_ARCSEC, {"roll_deg": 20 + 1500 / 3600}, None),
        (FEW_ARCSEC, {"roll_deg": 20 - 1560 / 3600}, "0.4 deg"),
        (FEW_ARCSEC, {"altitude_deg": 50 + 220 / 3600, "azimuth_deg": 40 + 220 / 3600 / np.cos(np.radians(50))}, "0.1"),
        (replace(FEW_ARCSEC, azimuth_arcsec=300.0), {"altitude_deg": 50 + 450 / 3600}, None),
    ],
)
def test_a_fitted_mount_beyond_what_is_stated_is_another_one(steady, uncertainty, change, apart):
    stated = replace(STATED, uncertainty=uncertainty)
    told = lines(fitted(steady, replace(stated, **change), stated))
    if apart is None:
        assert told == []
    else:
        (line,) = told
        assert line.startswith(f"the fitted mount is {apart}")


def test_a_fitted_mount_has_nothing_to_keep_to_where_none_is_stated(steady):
    far = replace(STATED, altitude_deg=10.0)
    assert lines(fitted(steady, far, replace(STATED, stated=False))) == []
    assert lines(replace(fitted(steady, far, STATED), alignment=None)) == []


BY_DAY = "stars by day: stars are identified in "


@pytest.mark.parametrize(("sun_deg", "is_told"), [(5.0, True), (1.1, True), (0.9, False), (-0.6, False), (-5.0, False)])
@pytest.mark.parametrize("align", ["first 60 s", None])
def test_stars_by_day_stand_in_the_way(sun_deg, is_told, align):
    made = fitted(session(200), STATED, replace(STATED, align=align))
    made.frames.columns["sun_altitude_deg"] = sun_deg
    assert [line.startswith(BY_DAY) for line in lines(made)] == [True] * is_told


@pytest.mark.parametrize(("frames", "is_told"), [(4, False), (5, True)])
def test_some_frames_by_day_are_enough(frames, is_told):
    made = session(200)
    made.frames.columns["sun_altitude_deg"] = -30.0
    made.frames.columns["sun_altitude_deg"][:frames] = 23.0
    assert [line.startswith(f"{BY_DAY}5 frames though the Sun stands 23 deg above") for line in lines(made)] == [
        True
    ] * is_told


def test_neither_an_emulator_nor_a_star_simulator_has_a_day():
    inertial = InertialDirection(ra_deg=10.0, de_deg=20.0)
    shown = session(200, station=STATION.model_copy(update={"mount": Mount(inertial=inertial)}))
    emulated = session(200)
    emulated.events = [LinkEvent(START_NS, 0, "TEST_STREAM", "")]
    for made in (shown, emulated):
        made.frames.columns["sun_altitude_deg"] = 23.0
        assert not any(line.startswith(BY_DAY) for line in lines(made))
    assert emulated.is_simulated


def test_the_gravest_obstacle_comes_first(steady):
    made = fitted(steady, replace(STATED, altitude_deg=10.0), replace(STATED, align="first 60 s"))
    told = lines(made, seconds(0, 1000, Cause.CLOCK_STEP, "a step"), rows=())
    assert [line.split(" ")[0] for line in told] == ["all", "1000", "the", "nothing"]
