"""A sans-I/O frame decoder: bytes in, frames and discards out, every byte in exactly one of them."""

from protocols.delimited import DelimitedScanner
from protocols.frame import Discard, Frame
from protocols.parts import PartsJoiner, Scanner
from protocols.protocol import Protocol
from protocols.syncword import SyncWordScanner
from protocols.unmarked import UnmarkedScanner
from protocols.wire_class import ClassLayout, ClassScanner


class FrameDecoder:
    """Finds the frames in a stream: those that the sensor sends, those that it is sent, or both (``from_sensor`` None).

    A message that goes the other way is no frame there: it is of an unknown type, or with ``echoes``, which is for a
    line that may give back what is sent, an `echo`.
    However the stream is cut into pieces, the same frames and the same discards come out, in the order of the stream.
    Always bytes_in == bytes_framed + bytes_discarded + pending.
    """

    def __init__(self, protocol: Protocol, *, from_sensor: bool | None = None, echoes: bool = False) -> None:
        self.bytes_in = 0
        self.bytes_framed = 0
        self.bytes_discarded = 0
        self._scanner = _scanner(protocol, from_sensor=from_sensor, echoes=echoes)

    @property
    def pending(self) -> int:
        """Bytes held back until it is known what they are; bounded by the largest frame and discard."""
        return self._scanner.pending

    @property
    def wanted(self) -> int:
        """How many bytes must come before anything can be found: what comes until then may come at once."""
        return self._scanner.wanted

    @property
    def refused(self) -> Discard | None:
        """What is held back, where it is known already that it begins with no frame; it comes as a discard later.

        For a sensor, which answers such a frame at once: its end is only known when the next one begins.
        """
        return self._scanner.refused

    def feed(self, data: bytes) -> list[Frame | Discard]:
        """Frames and discards that these bytes complete."""
        self.bytes_in += len(data)
        return self._count(self._scanner.feed(data))

    def finish(self) -> list[Frame | Discard]:
        """Frames and discards of the last bytes, at the end of the stream; afterwards nothing is pending."""
        return self._count(self._scanner.finish())

    def _count(self, found: list[Frame | Discard]) -> list[Frame | Discard]:
        for item in found:
            if isinstance(item, Frame):
                self.bytes_framed += item.size
            else:
                self.bytes_discarded += len(item.data)
        return found


def _scanner(protocol: Protocol, *, from_sensor: bool | None, echoes: bool) -> Scanner:
    layout = protocol.frame_layout
    if from_sensor is not None:
        layout = protocol.one_way_layout(from_sensor=from_sensor, echoes=echoes)
    if isinstance(layout, ClassLayout):
        scanner: Scanner = ClassScanner(layout)
    elif layout.delimiter:
        scanner = DelimitedScanner(layout, layout.delimiter)
    else:
        scanner = SyncWordScanner(layout) if layout.sync_word else UnmarkedScanner(layout)
    return PartsJoiner(scanner, protocol.panoramas) if protocol.panoramas and protocol.panoramas.in_parts else scanner
