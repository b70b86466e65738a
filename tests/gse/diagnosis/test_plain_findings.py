"""What events, counts and rates say by themselves: each limit from both sides, each word."""

from dataclasses import replace

import numpy as np
import pytest
from skies.known_nights import START_NS, STATION, session

from drivers.chunk import LinkEvent, LinkKind
from gse.diagnosis.plain_findings import (
    event_findings,
    faulty_panoramas,
    hot_pixels,
    moon_near,
    nothing_identified,
    ran_away_s,
    sensor_clock_drift,
)
from gse.station.columns import ANSWER_CHECKS, SKY_CONDITIONS, STATUSES
from gse.station.events import ClockStep, StationKind
from gse.station.exclusions import Cause, Exclusion
from gse.station.own_answers import SensorAnswers
from gse.station.results import AnswerCheck, SkyCondition, Status
from gse.statistics.counted_frames import counted_frames
from gse.statistics.excuses import BY_MOON, air_in_field
from gse.statistics.session_statistics import statistics
from gse.values.mount import Mount


def event(kind):
    return LinkEvent(START_NS, 0, kind, f"what {kind} says")


def step(step_ns=5_000_000, *, utc_kept=False):
    return ClockStep(START_NS, 0, StationKind.CLOCK_STEP, "the clock stepped", step_ns, utc_kept)


def told(*events, frames=0, named=()):
    made = session(frames)
    made.events.extend(events)
    return list(event_findings(made, set(named)))


@pytest.mark.parametrize(
    ("kind", "cause", "equals", "following"),
    [
        (StationKind.MIRRORED, "mirrored image",
         ("x and y exchanged (in the protocol description, or by the sensor)",), "gse calibrate SESSION"),
        (StationKind.WRONG_CAMERA, "focal length", ("distortion of the lens",), "gse calibrate fits it"),
        (StationKind.WRONG_DETECTOR, "detector size", (), "gse report SESSION --station FILE"),
        (LinkKind.NOT_RUN, "station stopped", (), "stop no session"),
        (LinkKind.LINE_FULL, "full line", (), "raise the baud rate"),
        (StationKind.NO_STATION, "station file", (), "gse report SESSION --station FILE"),
        (StationKind.SEQUENCE_CHAOS, "sequence numbers", (), "gse decode SESSION --explain"),
        (StationKind.FROZEN, "frozen sensor", (), "switch the sensor off and on"),
    ],
)  # fmt: skip
def test_an_event_is_a_finding_unless_a_named_cause_says_it(kind, cause, equals, following):
    (found,) = told(event(kind))
    assert (found.cause, found.size, found.equals, found.is_gross) == (cause, f"what {kind} says", equals, False)
    assert following in found.next_step
    assert told(event(kind), named=[cause]) == []


def test_a_mirrored_image_is_told_and_not_the_camera_that_follows_from_it():
    assert [one.cause for one in told(event(StationKind.WRONG_CAMERA), event(StationKind.MIRRORED))] == [
        "mirrored image"
    ]


def test_a_step_of_the_clock_is_told_and_one_of_the_monotonic_clock_as_that():
    (found,) = told(step())
    assert (found.cause, found.size) == ("clock step", "the clock stepped")
    (kept,) = told(step(utc_kept=True))
    assert (kept.cause, kept.size) == ("monotonic clock", "the clock stepped")
    assert "systemd-inhibit" in kept.next_step
    assert [one.cause for one in told(step(utc_kept=True), step())] == ["monotonic clock", "clock step"]
    assert told() == []


@pytest.mark.parametrize(
    ("frames", "steps", "runs_away"), [(0, 10, False), (0, 11, True), (9, 14, False), (9, 15, True)]
)
@pytest.mark.parametrize("step_ns", [5_000_000, -5_000_000])
def test_a_clock_that_steps_more_than_ten_times_and_in_half_the_frames_runs_away(frames, steps, runs_away, step_ns):
    made = session(frames)
    made.events.extend([step(step_ns)] * steps)
    total_s = steps * step_ns / 1e9
    assert ran_away_s(made) == pytest.approx(total_s if runs_away else 0.0)
    (found,) = event_findings(made, set())
    assert found.cause == ("clock drift" if runs_away else "clock step")
    assert not runs_away or f"by {total_s:+.3f} s, a little with each frame" in found.size
    assert [one.cause for one in event_findings(made, {"clock drift"})] == [] if runs_away else ["clock step"]


def test_steps_to_and_fro_or_of_the_monotonic_clock_do_not_run_away():
    made = session(0)
    made.events.extend([step()] * 20 + [step(-1)])
    assert ran_away_s(made) == 0.0
    made.events[:] = [step(utc_kept=True)] * 20
    assert ran_away_s(made) == 0.0


