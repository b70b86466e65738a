"""Kinds of events of the recorder."""

from enum import StrEnum


class RecorderKind(StrEnum):
    """What happened to the session file while it was written."""

    BEHIND = "RECORDER_BEHIND"
    REFUSED = "RECORDER_REFUSED"
    RECOVERED = "RECORDER_RECOVERED"
    LOST = "RECORDER_LOST"
    UNSAFE = "RECORDER_UNSAFE"
    SEGMENT = "RECORDER_SEGMENT"
    UNFINISHED = "RECORDER_UNFINISHED"
    UNCOMPRESSED = "RECORDER_UNCOMPRESSED"
    FILE_RESTORED = "FILE_RESTORED"
