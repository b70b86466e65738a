"""The port replay://: a recorded night behind pyserial's interface."""

import importlib
import os
from pathlib import Path

import pytest
import serial
from hypothesis import given
from hypothesis import strategies as st

from drivers.chunk import Chunk, LinkEvent
from drivers.errors import CaptureError, PortError
from drivers.link import SerialLink
from drivers.mock_ports import Pace, parse_mock_url, replay_url
from drivers.session_file.reader import read_capture
from drivers.session_file.records import TX, RecordedMessage
from drivers.session_file.writer import CaptureWriter

START_NS = 1_774_000_000_000_000_000  # 2026-03-20T09:46:40Z
STEP_NS = 100_000_000
CHUNKS = [Chunk(START_NS + n * STEP_NS, 5_000 + n * STEP_NS, bytes([n] * (n % 7 + 1))) for n in range(40)]


@pytest.fixture
def session(tmp_path: Path) -> Path:
    path = tmp_path / "a night? at 100% & more" / "session.mcap"
    path.parent.mkdir()
    with CaptureWriter(path) as writer:
        for chunk in CHUNKS[:20]:
            writer.rx(chunk)
        writer.event(LinkEvent(START_NS + 20 * STEP_NS - 1, 0, "LOST", "gone"))
        writer.tx(Chunk(START_NS, 0, b"command"))
        for chunk in CHUNKS[20:]:
            writer.rx(chunk)
    return path


def everything(url: str) -> list[Chunk | LinkEvent]:
    items = []
    with SerialLink(url) as link:
        assert not link.is_live
        while not link.at_end:
            items += link.receive(1.0)
    return [item for item in items if isinstance(item, Chunk) or item.kind != "SENT"]


