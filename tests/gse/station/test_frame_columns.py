"""Frames of a long session lie in a temporary file: the same columns in little memory."""

import mmap
import resource
import shutil
import tempfile
from pathlib import Path

import numpy as np
import pytest
from devices.mapped_memory import lies_on_disk
from skies.synthetic_night import synthetic_night

from gse.report.summary import summarise
from gse.station.columns import FRAME
from gse.station.frame_columns import GIVE_BACK_BYTES, ColumnStore, FrameColumns, InOrder
from gse.station.session_tables import MATCH, FrameTable
from gse.verdict.assessment import judge

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
        assert lies_on_disk(table.columns) == (count > 500)
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
    assert not lies_on_disk(table.columns)
    place = table.columns["utc_ns"].ctypes.data
    table.extend(some_rows(1000, 3000), NO_MATCHES.copy())
    assert table.columns["utc_ns"].ctypes.data == place  # the disk is asked once
    assert table.columns.rows().tobytes() == some_rows(4000).tobytes()


def test_a_session_on_the_disk_is_judged_as_one_in_memory():
    kept, moved = synthetic_night(1500), synthetic_night(1500)
    moved.frames.use_disk(0)
    assert lies_on_disk(moved.frames.columns)
    assert summarise(moved, judge(moved)) == summarise(kept, judge(kept))


# A store of columns, by hand

SMALL = np.dtype([("a", "i8"), ("b", "f4"), ("c", "u1")])


def small_rows(count, first=0):
    rows = np.zeros(count, SMALL)
    for name in SMALL.names:
        rows[name] = np.arange(first, first + count)
    return rows


def small_store(count, *, on_disk=False, room=0):
    """A store with so many rows and no more room, or with ``room`` of it."""
    store = ColumnStore(SMALL, 0).with_room(max(count, room), on_disk=on_disk)
    store.extend(small_rows(count))
    return store


def test_a_store_has_the_room_that_it_was_given_and_no_rows_yet():
    store = ColumnStore(SMALL, 7)
    assert (store.rows, store.used, store.is_on_disk, store.dtype) == (7, 0, False, SMALL)


@pytest.mark.parametrize("on_disk", [False, True])
def test_rows_follow_each_other_and_a_part_of_a_column_is_a_view(on_disk):
    store = small_store(3, on_disk=on_disk, room=5)
    store.extend(small_rows(2, 3))
    assert (store.used, store.rows, store.is_on_disk) == (5, 5, on_disk)
    assert [store.column(name, 1, 4).tolist() for name in SMALL.names] == [[1, 2, 3]] * 3
    store.column("a", 2, 3)[:] = 77
    assert store.column("a", 0, 5).tolist() == [0, 1, 77, 3, 4]


@pytest.mark.parametrize("on_disk", [False, True])
def test_more_room_leaves_the_rows_as_they_are(on_disk):
    larger = small_store(3, on_disk=on_disk, room=4).with_room(9, on_disk=on_disk)
    assert (larger.used, larger.rows, larger.is_on_disk) == (3, 9, on_disk)
    larger.extend(small_rows(6, 3))
    assert [larger.column(name, 0, 9).tolist() for name in SMALL.names] == [list(range(9))] * 3


def test_a_copy_lies_in_memory_and_has_no_part_in_what_comes_later():
    store = small_store(3, on_disk=True, room=5)
    copy = store.copied()
    store.column("a", 0, 3)[:] = 9
    assert (copy.used, copy.rows, copy.is_on_disk) == (3, 3, False)
    assert copy.column("a", 0, 3).tolist() == [0, 1, 2]


