"""A closed session file: read back against what was written to it, then packed, compressed and indexed.

Raw data is never rewritten. Where the file differs, its intact records and the bytes still in memory go to a file
beside it. The packed file takes the plain one's name, in one step, only once it is written, synced and read back the
same.
"""

import contextlib
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mcap.writer import CompressionType, Writer

from drivers.errors import CaptureError
from drivers.host_files import READ, new_file, sync_folder
from drivers.session_file.reader import one_file
from drivers.session_file.record_scanner import FileWindow
from drivers.session_file.records import PROFILE, RX, TX, Attachment, Damage, Record, RecordedMessage, checksum
from drivers.session_file.writer import BLOCK_BYTES, WrittenBytes


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
