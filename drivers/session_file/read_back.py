"""Comparison of a closed session file with the bytes written to it, and recovery where they differ.

Raw data is never rewritten: the intact records of the file and the bytes still in memory go to a file beside it.
"""

import contextlib
import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from drivers.errors import CaptureError
from drivers.host_files import READ, new_file
from drivers.session_file.compaction import write_compact
from drivers.session_file.file_window import FileWindow
from drivers.session_file.reader import one_file
from drivers.session_file.records import RX, TX, RecordedMessage
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