@pytest.mark.parametrize(("last_ns", "total_s"), [(1, 0.1), (-1, 0.0), (0, 0.0)])
def test_each_step_goes_the_same_way_however_small(last_ns, total_s):
    made = session(0)
    made.events.extend([*[step()] * 20, step(last_ns)])
    assert ran_away_s(made) == pytest.approx(total_s, abs=1e-6)


# Nothing identified


def night(count=20, *, identified=0, no_match=0, failed=0, absent=0, mount=STATION.mount):
    """Frames of these statuses, the others too few objects; the reference identifier alone names the ``absent``."""
    made = session(count, station=STATION.model_copy(update={"mount": mount}))
    columns = made.frames.columns
    statuses = [Status.IDENTIFIED] * identified + [Status.NO_MATCH] * no_match + [Status.IDENTIFIER_FAULT] * failed
    statuses += [Status.TOO_FEW] * (count - len(statuses))
    columns["status"] = [STATUSES.index(status) for status in statuses]
    columns["answer_check"] = ANSWER_CHECKS.index(AnswerCheck.UNKNOWN)
    columns["answer_check"][count - absent :] = ANSWER_CHECKS.index(AnswerCheck.ABSENT)
    columns["stars_seen"], columns["stars_expected"], columns["objects"] = 20, 30.0, 20
    return made


def causes(made):
    return [one.cause for one in nothing_identified(made)]


@pytest.mark.parametrize(
    ("counts", "found"),
    [
        ({"no_match": 1}, ["nothing identified"]),
        ({"no_match": 20}, ["nothing identified"]),
        ({}, []),
        ({"no_match": 19, "identified": 1}, []),
        ({"failed": 11, "no_match": 9}, ["identifier fails"]),
        ({"failed": 10, "no_match": 9}, ["nothing identified"]),
        ({"failed": 11, "no_match": 8, "identified": 1}, []),
        ({"absent": 11}, ["identifier without an answer"]),
        ({"absent": 10}, []),
        ({"identified": 9, "absent": 11}, ["identifier without an answer"]),
        ({"failed": 11, "absent": 9}, ["identifier fails"]),
    ],
)
def test_more_than_half_of_the_panoramas_tell_what_the_identifier_does(counts, found):
    assert causes(night(**counts)) == found


@pytest.mark.parametrize(
    ("kinds", "is_told"),
    [
        ([], True),
        ([StationKind.DAYLIGHT], False),
        ([StationKind.DAYLIGHT, StationKind.DARK_NIGHT], True),
        ([StationKind.DARK_NIGHT], True),
        ([StationKind.WRONG_CAMERA], False),
        ([StationKind.MIRRORED], False),
        ([StationKind.WRONG_DETECTOR], False),
    ],
)
def test_day_and_a_named_camera_explain_a_night_without_an_answer(kinds, is_told):
    made = night(no_match=20)
    made.events.extend(event(kind) for kind in kinds)
    assert causes(made) == ["nothing identified"] * is_told


def test_panoramas_without_an_answer_are_counted_in_words():
    (one,) = nothing_identified(night(no_match=1))
    assert one.size.startswith("not one of 1 panorama with enough objects was identified")
    assert len(one.equals) == 2
    (failed,) = nothing_identified(night(failed=11, no_match=9))
    assert failed.size == "the external identifier failed on 11 of 20 panoramas, and identified none"


def without_answer(*, answered=0, seen=20, expected=30.0, objects=20, external=False):
    made = night(identified=answered, absent=20 - answered)
    columns = made.frames.columns
    columns["stars_seen"], columns["stars_expected"], columns["objects"] = seen, expected, objects
    if external:
        identifier = replace(made.station.identifier, algorithm="external", command=["program"])
        made.station = made.station.model_copy(update={"identifier": identifier})
    (found,) = nothing_identified(made)
    return found


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({}, "answers none of 20 panoramas; the reference identifier does, and 20 stars of the sky are in each"),
        (
            {"answered": 3},
            "answers 3 of 20 panoramas; the reference identifier does, and 20 stars of the sky are in each",
        ),
        ({"expected": 19.0}, "20 stars of the sky are in each, of which its catalogue holds 19"),
        ({"expected": 20.0}, "20 stars of the sky are in each"),
        ({"expected": 0.0}, "20 stars of the sky are in each, of which its catalogue holds 0"),
        ({"expected": np.nan}, "20 stars of the sky are in each"),
        ({"objects": 21}, "20 stars of the sky are in each; 1 of 21 objects are none of them"),
        ({"objects": 19}, "20 stars of the sky are in each"),
        (
            {"expected": 5.0, "objects": 30},
            "in each, of which its catalogue holds 5; 10 of 30 objects are none of them",
        ),
    ],
)
def test_an_identifier_without_an_answer_is_told_with_the_stars_of_the_sky(values, words):
    assert without_answer(**values).size.endswith(words)


