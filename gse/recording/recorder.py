"""Recorder of a session: writes every byte to the session file, counts those that it cannot write.

A live port has a writing thread behind a queue: a stalled disk delays neither reading nor identification. Another
thread syncs the file once a second, so that all that came is with the kernel while the disk is busy. Simulated
sessions can wait, so everything is written at once. After a disk error writing is tried again until the end of the
session; unwritten bytes wait in memory, up to a limit, and the operator sees one message.
"""

import contextlib
import queue
import threading
import time
from array import array
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from drivers.chunk import LinkEvent
from drivers.errors import CaptureError
from drivers.session_file.reader import segment_path
from drivers.session_file.records import RX, TX, Attachment, MessageWriter, RecordedMessage
from drivers.session_file.writer import CaptureWriter, WrittenBytes, compact, read_back
from gse.recording.session_format import RecorderKind

# Syncing of a session file, beside its writing.
#
# A busy disk takes up to seconds to sync a file. A thread that waits for it does not write, and what comes meanwhile is
# in this process alone: lost if it is killed.


class DiskSync:
    """A thread that syncs when it is asked to, one file at a time.

    ``error`` is that of the last sync, None where the disk took everything.
    """

    def __init__(self) -> None:
        self.error: OSError | None = None
        self._is_busy = False
        self._asked: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        threading.Thread(target=self._run, name="sync", daemon=True).start()

    def ask(self, syncing: Callable[[], Callable[[], None]]) -> None:
        """Call what ``syncing`` gives in the other thread, or nothing while that is busy with the one before."""
        if not self._is_busy:
            sync = syncing()
            self._is_busy = True
            self._asked.put(sync)

    def end(self) -> None:
        """Let the thread end, when the disk has answered."""
        self._asked.put(None)

    def _run(self) -> None:
        while (sync := self._asked.get()) is not None:
            try:
                sync()
                self.error = None
            except OSError as error:
                self.error = error
            self._is_busy = False


SEGMENT_BYTES = 512 << 20
"""Some 50 hours at 10 Hz; a file that any tool still opens."""
WAITING_LIMIT_BYTES = 256 << 20
"""Most bytes that wait for a slow or full disk: 45 minutes at 921600 baud."""
WAITING_LIMIT_ITEMS = 500_000
"""Most messages that wait, however small: each takes a quarter of a kilobyte besides its data."""
BEHIND_BYTES = 4 << 20
REFUSALS_ANNOUNCED = 20
"""Most messages about a disk that is full, freed and full again."""
SYNC_S = 1.0
LAST_TRIES_S = 30.0
"""How long the last bytes are tried again at the end, with a disk that takes nothing."""
CLOSE_S = LAST_TRIES_S + 5.0


