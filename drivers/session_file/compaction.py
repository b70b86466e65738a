"""A closed session file, compressed and indexed, in the place of the plain one.

Only once the new file is written, synced and read back the same does it take the old one's name, in one step.
"""

import os
from collections.abc import Iterator
from pathlib import Path

from mcap.writer import CompressionType, Writer

from drivers.errors import CaptureError
from drivers.host_files import new_file, sync_folder
from drivers.session_file.reader import one_file
from drivers.session_file.records import PROFILE, RX, TX, Attachment, Damage, Record, RecordedMessage, checksum

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
