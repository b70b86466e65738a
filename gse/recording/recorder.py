"""The recorder: everything of a session goes to its file, and what does not is counted.

For a live port a thread of its own writes, behind a queue: a disk that stalls delays neither reading nor identifying.
For simulated sessions, which can wait, everything is written at once. A disk that refuses is tried again all night;
what it has not taken waits in memory, up to a limit, and the operator is told once.
"""

import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

from drivers.chunk import LinkEvent
from drivers.errors import CaptureError
from drivers.session_file.compaction import compact
from drivers.session_file.reader import segment_path
from drivers.session_file.records import RX, TX, Attachment, Message, MessageWriter
from drivers.session_file.writer import CaptureWriter
from gse.recording.event_kinds import RecorderKind

SEGMENT_BYTES = 512 << 20
"""Some 50 hours at 10 Hz; a file that any tool still opens."""
WAITING_LIMIT_BYTES = 256 << 20
"""Most bytes kept for a disk that does not take them: 45 minutes at 921600 baud."""
BEHIND_BYTES = 4 << 20
SYNC_S = 1.0
CLOSE_S = 30.0
LAST_TRIES_S = 2.0


class Recorder(MessageWriter):
    """One session in the making: /serial/rx, /serial/tx, events and derived results, in segments.

    It is the ``recorder`` of a SerialLink, which hands it all bytes before anybody decodes them. ``lost_bytes`` are
    received or sent bytes that are in no file; ``news`` gives what the operator and the night's events should know.
    """

    def __init__(
        self,
        path: Path,
        *,
        live: bool,
        segment_bytes: int = SEGMENT_BYTES,
        open_writer: Callable[[Path], CaptureWriter] = CaptureWriter,
    ) -> None:
        """Create the session file; CaptureError where it exists or cannot be made. ``live``: write in a thread."""
        self.path = path
        self.lost_bytes = 0
        self._segment_bytes = segment_bytes
        self._segments = [path]
        self._attachments: list[Attachment] = []
        self._open_writer = open_writer
        self._writer = open_writer(path)
        self._segment_data_bytes = 0
        self._unwritten: deque[tuple[int, int]] = deque()
        self._refused = False
        self._told: set[str] = set()
        self._news: queue.SimpleQueue[LinkEvent] = queue.SimpleQueue()
        self._stamp = (0, 0)
        self._closed = False
        self._items: queue.SimpleQueue[Message | Attachment | None] = queue.SimpleQueue()
        self._waiting_bytes = 0
        self._waiting_lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="record", daemon=True) if live else None
        if self._thread:
            self._thread.start()

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """A file to freeze into the session; every segment gets it."""
        self._submit(Attachment(name, media_type, data))

    def write(self, message: Message) -> None:
        """Any message; never waits for the disk of a live session, never fails."""
        self._submit(message)

    def news(self) -> list[LinkEvent]:
        """What happened to the recording since the last call: for the operator and for the night's events."""
        found = []
        while not self._news.empty():
            found.append(self._news.get_nowait())
        return found

    def close(self) -> None:
        """Write what is left, close and compress the segments. ``lost_bytes`` is final then."""
        if self._closed:
            return
        self._closed = True
        if self._thread is None:
            self._finish()
        else:
            self._items.put(None)
            self._thread.join(CLOSE_S)
            if self._thread.is_alive():
                self.lost_bytes += self._waiting_bytes
                text = f"the disk of {self.path} does not answer: {self._waiting_bytes} bytes are not in the file"
                self._say(RecorderKind.LOST, text)
                return
        self._compact()

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _submit(self, item: Message | Attachment) -> None:
        if self._closed:
            self._lose(item, "after the recording was closed")
        elif self._thread is None:
            self._take([item])
        elif self._waiting_bytes > WAITING_LIMIT_BYTES:
            self._lose(item, "because too much waits for the disk already")
        else:
            self._count_waiting(len(item.data))
            self._items.put(item)
            if self._waiting_bytes > BEHIND_BYTES:
                self._say_once(RecorderKind.BEHIND, f"the disk of {self.path} is slow: what it has not taken waits")

    def _count_waiting(self, change: int) -> None:
        # The receive thread adds, the station's adds, the writing thread takes away.
        with self._waiting_lock:
            self._waiting_bytes += change

    def _run(self) -> None:
        synced_s = time.monotonic()
        ended = False
        while not ended:
            batch: list[Message | Attachment] = []
            ended = not self._collect(batch)
            self._take(batch)
            self._count_waiting(-sum(len(item.data) for item in batch))
            if time.monotonic() - synced_s >= SYNC_S:
                self._keep_safe()
                synced_s = time.monotonic()
        self._finish()

    def _collect(self, batch: list[Message | Attachment]) -> bool:
        """All that waits, at least one or none after a while; False when the end was among it."""
        try:
            item = self._items.get(timeout=SYNC_S)
            while item is not None:
                batch.append(item)
                item = self._items.get_nowait()
        except queue.Empty:
            return True
        return False

    def _take(self, batch: list[Message | Attachment]) -> None:
        for item in batch:
            if self._writer.pending > WAITING_LIMIT_BYTES:
                self._lose(item, "because the disk takes nothing any more")
            elif isinstance(item, Attachment):
                self._attachments.append(item)
                self._writer.put_attachment(item.name, item.media_type, item.data)
            else:
                self._stamp = (item.utc_ns, item.mono_ns)
                self._writer.put(item)
                if item.topic in (RX, TX):
                    self._unwritten.append((self._writer.size, len(item.data)))
                    self._segment_data_bytes += len(item.data)
        if self._flush() and self._writer.size >= self._segment_bytes:
            self._next_segment()

    def _flush(self) -> bool:
        try:
            self._writer.flush()
        except OSError as error:
            self._refused = True
            self._say_once(
                RecorderKind.REFUSED,
                f"{self.path}: {error.strerror}; free the disk, what comes waits in memory",
            )
            return False
        self._unwritten.clear()
        if self._refused:
            self._refused = False
            self._say(RecorderKind.RECOVERED, f"{self.path} takes bytes again; nothing that waited was lost")
        return True

    def _keep_safe(self) -> None:
        """Once a second: try again what was refused, sync, and see that the file is still there."""
        try:
            if self._writer.restore_if_vanished():
                self._say(RecorderKind.FILE_RESTORED, f"{self._segments[-1]} was deleted and is written again, whole")
            if self._flush():
                self._writer.sync()
        except OSError as error:
            self._say_once(RecorderKind.UNSAFE, f"{self._segments[-1]}: {error.strerror}; the session is at risk")

    def _next_segment(self) -> None:
        """Go on in a new file; where none can be made, in the old one."""
        path = segment_path(self.path, len(self._segments) + 1)
        try:
            following = self._open_writer(path)
            for item in self._attachments:
                following.attach(item.name, item.media_type, item.data)
        except (CaptureError, OSError) as error:
            self._segment_bytes += SEGMENT_BYTES
            self._say_once(
                RecorderKind.SEGMENT,
                f"no new segment {path}: {error}; the session goes on in the old one",
            )
            return
        previous, self._writer = self._writer, following
        self._segments.append(path)
        self._segment_data_bytes = 0
        try:
            previous.continued(path.name, *self._stamp)
            previous.close()
        except OSError as error:
            self._say(RecorderKind.UNFINISHED, f"{self._segments[-2]}: {error.strerror}; it has no proper end")

    def _finish(self) -> None:
        until_s = time.monotonic() + LAST_TRIES_S
        self._keep_safe()
        while self._writer.pending and time.monotonic() < until_s:
            time.sleep(0.1)
            self._flush()
        written = self._writer.size - self._writer.pending
        lost = sum(size for end, size in self._unwritten if end > written)
        if self._writer.vanished():
            lost = self._segment_data_bytes
        try:
            self._writer.close()
        except OSError as error:
            self._say(RecorderKind.UNFINISHED, f"{self._segments[-1]}: {error.strerror}; it has no proper end")
        if lost:
            self.lost_bytes += lost
            self._say(
                RecorderKind.LOST,
                f"{lost} received bytes are not in {self._segments[-1]}: the disk took no more",
            )

    def _compact(self) -> None:
        for segment in self._segments:
            try:
                if segment.exists():
                    compact(segment)
            except CaptureError as error:
                self._say(RecorderKind.UNCOMPRESSED, str(error))

    def _lose(self, item: Message | Attachment, why: str) -> None:
        if isinstance(item, Message) and item.topic in (RX, TX):
            self.lost_bytes += len(item.data)
        self._say_once(RecorderKind.LOST, f"bytes are lost {why}; they are counted")

    def _say_once(self, kind: str, text: str) -> None:
        if kind not in self._told:
            self._told.add(kind)
            self._say(kind, text)

    def _say(self, kind: str, text: str) -> None:
        self._news.put(LinkEvent(*self._stamp, kind, text))
