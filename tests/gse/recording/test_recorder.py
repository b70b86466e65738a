"""The recorder: what was received is in the file, or it is counted."""

import random
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from devices.full_disk import full_disk
from devices.patience import PATIENCE_S

from drivers.chunk import Chunk, LinkEvent
from drivers.errors import CaptureError
from drivers.session_file.reader import Capture, read_capture, verify
from drivers.session_file.records import RX, Attachment, RecordedMessage
from drivers.session_file.writer import CaptureWriter
from gse.recording.recorder import Recorder
from gse.recording.session_format import RecorderKind


def received(path: Path) -> tuple[bytes, Capture]:
    capture = read_capture(path)
    return b"".join(r.data for r in capture if isinstance(r, RecordedMessage) and r.topic == RX), capture


def chunks(count: int, size: int = 216) -> list[Chunk]:
    rng = random.Random(count)
    return [Chunk(10**18 + n, n, rng.randbytes(size)) for n in range(count)]


def kinds(recorder: Recorder) -> list[str]:
    return [event.kind for event in recorder.news()]


@pytest.mark.parametrize("live", [True, False])
def test_everything_is_in_the_file_in_order(tmp_path: Path, live: bool) -> None:
    path = tmp_path / "session.mcap"
    with Recorder(path, live=live) as recorder:
        recorder.attach("station.yaml", "application/yaml", b"version: 1")
        for chunk in chunks(300):
            recorder.rx(chunk)
        recorder.tx(Chunk(1, 1, b"stop"))
        recorder.event(LinkEvent(1, 1, "LOST", "x"))
        recorder.derived("/gse/timing", 1, b"{}")
    data, capture = received(path)
    assert data == b"".join(chunk.data for chunk in chunks(300))
    assert not capture.truncated
    assert (recorder.lost_bytes, recorder.news()) == (0, [])


