"""Session files: chunks to MCAP.

Unchunked, and handed to the kernel after every message: what was written stays when the process is killed. Reading is
``read_capture`` of drivers/session_file/reader.py.

MCAP's own writer forgets a record when the write below it fails. So it writes into a spool (``RetryingFile``), which
never fails; ``flush`` hands the bytes to the kernel, and what the kernel refuses stays for the next flush, in order.
"""

import contextlib
import json
import os
import shutil
import zlib
from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from mcap.writer import CompressionType, IndexType, Writer

from drivers.errors import CaptureError
from drivers.host_files import CREATE, READ, new_file, read_at, sync_folder
from drivers.session_file.reader import one_file
from drivers.session_file.record_scanner import FileWindow
from drivers.session_file.records import (
    CONTINUED,
    CONTINUES,
    EVENTS,
    PROFILE,
    RX,
    TX,
    Attachment,
    Damage,
    MessageWriter,
    Record,
    RecordedMessage,
    checksum,
)

BLOCK_BYTES = 64 << 10
TAIL_BYTES = 8 << 20
"""The end of the file that memory still holds: an hour at 10 Hz."""
_LAST_NS = 2**64 - 1
_ENCODINGS = {RX: "octet-stream", TX: "octet-stream"}


class WrittenBytes:
    """Memory of the bytes written to a file: a checksum of each block, and the last bytes themselves.

    Another program, a bad sector or a faulty stick can change a file while it grows. The closed file is compared with
    this memory: 4 bytes for 64 KiB of file, and TAIL_BYTES.
    """

    def __init__(self) -> None:
        self.size = 0
        self._checksums = array("I")
        self._crc = 0
        self._tail = bytearray()

    def add(self, data: bytes) -> None:
        """Add bytes written at the end of the file."""
        self._tail += data
        if len(self._tail) > 2 * TAIL_BYTES:
            del self._tail[:-TAIL_BYTES]
        view = memoryview(data)
        while view:
            room = BLOCK_BYTES - self.size % BLOCK_BYTES
            self._crc = zlib.crc32(view[:room], self._crc)
            self.size += min(room, len(view))
            view = view[room:]
            if self.size % BLOCK_BYTES == 0:
                self._checksums.append(self._crc)
                self._crc = 0

    def differing(self, window: FileWindow) -> list[int]:
        """Offsets of the blocks of a file that are not what was written; CaptureError where it cannot be read."""
        checksums = [*self._checksums, self._crc] if self.size % BLOCK_BYTES else list(self._checksums)
        found = []
        for number, expected in enumerate(checksums):
            offset = number * BLOCK_BYTES
            size = min(BLOCK_BYTES, self.size - offset)
            block = window.get(offset, size)
            if len(block) != size or zlib.crc32(block) != expected:
                found.append(offset)
        return found

    def tail(self) -> tuple[int, bytes]:
        """Offset and bytes of the end of the file that is still in memory."""
        return self.size - len(self._tail), bytes(self._tail)