def test_columns_in_a_file_begin_with_a_page_each_and_do_not_overlap():
    """Rows of 8, 4 and 1 bytes, one byte more than a page in the longest."""
    count = mmap.PAGESIZE // 8 + 1
    store = small_store(count, on_disk=True)
    places = [store.column(name, 0, count).ctypes.data for name in SMALL.names]
    assert [place % mmap.PAGESIZE for place in places] == [0, 0, 0]
    assert [(place - places[0]) // mmap.PAGESIZE for place in places] == [0, 2, 3]


def resident_kib(store):
    """How much of a store's file this process holds in memory."""
    begin, mapped = f"{store.column('a', 0, 0).ctypes.data:x}-", False
    for line in Path("/proc/self/smaps").read_text().splitlines():
        if line[:1] in "0123456789abcdef":
            mapped = line.startswith(begin)
        elif mapped and line.startswith("Rss:"):
            return int(line.split()[1])
    raise AssertionError("the store has no file")


@pytest.mark.skipif(not Path("/proc/self/smaps").exists(), reason="resident memory is read from Linux's files")
@pytest.mark.parametrize("moves", [0, 1])
def test_pages_are_given_back_after_so_many_bytes_were_looked_at(moves):
    """The rows that were written count too, and so do those that move to another file."""
    store = small_store(100, on_disk=True)
    for _ in range(moves):
        store = store.with_room(200, on_disk=True)
    reads = (GIVE_BACK_BYTES - small_rows(100).nbytes) // 800
    for _ in range(reads):
        store.column("a", 0, 100).sum()
    assert resident_kib(store) > 0
    column = store.column("a", 0, 100)
    assert resident_kib(store) == 0
    assert column.tolist() == list(range(100))


@pytest.mark.parametrize(
    ("part", "numbers"),
    [
        (slice(None), [2, 3, 4, 5, 6]),
        (slice(1, 3), [3, 4]),
        (slice(3), [2, 3, 4]),
        (slice(-2, None), [5, 6]),
        (slice(4, 2), []),
        (slice(5, 9), []),
        (slice(0, 1), [2]),
    ],
)
def test_a_part_of_columns_counts_from_the_begin_of_its_whole(part, numbers):
    whole = FrameColumns(small_store(9), 2, 7)
    found = whole[part]
    assert (len(whole), len(found), found.dtype) == (5, len(numbers), SMALL)
    assert found["a"].tolist() == found.rows()["a"].tolist() == numbers
    assert found[1:]["c"].tolist() == numbers[1:]


@pytest.mark.parametrize("step", [2, -1, 0])
def test_rows_of_columns_follow_each_other(step):
    whole = FrameColumns(small_store(9), 2, 7)
    with pytest.raises(ValueError, match="follow each other; got the step 2" if step == 2 else "step"):
        whole[::step]


def test_a_column_is_put_in_order_when_it_is_asked_for():
    ordered = InOrder(small_rows(4), np.array([3, 1, 0]))
    assert (len(ordered), ordered["a"].tolist()) == (3, [3, 1, 0])


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="the files of a process are read from Linux's list")
def test_a_file_lies_where_the_user_wants_it_or_else_where_files_last(monkeypatch, tmp_path):
    """A system may hold /tmp in memory."""
    monkeypatch.setattr(tempfile, "tempdir", None)
    for folder, stated in ((tmp_path, str(tmp_path)), (Path("/var/tmp"), None)):
        if stated is None:
            monkeypatch.delenv("TMPDIR", raising=False)
        else:
            monkeypatch.setenv("TMPDIR", stated)
        store = small_store(10, on_disk=True)
        begin = f"{store.column('a', 0, 10).ctypes.data:x}-"
        (line,) = [line for line in Path("/proc/self/maps").read_text().splitlines() if line.startswith(begin)]
        assert f" {folder}/" in line


def test_a_file_that_would_take_more_than_an_eighth_of_the_free_disk_is_not_made(monkeypatch, tmp_path):
    monkeypatch.setattr(tempfile, "tempdir", None)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    seventh = shutil.disk_usage(tmp_path).free * 2 // 15
    assert ColumnStore(SMALL, 0)._map_file(seventh // (8 + 4 + 1)) is False
