"""The work that a session file may cause: bytes unpacked, messages and search steps within chunks, against its size.

A few hundred bytes can unpack to megabytes, and megabytes to a hundred thousand messages. What this station writes
unpacks to at most 440 times its size (a message of 64 KiB of one value) and has an index entry of 16 bytes in the file
for each packed message, so both stay far below the limit.
"""

from drivers.errors import CaptureError

FREE_BYTES = 64 << 20
WORK_PER_BYTE = 512
STEP_BYTES = 4096
"""What a message within a chunk, or a look for one, counts at least."""


class WorkLimit:
    """Counts the work that one file causes; CaptureError above FREE_BYTES and WORK_PER_BYTE times its size."""

    def __init__(self, file: str, size: int) -> None:
        self._file, self._size = file, size
        self._left = FREE_BYTES + WORK_PER_BYTE * size

    def spend(self, size: int) -> None:
        """So many bytes are unpacked or looked at."""
        self._left -= size
        if self._left < 0:
            raise CaptureError(
                f"{self._file} unpacks to too much: its {self._size} bytes stand for more than {WORK_PER_BYTE} times "
                f"as many and {FREE_BYTES >> 20} MiB besides, as no session of this station does; it is not read on"
            )