def test_a_replay_tells_what_was_sent_and_a_copy_records_it_as_sent(session: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.mcap"
    with CaptureWriter(copy) as writer, SerialLink(replay_url(session), recorder=writer) as link:
        items = [item for _ in range(20) for item in link.receive(1.0)]
    assert [item.text for item in items if isinstance(item, LinkEvent) and item.kind == "SENT"] == [b"command".hex()]
    records = [record for record in read_capture(copy) if isinstance(record, RecordedMessage)]
    assert [record.data for record in records if record.topic == TX] == [b"command"]
    assert not any(b"SENT" in record.data for record in records)


def chunks(url: str) -> list[Chunk]:
    return [item for item in everything(url) if isinstance(item, Chunk)]


@pytest.mark.parametrize("name", ["protocol_replay", "protocol_sim"])
def test_each_handler_imports(name: str) -> None:
    # pyserial turns an ImportError inside a handler into "protocol not known".
    assert issubclass(importlib.import_module(f"drivers.urlhandlers.{name}").Serial, serial.SerialBase)


def test_a_replay_gives_the_recorded_chunks_with_the_recorded_times(session: Path) -> None:
    items = everything(replay_url(session))
    assert items[:20] == CHUNKS[:20]
    assert items[20] == LinkEvent(START_NS + 20 * STEP_NS - 1, 0, "LOST", "gone")
    assert items[21:] == CHUNKS[20:]


@pytest.mark.parametrize("most", [1, 2, 3, 100])
def test_cutting_the_chunks_changes_neither_bytes_nor_the_time_of_any_byte(session: Path, most: int) -> None:
    def bytes_with_times(items: list[Chunk]) -> list[tuple[int, int, int]]:
        return [(chunk.utc_ns, chunk.mono_ns, byte) for chunk in items for byte in chunk.data]

    cut = chunks(replay_url(session, cut=most))
    assert max(len(chunk.data) for chunk in cut) == min(most, 7)
    assert bytes_with_times(cut) == bytes_with_times(CHUNKS)


def test_from_is_included_and_to_is_not(session: Path) -> None:
    part = chunks(replay_url(session, from_="2026-03-20T09:46:41.000Z", to="2026-03-20T09:46:42.500000Z"))
    assert part == CHUNKS[10:25]


def test_a_loop_gives_the_same_bytes_and_times_again_and_says_so(session: Path) -> None:
    items = everything(replay_url(session, loop=3))
    assert [item for item in items if isinstance(item, Chunk)] == CHUNKS * 3
    assert [item.kind for item in items if isinstance(item, LinkEvent)] == ["LOST", "LOOP", "LOST", "LOOP", "LOST"]


def test_plain_pyserial_reads_a_replay_byte_by_byte(session: Path) -> None:
    with serial.serial_for_url(replay_url(session), timeout=1) as port:
        data = b"".join(iter(lambda: port.read(3), b""))
        assert data == b"".join(chunk.data for chunk in CHUNKS)
        assert port.in_waiting == 0


def test_in_waiting_bytes_are_there_at_once(session: Path) -> None:
    with serial.serial_for_url(replay_url(session), timeout=0) as port:
        received = bytearray()
        while waiting := port.in_waiting:
            data = port.read(waiting)
            assert len(data) == waiting
            received += data
        assert bytes(received) == b"".join(chunk.data for chunk in CHUNKS[:20])  # an event ends the first run
        assert port.read(1000) == b"".join(chunk.data for chunk in CHUNKS[20:])


def test_a_read_across_chunks_leaves_the_rest_with_its_stamp(session: Path) -> None:
    with serial.serial_for_url(replay_url(session), timeout=1) as port:
        assert port.read(2) == CHUNKS[0].data + CHUNKS[1].data[:1]
        assert port.read_timestamped() == Chunk(CHUNKS[1].utc_ns, CHUNKS[1].mono_ns, CHUNKS[1].data[1:])


@pytest.mark.parametrize("speed", ["max", "1000", "2e3"])
def test_the_pace_changes_nothing_in_what_is_given(session: Path, speed: str) -> None:
    assert chunks(replay_url(session, speed=speed)) == CHUNKS


def test_no_more_is_given_at_once_than_is_asked_for_and_the_rest_later(session: Path) -> None:
    with SerialLink(replay_url(session)) as link:
        assert [link.receive(1.0, most) for most in (1, 2)] == [CHUNKS[:1], CHUNKS[1:3]]
        assert link.receive(1.0)[0] == CHUNKS[3]


def test_a_paced_port_gives_nothing_before_it_is_due(session: Path) -> None:
    with SerialLink(replay_url(session, speed=0.001)) as link:
        assert link.receive(0) == [CHUNKS[0]]
        assert link.receive(0) == []
        assert not link.at_end


def test_the_schedule_is_absolute_so_delays_do_not_add_up() -> None:
    pace = Pace(speed=1.0)
    waits = [pace.wait(10**9 + n * 1_000_000, timeout_s=1.0) for n in range(50)]
    assert all(waits)
    assert not pace.wait(10**9 + 3_600 * 10**9, timeout_s=0)
    assert pace.wait(10**9 + 25_000_000, timeout_s=0)  # an earlier clock is another boot: due at once


def test_relative_and_absolute_paths_are_the_same(session: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(session.parent)
    assert chunks("replay://session.mcap") == chunks(replay_url(session)) == CHUNKS


@given(path=st.text(st.characters(exclude_characters="\x00", exclude_categories=["Cs"]), min_size=1))
def test_any_path_survives_its_url(path: str) -> None:
    url = parse_mock_url(replay_url(path, speed="max", from_="2026-01-01T00:00:00Z"))
    assert (url.path, url.options) == (path, {"speed": "max", "from": "2026-01-01T00:00:00Z"})


def test_a_file_name_that_is_no_utf_8_survives_its_url() -> None:
    path = os.fsdecode(b"caf\xe9.mcap")
    assert parse_mock_url(replay_url(path)).path == path


def test_a_raw_capture_has_all_its_bytes_at_the_given_start(tmp_path: Path) -> None:
    raw = tmp_path / "capture.bin"
    raw.write_bytes(bytes(range(256)) * 20)
    items = chunks(replay_url(raw, start_utc="2026-03-20T09:46:40Z"))
    assert b"".join(chunk.data for chunk in items) == raw.read_bytes()
    assert {chunk.utc_ns for chunk in items} == {START_NS}


def test_a_cut_session_says_so_where_it_ends(session: Path) -> None:
    session.write_bytes(session.read_bytes()[:700])
    items = everything(replay_url(session))
    assert items[:-1] == CHUNKS[: len(items) - 1]
    assert isinstance(items[-1], LinkEvent)
    assert items[-1].kind == "TRUNCATED"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"speed": "fast"}, "expected max, 1, or a factor"),
        ({"speed": "-1"}, "expected max, 1, or a factor"),
        ({"loop": "0"}, "whole number from 1 on"),
        ({"cut": "x"}, "whole number from 1 on"),
        ({"spede": "1"}, "no option spede"),
        ({"from_": "yesterday"}, "is not a UTC instant"),
    ],
)
def test_a_wrong_option_is_refused_in_words(session: Path, options: dict[str, str], words: str) -> None:
    with pytest.raises(PortError, match=words):
        SerialLink(replay_url(session, **options))


def test_a_missing_recording_is_an_error_of_the_file_and_not_of_a_port(tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match="there is no recording"):
        SerialLink(replay_url(tmp_path / "none.mcap"))


def test_a_raw_capture_without_its_start_says_what_it_needs(tmp_path: Path) -> None:
    (tmp_path / "raw.bin").write_bytes(b"abc")
    with pytest.raises(CaptureError, match="--start-utc"):
        SerialLink(replay_url(tmp_path / "raw.bin"))


def test_plain_pyserial_gets_its_own_kind_of_error(tmp_path: Path) -> None:
    with pytest.raises(serial.SerialException, match="there is no recording"):
        serial.serial_for_url(replay_url(tmp_path / "none.mcap"))


def test_the_recorder_has_everything_before_it_is_given(session: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.mcap"
    with CaptureWriter(copy) as writer, SerialLink(replay_url(session), recorder=writer) as link:
        while not link.at_end:
            link.receive(0.1)
    assert everything(replay_url(copy)) == everything(replay_url(session))
