"""Bytes by offset: of a file through a window, or of a block in memory."""

import os
from pathlib import Path

from drivers.errors import CaptureError
from drivers.host_files import READ, read_at

WINDOW_BYTES = 1 << 20


class BlockWindow:
    """Bytes by offset of a block in memory."""

    def __init__(self, block: bytes) -> None:
        self.block = block
        self.size = len(block)

    def get(self, offset: int, size: int) -> bytes:
        """At most ``size`` bytes from ``offset`` on, fewer at the end."""
        return self.block[offset : offset + size]


def refuse_special(path: Path) -> None:
    """CaptureError for a pipe or a device: nobody may write into it, or it may never end."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise CaptureError(f"{path} cannot be read: it is a pipe or a device; expected a file")


class FileWindow:
    """Bytes by offset of a file.

    Not a memory map: with one, a disk that fails to read kills the process instead of raising an error.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        refuse_special(path)
        try:
            self._fd = os.open(path, READ)
        except OSError as error:
            raise CaptureError(f"cannot read {path}: {error.strerror}") from error
        self.size = os.fstat(self._fd).st_size
        self._start, self._block = 0, b""

    def get(self, offset: int, size: int) -> bytes:
        """At most ``size`` bytes from ``offset`` on, fewer at the end; CaptureError where the disk fails."""
        size = max(0, min(size, self.size - offset))
        begin = offset - self._start
        if begin < 0 or begin + size > len(self._block):
            self._start, self._block, begin = (
                offset,
                self._read(offset, max(size, min(WINDOW_BYTES, self.size - offset))),
                0,
            )
        return self._block[begin : begin + size]

    def close(self) -> None:
        """Close the file."""
        os.close(self._fd)

    def __enter__(self) -> "FileWindow":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _read(self, offset: int, size: int) -> bytes:
        try:
            return read_at(self._fd, size, offset)
        except OSError as error:
            raise CaptureError(f"cannot read {self._path} at byte {offset}: {error.strerror}") from error


Window = BlockWindow | FileWindow
