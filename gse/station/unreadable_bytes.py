"""What bytes without a valid frame may be: frames of another protocol, or of another baud rate.

Another protocol shows by frames with a right checksum. Another baud rate shows by the sync word as a UART of ours would
read it, for sensors that are slower; of one that is faster too few bits arrive.
"""

from drivers.uart import USUAL_BAUDS, received_at
from protocols import Frame, FrameDecoder, Protocol, built_in_names, load_protocol

_FEWEST_FRAMES = 2
_FEWEST_HEADS = 3
_FEWEST_BYTES = 3
"""Fewest bytes of a frame's head that are looked for; fewer are found by chance."""
_ZERO_FROM = 12
"""A sensor so many times slower than the port gives nothing but zeros."""


def what_fits(sample: bytes, protocol: Protocol, baudrate: int) -> str:
    """What would fit some unreadable bytes, for the operator; empty where they do not tell."""
    if name := _other_protocol(sample, protocol):
        return f"they are frames of {name}: write 'protocol: {name}' in the station file"
    if baud := _slower_baud(sample, protocol, baudrate):
        return f"wrong baud rate: they fit port.baudrate: {baud} (here {baudrate})"
    if sample and not any(sample):
        return f"wrong baud rate: they fit {baudrate // _ZERO_FROM} or less (here {baudrate})"
    return ""


def _other_protocol(sample: bytes, protocol: Protocol) -> str:
    for name in built_in_names():
        if name != protocol.name and _frames(sample, load_protocol(name)) >= _FEWEST_FRAMES:
            return name
    return ""


def _frames(sample: bytes, protocol: Protocol) -> int:
    return sum(isinstance(piece, Frame) for piece in FrameDecoder(protocol).feed(sample))


def _slower_baud(sample: bytes, protocol: Protocol, baudrate: int) -> int:
    """The usual rate whose sync words explain most of the bytes; 0 where none is there."""
    sync_word = protocol.frame_layout.sync_word
    slower = [baud for baud in reversed(USUAL_BAUDS) if baud < baudrate]
    explained = {baud: _explained(sample, sync_word, baud, baudrate) for baud in slower}
    return max(slower, key=explained.__getitem__) if any(explained.values()) else 0


def _explained(sample: bytes, sync_word: bytes, baud: int, baudrate: int) -> int:
    head = received_at(sync_word, baud, baudrate)[:-1]
    if len(head) < _FEWEST_BYTES or not any(head):
        return 0
    count = sample.count(head)
    return count * len(head) if count >= _FEWEST_HEADS else 0
