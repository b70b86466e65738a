"""Explanation of discarded bytes: the expected frame against the received bytes."""

from protocols.frame import Discard
from protocols.layout import FrameLayout
from protocols.text import TextLayout


def explain(layout: FrameLayout, discard: Discard) -> str:
    """One line: what was expected and what came, as far as the discarded bytes show it."""
    match discard.reason:
        case "no sync":
            return f"no frame begins in these {len(discard.data)} bytes"
        case "echo":
            return "a frame that goes to the sensor: an adapter gives back what is sent, or another master is there"
        case "not for us":
            return "a frame between other addresses than port.address and port.host_address"
        case "part missing":
            return "a part of a panorama of which another part did not come, or not in order"
        case _ if isinstance(layout, TextLayout):
            return _explain_line(layout, discard)
        case _ if layout.escape:
            return f"{len(discard.data)} bytes from a start word on"
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
    size = _size(layout, code, content)
    if size is None:
        return f"{name}: its count says more objects than the {layout.counted[code].most} that it can have"
    there = len(content) - layout.header.size - layout.tail
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


def _size(layout: FrameLayout, code: int, content: bytes) -> int | None:
    """The bytes of payload that a frame says it has; None where its count is over the most."""
    counted = layout.counted.get(code)
    if counted is None or len(content) < layout.header.size + counted.base:
        return layout.sizes[code]
    size = counted.stated(content, layout.header.size)
    return None if size < 0 else size


def _explain_line(layout: TextLayout, discard: Discard) -> str:
    match discard.reason:
        case "unknown type":
            return f"the first field is none of {', '.join(sorted(layout.words))}"
        case "bad crc":
            body = discard.data.strip().removeprefix(layout.begin).partition(b"*")[0]
            expected = f"{layout.checksum.compute(body):0{2 * layout.checksum.size}X}"
            return f"{layout.checksum.name} should be {expected}, by the characters before *"
        case "truncated":
            return "the stream ends before the line does"
        case _:
            return "not as many fields as this line has, or a field that is no number"


def _checksums(layout: FrameLayout, content: bytes, size: int) -> str:
    end = layout.header.size + size
    expected = layout.checksum_of(layout.sync_word + content[:end])
    found = content[end : end + layout.checksum.size]
    if expected == found:
        return f"the end word {layout.end_word.hex().upper()} is missing"
    return (
        f"{layout.checksum.name} is {found.hex().upper()} on the wire, {expected.hex().upper()} by the bytes before it"
    )
