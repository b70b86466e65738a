"""Frames and answers that no count covers: the numbers at which they leave a share open."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from skies.known_nights import START_NS, STATION, session

from gse.station.columns import FRAME
from gse.station.events import ClockStep, StationKind
from gse.station.exclusions import Cause, Exclusion
from gse.station.results import Subject
from gse.station.session_tables import MATCH
from gse.statistics.session_statistics import statistics
from gse.values.instant import NS_PER_S
from gse.verdict.obstacles import _answers_not_compared, missing_by_time, obstacles
from protocols import AttitudeMessage


def frames(seconds, *, tags_s=None):
    """Frames that the host reads at these seconds, with tags of the same."""
    made = np.zeros(len(seconds), dtype=FRAME)
    made["host_utc_ns"] = made["utc_ns"] = START_NS + np.round(np.asarray(seconds) * NS_PER_S).astype(np.int64)
    made["time_us"] = np.round((np.asarray(seconds) if tags_s is None else np.asarray(tags_s)) * 1e6)
    return made


def spaced(gap_s, count=20):
    """A frame a second, and one pause of so long in the middle."""
    seconds = np.arange(count, dtype=float)
    seconds[count // 2 :] += gap_s - 1
    return seconds


@pytest.mark.parametrize(
    ("gap_s", "missing"),
    [(1.0, 0), (1.4, 0), (1.6, 1), (2.0, 1), (2.4, 1), (2.6, 2), (60.0, 59), (60.001, 0), (61.0, 0)],
)
def test_whole_frames_that_fit_into_a_pause_of_a_minute_at_most_are_missing(gap_s, missing):
    assert missing_by_time(frames(spaced(gap_s))) == missing


@pytest.mark.parametrize(("count", "missing"), [(15, 0), (16, 4), (17, 4)])
def test_more_than_fifteen_frames_tell_their_rate(count, missing):
    assert missing_by_time(frames(spaced(5.0, count))) == missing


@pytest.mark.parametrize(
    ("host_gap_s", "tag_gap_s", "missing"), [(5.0, 9.0, 4), (9.0, 5.0, 4), (1.0, 9.0, 0), (9.0, 1.0, 0)]
)
def test_the_lesser_of_both_clocks_counts(host_gap_s, tag_gap_s, missing):
    assert missing_by_time(frames(spaced(host_gap_s), tags_s=spaced(tag_gap_s))) == missing


def test_without_stamps_of_the_host_the_tags_count_alone():
    made = frames(spaced(1.0), tags_s=spaced(5.0))
    assert missing_by_time(made) == 0
    made["host_utc_ns"][3] = 0
    assert missing_by_time(made) == 4


@pytest.mark.parametrize(("row", "missing"), [(8, 4), (9, 0), (10, 0), (11, 4)])
def test_beside_a_frame_that_is_excused_none_is_missing(row, missing):
    excused = np.zeros(20, dtype=bool)
    excused[row] = True
    assert missing_by_time(frames(spaced(5.0)), excused) == missing


def test_where_a_tag_stands_still_the_host_counts():
    seconds = spaced(5.0)
    standing = np.where(np.arange(20) < 8, seconds, 7.0)
    assert missing_by_time(frames(seconds, tags_s=standing)) == 4


@pytest.mark.parametrize(("restarts", "missing"), [(2, 0), (3, 12)])
def test_three_restarts_are_too_many(restarts, missing):
    """Each comes five seconds after the last frame before it."""
    seconds = np.arange(40, dtype=float)
    tags_s = seconds.copy()
    for number in range(1, restarts + 1):
        seconds[10 * number :] += 4.0
        tags_s[10 * number :] = np.arange(40 - 10 * number)
    assert missing_by_time(frames(seconds, tags_s=tags_s)) == missing


def test_a_frame_that_comes_early_makes_up_for_none_that_is_missing():
    seconds = spaced(2.0)
    seconds[15:] -= 0.6  # two fifths of a second after the frame before it
    assert missing_by_time(frames(seconds)) == 1


def test_tags_that_stand_still_tell_no_rate_and_so_no_missing_frame():
    made = frames(spaced(5.0), tags_s=np.zeros(20))
    made["host_utc_ns"] = 0
    assert missing_by_time(made) == 0


def test_the_rate_is_that_of_the_fifteen_frames_about_a_pause():
    """A sensor that is told to send every two seconds misses none; two pauses among its slow frames are its own."""
    seconds = np.cumsum(np.r_[np.ones(30), np.full(30, 2.0)])
    assert missing_by_time(frames(seconds)) == 0
    seconds[45:] += 6.0
    assert missing_by_time(frames(seconds)) == 3
    seconds[15:] += 3.0
    assert missing_by_time(frames(seconds)) == 6


# In a session


def night(missing=6, *, lost=0):
    """A hundred frames less some in the middle, which the sensor's own numbers do not tell."""
    made, whole = session(0), session(100).frames.columns.rows()
    rows = np.delete(whole, np.s_[40 : 40 + missing])
    rows["frame_no"] = np.arange(len(rows))
    made.frames.extend(rows, np.zeros(0, MATCH))
    made.link.frames_lost = lost
    return made