@pytest.mark.parametrize(
    ("seen", "objects", "is_lens"),
    [(20, 25, False), (20, 26, True), (40, 51, False), (40, 52, True), (10, 16, True), (10, 15, False)],
)
def test_six_objects_and_three_in_ten_that_are_no_stars_may_be_a_lens(seen, objects, is_lens):
    equals = without_answer(seen=seen, objects=objects, expected=5.0).equals
    assert equals[0] == "a fault of the identifier"
    assert [text.split(" of")[0] for text in equals[1:]] == ["a distortion"] * is_lens


@pytest.mark.parametrize(
    ("expected", "seen", "is_lens"), [(12.0, 20, True), (11.0, 20, False), (30.0, 12, True), (30.0, 11, False)]
)
def test_a_catalogue_of_twice_the_stars_of_an_answer_is_not_short_so_that_it_may_be_a_lens(expected, seen, is_lens):
    """Six stars make an answer."""
    equals = without_answer(seen=seen, objects=seen, expected=expected).equals
    assert [text.split(" of")[0] for text in equals[1:]] == ["a distortion"] * is_lens


@pytest.mark.parametrize("external", [True, False])
def test_an_external_identifier_has_a_catalogue_of_its_own(external):
    words = "a catalogue of its own with more stars" if external else "more stars (identifier.catalog_stars)"
    assert without_answer(external=external).next_step.startswith(f"let it know {words}, and try: ")


def test_air_that_parts_the_stars_is_told_before_the_catalogue():
    made = night(absent=20, mount=Mount(azimuth_deg=180.0, altitude_deg=12.0))
    air = air_in_field(made)
    (found,) = nothing_identified(made)
    assert air
    assert found.size.startswith(
        "the identifier under test answers none of 20 panoramas; the reference identifier does: "
    )
    assert found.size.endswith(f"does: {air}, and it knows no air")
    assert found.equals == ("a fault of the identifier",)
    assert "point the sensor higher" in found.next_step


# Counts and rates


@pytest.mark.parametrize(
    ("faulty", "words"),
    [(1, []), (2, ["in 2 of 20 panoramas the sensor reports"]), (11, ["11 of 20 panoramas cannot be: the sensor"])],
)
def test_faulty_panoramas_are_named_where_they_are_more_than_may_be_without_an_answer(faulty, words):
    """Of a limit of 95 % one of twenty may be."""
    made = session(20)
    made.frames.columns["status"][:faulty] = STATUSES.index(Status.SENSOR_FAULT)
    found = list(faulty_panoramas(made, counted_frames(made)))
    assert [one.size[: len(text)] for one, text in zip(found, words, strict=True)] == words


@pytest.mark.parametrize(
    ("ppm", "error_ppm", "words"),
    [
        (100.0, 0.0, None),
        (100.1, 0.0, "it runs 100 ppm slow against the host's"),
        (-100.1, 0.0, "it runs 100 ppm fast against the host's"),
        (150.0, 50.0, None),
        (150.1, 50.0, "it runs 150 ppm slow against the host's"),
        (-149.0, 50.0, None),
        (np.nan, np.nan, None),
    ],
)
def test_a_drift_of_a_sensor_clock_is_more_than_a_crystal_and_three_of_its_errors(ppm, error_ppm, words):
    stats = statistics(session(2))
    clock = replace(stats.clock, sensor_drift_ppm=ppm, sensor_drift_error_ppm=error_ppm)
    found = list(sensor_clock_drift(replace(stats, clock=clock)))
    assert [one.size for one in found] == ([words] if words else [])


@pytest.mark.parametrize(
    ("pixels", "listed", "words"),
    [
        ([9] * 15 + [0] * 5, 0, None),
        ([0] * 15 + [3] * 5, 0, "3 objects of a frame"),
        ([0] * 14 + [2, 3, 4, 4, 4, 0], 0, "4 objects of a frame"),
        ([0] * 15 + [1] * 5, 1, None),
        ([0] * 15 + [2] * 5, 1, "2 objects of a frame"),
        ([0, 5, 5, 5], 0, "5 objects of a frame"),
        ([5, 5, 5], 0, None),
        ([], 0, None),
    ],
)
def test_hot_pixels_are_those_of_the_last_quarter_beyond_the_listed_ones(pixels, listed, words):
    """By its median, once the sky has moved."""
    made = session(len(pixels))
    made.frames.columns["hot_pixels"] = pixels
    sensor = made.station.sensor.model_copy(update={"hot_pixels": [(5, 5)] * listed})
    made.station = made.station.model_copy(update={"sensor": sensor})
    found = list(hot_pixels(made))
    assert [one.size.split(" (median)")[0] for one in found] == ([words] if words else [])