def test_the_closed_file_is_compressed_and_holds_the_same(tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    recorder = Recorder(path, live=False)
    recorder.attach("a", "text/plain", b"b")
    for n in range(2000):
        recorder.rx(Chunk(n, n, b"the same again and again" * 4))
    plain = list(read_capture(path))
    size = path.stat().st_size
    recorder.close()
    assert list(read_capture(path)) == plain
    assert path.stat().st_size < size / 5
    assert [entry.name for entry in tmp_path.iterdir()] == ["session.mcap"]


def test_segments_lose_nothing_at_the_seams_and_each_stands_alone(tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    with Recorder(path, live=True, segment_bytes=10_000) as recorder:
        recorder.attach("station.yaml", "application/yaml", b"version: 1")
        for chunk in chunks(200):
            recorder.rx(chunk)
            while recorder.waiting_bytes > 5_000:  # half a segment: the disk has its turn on a busy machine too
                time.sleep(0.0002)
    data, capture = received(path)
    assert data == b"".join(chunk.data for chunk in chunks(200))
    assert len(capture.segments) > 2
    assert not capture.truncated
    for segment in capture.segments:
        assert any(isinstance(record, Attachment) for record in read_capture(segment))


def test_two_recordings_with_exchanged_segments_are_not_taken_for_whole(tmp_path: Path) -> None:
    for name, begin in (("a", 10**18), ("b", 2 * 10**18)):
        with Recorder(tmp_path / f"{name}.mcap", live=False, segment_bytes=10_000) as recorder:
            recorder.attach("station.yaml", "application/yaml", b"version: 1")
            for chunk in chunks(80):
                recorder.rx(Chunk(begin + chunk.mono_ns, chunk.mono_ns, chunk.data))
        assert verify(tmp_path / f"{name}.mcap").is_whole
    (tmp_path / "b.part2.mcap").replace(tmp_path / "a.part2.mcap")
    check = verify(tmp_path / "a.mcap")
    assert [file.name for file in check.files] == ["a.mcap", "a.part3.mcap"]
    assert "a.part2.mcap" in check.foreign[0]
    assert check.missing == ("a.part2.mcap",)


def test_a_new_segment_that_the_disk_refuses_leaves_no_file_behind(tmp_path: Path) -> None:
    with CaptureWriter(tmp_path / "trial.mcap") as trial:
        trial.attach("station.yaml", "application/yaml", b"x" * 10_000)
        size = trial.size
    with (
        full_disk(size + 20),
        Recorder(tmp_path / "session.mcap", live=False, segment_bytes=size, last_tries_s=0.1) as recorder,
    ):
        recorder.attach("station.yaml", "application/yaml", b"x" * 10_000)
    assert RecorderKind.SEGMENT in kinds(recorder)
    assert {path.name for path in tmp_path.iterdir()} == {"trial.mcap", "session.mcap"}


def test_a_session_is_never_overwritten(tmp_path: Path) -> None:
    Recorder(tmp_path / "session.mcap", live=False).close()
    with pytest.raises(CaptureError, match="never overwritten"):
        Recorder(tmp_path / "session.mcap", live=True)


def test_a_deleted_folder_is_made_again_with_all_that_was_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "night" / "session.mcap"
    path.parent.mkdir()
    with Recorder(path, live=False) as recorder:
        for chunk in chunks(20):
            recorder.rx(chunk)
        shutil.rmtree(path.parent)
        for chunk in chunks(30):
            recorder.rx(chunk)
    assert received(path)[0] == b"".join(chunk.data for chunk in chunks(20) + chunks(30))
    assert kinds(recorder) == ["FILE_RESTORED"]
    assert recorder.lost_bytes == 0


def test_a_file_that_cannot_be_restored_is_counted_as_lost(tmp_path: Path) -> None:
    path = tmp_path / "night" / "session.mcap"
    path.parent.mkdir()
    with Recorder(path, live=False) as recorder:
        for chunk in chunks(20):
            recorder.rx(chunk)
        shutil.rmtree(path.parent)
        path.parent.write_text("a file where the folder was")
    assert recorder.lost_bytes == 20 * 216
    assert "RECORDER_LOST" in kinds(recorder)


DISK_FULL = """
import resource, sys, threading
from pathlib import Path
from drivers.chunk import Chunk
from gse.recording.recorder import Recorder
hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, hard))
tries_s = 120.0 if sys.argv[3] == "freed late" else 1.0
recorder = Recorder(Path(sys.argv[1]), live=sys.argv[2] == "live", last_tries_s=tries_s)
for n in range(200):
    recorder.rx(Chunk(n, n, bytes([n]) * 216))
if sys.argv[3] == "freed":
    if sys.argv[2] == "live":
        while not (news := recorder.news()):
            pass
        print(news[0].kind)
    resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
if sys.argv[3] == "freed late":
    threading.Timer(1.0, resource.setrlimit, (resource.RLIMIT_FSIZE, (hard, hard))).start()
recorder.close()
print(recorder.lost_bytes, *(event.kind for event in recorder.news()))
"""


def run(script: str, *arguments: str) -> list[str]:
    done = subprocess.run([sys.executable, "-B", "-c", script, *arguments], capture_output=True, text=True, check=True)
    return done.stdout.split()


@pytest.mark.parametrize("live", ["live", "simulated"])
def test_a_full_disk_keeps_what_it_took_and_the_rest_is_counted(tmp_path: Path, live: str) -> None:
    path = tmp_path / "session.mcap"
    lost, *told = run(DISK_FULL, str(path), live, "full")
    data, capture = received(path)
    assert capture.truncated
    assert len(data) + int(lost) == 200 * 216
    assert 15_000 < len(data) < 20_000
    assert told.count("RECORDER_REFUSED") == 1
    assert told.count("RECORDER_LOST") == 1


@pytest.mark.parametrize(("live", "when"), [("live", "freed"), ("simulated", "freed"), ("live", "freed late")])
def test_a_full_disk_that_is_freed_in_time_loses_nothing(tmp_path: Path, live: str, when: str) -> None:
    path = tmp_path / "session.mcap"
    told = run(DISK_FULL, str(path), live, when)
    assert "0" in told
    assert "RECORDER_RECOVERED" in told
    data, capture = received(path)
    assert data == b"".join(bytes([n]) * 216 for n in range(200))
    assert not capture.truncated


FULL_AT_THE_END = """
import resource, sys, threading
from pathlib import Path
from drivers.chunk import Chunk
from gse.recording.recorder import Recorder
hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
path = Path(sys.argv[1])
recorder = Recorder(path, live=False, last_tries_s=float(sys.argv[2]))
for n in range(200):
    recorder.rx(Chunk(n, n, bytes([n]) * 216))
resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size, hard))
if float(sys.argv[2]):
    threading.Timer(0.3, resource.setrlimit, (resource.RLIMIT_FSIZE, (hard, hard))).start()
recorder.close()
print(recorder.lost_bytes, recorder.damage is None)
"""


@pytest.mark.parametrize(("tries_s", "closed"), [("120", True), ("0", False)])
def test_the_end_of_a_file_is_tried_again_on_a_full_disk_and_told_where_it_is_missing(
    tmp_path: Path, tries_s: str, closed: bool
) -> None:
    path = tmp_path / "session.mcap"
    assert run(FULL_AT_THE_END, str(path), tries_s) == ["0", str(closed)]
    data, capture = received(path)
    assert data == b"".join(bytes([n]) * 216 for n in range(200))
    assert capture.truncated is not closed


DISK_FULL_TWICE = """
import resource, sys
from pathlib import Path
from drivers.chunk import Chunk
from gse.recording.recorder import Recorder
hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
recorder = Recorder(Path(sys.argv[1]), live=False)
for n, limit in enumerate((20_000, hard, 60_000, hard)):
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
    for _ in range(200):
        recorder.rx(Chunk(n, n, bytes(216)))
print(*(event.kind for event in recorder.news()))
"""


def test_a_disk_that_is_full_twice_is_told_twice(tmp_path: Path) -> None:
    told = run(DISK_FULL_TWICE, str(tmp_path / "session.mcap"))
    assert told == ["RECORDER_REFUSED", "RECORDER_RECOVERED"] * 2


def test_a_disk_that_comes_back_says_what_was_lost_only_when_it_was(tmp_path: Path) -> None:
    class Refusing(CaptureWriter):
        refuses = False
        waits_bytes = 0

        def flush(self) -> None:
            if self.refuses:
                raise OSError(28, "No space left on device")
            super().flush()

        @property
        def pending(self) -> int:
            return self.waits_bytes

    opened: list[Refusing] = []

    def open_writer(path: Path) -> Refusing:
        opened.append(Refusing(path))
        return opened[-1]

    recorder = Recorder(tmp_path / "session.mcap", live=False, open_writer=open_writer)
    (writer,) = opened
    words = []
    for waits_bytes in (0, 1 << 40):
        writer.refuses, writer.waits_bytes = True, waits_bytes
        for chunk in chunks(2):
            recorder.rx(chunk)
        writer.refuses, writer.waits_bytes = False, 0
        recorder.rx(chunks(1)[0])
        words += [event.text for event in recorder.news() if event.kind == "RECORDER_RECOVERED"]
    recorder.close()
    assert "nothing was lost" in words[0]
    assert f"{recorder.lost_bytes} received bytes are lost in all" in words[1]
    assert recorder.lost_bytes > 0


def test_a_disk_that_stalls_holds_up_nobody_and_loses_nothing(tmp_path: Path) -> None:
    stalled, go_on, released = threading.Event(), threading.Event(), []

    class StalledDisk(CaptureWriter):
        def flush(self) -> None:
            if self.size > 1000:
                stalled.set()
                released.append(go_on.wait(PATIENCE_S))
            super().flush()

    path = tmp_path / "session.mcap"
    with Recorder(path, live=True, open_writer=StalledDisk) as recorder:
        for chunk in chunks(10):
            recorder.rx(chunk)
        assert stalled.wait(PATIENCE_S)
        many = chunks(2000, 4096)
        for chunk in many:
            recorder.rx(chunk)
        assert not released, "who waits for the disk waits until it gives up"
        assert kinds(recorder) == ["RECORDER_BEHIND"]
        go_on.set()
    assert received(path)[0] == b"".join(chunk.data for chunk in chunks(10) + many)
    assert recorder.lost_bytes == 0


def test_what_comes_while_the_disk_syncs_is_in_the_file_at_once(tmp_path: Path) -> None:
    syncing, go_on = threading.Event(), threading.Event()

    class BusyDisk(CaptureWriter):
        def syncing(self) -> Callable[[], None]:
            sync = super().syncing()

            def wait_and_sync() -> None:
                syncing.set()
                go_on.wait(2 * PATIENCE_S)
                sync()

            return wait_and_sync

    path = tmp_path / "session.mcap"
    some = chunks(10)
    with Recorder(path, live=True, open_writer=BusyDisk) as recorder:
        assert syncing.wait(PATIENCE_S)
        for chunk in some:
            recorder.rx(chunk)
        until_s = time.monotonic() + PATIENCE_S
        while received(path)[0] != b"".join(chunk.data for chunk in some) and time.monotonic() < until_s:
            time.sleep(0.01)
        assert not go_on.is_set()
        assert time.monotonic() < until_s
        go_on.set()


KILLED = """
import sys, time
from pathlib import Path
from drivers.chunk import Chunk
from drivers.session_file.writer import CaptureWriter
from gse.recording.recorder import Recorder

class Telling(CaptureWriter):
    chunks = 0
    def put(self, message):
        super().put(message)
        self.chunks += 1
    def flush(self):
        super().flush()
        print(self.chunks, flush=True)

recorder = Recorder(Path(sys.argv[1]), live=True, open_writer=Telling)
most = int(sys.argv[2])
for n in range(most):
    recorder.rx(Chunk(time.time_ns(), time.monotonic_ns(), bytes(216)))
    time.sleep(0.001)
time.sleep(3600)
"""


@pytest.mark.parametrize("most", [300, 100_000], ids=["in a silence", "while more comes"])
def test_kill_9_loses_nothing_that_the_disk_was_given_and_that_is_all_as_soon_as_nothing_comes(
    tmp_path: Path, most: int
) -> None:
    """Within 10 ms on an idle machine, as benchmarks/faults.py measures."""
    path = tmp_path / "session.mcap"
    command = [sys.executable, "-c", KILLED, str(path), str(most)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        given = 0
        while given < 300:
            given = int(process.stdout.readline())
        process.send_signal(signal.SIGKILL)
        given = max([given, *map(int, process.stdout.read().split())])
    written = [record for record in read_capture(path) if isinstance(record, RecordedMessage)]
    assert len(written) >= given


def test_bytes_of_either_way_that_come_after_the_end_are_counted_as_lost_and_events_are_not(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "session.mcap", live=False)
    recorder.close()
    recorder.rx(Chunk(1, 1, b"frame"))
    recorder.tx(Chunk(2, 2, b"stop"))
    recorder.event(LinkEvent(3, 3, "LOST", "x"))
    assert recorder.lost_bytes == 9
