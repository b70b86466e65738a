"""Explanation of discarded bytes: the expected frame against the received bytes."""

from protocols.frame import Discard
from protocols.layout import FrameLayout


def explain(layout: FrameLayout, discard: Discard) -> str:
    """One line: what was expected and what came, as far as the discarded bytes show it."""
    if discard.reason == "no sync":
        return f"no frame begins in these {len(discard.data)} bytes"
    content = discard.data[len(layout.sync_word) :]
    if layout.delimiter:
        unpacked = layout.delimiter.unpacked(content.strip(layout.delimiter.end))
        if unpacked is None:
            return layout.delimiter.fault
        content = unpacked
    if len(content) < layout.header.size:
        return f"{len(content)} bytes of a header of {layout.header.size}"
    code, _, length, sequence = layout.header.read(content, 0)
    if code not in layout.sizes:
        return f"no message has type {code:02X}; known are {', '.join(f'{c:02X}' for c in sorted(layout.sizes))}"
    name = layout.names[code] + (f", sequence {sequence}" if sequence >= 0 else "")
    if discard.reason == "unknown type":
        return f"{name}: this message goes the other way; is it an echo, or a capture of both directions?"
    size = layout.sizes[code]
    there = len(content) - layout.header.size - layout.checksum.size
    match discard.reason:
        case "bad length" if length is not None and length != size:
            return f"{name}: the header says {length} bytes of payload; it has {size}"
        case "bad length":
            return f"{name}: {max(there, 0)} bytes of payload came; it has {size}"
        case "bad crc" if there >= size:
            return f"{name}: {_checksums(layout, content, size)}"
        case "bad crc":
            return f"{name}: {layout.checksum.name} is wrong; the next sync word comes {size - there} bytes too early"
        case _:
            return f"{name}: the stream ends {size - there} bytes before the frame does"


def _checksums(layout: FrameLayout, content: bytes, size: int) -> str:
    end = layout.header.size + size
    expected = layout.checksum_of(layout.sync_word + content[:end])
    found = content[end : end + layout.checksum.size]
    return (
        f"{layout.checksum.name} is {found.hex().upper()} on the wire, {expected.hex().upper()} by the bytes before it"
    )