def under_the_moon(off_deg, absent, *, up_deg=40.0, hidden=8, false=10, elsewhere=0, count=200):
    """Of so many frames the first half have the Moon so far off; so many of them have no answer, and glare instead."""
    made = session(count)
    frames, half = made.frames.columns, count // 2
    near, missing = slice(0, half), np.r_[0:absent, half : half + elsewhere]
    frames["sun_altitude_deg"], frames["moon_altitude_deg"] = -40.0, up_deg
    frames["moon_separation_deg"], frames["moon_separation_deg"][near] = 60.0, off_deg
    frames["stars_expected"], frames["stars_seen"], frames["objects"] = 20, 18, 19
    frames["status"][missing] = STATUSES.index(Status.NO_MATCH)
    frames["stars_seen"][missing], frames["objects"][missing] = 18 - hidden, 18 - hidden + 1 + false
    return made


def moons(made, own=None):
    stats = statistics(made)
    return list(moon_near(made, replace(stats, own=own)))


FIELD_DEG = np.degrees(STATION.sensor.camera().diagonal_rad) / 2


@pytest.mark.parametrize(
    ("off_deg", "more", "where"),
    [
        (FIELD_DEG - 1, {}, "in the field"),
        (FIELD_DEG + 9, {}, "near the field"),
        (FIELD_DEG + 11, {}, None),
        (FIELD_DEG - 1, {"up_deg": -1.0}, None),
        (FIELD_DEG - 1, {"elsewhere": 40}, None),
        (FIELD_DEG - 1, {"elsewhere": 5}, "in the field"),
        (FIELD_DEG - 1, {"hidden": 2, "false": 2}, None),
        (FIELD_DEG - 1, {"hidden": 3, "false": 0}, "in the field"),
        (FIELD_DEG - 1, {"hidden": 0, "false": 3}, "in the field"),
        (FIELD_DEG - 1, {"hidden": 18, "false": -1}, None),
    ],
)
def test_the_moon_is_named_where_answers_are_missing_beside_it_and_glare_is_seen(off_deg, more, where):
    found = moons(under_the_moon(off_deg, 60, **more))
    assert len(found) == bool(where)
    if where:
        absent = 60 + more.get("elsewhere", 0)
        assert found[0].size.startswith(f"it was {where} in 60 of {absent} frames without an answer of onboard: ")
        assert f"{off_deg:.1f} to {off_deg:.1f} deg from the boresight" in found[0].size
        assert "40 to 40 deg up" in found[0].size


@pytest.mark.parametrize(("absent", "is_told"), [(4, False), (5, False), (6, True)])
def test_so_few_missing_answers_as_the_limit_allows_are_not_the_moons(absent, is_told):
    assert bool(moons(under_the_moon(3.0, absent))) is is_told


@pytest.mark.parametrize(
    ("off_deg", "hidden", "is_told"), [(3.0, 12, True), (3.0, 7, False), (FIELD_DEG + 1, 12, False)]
)
def test_a_moon_that_is_there_all_the_time_is_named_where_it_is_in_the_field(off_deg, hidden, is_told):
    made = under_the_moon(off_deg, 100, hidden=hidden, false=-1, elsewhere=100)
    made.frames.columns["moon_separation_deg"] = off_deg
    assert bool(moons(made)) is is_told


def test_the_moon_is_named_for_the_sensors_own_answers_too():
    made = under_the_moon(3.0, 0)
    frames = made.frames.columns
    frames["stars_seen"][:60], frames["objects"][:60] = 10, 20
    own = SensorAnswers(np.ones(200, dtype=bool), np.arange(200) >= 60, *[np.zeros(200)] * 11)
    (found,) = moons(made, own)
    assert "60 of 60 frames without an answer of sensor: " in found.size


def test_what_is_left_out_because_of_a_cloud_is_not_the_moons():
    made = under_the_moon(FIELD_DEG + 9, 60)
    made.frames.columns["sky_condition"][:60] = SKY_CONDITIONS.index(SkyCondition.NO_STARS)
    assert moons(made)
    stats = statistics(made)
    begin, end = (int(made.frames.columns["utc_ns"][row]) for row in (0, 60))
    for reason, is_named in (("cloud", False), (f"{BY_MOON}, 3.0 deg from the boresight", True)):
        left_out = Exclusion(begin, end, reason, Cause.NO_SKY)
        counted = replace(stats.counted, exclusions=(left_out,))
        assert bool(list(moon_near(made, replace(stats, own=None, counted=counted)))) is is_named
