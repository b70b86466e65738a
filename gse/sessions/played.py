"""A recorded session played to a flight computer: the sensor's bytes at the pace at which they were recorded.

The bytes are the recorded ones, or, shifted to now, the same frames made anew by the description of their protocol:

time tag    an absolute clock says now; a counter begins at 0 with the first tag; the distances are the recorded ones
sequence    begins at 0; what was lost, or came twice, is missing or comes twice again
flag        `test`; a format without it says so by a STATUS with the serial number 0 at the beginning, where it has one
checksum    of the new bytes

All other fields are as they were, and bytes that were no frame go out as they came.
"""

import dataclasses
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from drivers.chunk import Chunk
from drivers.clock import read_clock
from drivers.faults import inject, parse_faults
from drivers.mock_ports import Item
from drivers.playback import is_session, session_items
from drivers.uart import BITS_PER_BYTE
from gse.config.station import Port
from gse.errors import UsageError
from gse.recording.session_format import read_attachments
from gse.sessions.imported import stated_start_ns
from gse.sessions.replay import station_in_force
from gse.simulator.emulator import Endpoint
from gse.station.setup import addressed
from gse.values.instant import NS_PER_S
from gse.values.sensor_time import tag_us_of, time_of, utc_ns_of
from protocols import (
    AttitudeMessage,
    Discard,
    EncodeError,
    Frame,
    FrameDecoder,
    Message,
    PanoramaMessage,
    Protocol,
    StarsMessage,
    StatusMessage,
    built_in_names,
    load_protocol,
)
from protocols.description import TimeDescription
from protocols.parts import PART

_PIECE_BYTES = 512
"""Most bytes at once: a host that read its port late has recorded more together than a terminal holds."""
_LONGEST_WAIT_S = 0.1


class ShiftedFrames:
    """Makes the frames of a stream anew, as test data of now.

    ``utc_ns`` is the clock that tells now; ``left_out`` counts frames that cannot be made.
    """

    def __init__(self, protocol: Protocol, time: TimeDescription, utc_ns: Callable[[], int]) -> None:
        self.left_out = 0
        self._protocol, self._time, self._utc_ns = protocol, time, utc_ns
        self._shift_ns: int | None = None
        self._decoder = FrameDecoder(protocol, from_sensor=True)
        self._first_tag_us: int | None = None
        self._first_sequence: dict[str, int] = {}
        self._flag = _test_flag(protocol)
        self._status = None if self._flag else _status_of_no_detector(protocol)

    @property
    def mark(self) -> str:
        """What tells that the stream comes from no detector; empty where nothing does."""
        return "the flag `test`" if self._flag else "STATUS with the serial number 0" if self._status else ""

    def feed(self, chunk: Chunk) -> bytes:
        """What is sent in place of these bytes: the frames that they complete, and what is none."""
        first = b""
        if self._shift_ns is None:
            self._shift_ns = self._utc_ns() - chunk.utc_ns
            first = self._first_status(self._shift_ns + chunk.utc_ns)
        return first + b"".join(map(self._anew, self._decoder.feed(chunk.data)))

    def finish(self) -> bytes:
        """The same of the last bytes."""
        return b"".join(map(self._anew, self._decoder.finish()))

    def _first_status(self, utc_ns: int) -> bytes:
        if self._status is None:
            return b""
        time_us = 0 if self._is_counter else tag_us_of(utc_ns, self._time)
        return self._protocol.encode(dataclasses.replace(self._status, time_us=time_us), 0)

    @property
    def _is_counter(self) -> bool:
        return self._time.scale in ("counter", "host")

    def _anew(self, piece: Frame | Discard) -> bytes:
        if isinstance(piece, Discard):
            return piece.data
        if piece.type == PART:  # it goes with the first part, which has the objects of all
            return b""
        message = self._shifted(self._protocol.decode(piece))
        counter = piece.type if self._protocol.counts_each_message else ""
        first = self._first_sequence.setdefault(counter, piece.sequence)
        behind = self._status is not None and counter in ("", "STATUS")
        number = piece.sequence - first + (self._protocol.sequence_step if behind else 0)
        try:
            if isinstance(message, StatusMessage) and self._status is not None:
                return self._protocol.encode(dataclasses.replace(message, serial=0), number, piece.flags)
            return self._protocol.resent(piece, message, number, piece.flags | self._flag)
        except EncodeError:
            self.left_out += 1
            return b""

    def _shifted(self, message: Message) -> Message:
        # 0 is no time too: that of a message that has none in this format.
        timed = PanoramaMessage | AttitudeMessage | StarsMessage | StatusMessage
        if not isinstance(message, timed) or not message.time_us:
            return message
        tag_us = message.time_us
        if self._is_counter:
            if self._first_tag_us is None:
                self._first_tag_us = tag_us
            tag_us = tag_us - self._first_tag_us if tag_us >= self._first_tag_us else tag_us  # after a reset
        else:
            tag_us = tag_us_of(utc_ns_of(tag_us, self._time) + (self._shift_ns or 0), self._time)
        return dataclasses.replace(message, time_us=tag_us)


