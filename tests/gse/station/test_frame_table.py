"""A long night in little memory: frames are all kept, their matches thinned out evenly."""

import math

import numpy as np
import pytest
from devices.mapped_memory import lies_on_disk
from skies.one_by_one import Light, Made, Stars, add_frame, results_of
from skies.synthetic_night import synthetic_frames

from gse.identifier import Identification
from gse.station.columns import FRAME
from gse.station.results import Status
from gse.station.session_tables import MATCH, MOST_IN_MEMORY, MOST_MATCHES, OTHER, FrameTable
from gse.values.panorama import Panorama


def test_every_frame_and_every_match_of_a_short_night_is_kept():
    frames = list(synthetic_frames(50, trouble=False))
    table = FrameTable()
    for frame in frames:
        add_frame(table, frame)
    assert table.columns["utc_ns"].tolist() == [frame.panorama.utc_ns for frame in frames]
    assert np.bincount(table.matches["frame"]).tolist() == [len(frame.matches) for frame in frames]


def test_objects_are_counted_up_to_255():
    counts = [0, 7, 255, 300]
    made = [Panorama(k, np.full((count, 2), 9.0), np.ones(count)) for k, count in enumerate(counts)]
    results = results_of([Made(one, Status.NO_MATCH, "", "neighbour") for one in made])
    assert results.rows["objects"].tolist() == [0, 7, 255, 255]
    assert results.rows["stars_seen"].tolist() == results.rows["matched"].tolist() == [0, 0, 0, 0]


