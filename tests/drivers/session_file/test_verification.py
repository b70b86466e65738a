"""verify: a session is whole, or it says what is wrong and where."""

from pathlib import Path

import pytest

from drivers.chunk import Chunk
from drivers.errors import CaptureError
from drivers.session_file.reader import verify
from drivers.session_file.records import RX
from drivers.session_file.writer import CaptureWriter, compact


def write(path: Path, count: int = 3) -> None:
    with CaptureWriter(path) as writer:
        writer.attach("station.yaml", "application/yaml", b"version: 1\n")
        for number in range(count):
            writer.rx(Chunk(1000 + number, number, b"some bytes " * 3))


def test_a_whole_session_is_whole_and_counted(tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    write(path)
    check = verify(path)
    assert check.is_whole
    (file,) = check.files
    assert (file.messages[RX], file.rx_bytes, file.attachments) == (3, 3 * 33, ["station.yaml"])
    assert (file.first_ns, file.last_ns) == (1000, 1002)


@pytest.mark.parametrize("compressed", [False, True])
def test_every_flipped_bit_of_a_closed_session_is_found(tmp_path: Path, compressed: bool) -> None:
    path = tmp_path / "session.mcap"
    write(path)
    if compressed:
        assert compact(path)
    assert verify(path).is_whole
    content = path.read_bytes()
    for position in range(len(content)):
        damaged = bytearray(content)
        damaged[position] ^= 1 << position % 8
        path.write_bytes(damaged)
        try:
            found_whole = verify(path).is_whole
        except CaptureError:
            # Its only chunk proves nothing any more, so nothing says whose file it is.
            found_whole = not compressed
        assert not found_whole, position


@pytest.mark.parametrize("compressed", [False, True])
def test_every_truncation_is_found(tmp_path: Path, compressed: bool) -> None:
    path = tmp_path / "session.mcap"
    write(path)
    if compressed:
        assert compact(path)
    content = path.read_bytes()
    for size in range(100, len(content), 3):
        path.write_bytes(content[:size])
        assert not verify(path).is_whole


def test_a_compressed_file_is_not_compressed_where_it_is_damaged(tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    write(path)
    damaged = path.read_bytes().replace(b"some bytes", b"same bytes", 1)
    path.write_bytes(damaged)
    assert not compact(path)
    assert path.read_bytes() == damaged
    assert [entry.name for entry in tmp_path.iterdir()] == ["session.mcap"]
