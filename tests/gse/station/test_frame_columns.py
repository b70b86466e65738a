"""Frames of a long session lie in a temporary file: the same columns in little memory."""

import resource
from pathlib import Path

import numpy as np
import pytest
from skies.synthetic_night import synthetic_night

from gse.assessment.verdict import judge
from gse.report.summary import summarise
from gse.station.frame_columns import ColumnStore
from gse.station.frame_table import FRAME, MATCH, FrameTable

MIB = 1 << 20
NO_MATCHES = np.zeros(0, MATCH)


def some_rows(count: int, first: int = 0) -> np.ndarray:
    rows = np.zeros(count, FRAME)
    for place, name in enumerate(FRAME.names):
        rows[name] = (np.arange(first, first + count) * (place + 1)) % 251
    return rows


def resident_mib() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / MIB


def filled(table: FrameTable, count: int, at_once: int = 1000) -> FrameTable:
    for first in range(0, count, at_once):
        table.extend(some_rows(at_once, first), NO_MATCHES.copy())
    return table


def on_disk(most_in_memory: int = 500) -> FrameTable:
    table = FrameTable()
    table.use_disk(most_in_memory)
    return table


def test_columns_are_the_same_before_and_after_they_move_to_the_disk_and_when_their_file_grows():
    table = on_disk()
    expected = some_rows(400_000)
    for count in (300, 1000, 100_000, 400_000):
        table.extend(expected[len(table) : count], NO_MATCHES.copy())
        assert table._frames.is_on_disk == (count > 500)
        assert table.columns.rows().tobytes() == expected[:count].tobytes()


def test_columns_on_the_disk_can_be_written_by_view_part_and_name():
    table = filled(on_disk(), 2000)
    table.columns["ra_deg"][5:7] = 77.0
    part = table.columns[10:20]
    part["de_deg"] = 5.0
    table.columns["roll_deg"] += 1.0
    assert table.columns["ra_deg"][4:8].tolist() == [
        *some_rows(8)["ra_deg"][4:5],
        77.0,
        77.0,
        *some_rows(8)["ra_deg"][7:],
    ]
    assert (table.columns["de_deg"] == 5.0).sum() >= 10
    assert table.columns["roll_deg"][3] == some_rows(4)["roll_deg"][3] + 1
    assert len(part) == 10


def test_some_rows_come_in_the_order_in_which_they_are_asked_for():
    columns, expected = filled(on_disk(), 2000).columns, some_rows(2000)
    is_even = np.arange(2000) % 2 == 0
    for places in (is_even, np.array([7, 3, 1999]), slice(600, 900)):
        assert columns.rows(places).tobytes() == expected[places].tobytes()


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="resident memory is read from Linux's files")
def test_a_day_of_frames_takes_less_memory_than_its_columns_while_it_is_filled_and_read():
    before_mib, most_mib = resident_mib(), 0.0
    table = on_disk()
    for first in range(0, 400_000, 4000):
        table.extend(some_rows(4000, first), NO_MATCHES.copy())
        most_mib = max(most_mib, resident_mib())
    for name in FRAME.names:
        assert len(table.columns[name].tolist()[:1]) == 1
        float(np.sum(table.columns[name]))
        most_mib = max(most_mib, resident_mib())
    whole_mib = 400_000 * FRAME.itemsize / MIB
    assert whole_mib > 60
    assert most_mib - before_mib < whole_mib / 2


def test_without_room_on_the_disk_frames_stay_in_memory():
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (MIB, limits[1]))
    try:
        table = filled(on_disk(), 3000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    store = table._frames
    assert not store.is_on_disk
    table.extend(some_rows(1000, 3000), NO_MATCHES.copy())
    assert table._frames is store  # the disk is asked once
    assert table.columns.rows().tobytes() == some_rows(4000).tobytes()


@pytest.mark.parametrize(("rows", "is_made"), [(1000, True), (10**15, False)])
def test_a_file_for_which_the_disk_has_no_room_is_not_made(rows: int, is_made: bool) -> None:
    """A row takes more than a hundred bytes: no disk has room for 10^15 of them."""
    store = ColumnStore(FRAME, 0)
    assert store._map_file(rows) is is_made
    assert store.is_on_disk is is_made


def test_a_session_on_the_disk_is_judged_as_one_in_memory():
    kept, moved = synthetic_night(1500), synthetic_night(1500)
    moved.frames.use_disk(0)
    assert moved.frames._frames.is_on_disk
    assert summarise(moved, judge(moved)) == summarise(kept, judge(kept))
