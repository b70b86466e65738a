"""MCAP records one after another, with a way on after damage.

An MCAP record is an opcode u8, a length u64 LE and that many bytes. The mcap package's readers stop at the first
broken one, trust lengths, and check neither messages nor attachments; this walk believes a record only when its
checksum says so, and after damage scans for the next record that can be believed. It walks over bytes by offset, of a
file through a window or of a block in memory.
"""

import os
import re
import struct
import zlib
from collections.abc import Container, Iterator, Sequence
from io import BytesIO
from itertools import chain
from pathlib import Path

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment as McapAttachment
from mcap.records import Channel, DataEnd, Footer, Header
from mcap.records import Chunk as McapChunk

from drivers.errors import CaptureError
from drivers.host_files import READ, read_at
from drivers.session_file.records import (
    CLOCK,
    CONTINUED,
    CONTINUES,
    EVENTS,
    PROFILE,
    RX,
    TX,
    Attachment,
    Damage,
    Record,
    RecordedMessage,
    checksum,
    topic_checksum,
)

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


# The work that a session file may cause: bytes unpacked, messages and search steps within chunks, against its size.
#
# A few hundred bytes can unpack to megabytes, and megabytes to a hundred thousand messages. What this station writes
# unpacks to at most 440 times its size (a message of 64 KiB of one value) and has an index entry of 16 bytes in the
# file for each packed message, so both stay far below the limit.

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


# What one MCAP record holds, read from its bytes, and checked where its kind has a checksum.

MAX_CHUNK_BYTES = 4 << 20
"""Unpacked: a few hundred bytes can unpack to very much more."""
_TOPIC = re.compile("/[!-~]{0,199}")


class NotBelievedError(Exception):
    """Not an intact record."""


def header_of(content: bytes) -> Header:
    """The header of a session; NotBelievedError where bytes are left over."""
    stream = stream_of(content)
    header = Header.read(stream)
    if stream.count != len(content):
        raise NotBelievedError("no header of a session")
    return header


def channel_of(content: bytes) -> Channel:
    """A channel with a topic as this station writes them."""
    stream = stream_of(content)
    channel = Channel.read(stream)
    if stream.count != len(content) or channel.schema_id != 0 or not _TOPIC.fullmatch(channel.topic):
        raise NotBelievedError("no channel of a session")
    return channel


def is_index(opcode: int, content: bytes) -> bool:
    """Whether this is the message index that follows a chunk: channel u16, size u32, entries of 16 bytes."""
    return opcode == Opcode.MESSAGE_INDEX and content[2:6] == struct.pack("<I", len(content) - 6)


def attachment_of(content: bytes) -> Attachment:
    """An attachment whose checksum is right."""
    if len(content) < 4 or zlib.crc32(content[:-4]) != struct.unpack("<I", content[-4:])[0]:
        raise NotBelievedError("attachment with a wrong checksum")
    attachment = McapAttachment.read(stream_of(content))
    return Attachment(attachment.name, attachment.media_type, attachment.data)


def unpacked(chunk: McapChunk) -> bytes:
    """The content of a chunk, as far as it can be unpacked."""
    if chunk.compression == "":
        return bytes(chunk.data)
    if chunk.compression != "zstd":
        raise NotBelievedError(f"chunk with unknown compression {chunk.compression[:20]!r}")
    unpacker = zstandard.ZstdDecompressor(max_window_size=MAX_CHUNK_BYTES).decompressobj()
    block = bytearray()
    try:
        for start in range(0, len(chunk.data), 1024):
            block += unpacker.decompress(chunk.data[start : start + 1024])
            if unpacker.eof or len(block) > MAX_CHUNK_BYTES:
                break
    except zstandard.ZstdError:
        pass
    return bytes(block[:MAX_CHUNK_BYTES])


def stream_of(content: bytes) -> ReadDataStream:
    """The bytes as the mcap package reads them."""
    return ReadDataStream(BytesIO(content))