class CaptureWriter(MessageWriter):
    """One session file in the making, never one that exists already."""

    def __init__(self, path: Path | str) -> None:
        """Create the file; CaptureError where it exists or cannot be made."""
        try:
            self._spool = RetryingFile(Path(path))
        except FileExistsError:
            raise CaptureError(f"{path} exists already; a session is never overwritten: choose another name") from None
        except OSError as error:
            raise CaptureError(f"cannot create {path}: {error.strerror}") from error
        self._writer = Writer(
            self._spool,
            use_chunking=False,
            index_types=IndexType.ATTACHMENT,
            enable_data_crcs=True,
        )
        self._channels: dict[str, int] = {}
        self._finished = False
        self.first_stamp: tuple[int, int] | None = None
        """UTC and monotonic clock of the first message: of a session's first segment, what tells it from all others."""
        self._writer.start(profile=PROFILE, library="gse-star-sensor")
        for topic in (RX, TX, EVENTS):
            self._channel(topic)
        self._begin(Path(path))

    def _begin(self, path: Path) -> None:
        """Write the head of the file; without it no file is left, since an empty one is not a session."""
        try:
            self._writer.flush()
        except OSError:
            self._spool.close()
            path.unlink(missing_ok=True)
            raise

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """A file to freeze into the session."""
        self.put_attachment(name, media_type, data)
        self.flush()

    def put_attachment(self, name: str, media_type: str, data: bytes) -> None:
        """A file to freeze into the session, into memory only until ``flush``."""
        self._writer.add_attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=data)

    def write(self, message: RecordedMessage) -> None:
        """Any message. OSError when the disk refuses it: it is kept then, and written with the next one."""
        self.put(message)
        self.flush()

    def put(self, message: RecordedMessage) -> None:
        """Any message, into memory only until ``flush``: for many at once."""
        # MCAP's clock is unsigned, of 64 bits: before 1970 is stored as 1970, after 2554 as 2554.
        utc_ns, mono_ns = (min(max(stamp, 0), _LAST_NS) for stamp in (message.utc_ns, message.mono_ns))
        self.first_stamp = self.first_stamp or (utc_ns, mono_ns)
        self._writer.add_message(
            channel_id=self._channel(message.topic),
            log_time=utc_ns,
            publish_time=mono_ns,
            data=message.data,
            sequence=checksum(message.topic, utc_ns, mono_ns, message.data),
        )

    def flush(self) -> None:
        """Hand everything to the kernel; OSError when the disk refuses."""
        self._spool.flush()

    def syncing(self) -> Callable[[], None]:
        """What brings everything to the disk; it may be called once, from any thread, even after ``close``."""
        return self._spool.syncing()

    @property
    def size(self) -> int:
        """Bytes of the file so far."""
        return self._spool.tell()

    @property
    def written(self) -> WrittenBytes:
        """What the kernel took, to compare the closed file with."""
        return self._spool.written

    @property
    def pending(self) -> int:
        """Bytes that the disk has not taken yet."""
        return self._spool.pending

    def vanished(self) -> bool:
        """Whether the file or its folder was deleted."""
        return self._spool.vanished()

    def restore_if_vanished(self) -> bool:
        """Write the file again if it or its folder was deleted; True when that was necessary."""
        if not self._spool.vanished():
            return False
        self._spool.restore()
        return True

    def continued(self, successor: str, session: tuple[int, int] | None, utc_ns: int, mono_ns: int) -> None:
        """Say that the session goes on in another file."""
        document = {"next": successor, "session": session}
        self.write(RecordedMessage(CONTINUED, utc_ns, mono_ns, json.dumps(document).encode()))

    def continues(self, number: int, session: tuple[int, int] | None, utc_ns: int, mono_ns: int) -> None:
        """Say which segment of which session this is; the stamp is that of the end of the segment before."""
        document = {"segment": number, "session": session}
        self.write(RecordedMessage(CONTINUES, utc_ns, mono_ns, json.dumps(document).encode()))

    def finish(self) -> None:
        """End the file with its summary, in memory only until ``flush``; no message can follow."""
        if self._finished:
            return
        self._finished = True
        # mcap's finish() leaves records that are not flushed out of the checksum of the data section (1.6).
        with contextlib.suppress(OSError):  # of the disk: all records are in the spool then
            self._writer.flush()
        self._writer.finish()

    def close(self) -> None:
        """Write the summary and close; OSError when the disk refuses, the messages before stay readable."""
        try:
            self.finish()
            self._spool.flush()
            self._spool.sync()
        finally:
            self._spool.close()

    def __enter__(self) -> "CaptureWriter":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _channel(self, topic: str) -> int:
        if topic not in self._channels:
            encoding = _ENCODINGS.get(topic, "json")
            self._channels[topic] = self._writer.register_channel(topic, encoding, schema_id=0)
        return self._channels[topic]


COPY_BYTES = 1 << 20