def test_a_long_night_keeps_all_frames_and_the_matches_of_every_second_one_or_fewer():
    frame = next(iter(synthetic_frames(1, trouble=False)))
    table = FrameTable()
    count = 2 * MOST_MATCHES // len(frame.matches)
    hundred = results_of([frame] * 100)
    for _ in range(count // 100):
        table.extend(hundred.rows, hundred.match_rows())
    kept = np.unique(table.matches["frame"])
    assert len(table) == count // 100 * 100
    assert MOST_MATCHES / 4 < len(table.matches) <= MOST_MATCHES
    assert np.unique(np.diff(kept)).tolist() in ([2], [4])
    assert (np.bincount(table.matches["frame"])[kept] == len(frame.matches)).all()


@pytest.mark.parametrize("elapsed_us", [None, 0.0, 150.5])
def test_the_time_that_an_answer_took_is_kept_and_that_of_none_is_none(elapsed_us):
    made = Made(Panorama(1, np.zeros((2, 2)), np.ones(2)), Status.NO_MATCH, "", "neighbour", elapsed_us=elapsed_us)
    results = results_of([made])
    assert results[0].elapsed_us == elapsed_us
    assert results.rows["elapsed_us"] == pytest.approx([math.nan if elapsed_us is None else elapsed_us], nan_ok=True)


def test_named_stars_and_stars_seen_are_counted_up_to_255():
    made = []
    for k, count in enumerate([3, 255, 300]):
        panorama = Panorama(k, np.full((count, 2), 9.0), np.ones(count))
        every = np.arange(count)
        named, matches = Identification(every, every, 1e-9), Stars(every, every, np.zeros((count, 2)), str)
        light = Light(count, 14.5, 5.5, 80.0)
        made.append(Made(panorama, Status.IDENTIFIED, "", "neighbour", named, matches=matches, light=light))
    rows = results_of(made).rows
    assert rows["stars_seen"].tolist() == rows["matched"].tolist() == [3, 255, 255]
    assert rows["zero_point_mag"].tolist() == [14.5] * 3
    assert rows["limiting_mag"].tolist() == [5.5] * 3


def test_a_replay_of_two_hours_lies_in_memory_and_a_longer_one_on_the_disk():
    for count, on_disk in ((MOST_IN_MEMORY, False), (MOST_IN_MEMORY + 1, True)):
        table = FrameTable()
        table.use_disk()
        table.extend(np.zeros(count, FRAME), np.zeros(0, MATCH))
        assert lies_on_disk(table.columns) is on_disk
    assert 2 * 3600 * 10 * 0.8 < MOST_IN_MEMORY < 2 * 3600 * 10


def rows_of_frames(count):
    rows = np.zeros(count, FRAME)
    rows["frame_no"] = np.arange(count)
    return rows


def rows_of_others(*frames):
    rows = np.zeros(len(frames), OTHER)
    rows["frame"] = frames
    return rows


def rows_of_stars(*frames):
    rows = np.zeros(len(frames), MATCH)
    rows["frame"] = frames
    return rows


def test_a_table_has_room_for_fourteen_hours_at_ten_hertz_from_the_first():
    """504,000 frames; memory that is not written takes none."""
    assert 504_000 <= FrameTable()._frames.rows < 600_000


def test_a_table_that_is_full_gets_twice_the_room_that_it_needs_and_not_before():
    """Room for 1, then for 4, then for 10: where its columns lie in memory shows it."""
    table, moved = FrameTable.from_rows(rows_of_frames(1), rows_of_stars()), []
    for number in range(1, 11):
        before = table.columns["frame_no"].ctypes.data
        table.extend(rows_of_frames(number + 1)[number:], rows_of_stars(0))
        moved += [number] if table.columns["frame_no"].ctypes.data != before else []
    assert moved == [1, 4, 10]
    assert table.columns["frame_no"].tolist() == list(range(11))
    assert table.matches["frame"].tolist() == list(range(1, 11))


def test_a_table_of_given_rows_is_what_they_are_and_takes_more():
    table = FrameTable.from_rows(rows_of_frames(3), rows_of_stars(0, 2))
    assert (len(table), table.columns["frame_no"].tolist()) == (3, [0, 1, 2])
    table.extend(rows_of_frames(2), rows_of_stars(0, 1, 1))
    assert table.columns["frame_no"].tolist() == [0, 1, 2, 0, 1]
    assert table.matches["frame"].tolist() == [0, 2, 3, 4, 4]


def test_rows_that_are_filled_by_column_begin_as_nothing():
    table = FrameTable.with_rows(4, rows_of_stars(3))
    assert (len(table), table.columns["utc_ns"].tolist(), table.matches["frame"].tolist()) == (4, [0] * 4, [3])
    assert not lies_on_disk(table.columns)


@pytest.mark.parametrize(("count", "on_disk"), [(0, False), (10, False), (11, True)])
def test_rows_lie_on_the_disk_where_they_are_more_than_memory_may_hold_and_move_there_at_once(count, on_disk):
    given = FrameTable.with_rows(count, rows_of_stars(), most_in_memory=10)
    assert (len(given), lies_on_disk(given.columns), given.columns["frame_no"].tolist()) == (
        count,
        on_disk,
        [0] * count,
    )
    table = FrameTable()
    table.extend(rows_of_frames(count), rows_of_stars())
    table.use_disk(10)
    assert lies_on_disk(table.columns) is on_disk
    assert table.columns["frame_no"].tolist() == list(range(count))


@pytest.mark.parametrize(("more", "latest_frame"), [(0, 1), (1, 0)])
def test_so_many_matches_are_kept_and_one_more_costs_those_of_every_second_frame(more, latest_frame):
    """All of them but the last are of the first frame."""
    table = FrameTable()
    table.extend(rows_of_frames(1), np.zeros(MOST_MATCHES + more - 1, MATCH))
    table.extend(rows_of_frames(1), rows_of_stars(0))
    assert (len(table), len(table.matches)) == (2, MOST_MATCHES)
    assert table.matches["frame"][-1] == latest_frame


def test_other_objects_are_thinned_by_themselves_and_pictures_are_of_frames_with_all_of_theirs():
    table, four = FrameTable(), rows_of_frames(4)
    table.extend(four, rows_of_stars(0, 1, 2, 3), rows_of_others(0, 1, 2, 3))
    assert (table.picture_stride, len(table.others)) == (1, 4)
    table.extend(four, rows_of_stars(0, 1, 2, 3), rows_of_others(*[1] * MOST_MATCHES, 2))
    assert (table.picture_stride, table.matches["frame"].tolist()) == (2, [0, 1, 2, 3, 4, 5, 6, 7])
    assert table.others["frame"].tolist() == [0, 2, 6]
    taken = table.snapshot()
    table.extend(four, rows_of_stars(), rows_of_others(0, 1))
    assert (len(taken.others), table.others["frame"].tolist()) == (3, [0, 2, 6, 8])
    given = FrameTable.with_rows(8, table.matches, table.others, stride=2)
    assert (given.picture_stride, given.others["frame"].tolist()) == (2, [0, 2, 6, 8])


def test_a_snapshot_stays_as_it_was_while_the_table_goes_on():
    table = FrameTable.from_rows(rows_of_frames(2), rows_of_stars(1))
    taken = table.snapshot()
    table.extend(rows_of_frames(1), rows_of_stars(0))
    table.columns["frame_no"] = 9
    assert (len(taken), taken.columns["frame_no"].tolist(), taken.matches["frame"].tolist()) == (2, [0, 1], [1])
    taken.extend(rows_of_frames(1), rows_of_stars(0))
    assert (len(taken), len(table)) == (3, 3)
