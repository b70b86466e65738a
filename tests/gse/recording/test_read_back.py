"""A file that was changed while it was written: told, never rewritten, and saved as far as memory goes."""

import os
import random
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from devices.command_line import runner

from drivers.chunk import Chunk
from drivers.session_file.reader import read_capture, verify
from drivers.session_file.records import RX, RecordedMessage
from drivers.session_file.writer import BLOCK_BYTES, TAIL_BYTES
from gse.recording.recorder import Recorder

COUNT, SIZE = 1000, 216


def chunks() -> list[Chunk]:
    rng = random.Random(1)
    return [Chunk(10**18 + n, n, rng.randbytes(SIZE)) for n in range(COUNT)]


def flip(path: Path) -> None:
    """One byte of another program's."""
    with path.open("r+b") as file:
        file.seek(50_000)
        before = file.read(1)
        file.seek(50_000)
        file.write(bytes([before[0] ^ 1]))


def zero(path: Path) -> None:
    """A sector that lost its content."""
    with path.open("r+b") as file:
        file.seek(30_000)
        file.write(bytes(16 << 10))


def truncate(path: Path) -> None:
    os.truncate(path, 1000)


def append(path: Path) -> None:
    """A second writer; where the recorder goes on, it overwrites it."""
    with path.open("ab") as file:
        file.write(b"a log line of somebody else\n" * 10_000)


def received(path: Path) -> bytes:
    return b"".join(item.data for item in read_capture(path) if isinstance(item, RecordedMessage) and item.topic == RX)


@pytest.mark.parametrize("harm", [flip, zero, truncate, append])
@pytest.mark.parametrize("live", [True, False])
def test_a_file_changed_during_the_run_is_told_and_saved_beside_it(
    tmp_path: Path, harm: Callable[[Path], None], live: bool
) -> None:
    path = tmp_path / "session.mcap"
    sent = chunks()
    recorder = Recorder(path, live=live)
    for chunk in sent[: COUNT // 2]:
        recorder.rx(chunk)
    while path.stat().st_size < COUNT // 2 * SIZE:
        pass
    harm(path)
    changed = path.read_bytes()[:100_000]
    for chunk in sent[COUNT // 2 :]:
        recorder.rx(chunk)
    recorder.close()
    assert recorder.damage is not None
    assert "FILE_DAMAGED" in [event.kind for event in recorder.news()]
    assert path.read_bytes()[: len(changed)].rstrip(b"\0") == changed.rstrip(b"\0")  # never rewritten
    assert received(tmp_path / "session.recovered.mcap") == b"".join(chunk.data for chunk in sent)
    assert verify(tmp_path / "session.recovered.mcap").is_whole
    assert recorder.lost_bytes == 0


def test_what_is_older_than_memory_and_damaged_is_counted_as_lost(tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    recorder = Recorder(path, live=False)
    for number in range(2 * TAIL_BYTES // BLOCK_BYTES + 20):
        recorder.rx(Chunk(number, number, random.Random(number).randbytes(BLOCK_BYTES)))
    flip(path)
    recorder.close()
    assert recorder.lost_bytes == BLOCK_BYTES
    assert "1 of " in str(recorder.damage)


def test_an_untouched_file_has_nothing_beside_it(tmp_path: Path) -> None:
    with Recorder(tmp_path / "session.mcap", live=True) as recorder:
        for chunk in chunks():
            recorder.rx(chunk)
    assert recorder.damage is None
    assert [entry.name for entry in tmp_path.iterdir()] == ["session.mcap"]


@pytest.mark.parametrize("command", ["run", "simulate"])
def test_a_session_whose_file_was_changed_ends_with_exit_code_3(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    ended = threading.Event()

    def harm() -> None:
        while not ended.wait(0.001):
            for path in tmp_path.glob("*/session.mcap"):
                if path.stat().st_size > 60_000:
                    flip(path)
                    return

    other = threading.Thread(target=harm)
    other.start()
    try:
        done = runner(capsys)(command, "--out", tmp_path)
    finally:
        ended.set()
        other.join()
    assert done.code == 3
    assert "is not what was written to it" in done.err
    assert len(list(tmp_path.glob("*/session.recovered.mcap"))) == 1