class RetryingFile:
    """An append-only file that keeps what is not yet written, and writes it later."""

    def __init__(self, path: Path) -> None:
        """Create the file; FileExistsError where there is one already: nothing is ever overwritten."""
        self._path = path.absolute()  # the working folder may be deleted, too
        self._fd = os.open(path, CREATE, 0o644)
        self._pending = bytearray()
        self.written = WrittenBytes()

    @property
    def pending(self) -> int:
        """Bytes that the kernel has not taken yet."""
        return len(self._pending)

    def write(self, data: bytes) -> int:
        """Take the bytes; they are in memory only until ``flush``."""
        self._pending += data
        return len(data)

    def tell(self) -> int:
        """The length of the file once everything is written."""
        return self.written.size + len(self._pending)

    def flush(self) -> None:
        """Hand everything to the kernel; OSError leaves the rest pending."""
        while self._pending:
            count = os.write(self._fd, self._pending)
            self.written.add(bytes(self._pending[:count]))
            del self._pending[:count]

    def sync(self) -> None:
        """Have the kernel bring everything to the disk."""
        os.fsync(self._fd)

    def syncing(self) -> Callable[[], None]:
        """The same, to be called once, from any thread."""
        fd = os.dup(self._fd)

        def sync() -> None:
            try:
                os.fsync(fd)
            finally:
                os.close(fd)

        return sync

    def vanished(self) -> bool:
        """Whether the file was deleted or replaced: writing still succeeds then, but without effect."""
        try:
            there, here = os.stat(self._path), os.fstat(self._fd)
        except OSError:
            return True
        return (there.st_dev, there.st_ino) != (here.st_dev, here.st_ino)

    def restore(self) -> None:
        """Write a vanished file again, whole, from the open descriptor; OSError where that is not possible."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        fd = os.open(self._path, CREATE, 0o644)
        try:
            offset = 0
            while block := read_at(self._fd, COPY_BYTES, offset):
                while block:
                    count = os.write(fd, block)
                    offset, block = offset + count, block[count:]
        except OSError:
            os.close(fd)
            self._path.unlink(missing_ok=True)
            raise
        os.close(self._fd)
        self._fd = fd

    def close(self) -> None:
        """Close the file; what is still pending is lost, so ``flush`` first."""
        os.close(self._fd)


# A closed session file: read back against what was written to it, then packed, compressed and indexed.
#
# Raw data is never rewritten. Where the file differs, its intact records and the bytes still in memory go to a file
# beside it. The packed file takes the plain one's name, in one step, only once it is written, synced and read back the
# same.


@dataclass(frozen=True, slots=True)
class Difference:
    """Description of the damage, the recovered file, and the number of the port's bytes in neither file."""

    text: str
    recovered: Path | None
    lost_bytes: int


def read_back(path: Path, written: WrittenBytes, port_bytes: int) -> Difference | None:
    """Compare a closed file with what was written to it; ``port_bytes`` of it came from or went to the port."""
    try:
        _forget_cache(path)
        with FileWindow(path) as window:
            differing, size = written.differing(window), window.size
    except CaptureError as error:
        return Difference(f"{error}: it cannot be read back", None, port_bytes)
    if not differing and size == written.size:
        return None
    text = f"{path.name} is not what was written to it: {len(differing)} of {-(-written.size // BLOCK_BYTES)} blocks"
    text += f" of {BLOCK_BYTES >> 10} KiB differ, from byte {differing[0]} on" if differing else " differ"
    if size != written.size:
        text += f", it has {size} bytes instead of {written.size}"
    try:
        recovered, found = _recover(path, written)
    except (CaptureError, OSError) as error:
        return Difference(f"{text}; nothing could be saved: {error}", None, max(port_bytes - _port_bytes(path), 0))
    lost = max(port_bytes - found, 0)
    return Difference(f"{text}; {recovered.name} holds all but {lost} bytes of the port", recovered, lost)


