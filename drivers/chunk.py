"""Bytes as they came from a port, with the instant at which they came."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Chunk:
    """Some bytes of a port and when they were read.

    ``utc_ns`` is UTC in nanoseconds since 1970-01-01 (leap seconds not counted), ``mono_ns`` the
    monotonic clock of the same host: the two together show a step of the UTC clock.
    """

    utc_ns: int
    mono_ns: int
    data: bytes


@dataclass(frozen=True, slots=True)
class LinkEvent:
    """Something that happened to the link, at an instant: never an exception, always recorded.

    ``kind`` is a short upper-case word (``OPENED``, ``LOST``, ``REOPENED``, ``STREAMING``, ``STALE``, ...), ``text``
    one line for the operator.
    """

    utc_ns: int
    mono_ns: int
    kind: str
    text: str
