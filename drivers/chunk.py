"""Received bytes with the time of their reception, and events of the link."""

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

NS_PER_S = 1_000_000_000


class Chunk(NamedTuple):
    """Bytes of a port and the time at which they were read; a tuple, because a night has a million of them.

    ``utc_ns`` is UTC in nanoseconds since 1970-01-01 (leap seconds not counted), ``mono_ns`` the
    monotonic clock of the same host: the two together show a step of the UTC clock.
    """

    utc_ns: int
    mono_ns: int
    data: bytes


class LinkKind(StrEnum):
    """Kinds of events of the port, of its state and of a played recording."""

    OPENED = "OPENED"
    REOPENED = "REOPENED"
    LOST = "LOST"
    BACKLOG = "BACKLOG"
    BACKLOG_FULL = "BACKLOG_FULL"
    NOT_RUN = "NOT_RUN"
    NO_PORT = "NO_PORT"
    OTHER_ADAPTER = "OTHER_ADAPTER"
    WAITING = "WAITING"
    SYNCING = "SYNCING"
    STREAMING = "STREAMING"
    STALE = "STALE"
    SILENT = "SILENT"
    NO_FRAMES = "NO_FRAMES"
    DAMAGED = "DAMAGED"
    TRUNCATED = "TRUNCATED"
    UNREADABLE = "UNREADABLE"
    LOOP = "LOOP"
    SENT = "SENT"
    """Bytes that the station sent, in hexadecimal digits: recorded as such on /serial/tx, never as an event."""
    LINE_ERRORS = "LINE_ERRORS"
    LINE_FULL = "LINE_FULL"
    OTHER_END = "OTHER_END"
    PASSING = "PASSING"
    FAULT = "FAULT"


@dataclass(frozen=True, slots=True)
class LinkEvent:
    """Something that happened to the link, at an instant: never an exception, always recorded.

    ``kind`` is a short upper-case word: a LinkKind, a kind of a package above, or any word that a recorded
    session holds. ``text`` is one line for the operator.
    """

    utc_ns: int
    mono_ns: int
    kind: str
    text: str