def _recover(path: Path, written: WrittenBytes) -> tuple[Path, int]:
    """A new session of all intact records in file and memory, and the number of the port's bytes in it."""
    beside = path.with_name(f"{path.stem}.recovered{path.suffix}")
    mended = path.with_name(f".{path.name}.mended")
    try:
        mended.unlink(missing_ok=True)
        offset, tail = written.tail()
        with path.open("rb") as source, new_file(mended) as file:
            shutil.copyfileobj(source, file)
            file.truncate(written.size)
            file.seek(offset)
            file.write(tail)
        write_compact(beside, iter(one_file(mended)))
    finally:
        mended.unlink(missing_ok=True)
    return beside, _port_bytes(beside)


def _port_bytes(path: Path) -> int:
    try:
        records = one_file(path)
        return sum(len(item.data) for item in records if isinstance(item, RecordedMessage) and item.topic in (RX, TX))
    except CaptureError:
        return 0


def _forget_cache(path: Path) -> None:
    """Drop the kernel's cache of the file, where possible, so that it is read from the disk."""
    if not hasattr(os, "posix_fadvise"):
        return
    with contextlib.suppress(OSError):
        fd = os.open(path, READ)
        try:
            os.posix_fadvise(fd, 0, 0, os.POSIX_FADV_DONTNEED)
        finally:
            os.close(fd)


CHUNK_BYTES = 64 << 10
"""Unpacked size: some 15 s at 10 Hz, the most that a damaged place can cost. Larger chunks pack no better."""


def compact(path: Path) -> bool:
    """Compress one session file in place; False where it is damaged, cut or already compact: it stays as it is.

    CaptureError where the disk refuses; the old file is untouched then.
    """
    beside = path.with_name(f".{path.name}.compacting")
    source = one_file(path)
    replaced = False
    try:
        beside.unlink(missing_ok=True)
        count = write_compact(beside, iter(source))
        if source.damage_count or source.truncated or not _reads_back_the_same(path, beside, count):
            return False
        os.replace(beside, path)
        replaced = True
        sync_folder(path.parent)
    except OSError as error:
        raise CaptureError(f"cannot compress {path}: {error.strerror}; it stays as it is, whole") from error
    finally:
        if not replaced:
            beside.unlink(missing_ok=True)
    return True


def write_compact(path: Path, records: Iterator[Record]) -> int:
    """A new session file of these records, damage left out; how many it holds. OSError where the disk refuses."""
    count = 0
    with new_file(path) as file:
        writer = Writer(file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True)
        writer.start(profile=PROFILE, library="gse-star-sensor")
        channels: dict[str, int] = {}
        for record in records:
            if isinstance(record, Damage):
                continue
            count += 1
            if isinstance(record, Attachment):
                writer.add_attachment(0, 0, record.name, record.media_type, record.data)
            else:
                _add(writer, channels, record)
        writer.finish()
        file.flush()
        os.fsync(file.fileno())
    return count


def _add(writer: Writer, channels: dict[str, int], message: RecordedMessage) -> None:
    topic = message.topic
    if topic not in channels:
        encoding = "octet-stream" if topic in (RX, TX) else "json"
        channels[topic] = writer.register_channel(topic, encoding, schema_id=0)
    writer.add_message(
        channel_id=channels[topic],
        log_time=message.utc_ns,
        publish_time=message.mono_ns,
        data=message.data,
        sequence=checksum(topic, message.utc_ns, message.mono_ns, message.data),
    )


def _reads_back_the_same(old: Path, new: Path, count: int) -> bool:
    """Whether both files hold the same attachments and the same messages in the same order."""
    copy = one_file(new)
    if sum(1 for _ in copy) != count or copy.truncated or copy.damage_count:
        return False
    return all(before == after for before, after in zip(_ordered(old), _ordered(new), strict=True))


def _ordered(path: Path) -> Iterator[Record]:
    # A chunk is written when it is full, so an attachment that came amid messages stands before them in the new file.
    yield from (record for record in one_file(path) if isinstance(record, Attachment))
    yield from (record for record in one_file(path) if isinstance(record, RecordedMessage))