def reason_of(error: BaseException) -> str:
    """Why a record is not believed, in words for a damage."""
    return str(error) if isinstance(error, NotBelievedError) else "no whole record"


MAGIC = b"\x89MCAP0\r\n"
MAX_RECORD_BYTES = 16 << 20
"""No record is longer: chunks are cut at 256 KiB, attachments are pages of text, messages are reads of a port."""
SCAN_BYTES = 1 << 20
MAX_SCAN_WORK = 64
"""Bytes checked per byte scanned before long candidates are passed over: damage must not cost hours."""
FREELY_CHECKED_BYTES = 1024
"""Candidates up to this length are never passed over: the messages of most sessions are shorter."""
MAX_CHANNELS = 64
MOST_TOPICS_TRIED = 16
"""For a message whose channel is unknown; this station writes fewer."""
FOREIGN_AFTER = 1 << 20

_ALWAYS = (RX, TX, EVENTS, CLOCK, CONTINUED, CONTINUES)
_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_HEAD_AND_MESSAGE = struct.Struct("<BQHIQQ")
_HEAD_BYTES = _HEAD.size
_STAMPS_AT = _HEAD_BYTES + struct.calcsize("<HI")
_DATA_AT = _HEAD_AND_MESSAGE.size
_MESSAGE_OPCODE = int(Opcode.MESSAGE)  # a look into an enumeration takes a tenth of the time of a message
_CANDIDATE = re.compile(rb"[\x04-\x06\x09\x0f\x02](?=...\x00\x00\x00\x00\x00)", re.DOTALL)
# What the mcap package and zstandard raise on damaged content, seen by flipping bits.
_BROKEN = (
    McapError,
    struct.error,
    ValueError,
    KeyError,
    IndexError,
    OverflowError,
    MemoryError,
    zstandard.ZstdError,
)