def uncounted(made):
    found = obstacles(made, statistics(made), ())
    return [line for line in found if line.startswith("by time") or "belong to no panorama" in line]


def lines(made):
    return [line.split(" frames")[0] for line in uncounted(made)]


@pytest.mark.parametrize(
    ("missing", "lost", "told"),
    [
        (6, 0, ["by time 6"]),
        (6, 1, ["by time 5"]),
        (6, 5, ["by time 1"]),
        (6, 6, []),
        (6, 7, []),
        (5, 0, []),
        (10, 8, ["by time 2"]),
    ],
)
def test_frames_that_the_sequence_numbers_tell_are_not_told_again(missing, lost, told):
    assert lines(night(missing, lost=lost)) == told


@pytest.mark.parametrize(
    ("cause", "told"),
    [(Cause.OPERATOR, []), (Cause.NO_SKY, []), (Cause.CLOCK_STEP, ["by time 6"]), (Cause.BACKLOG, ["by time 6"])],
)
def test_a_pause_is_the_operators_or_the_skys(cause, told):
    made = night()
    made.excluded = (Exclusion(START_NS + 35 * NS_PER_S // 10, START_NS + 4 * NS_PER_S, "so", cause),)
    assert lines(made) == told


@pytest.mark.parametrize(("utc_kept", "told"), [(True, []), (False, ["by time 6"])])
def test_while_the_host_slept_none_is_missing(utc_kept, told):
    made = night()
    at_ns = int(made.frames.columns["host_utc_ns"][40]) - 1
    made.events.append(ClockStep(at_ns, 0, StationKind.CLOCK_STEP, "asleep", 0, utc_kept))
    assert lines(made) == told


def test_a_suspension_after_the_last_frame_excuses_nothing():
    made = night()
    made.events.append(ClockStep(START_NS + 100 * NS_PER_S, 0, StationKind.CLOCK_STEP, "asleep", 0, True))
    assert lines(made) == ["by time 6"]


def with_answers(others, *, lost=0):
    """Ninety-nine answers to panoramas, and so many to none."""
    made = session(99)
    for row in made.frames.columns.rows():
        message = AttitudeMessage(int(row["time_us"]), 10.0, 20.0, 30.0, int(row["frame_no"]), 12, "acquired", 0.08)
        made.sensor_attitudes.append(int(row["utc_ns"]), message)
    for number in range(others):
        made.sensor_attitudes.append(START_NS, AttitudeMessage(10**9 + number, 10.0, 20.0, 30.0, 0, 12, "acquired"))
    made.link.frames_lost = lost
    return made


@pytest.mark.parametrize(("others", "lost", "count"), [(0, 0, 0), (1, 0, 0), (2, 0, 2), (3, 1, 2), (3, 2, 0)])
def test_more_answers_than_may_be_false_must_have_a_panorama_but_for_those_lost_on_the_way(others, lost, count):
    """One in a hundred may be false."""
    made = with_answers(others, lost=lost)
    told = [line for line in uncounted(made) if line.startswith("sensor")]
    assert [line.split(" belong")[0] for line in told] == [f"sensor: {count} of its answers"] * (count > 0)


@pytest.mark.parametrize(
    ("false_share", "others", "given", "is_told"),
    [
        (0.5, 1, 0, True),  # one of one
        (0.5, 1, 1, False),  # one of two
        (0.5, 2, 1, True),
        (1.0, 1, 0, False),
        (0.25, 3, 9, False),
        (0.25, 4, 9, True),
    ],
)
def test_answers_to_nothing_count_among_those_that_were_compared_and_themselves(false_share, others, given, is_told):
    station = STATION.model_copy(update={"limits": replace(STATION.limits, false_share=false_share)})
    made = session(0, station=station)
    for number in range(others):
        made.sensor_attitudes.append(START_NS, AttitudeMessage(10**9 + number, 10.0, 20.0, 30.0, 0, 12, "acquired"))
    own = SimpleNamespace(acquired=np.arange(20) < given) if given else None
    told = list(_answers_not_compared(made, SimpleNamespace(own=own)))
    assert [line.split(" belong")[0] for line in told] == [f"sensor: {others} of its answers"] * is_told


def test_answers_alone_are_the_subject_and_answers_to_nothing_are_not_compared():
    alone = with_answers(50)
    alone.subject = Subject.SENSOR
    assert not [line for line in uncounted(alone) if line.startswith("sensor")]
    without = session(20)
    without.sensor_attitudes.append(START_NS, AttitudeMessage(10**9, 10.0, 20.0, 30.0, 0, 12, "acquired"))
    assert [line.split(" belong")[0] for line in uncounted(without)] == ["sensor: 1 of its answers"]
