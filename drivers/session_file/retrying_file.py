"""File that keeps unwritten bytes after a disk error and writes them later.

MCAP's own writer forgets a record when the write below it fails. So it writes into a spool, which never fails;
``flush`` hands the bytes to the kernel, and what the kernel refuses stays for the next flush, in order.
"""

import os
from collections.abc import Callable
from pathlib import Path

from drivers.host_files import CREATE, read_at
from drivers.session_file.written_bytes import WrittenBytes

COPY_BYTES = 1 << 20


class RetryingFile:
    """An append-only file with a memory of what is not yet written."""

    def __init__(self, path: Path) -> None:
        """Create the file; FileExistsError where there is one already: nothing is ever overwritten."""
        self.path = path
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
            there, here = os.stat(self.path), os.fstat(self._fd)
        except OSError:
            return True
        return (there.st_dev, there.st_ino) != (here.st_dev, here.st_ino)

    def restore(self) -> None:
        """Write a vanished file again, whole, from the open descriptor; OSError where that is not possible."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        fd = os.open(self.path, CREATE, 0o644)
        try:
            offset = 0
            while block := read_at(self._fd, COPY_BYTES, offset):
                while block:
                    count = os.write(fd, block)
                    offset, block = offset + count, block[count:]
        except OSError:
            os.close(fd)
            self.path.unlink(missing_ok=True)
            raise
        os.close(self._fd)
        self._fd = fd

    def close(self) -> None:
        """Close the file; what is still pending is lost, so ``flush`` first."""
        os.close(self._fd)
