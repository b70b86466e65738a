"""Memory of the bytes written to a file: a checksum of each block, and the last bytes themselves.

Another program, a bad sector or a faulty stick can change a file while it grows. The closed file is compared with this
memory.
"""

import zlib
from array import array

from drivers.session_file.file_window import FileWindow

BLOCK_BYTES = 64 << 10
TAIL_BYTES = 8 << 20
"""The end of the file that memory still holds: an hour at 10 Hz."""


class WrittenBytes:
    """Grows with each write; 4 bytes of memory for 64 KiB of file, and TAIL_BYTES."""

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
        for number, checksum in enumerate(checksums):
            offset = number * BLOCK_BYTES
            size = min(BLOCK_BYTES, self.size - offset)
            block = window.get(offset, size)
            if len(block) != size or zlib.crc32(block) != checksum:
                found.append(offset)
        return found

    def tail(self) -> tuple[int, bytes]:
        """Offset and bytes of the end of the file that is still in memory."""
        return self.size - len(self._tail), bytes(self._tail)
