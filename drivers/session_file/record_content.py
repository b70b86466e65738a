"""What one MCAP record holds, read from its bytes, and checked where its kind has a checksum."""

import re
import struct
import zlib
from io import BytesIO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment as McapAttachment
from mcap.records import Channel, Header
from mcap.records import Chunk as McapChunk

from drivers.session_file.records import Attachment

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