class Recorder(MessageWriter):
    """Writes one session: /serial/rx, /serial/tx, events and derived results, in segments.

    It is the ``recorder`` of a SerialLink and gets all bytes before they are decoded. ``lost_bytes`` are received or
    sent bytes that are in no file. After ``close``, ``damage`` is the difference between the files and the bytes
    written to them, None without one. ``news`` gives the events of the recorder.
    """

    def __init__(
        self,
        path: Path,
        *,
        live: bool,
        segment_bytes: int = SEGMENT_BYTES,
        open_writer: Callable[[Path], CaptureWriter] = CaptureWriter,
        last_tries_s: float = LAST_TRIES_S,
    ) -> None:
        """Create the session file; CaptureError where it exists or cannot be made. ``live``: write in a thread."""
        self.path = path
        self.lost_bytes = 0
        self.damage: str | None = None
        self._segment_bytes = segment_bytes
        self._segments = [path]
        self._damaged: set[Path] = set()
        self._attachments: list[Attachment] = []
        self._open_writer = open_writer
        self._writer = open_writer(path)
        self._session: tuple[int, int] | None = None
        self._segment_data_bytes = 0
        self._unwritten_ends, self._unwritten_sizes = array("Q"), array("L")
        self._last_tries_s = last_tries_s
        self._refused = False
        self._lost_meanwhile = False
        self._announced: Counter[str] = Counter()
        self._news: queue.SimpleQueue[LinkEvent] = queue.SimpleQueue()
        self._stamp = (0, 0)
        self._closed = False
        self._items: queue.SimpleQueue[RecordedMessage | Attachment | None] = queue.SimpleQueue()
        self._waiting_bytes = 0
        self._waiting_lock = threading.Lock()
        self._sync = DiskSync() if live else None
        self._thread = threading.Thread(target=self._run, name="record", daemon=True) if live else None
        if self._thread:
            self._thread.start()

    @property
    def waiting_bytes(self) -> int:
        """Bytes that the disk has not taken yet."""
        return self._waiting_bytes + self._writer.pending

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Attach a file to the session; every segment gets it."""
        self._submit(Attachment(name, media_type, data))

    def write(self, message: RecordedMessage) -> None:
        """Write a message; never waits for the disk of a live session, never fails."""
        self._submit(message)

    def news(self) -> list[LinkEvent]:
        """Events of the recorder since the last call, for the operator and for the session's events."""
        found = []
        while not self._news.empty():
            found.append(self._news.get_nowait())
        return found

    def close(self) -> None:
        """Write the remaining bytes, close and compress the segments; ``lost_bytes`` is final afterwards."""
        if self._closed:
            return
        self._closed = True
        if self._thread is None:
            self._finish()
        else:
            self._items.put(None)
            self._thread.join(CLOSE_S)
            if self._thread.is_alive():
                waiting = self.waiting_bytes
                self.lost_bytes += waiting
                text = f"the disk of {self.path} does not answer: {waiting} bytes are not in the file; check the disk"
                self._announce(RecorderKind.LOST, text)
                return
        if self._segments[-1].exists():
            self._read_back(self._segments[-1], self._writer.written, self._segment_data_bytes)
        self._compact()

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _submit(self, item: RecordedMessage | Attachment) -> None:
        if self._closed:
            self._lose(item, "after the recording was closed")
        elif self._thread is None:
            self._take([item])
        elif self._waiting_bytes > WAITING_LIMIT_BYTES or self._items.qsize() > WAITING_LIMIT_ITEMS:
            self._lose(item, "because too much waits for the disk")
        else:
            self._count_waiting(len(item.data))
            self._items.put(item)
            if self._waiting_bytes > BEHIND_BYTES:
                text = f"the disk of {self.path} is slow: received bytes wait in memory"
                self._announce_once(RecorderKind.BEHIND, text)

    def _count_waiting(self, change: int) -> None:
        # Added by the receive thread and the station's, subtracted by the writing thread.
        with self._waiting_lock:
            self._waiting_bytes += change

    def _run(self) -> None:
        synced_s = time.monotonic()
        ended = False
        while not ended:
            batch: list[RecordedMessage | Attachment] = []
            ended = not self._collect(batch)
            self._take(batch)
            self._count_waiting(-sum(len(item.data) for item in batch))
            if time.monotonic() - synced_s >= SYNC_S:
                self._keep_safe()
                synced_s = time.monotonic()
        self._finish()

    def _collect(self, batch: list[RecordedMessage | Attachment]) -> bool:
        """Collect all waiting items, none after SYNC_S without one; False at the end of the session."""
        try:
            item = self._items.get(timeout=SYNC_S)
            while item is not None:
                batch.append(item)
                item = self._items.get_nowait()
        except queue.Empty:
            return True
        return False

    def _take(self, batch: list[RecordedMessage | Attachment]) -> None:
        for item in batch:
            if self._writer.pending > WAITING_LIMIT_BYTES:
                self._lose(item, "because the disk takes no more bytes")
            elif isinstance(item, Attachment):
                self._attachments.append(item)
                self._writer.put_attachment(item.name, item.media_type, item.data)
            else:
                self._stamp = (item.utc_ns, item.mono_ns)
                self._writer.put(item)
                if item.topic in (RX, TX):
                    self._unwritten_ends.append(self._writer.size)
                    self._unwritten_sizes.append(len(item.data))
                    self._segment_data_bytes += len(item.data)
        if self._flush() and self._writer.size >= self._segment_bytes:
            self._next_segment()

    def _flush(self) -> bool:
        try:
            self._writer.flush()
        except OSError as error:
            if not self._refused:
                self._refused, self._lost_meanwhile = True, False
                text = f"{self.path}: {error.strerror}; free some disk space; received bytes wait in memory"
                self._announce_at_most(REFUSALS_ANNOUNCED, RecorderKind.REFUSED, text)
            return False
        del self._unwritten_ends[:], self._unwritten_sizes[:]
        if self._refused:
            self._refused = False
            lost = f"{self.lost_bytes} received bytes are lost in all"
            loss = lost if self._lost_meanwhile else "nothing was lost"
            self._announce_at_most(REFUSALS_ANNOUNCED, RecorderKind.RECOVERED, f"{self.path} takes bytes again; {loss}")
        return True

    def _keep_safe(self) -> None:
        """Once a second: write again after a disk error, sync, and restore a deleted file."""
        try:
            if self._writer.restore_if_vanished():
                text = f"{self._segments[-1]} was deleted and is written again in full"
                self._announce(RecorderKind.FILE_RESTORED, text)
            if self._flush() and self._sync:
                self._sync.ask(self._writer.syncing)
                if self._sync.error:
                    raise self._sync.error
        except OSError as error:
            self._announce_once(
                RecorderKind.UNSAFE, f"{self._segments[-1]}: {error.strerror}; the session is at risk: check the disk"
            )

    def _next_segment(self) -> None:
        """Continue in a new file, or in the old one if that fails."""
        number = len(self._segments) + 1
        path = segment_path(self.path, number)
        self._session = self._session or self._writer.first_stamp or self._stamp
        try:
            following = self._begun(path, number)
        except (CaptureError, OSError) as error:
            self._segment_bytes += SEGMENT_BYTES
            self._announce_once(
                RecorderKind.SEGMENT,
                f"no new segment {path}: {error}; the session goes on in the old one",
            )
            return
        previous, self._writer = self._writer, following
        self._segments.append(path)
        data_bytes, self._segment_data_bytes = self._segment_data_bytes, 0
        try:
            previous.continued(path.name, self._session, *self._stamp)
            previous.close()
        except OSError as error:
            self._leave_unfinished(self._segments[-2], error)
        self._read_back(self._segments[-2], previous.written, data_bytes)

    def _begun(self, path: Path, number: int) -> CaptureWriter:
        """The next file of the session with its attachments; where the disk refuses them, none is left."""
        following = self._open_writer(path)
        try:
            for item in self._attachments:
                following.attach(item.name, item.media_type, item.data)
            following.continues(number, self._session, *self._stamp)
        except OSError:
            with contextlib.suppress(OSError):
                following.close()
            path.unlink(missing_ok=True)
            raise
        return following

    def _finish(self) -> None:
        until_s = time.monotonic() + self._last_tries_s
        self._keep_safe()
        if self._sync:
            self._sync.end()
        self._writer.finish()
        while not self._flush() and time.monotonic() < until_s:
            time.sleep(0.1)
        written = self._writer.size - self._writer.pending
        lost = sum(size for end, size in zip(self._unwritten_ends, self._unwritten_sizes, strict=True) if end > written)
        if self._writer.vanished():
            lost = self._segment_data_bytes
        try:
            self._writer.close()
        except OSError as error:
            self._leave_unfinished(self._segments[-1], error)
        if lost:
            self.lost_bytes += lost
            self._announce(
                RecorderKind.LOST, f"{lost} received bytes are not in {self._segments[-1]}: the disk took no more"
            )
        self._segment_data_bytes -= lost

    def _leave_unfinished(self, segment: Path, error: OSError) -> None:
        """Tell that a file has no end: without one a reader cannot know that nothing is missing."""
        text = f"{segment}: {error.strerror}; it was not closed properly; it is still readable"
        self.damage = f"{self.damage}; {text}" if self.damage else text
        self._announce(RecorderKind.UNFINISHED, text)

    def _read_back(self, segment: Path, written: WrittenBytes, data_bytes: int) -> None:
        """Compare a closed file with the bytes written to it, before it is compressed."""
        difference = read_back(segment, written, data_bytes)
        if difference is not None:
            self._damaged.add(segment)
            self.damage = f"{self.damage}; {difference.text}" if self.damage else difference.text
            self.lost_bytes += difference.lost_bytes
            self._announce(RecorderKind.FILE_DAMAGED, difference.text)

    def _compact(self) -> None:
        for segment in self._segments:
            try:
                if segment.exists() and segment not in self._damaged and not compact(segment):
                    self._announce(RecorderKind.UNCOMPRESSED, f"{segment} could not be compressed; it stays as it is")
            except CaptureError as error:
                self._announce(RecorderKind.UNCOMPRESSED, str(error))

    def _lose(self, item: RecordedMessage | Attachment, why: str) -> None:
        if isinstance(item, RecordedMessage) and item.topic in (RX, TX):
            self.lost_bytes += len(item.data)
        self._lost_meanwhile = True
        self._announce_once(RecorderKind.LOST, f"bytes are lost {why}; the report counts them")

    def _announce_once(self, kind: str, text: str) -> None:
        self._announce_at_most(1, kind, text)

    def _announce_at_most(self, times: int, kind: str, text: str) -> None:
        self._announced[kind] += 1
        if self._announced[kind] <= times:
            self._announce(kind, text)

    def _announce(self, kind: str, text: str) -> None:
        self._news.put(LinkEvent(*self._stamp, kind, text))