def _test_flag(protocol: Protocol) -> int:
    """The flag of test data; an older description of a built-in format may lack the name that the format has for it."""
    if protocol.test_flag or protocol.name not in built_in_names():
        return protocol.test_flag
    flag = load_protocol(protocol.name).test_flag
    return flag if flag <= protocol.frame_layout.header.largest_flags else 0


def _status_of_no_detector(protocol: Protocol) -> StatusMessage | None:
    """The STATUS that says so in this format; None in a format that cannot."""
    status = StatusMessage(temperature_c=0.0, supply_v=0.0, mode="streaming", firmware=(0, 0, 0), serial=0)
    try:
        pieces = FrameDecoder(protocol, from_sensor=True).feed(protocol.encode(status, 0))
    except EncodeError:
        return None
    return status if any(isinstance(piece, Frame) and protocol.is_test(piece) for piece in pieces) else None


def shifted(items: Iterable[Item], frames: ShiftedFrames) -> Iterator[Item]:
    """The items with their bytes made anew."""
    last: Chunk | None = None
    for item in items:
        if not isinstance(item, Chunk):
            yield item
            continue
        last = item._replace(data=frames.feed(item))
        yield last
    if last is not None and (rest := frames.finish()):
        yield last._replace(data=rest)


def play(
    items: Iterable[Item], endpoint: Endpoint, now_ns: Callable[[], int], stop: Callable[[], bool], *, baudrate: int
) -> int:
    """Send the bytes of a recording at its pace, never faster than the line; how many there were.

    It begins when somebody is at the other end. ``now_ns`` is a monotonic clock. What comes back is not answered.
    """
    byte_ns = BITS_PER_BYTE * NS_PER_S // baudrate
    offset_ns: int | None = None
    free_ns = sent = 0
    while not endpoint.is_heard() and not stop():
        endpoint.wait(_LONGEST_WAIT_S)
    for item in items:
        if not isinstance(item, Chunk):
            continue
        offset_ns = now_ns() - item.mono_ns if offset_ns is None else offset_ns
        for at in range(0, len(item.data), _PIECE_BYTES):
            piece = item.data[at : at + _PIECE_BYTES]
            due_ns = max(item.mono_ns + offset_ns, free_ns)
            while (left_ns := due_ns - now_ns()) > 0 and not stop():
                endpoint.wait(min(left_ns / NS_PER_S, _LONGEST_WAIT_S))
            if stop():
                return sent
            endpoint.send(piece)
            sent += len(piece)
            free_ns = max(due_ns, now_ns()) + len(piece) * byte_ns
    return sent


@dataclass(frozen=True, slots=True)
class PlayedSession:
    """The items of a session, the port that it was recorded from, and what makes its frames anew, if anything does."""

    items: Iterator[Item]
    port: Port
    frames: ShiftedFrames | None
    words: str


def played_session(path: Path, *, is_shifted: bool, faults: str | None, seed: int) -> PlayedSession:
    """A session to be played; UsageError where it holds no pace or no description, CaptureError where it is none."""
    if not is_session(path):
        raise UsageError(f"{path} is not a session; a raw capture has no times of its bytes and cannot be played")
    attachments = read_attachments(path)
    if stated_start_ns(attachments) is not None:
        raise UsageError(f"{path} was imported from a capture, which has no times of its bytes: it cannot be played")
    force = station_in_force(attachments, lambda recorded: recorded)
    station, protocol = force.station, force.protocol()
    items = session_items(path)
    frames = None
    words = "its bytes as recorded, which bear no mark of test data"
    if is_shifted:
        time = time_of(station.sensor.time, protocol)
        frames = ShiftedFrames(addressed(protocol, station), time, lambda: read_clock().utc_ns)
        items = shifted(items, frames)
        marked = f"marked by {frames.mark}" if frames.mark else "with no mark: the format has no room for one"
        words = f"its frames made anew for now, {marked}"
    start = {"frame_start": word.hex()} if (word := protocol.frame_layout.sync_word) else {}
    chosen = parse_faults({"faults": faults or "", "seed": str(seed), **start})
    if chosen is not None:
        items = inject(items, chosen, station.port.baudrate)
    return PlayedSession(items, station.port, frames, words)
