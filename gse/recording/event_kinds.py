"""Kinds of events of the recorder."""

from enum import StrEnum


class RecorderKind(StrEnum):
    """Events of writing the session file."""

    BEHIND = "RECORDER_BEHIND"
    REFUSED = "RECORDER_REFUSED"
    RECOVERED = "RECORDER_RECOVERED"
    LOST = "RECORDER_LOST"
    UNSAFE = "RECORDER_UNSAFE"
    SEGMENT = "RECORDER_SEGMENT"
    UNFINISHED = "RECORDER_UNFINISHED"
    UNCOMPRESSED = "RECORDER_UNCOMPRESSED"
    FILE_RESTORED = "FILE_RESTORED"
    FILE_DAMAGED = "FILE_DAMAGED"
