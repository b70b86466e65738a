"""Session files: what goes in comes out, and nothing else, whatever is done to the file."""

import itertools
import json
import os
import shutil
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from drivers.chunk import Chunk, LinkEvent
from drivers.errors import CaptureError
from drivers.session_file.reader import Capture, read_capture, segment_path, verify
from drivers.session_file.records import CONTINUED, EVENTS, RX, TX, Attachment, Damage, RecordedMessage
from drivers.session_file.writer import CaptureWriter, compact

MESSAGES = 6


def write_session(path: Path, count: int = MESSAGES) -> list[bytes]:
    data = [bytes([number]) * (5 + number) for number in range(count)]
    with CaptureWriter(path) as writer:
        writer.attach("station.yaml", "application/yaml", b"version: 1\n")
        for number, piece in enumerate(data):
            writer.rx(Chunk(10**18 + number, 7000 + number, piece))
    return data


def whole(path: Path) -> tuple[list[RecordedMessage | Attachment], Capture]:
    capture = read_capture(path)
    return [record for record in capture if not isinstance(record, Damage)], capture


def test_everything_written_is_read_back_with_both_clocks(tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    with CaptureWriter(path) as writer:
        writer.attach("protocol.yaml", "application/yaml", b"x")
        writer.rx(Chunk(1_700_000_000_123_456_789, 42, b"\x00\xff"))
        writer.tx(Chunk(1_700_000_000_123_456_790, 43, b"go"))
        writer.event(LinkEvent(5, 6, "LOST", "süd"))
        writer.derived("/gse/frame", 9, b"{}")
    records, capture = whole(path)
    assert records == [
        Attachment("protocol.yaml", "application/yaml", b"x"),
        RecordedMessage(RX, 1_700_000_000_123_456_789, 42, b"\x00\xff"),
        RecordedMessage(TX, 1_700_000_000_123_456_790, 43, b"go"),
        RecordedMessage(EVENTS, 5, 6, json.dumps({"kind": "LOST", "text": "süd"}, ensure_ascii=False).encode()),
        RecordedMessage("/gse/frame", 9, 0, b"{}"),
    ]
    assert isinstance(records[3], RecordedMessage)
    assert records[3].event() == LinkEvent(5, 6, "LOST", "süd")
    assert not capture.truncated
    assert capture.damage_count == 0


def test_other_mcap_readers_read_our_sessions(tmp_path: Path) -> None:
    data = write_session(tmp_path / "session.mcap")
    with (tmp_path / "session.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert [message.data for _, _, message in reader.iter_messages(RX)] == data


def test_a_session_is_never_overwritten(tmp_path: Path) -> None:
    write_session(tmp_path / "session.mcap")
    with pytest.raises(CaptureError, match="never overwritten"):
        CaptureWriter(tmp_path / "session.mcap")


def test_a_session_that_is_still_written_can_be_read(tmp_path: Path) -> None:
    writer = CaptureWriter(tmp_path / "session.mcap")
    writer.rx(Chunk(1, 2, b"abc"))
    records, capture = whole(tmp_path / "session.mcap")
    assert records == [RecordedMessage(RX, 1, 2, b"abc")]
    assert capture.truncated
    writer.close()


def test_a_session_cut_at_any_byte_gives_its_whole_records_and_nothing_else(tmp_path: Path) -> None:
    path, piece = tmp_path / "session.mcap", tmp_path / "cut.mcap"
    data = write_session(path)
    content = path.read_bytes()
    given: list[int] = []
    for size in range(len(content)):
        piece.write_bytes(content[:size])
        try:
            records, capture = whole(piece)
        except CaptureError:
            assert size < 60  # the file does not yet say whose it is
            continue
        received = [record.data for record in records if isinstance(record, RecordedMessage)]
        assert received == data[: len(received)]
        assert capture.truncated
        given.append(len(received))
    assert given == sorted(given)
    assert given[-1] == len(data)


def test_any_flipped_bit_costs_at_most_the_record_it_is_in(tmp_path: Path) -> None:
    path, flipped = tmp_path / "session.mcap", tmp_path / "flipped.mcap"
    data = write_session(path)
    content = path.read_bytes()
    true = set(whole(path)[0])
    for position in range(len(content)):
        damaged = bytearray(content)
        damaged[position] ^= 1 << position % 8
        flipped.write_bytes(damaged)
        records, capture = whole(flipped)
        assert set(records) <= true
        assert len(records) >= len(data)  # of one attachment and the messages, one may be missing
        if len(records) <= len(data):
            assert capture.damage_count


def test_a_channel_record_that_is_damaged_costs_no_message(tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    data = write_session(path)
    content = path.read_bytes()
    path.write_bytes(content.replace(b"/serial/rx", b"/serial/ry", 1))
    records, _ = whole(path)
    assert [record.data for record in records if isinstance(record, RecordedMessage)] == data


def test_a_hole_in_the_file_costs_what_stood_in_it(tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    data = write_session(path, 200)
    content = bytearray(path.read_bytes())
    start = content.index(data[90])
    end = content.index(data[110])
    content[start:end] = bytes(end - start)
    path.write_bytes(content)
    records, capture = whole(path)
    received = [record.data for record in records if isinstance(record, RecordedMessage)]
    assert received == data[:90] + data[111:]  # the head of 110 was in the hole
    assert capture.damage_count == 1
    assert not capture.truncated


@settings(max_examples=60)
@given(noise=st.binary(max_size=300), head=st.sampled_from([b"", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n\x01"]))
def test_a_foreign_file_is_refused_in_words(
    tmp_path_factory: pytest.TempPathFactory, noise: bytes, head: bytes
) -> None:
    path = tmp_path_factory.mktemp("foreign") / "x.mcap"
    path.write_bytes(head + noise)
    with pytest.raises(CaptureError, match="session"):
        read_capture(path)


def test_a_footer_alone_with_a_damaged_magic_is_refused_in_words(tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    CaptureWriter(path).close()
    content = bytearray(path.read_bytes())
    content[:-37] = bytes(len(content) - 37)  # all but the footer
    content[-1] ^= 1
    path.write_bytes(content)
    with pytest.raises(CaptureError, match="is not a session"):
        read_capture(path)


def test_clocks_beyond_what_the_file_can_say_are_stored_at_its_ends(tmp_path: Path) -> None:
    with CaptureWriter(tmp_path / "session.mcap") as writer:
        writer.rx(Chunk(2**70, -1, b"x"))
    [record] = read_capture(tmp_path / "session.mcap")
    assert record == RecordedMessage(RX, 2**64 - 1, 0, b"x")


def test_a_missing_session_is_told_in_words(tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match="there is no session"):
        read_capture(tmp_path / "nothing.mcap")


def test_a_folder_with_a_report_only_is_told_from_a_missing_session(tmp_path: Path) -> None:
    (tmp_path / "report.json").write_text("{}")
    with pytest.raises(CaptureError, match="holds a report and no session"):
        read_capture(tmp_path)


def test_a_folder_stands_for_the_session_in_it(tmp_path: Path) -> None:
    data = write_session(tmp_path / "session.mcap")
    assert [record.data for record in whole(tmp_path)[0] if isinstance(record, RecordedMessage)] == data


def write_segments(first: Path, begin: int, *, says_so: bool = True) -> list[Path]:
    """Three segments; ``says_so`` is False for a session from before segments said what they continue."""
    paths = [segment_path(first, number) for number in (1, 2, 3)]
    for number, path in enumerate(paths, start=1):
        stamp, session = begin + number, (begin + 1, begin + 1)
        with CaptureWriter(path) as writer:
            writer.attach("station.yaml", "application/yaml", b"begin: %d\n" % begin)
            if says_so and number > 1:
                writer.continues(number, session, stamp - 1, stamp - 1)
            writer.rx(Chunk(stamp, stamp, bytes([stamp])))
            if number < 3 and says_so:
                writer.continued("next", session, stamp, stamp)
            elif number < 3:
                writer.write(RecordedMessage(CONTINUED, stamp, stamp, b"next"))
    return paths


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("says_so", [True, False])
def test_segments_are_read_as_one_session_and_a_missing_one_is_named(
    tmp_path: Path, says_so: bool, compressed: bool
) -> None:
    first, second, third = write_segments(tmp_path / "session.mcap", 0, says_so=says_so)
    if compressed:
        assert all(compact(path) for path in (first, second, third))
    records, capture = whole(first)
    assert [record.data for record in records] == [b"begin: 0\n", b"\1", b"\2", b"\3"]
    assert not capture.truncated
    assert verify(first).is_whole
    second.unlink()
    records, capture = whole(first)
    assert [record.data for record in records] == [b"begin: 0\n", b"\1", b"\3"]
    assert capture.truncated
    assert capture.missing == list(verify(first).missing) == ["session.part2.mcap"]
    third.unlink()
    _, capture = whole(first)
    assert capture.missing == list(verify(first).missing) == ["what follows session.mcap"]


FOREIGN = {
    "one more": ("other.mcap", 4, "session.part3.mcap is closed, and says that nothing follows"),
    "another session's": ("other.part2.mcap", 2, "it says that it continues another session"),
    "a later one of its own": ("session.part3.mcap", 2, "it says that it is segment 3"),
    "the beginning of a session": ("other.mcap", 2, "it is the beginning of a session"),
}


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("kind", FOREIGN)
def test_a_file_with_the_name_of_a_segment_that_belongs_to_another_session_is_named_and_not_read(
    tmp_path: Path, kind: str, compressed: bool
) -> None:
    paths = write_segments(tmp_path / "session.mcap", 0)
    paths += write_segments(tmp_path / "other.mcap", 10)
    if compressed:
        assert all(compact(path) for path in paths)
    source, number, reason = FOREIGN[kind]
    shutil.copy(tmp_path / source, segment_path(paths[0], number))
    records, capture = whole(paths[0])
    data = [record.data for record in records if isinstance(record, RecordedMessage)]
    assert data == [bytes([each]) for each in (1, 2, 3) if each != number]
    assert capture.truncated
    (sentence,) = capture.foreign
    assert sentence == f"session.part{number}.mcap was not read, it is no part of session.mcap: {reason}"
    check = verify(paths[0])
    assert (check.is_whole, check.foreign, check.missing) == (False, (sentence,), tuple(capture.missing))


@pytest.mark.parametrize("ends", [True, False])
def test_an_older_session_takes_no_file_with_another_station_and_none_after_its_end(tmp_path: Path, ends: bool) -> None:
    first, second, _ = write_segments(tmp_path / "session.mcap", 0, says_so=False)
    other, *_ = write_segments(tmp_path / "other.mcap", 10, says_so=False)
    if ends:
        shutil.copy(tmp_path / "session.part3.mcap", first)
    else:
        shutil.copy(other, second)
    _, capture = whole(first)
    reason = "session.mcap is closed, and says that nothing follows" if ends else "its station.yaml is another"
    assert capture.foreign[0] == f"session.part2.mcap was not read, it is no part of session.mcap: {reason}"
    attachments = read_capture(first, from_utc_ns=2**63, only=())
    assert [record.data for record in attachments] == [b"begin: 0\n"]
    assert attachments.foreign == capture.foreign


def test_a_segment_that_does_not_begin_where_the_one_before_ends_is_not_read(tmp_path: Path) -> None:
    first, second, _ = write_segments(tmp_path / "session.mcap", 0)
    second.unlink()
    with CaptureWriter(second) as writer:
        writer.continues(2, (1, 1), 5, 5)
    _, capture = whole(first)
    assert capture.foreign == [
        "session.part2.mcap was not read, it is no part of session.mcap: it does not begin where session.mcap ends"
    ]


def test_a_pipe_with_the_name_of_a_segment_is_named_and_not_waited_for(tmp_path: Path) -> None:
    first, second, _ = write_segments(tmp_path / "session.mcap", 0)
    second.unlink()
    os.mkfifo(second)
    _, capture = whole(first)
    assert "pipe" in capture.foreign[0]


def test_a_missing_successor_is_named_whatever_topics_are_wanted_and_none_wanted_gives_none(tmp_path: Path) -> None:
    first, closed = tmp_path / "session.mcap", tmp_path / "compact.mcap"
    with CaptureWriter(first) as writer:
        writer.attach("station.yaml", "application/yaml", b"version: 1\n")
        writer.rx(Chunk(1, 1, b"a"))
        writer.continued("session.part2.mcap", (1, 1), 2, 2)
    shutil.copy(first, closed)
    assert compact(closed)
    for path, only in itertools.product((first, closed), ((), (RX,), (EVENTS,), None)):
        capture = read_capture(path, only=only)
        topics = [record.topic for record in capture if isinstance(record, RecordedMessage)]
        assert topics == ([RX] if only is None or RX in only else [])
        assert capture.missing == [f"what follows {path.name}"]


def test_a_chunk_with_a_wrong_checksum_is_read_in_part_whichever_of_its_topics_are_wanted(tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    with CaptureWriter(path) as writer:
        writer.rx(Chunk(1, 1, b"the only message"))
    assert compact(path)
    content = bytearray(path.read_bytes())
    chunk_at = 8 + 9 + int.from_bytes(content[9:17], "little")  # after the magic and the header
    assert content[chunk_at] == 6
    content[chunk_at + 9 + 24] ^= 1  # the checksum, after the times and the size
    path.write_bytes(content)
    for only in ((RX,), (EVENTS,), None):
        (damage,) = [record for record in read_capture(path, only=only) if isinstance(record, Damage)]
        assert damage.reason == "chunk with a wrong checksum, read in part"


@settings(max_examples=150)
@given(content=st.binary(max_size=400), cuts=st.lists(st.integers(0, 2000), max_size=4))
def test_the_reader_bears_any_bytes_after_a_true_head(
    tmp_path_factory: pytest.TempPathFactory, content: bytes, cuts: list[int]
) -> None:
    folder = tmp_path_factory.mktemp("fuzz")
    write_session(folder / "true.mcap")
    true = bytearray((folder / "true.mcap").read_bytes())
    for position in cuts:
        true = true[:60] + true[60 : 60 + position] + content + true[60 + position :]
    path = folder / "x.mcap"
    path.write_bytes(true)
    known = set(whole(folder / "true.mcap")[0])
    assert set(whole(path)[0]) <= known