class RecordScanner:
    """The records of one MCAP file, or of the inside of one chunk."""

    def __init__(
        self,
        window: Window,
        file: str,
        *,
        from_utc_ns: int | None = None,
        only: Container[str] | None = None,
    ) -> None:
        self._window = window
        self._file = file
        self._limit = WorkLimit(file, window.size)
        self._is_chunk = False
        self._from_utc_ns = from_utc_ns or 0
        self._only = only
        self._topics: dict[int, str] = {}
        self.data_end: tuple[int, int] | None = None
        """Where the data section ends, and the CRC-32 that is said to be of everything before."""
        self.footer: tuple[int, int, int] | None = None
        """Where the footer stands, where the summary starts, and the CRC-32 that is said to be of both."""
        self.ended = False

    def has_channel(self, topic: str) -> bool:
        """Whether a channel of this topic was seen; a closed file names all of its channels once more at its end."""
        return topic in self._topics.values()

    def _inside(self, block: bytes, offset: int, only: Container[str] | None) -> "RecordScanner":
        """The scanner of a chunk's content: it knows the same channels, and works on the same account."""
        inside = RecordScanner(BlockWindow(block), f"{self._file}, chunk at {offset}", only=only)
        inside._limit, inside._topics, inside._is_chunk = self._limit, self._topics, True
        return inside

    def check_ours(self) -> None:
        """CaptureError where the file is not a session of this station."""
        if self._window.size == 0:
            raise CaptureError(f"{self._file} is empty: no session")
        if self._window.get(0, len(MAGIC)) == MAGIC:
            try:
                opcode, content, _ = self._content(len(MAGIC))
                if opcode == Opcode.HEADER and header_of(content).profile == PROFILE:
                    return
            except (NotBelievedError, *_BROKEN):
                pass
        # The head may be damaged: one message that proves true makes it ours.
        if not self._has_message(min(FOREIGN_AFTER, self._window.size)):
            raise CaptureError(
                f"{self._file} is not a session of this station (MCAP with profile {PROFILE!r} expected); "
                "a raw serial capture needs the UTC of its start: gse replay --start-utc"
            )

    def _has_message(self, end: int) -> bool:
        offset = 0
        while (start := self._scan(offset, end)) is not None:
            try:
                records, offset = self._try(start)
            except (NotBelievedError, *_BROKEN):
                # A footer is proven by its place, and may have no magic after it all the same.
                records, offset = [], start + 1
            if any(isinstance(record, RecordedMessage) for record in records):
                return True
        return False

    def records(self) -> Iterator[Record]:
        """All that can be believed, in order of the file, with the damage between."""
        return chain.from_iterable(self.parts())

    def parts(self) -> Iterator[Sequence[Record]]:
        """The same in parts: the records of a chunk together, because a night has a million of them."""
        offset = len(MAGIC)
        if self._window.size and self._window.get(0, offset) != MAGIC:
            damage, offset = self._damage(0, "no MCAP magic")
            yield [damage]
        yield from self._parts(offset)

    def _parts(self, offset: int) -> Iterator[Sequence[Record]]:
        """The same from an offset on, without the magic of a file."""
        while offset < self._window.size and not self.ended:
            messages, offset = self._messages(offset)
            yield messages
            if offset == self._window.size:
                break
            try:
                found, following = self._try(offset)
            except (NotBelievedError, *_BROKEN) as error:
                damage, offset = self._damage(offset, reason_of(error))
                yield [damage]
            else:
                yield found
                offset = following

    def _damage(self, offset: int, reason: str) -> tuple[Damage, int]:
        """The damage from an offset on, and its end: the next record that proves true."""
        following = self._scan(offset + 1, self._window.size)
        end = self._window.size if following is None else following
        return Damage(self._file, offset, end - offset, "cut off" if following is None else reason), end

    def _scan(self, offset: int, end: int) -> int | None:
        """The offset of the next record that proves true, or None."""
        work = 0
        start = offset
        while offset < end:
            block = self._window.get(offset, SCAN_BYTES)
            for match in _CANDIDATE.finditer(block):
                here = offset + match.start()
                size = _HEAD.unpack_from(block, match.start())[1]
                if size > FREELY_CHECKED_BYTES and work > SCAN_BYTES + MAX_SCAN_WORK * (here - start):
                    continue
                work += size if here + 9 + size <= self._window.size else 0
                if self._is_proven(here):
                    return here
            offset += max(1, len(block) - 8)
        return None

    def _is_proven(self, offset: int) -> bool:
        if self._is_chunk:
            self._limit.spend(STEP_BYTES)
        try:
            opcode, content, _ = self._content(offset)
            if opcode == Opcode.CHANNEL:
                channel_of(content)
            elif opcode == Opcode.DATA_END:
                return len(content) == 4
            elif opcode == Opcode.FOOTER:
                return len(content) == 20 and self._window.size == offset + 9 + 20 + len(MAGIC)
            else:
                self._parse(opcode, content, offset)
        except (NotBelievedError, *_BROKEN):
            return False
        return True

    def _try(self, offset: int) -> tuple[list[Record], int]:
        opcode, content, following = self._content(offset)
        return self._parse(opcode, content, offset), following

    def _content(self, offset: int) -> tuple[int, bytes, int]:
        head = self._window.get(offset, 9)
        if len(head) < 9:
            raise NotBelievedError("cut off")
        opcode, size = _HEAD.unpack(head)
        if not Opcode.HEADER <= opcode <= Opcode.DATA_END:
            raise NotBelievedError("no MCAP record")
        if self._is_chunk and opcode not in (Opcode.MESSAGE, Opcode.CHANNEL):
            # MCAP specification, section Chunk: schemas, channels and messages; this station writes no schemas.
            raise NotBelievedError("no record of a chunk")
        if size > MAX_RECORD_BYTES or offset + 9 + size > self._window.size:
            raise NotBelievedError("impossible length")
        return opcode, self._window.get(offset + 9, size), offset + 9 + size

    def _parse(self, opcode: int, content: bytes, offset: int) -> list[Record]:
        if opcode == Opcode.MESSAGE:
            return [self._message(content)]
        if opcode == Opcode.CHUNK:
            return self._chunk(content, offset)
        if opcode == Opcode.ATTACHMENT:
            return [attachment_of(content)]
        if opcode == Opcode.CHANNEL:
            channel = channel_of(content)
            if len(self._topics) >= MAX_CHANNELS and channel.id not in self._topics:
                raise NotBelievedError("too many channels")
            self._topics[channel.id] = channel.topic
        elif opcode == Opcode.DATA_END and len(content) == 4:
            self.data_end = (offset, DataEnd.read(stream_of(content)).data_section_crc)
        elif opcode == Opcode.FOOTER and self._window.get(offset + 9 + len(content), len(MAGIC)) == MAGIC:
            footer = Footer.read(stream_of(content))
            self.footer = (offset, footer.summary_start, footer.summary_crc)
            self.ended = True
        elif opcode == Opcode.HEADER and offset == len(MAGIC):
            header_of(content)
        elif self.data_end is None and not is_index(opcode, content):
            # Nothing else stands in a session: this was a message before its opcode was damaged.
            raise NotBelievedError("no record of a session")
        return []

    def _messages(self, offset: int) -> tuple[list[RecordedMessage], int]:
        """The messages from an offset of a block on, up to the first that is not an intact message of a known channel,
        and its offset.

        A session has up to a million of them, so each takes one look at the block; all other records are checked
        elsewhere.
        """
        messages: list[RecordedMessage] = []
        if isinstance(self._window, FileWindow):
            return messages, offset
        block, size, count = self._window.block, self._window.size, 0
        channels = {
            number: (topic, topic_checksum(topic), self._only is None or topic in self._only)
            for number, topic in self._topics.items()
        }
        while (data_at := offset + _DATA_AT) <= size:
            opcode, length, channel, crc, utc_ns, mono_ns = _HEAD_AND_MESSAGE.unpack_from(block, offset)
            following = offset + _HEAD_BYTES + length
            if opcode != _MESSAGE_OPCODE or not data_at <= following <= size or channel not in channels:
                break
            topic, seed, is_wanted = channels[channel]
            if zlib.crc32(block[offset + _STAMPS_AT : following], seed) != crc:
                break
            if is_wanted:
                messages.append(RecordedMessage(topic, utc_ns, mono_ns, block[data_at:following]))
            count += 1
            offset = following
        self._limit.spend(STEP_BYTES * count)
        return messages, offset

    def _message(self, content: bytes) -> RecordedMessage:
        channel, crc, utc_ns, mono_ns = _MESSAGE.unpack_from(content)
        data = content[_MESSAGE.size :]
        topic = self._topics.get(channel, "")
        if checksum(topic, utc_ns, mono_ns, data) == crc:
            return RecordedMessage(topic, utc_ns, mono_ns, data)
        # Where the record that names the channel was damaged, the checksum still tells which topic it was.
        for topic in list(dict.fromkeys((*_ALWAYS, *self._topics.values())))[:MOST_TOPICS_TRIED]:
            if self._is_chunk:
                self._limit.spend(len(data))
            if checksum(topic, utc_ns, mono_ns, data) == crc:
                return RecordedMessage(topic, utc_ns, mono_ns, data)
        raise NotBelievedError("message with a wrong checksum")

    def _chunk(self, content: bytes, offset: int) -> list[Record]:
        chunk = McapChunk.read(stream_of(content))
        if chunk.message_start_time <= chunk.message_end_time < self._from_utc_ns:
            return []
        if chunk.uncompressed_size > MAX_CHUNK_BYTES:
            raise NotBelievedError("impossible length")
        block = unpacked(chunk)
        self._limit.spend(len(block))
        whole = len(block) == chunk.uncompressed_size and zlib.crc32(block) == chunk.uncompressed_crc
        inside = self._inside(block, offset, self._only if whole else None)
        records = [record for part in inside._parts(0) for record in part]
        if not whole:
            if not any(isinstance(record, RecordedMessage) for record in records):
                raise NotBelievedError("chunk with a wrong checksum")
            records.append(Damage(self._file, offset, len(content) + 9, "chunk with a wrong checksum, read in part"))
        return records
