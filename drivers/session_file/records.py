"""Records of a session file: messages, attachments, damage.

A message stands in MCAP as (channel, sequence u32, log_time u64, publish_time u64, data). Here log_time is UTC and
publish_time the monotonic clock, both in nanoseconds, and ``sequence`` (free for the publisher's use) carries the
CRC-32 of the message, because an unchunked MCAP file has no checksum of its own until it is closed:

    crc32( topic as UTF-8, 0x00, log_time u64 LE, publish_time u64 LE, data )
"""

import functools
import json
import re
import struct
import zlib
from dataclasses import dataclass
from typing import NamedTuple

from drivers.chunk import Chunk, LinkEvent, LinkKind
from drivers.outside_text import plain_line

RX = "/serial/rx"
TX = "/serial/tx"
EVENTS = "/events"
CLOCK = "/clock"
CONTINUED = "/continued"
"""The last message of a segment that has a successor: its name, or a JSON object with ``next`` and ``session``."""
CONTINUES = "/continues"
"""The first message of a further segment, stamped as the CONTINUED before it: its session and its number as JSON."""

PROFILE = "gse-session"
"""The MCAP profile of a session of this station."""

_KIND = re.compile("[A-Z][A-Z0-9_]{0,39}")


class RecordedMessage(NamedTuple):
    """One message of a session: raw bytes of a port, an event, a derived result."""

    topic: str
    utc_ns: int
    mono_ns: int
    data: bytes

    def chunk(self) -> Chunk:
        """The chunk of a message of /serial/rx or /serial/tx."""
        return Chunk(self.utc_ns, self.mono_ns, self.data)

    def event(self) -> LinkEvent:
        """The event of a message of /events; of kind UNREADABLE where it cannot be read.

        What was sent stands in /serial/tx alone: SENT with another text than bytes would be taken for those.
        """
        try:
            document = json.loads(self.data)
            kind, text = str(document["kind"]), plain_line(str(document["text"]))
        except (ValueError, KeyError, TypeError, RecursionError):
            kind, text = "", ""
        if not _KIND.fullmatch(kind) or kind == LinkKind.SENT:
            return LinkEvent(self.utc_ns, self.mono_ns, LinkKind.UNREADABLE, f"{self.data[:40]!r} is not an event")
        return LinkEvent(self.utc_ns, self.mono_ns, kind, text)


@dataclass(frozen=True, slots=True)
class Attachment:
    """A file frozen into the session: the station file, the protocol description."""

    name: str
    media_type: str
    data: bytes


@dataclass(frozen=True, slots=True)
class Damage:
    """Bytes of a session file that are not an intact record."""

    file: str
    offset: int
    size: int
    reason: str


Record = RecordedMessage | Attachment | Damage


def checksum(topic: str, utc_ns: int, mono_ns: int, data: bytes) -> int:
    """The CRC-32 of a message, see the head of this module."""
    return zlib.crc32(data, zlib.crc32(struct.pack("<QQ", utc_ns, mono_ns), topic_checksum(topic)))


@functools.lru_cache(maxsize=64)
def topic_checksum(topic: str) -> int:
    """What the CRC-32 of a message begins with: both stamps and the data follow, as they stand in the file."""
    return zlib.crc32(topic.encode() + b"\0")


def event_message(event: LinkEvent) -> RecordedMessage:
    """An event as the message of /events that holds it."""
    document = {"kind": event.kind, "text": event.text}
    return RecordedMessage(EVENTS, event.utc_ns, event.mono_ns, json.dumps(document, ensure_ascii=False).encode())


class MessageWriter:
    """Writer of messages: received bytes, sent bytes, events and derived results."""

    def write(self, message: RecordedMessage) -> None:
        """Any message."""
        raise NotImplementedError

    def rx(self, chunk: Chunk) -> None:
        """Bytes that came from the port."""
        self.write(RecordedMessage(RX, chunk.utc_ns, chunk.mono_ns, chunk.data))

    def tx(self, chunk: Chunk) -> None:
        """Bytes that went to the port."""
        self.write(RecordedMessage(TX, chunk.utc_ns, chunk.mono_ns, chunk.data))

    def event(self, event: LinkEvent) -> None:
        """Write an event."""
        self.write(event_message(event))

    def derived(self, topic: str, utc_ns: int, json_bytes: bytes) -> None:
        """A result that was derived from the bytes, as JSON."""
        self.write(RecordedMessage(topic, utc_ns, 0, json_bytes))
